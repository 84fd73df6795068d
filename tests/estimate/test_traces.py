"""What causes leave along a flight, against the same flight with the cause in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from gcs_sysid.aircraft import COEFFICIENTS, FORCES, Propulsion
from gcs_sysid.estimate import basis, traces
from gcs_sysid.estimate.suspects import Direction, file_values
from tests.maneuvers.made_model import aircraft

TIME = np.arange(0.0, 20.0, 0.02)
MADE = aircraft()
CONTROLS = MADE.control_names


def flow(airspeed: np.ndarray) -> dict[str, np.ndarray]:
    """Variables of a smooth flight at an airspeed; angles and rates [rad/s] are the same at any."""

    def wave(size: float, hertz: float) -> np.ndarray:
        return size * np.sin(2.0 * np.pi * hertz * TIME + 10.0 * hertz)

    shape = MADE.geometry
    half_span, half_chord = 0.5 * shape.wing_span / airspeed, 0.5 * shape.mean_chord / airspeed
    return {
        "alpha": 0.05 + wave(0.03, 0.3),
        "beta": wave(0.04, 0.2),
        "phat": wave(0.8, 0.5) * half_span,
        "qhat": wave(0.4, 0.3) * half_chord,
        "rhat": wave(0.3, 0.2) * half_span,
        "V": airspeed,
        "qbar": 0.6 * airspeed**2,
        "Tc": wave(0.04, 0.1) + 0.06,
        **{name: wave(0.1, 0.4 + 0.1 * place) for place, name in enumerate(CONTROLS)},
    }


FLOWN = flow(15.0 + 2.0 * np.sin(0.7 * TIME))
WIDE = FLOWN | traces.values(FLOWN, CONTROLS, TIME)


def moves(label: str, made=MADE) -> Direction:
    return next(one.moves for one in traces.traces(made) if one.label == label)


def shown(moved: Direction, name: str) -> np.ndarray:
    """What one unit of a cause adds to a coefficient."""
    keys = [key for at, key in moved if at == name]
    if not keys:
        return np.zeros(TIME.size)
    sizes = np.array([moved[name, key] for key in keys])
    every = (*CONTROLS, *traces.names(CONTROLS))
    return basis.columns(keys, every, WIDE) @ sizes


def coefficient(name: str, values: dict[str, np.ndarray]) -> np.ndarray:
    terms = {key: value for (at, key), value in file_values(MADE).items() if at == name}
    return basis.columns(tuple(terms), CONTROLS, values) @ np.array(list(terms.values()))


def alike(found: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found[5:-5], expected[5:-5], atol=0.01 * np.abs(expected).max())


def late(values: np.ndarray, delay: float) -> np.ndarray:
    return CubicSpline(TIME, values)(TIME - delay)


@pytest.mark.parametrize("control", CONTROLS)
def test_a_control_that_lags(control: str) -> None:
    """Against a deflection that is looked up later."""
    delay = 1e-3
    moved = FLOWN | {control: late(FLOWN[control], delay)}
    touched = 0
    for name in COEFFICIENTS:
        change = (coefficient(name, moved) - coefficient(name, FLOWN)) / delay
        if np.any(change):
            touched += 1
            alike(shown(moves(f"actuator_lag {control}"), name), change)
    assert touched


def test_commands_that_come_late_are_all_controls_that_lag() -> None:
    every = moves("time_skew SERVO_OUTPUT_RAW")
    for name in COEFFICIENTS:
        sums = sum(shown(moves(f"actuator_lag {control}"), name) for control in CONTROLS)
        np.testing.assert_allclose(shown(every, name), sums, atol=1e-12)


def test_an_airspeed_that_comes_late() -> None:
    """Forces and moments as they are, made dimensionless by what is told, against the file's.

    Angles are not asked of the airspeed here.
    """
    delay = 1e-3
    told = flow(late(FLOWN["V"], delay))
    for name in COEFFICIENTS:
        seems = coefficient(name, FLOWN) * FLOWN["qbar"] / told["qbar"]
        left = (seems - coefficient(name, told)) / delay
        for label in ("pitot_lag", "time_skew VFR_HUD", "time_skew AIRSPEED"):
            alike(shown(moves(label), name), left)


def test_what_an_accelerometer_reads_too_much() -> None:
    weight = MADE.mass.mass / (FLOWN["qbar"] * MADE.geometry.wing_area)
    for axis, name in zip("xyz", FORCES, strict=True):
        np.testing.assert_allclose(shown(moves(f"accelerometer_bias {axis}"), name), weight)


def test_thrust_acts_along_its_axes_and_by_its_arms() -> None:
    """Two engines of one thrust each, against their forces and moments summed."""
    engine = Propulsion(3, (1000.0, 2000.0), (0.0, 1.0), (0.0, 30.0), ((0.0, 0.0), (9.0, 5.0)))
    engines = (
        replace(engine, axis=(2.0, 0.0, -0.4), position=(0.1, 0.3, -0.2)),
        replace(engine, axis=(1.0, 0.1, 0.0), position=(0.1, -0.5, 0.1)),
    )
    made = replace(MADE, propulsion=engines, mass=replace(MADE.mass, cg=(0.02, 0.0, 0.01)))
    force, moment = np.zeros(3), np.zeros(3)
    for one in engines:
        along = np.array(one.axis) / np.linalg.norm(one.axis)
        force += along
        moment += np.cross(np.array(one.position) - np.array(made.mass.cg), along)
    shape = made.geometry
    moment /= (shape.wing_span, shape.mean_chord, shape.wing_span)
    found = moves("thrust_scale", made)
    for name, value in zip((*FORCES, "Cl", "Cm", "Cn"), (*force, *moment), strict=True):
        assert found[name, "Tc"] == pytest.approx(value / force.sum())


def test_an_aircraft_without_engine_has_no_thrust_that_is_wrong() -> None:
    glider = replace(MADE, propulsion=())
    assert "thrust_scale" not in {one.cause for one in traces.traces(glider)}
