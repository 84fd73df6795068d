"""Steady flight: turns and climbs against their closed forms, and the balance of everything."""

from __future__ import annotations

import math
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid import aircraft_file, frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.atmosphere import GRAVITY
from gcs_sysid.errors import UsageError
from gcs_sysid.model import rigid_body, trim
from gcs_sysid.model.rigid_body import State
from gcs_sysid.model.trim import Trim
from tests.model.made_linear import AIRSPEED, DENSITY, HEIGHT, flying
from tests.offline.conftest import ROOT

LEFT = 2e-3
"""What the small weight on unknowns may leave [m/s², rad/s²]: its square, times what they move."""


def found(bank: float = 0.0, climb: float = 0.0, aircraft: Aircraft | None = None) -> Trim:
    angles = {"bank": math.radians(bank), "climb": math.radians(climb)}
    return trim.find(aircraft or flying(), AIRSPEED, HEIGHT, DENSITY, **angles)


def change(one: Trim, aircraft: Aircraft) -> State:
    """Rate of change of the motion, by the equations of motion alone."""
    inputs = trim.inputs(
        aircraft, jnp.asarray(one.controls), jnp.asarray(one.settings), one.density
    )
    return rigid_body.derivative(aircraft, rigid_body.parameters(aircraft), one.state, inputs)


def climb_angle(one: Trim) -> float:
    north, east, down = np.asarray(one.state.velocity)
    return math.degrees(math.atan2(-down, math.hypot(north, east)))


CONDITIONS = [(0.0, 0.0), (30.0, 0.0), (-45.0, 0.0), (0.0, 8.0), (0.0, -6.0), (30.0, 5.0)]


@pytest.mark.parametrize(("bank", "climb"), CONDITIONS)
def test_force_and_moment_balance_in_all_six_equations(bank, climb) -> None:
    """Velocity turns with the flight path and nothing else; the body's rate does not change."""
    one = found(bank, climb)
    moved = change(one, flying())
    turning = np.array([0.0, 0.0, one.turn_rate])
    pulled = np.asarray(moved.velocity) - np.cross(turning, np.asarray(one.state.velocity))
    np.testing.assert_allclose(pulled, 0.0, atol=LEFT)
    np.testing.assert_allclose(moved.rate, 0.0, atol=LEFT)
    assert climb_angle(one) == pytest.approx(climb, abs=1e-9)
    assert float(jnp.linalg.norm(one.state.velocity)) == pytest.approx(AIRSPEED)
    # Roll and pitch stay: all turning is about the vertical.
    np.testing.assert_allclose(
        frames.rotate(one.state.attitude, one.state.rate), turning, atol=1e-12
    )


@pytest.mark.parametrize("bank", [-50.0, -20.0, 30.0, 45.0])
def test_a_level_turn_is_that_of_the_closed_forms(bank) -> None:
    """ψ̇ = g tan μ/V of the bank about the velocity, and specific force g √(1 + (Vψ̇/g)²) = g/cos μ.

    tan μ = tan φ cos α without sideslip (Stevens, Lewis & Johnson 2015, section 3.6).
    """
    one = found(bank)
    roll = float(frames.euler_from_quaternion(one.state.attitude)[0])
    assert math.degrees(roll) == pytest.approx(bank, abs=1e-9)
    _, alpha, beta = frames.flow_angles(frames.unrotate(one.state.attitude, one.state.velocity))
    felt = np.asarray(change(one, flying()).velocity) - np.array([0.0, 0.0, GRAVITY])
    body = np.asarray(frames.unrotate(one.state.attitude, jnp.asarray(felt)))
    assert body[1] == pytest.approx(0.0, abs=LEFT)
    tangent = math.tan(roll) * math.cos(float(alpha))
    within = 3.0 * abs(float(beta)) + 1e-4
    assert one.turn_rate == pytest.approx(GRAVITY * tangent / AIRSPEED, rel=within)
    pull = AIRSPEED * one.turn_rate / GRAVITY
    assert np.linalg.norm(felt) == pytest.approx(GRAVITY * math.hypot(1.0, pull), abs=LEFT)
    assert math.hypot(1.0, pull) == pytest.approx(math.hypot(1.0, tangent), rel=within)
    # As in every handbook, within what the angle of attack makes of it.
    near = 1.5 * float(alpha) ** 2 + within
    assert one.turn_rate == pytest.approx(GRAVITY * math.tan(roll) / AIRSPEED, rel=near)
    assert -body[2] / GRAVITY == pytest.approx(1.0 / math.cos(roll), rel=near)


def test_a_turn_to_the_left_is_one_to_the_right_in_the_mirror() -> None:
    right, left = found(40.0), found(-40.0)
    names = flying().control_names
    sides = np.array([1.0 if name == "elevator" else -1.0 for name in names])
    np.testing.assert_allclose(left.controls, sides * right.controls, atol=1e-6)
    np.testing.assert_allclose(left.settings, right.settings, rtol=1e-5)
    assert left.turn_rate == pytest.approx(-right.turn_rate)


@pytest.mark.parametrize("climb", [-5.0, 3.0, 6.5])
def test_thrust_exceeds_drag_by_the_weight_along_the_path(climb) -> None:
    """T cos α − D = W sin γ: force along the velocity, aerodynamics and thrust taken together."""
    aircraft, one = flying(), found(climb=climb)
    felt = np.asarray(change(one, aircraft).velocity) - np.array([0.0, 0.0, GRAVITY])
    path = np.asarray(one.state.velocity) / AIRSPEED
    excess = aircraft.mass.mass * felt @ path
    weight = aircraft.mass.mass * GRAVITY
    assert excess == pytest.approx(weight * math.sin(math.radians(climb)), abs=LEFT * weight)
    steeper = found(climb=climb + 1.0)
    assert steeper.settings[0] > one.settings[0]


def test_a_glide_needs_no_thrust() -> None:
    """tan γ = −D/L of the engine at rest: the same aircraft finds its own glide."""
    one = found(climb=-5.0)
    state, aircraft = one.state, flying()
    forces = rigid_body.loads(
        aircraft,
        rigid_body.parameters(aircraft),
        state,
        trim.inputs(aircraft, jnp.asarray(one.controls), jnp.zeros(1), DENSITY),
    ).force
    ned = np.asarray(frames.rotate(state.attitude, forces))
    path = np.asarray(state.velocity) / AIRSPEED
    drag = -ned @ path
    lift = np.linalg.norm(ned + drag * path)
    steepest = math.degrees(math.atan2(drag, lift))
    glide = found(climb=-steepest)
    # A degree or two of path hardly change drag over lift.
    assert glide.settings[0] == pytest.approx(0.0, abs=0.02)
    # A slip makes it steeper, but not so much.
    with pytest.raises(UsageError, match="climb angle of -"):
        found(climb=-steepest - 10.0)


def test_a_heavier_load_asks_for_more_lift_and_thrust() -> None:
    level, turning = found(), found(50.0)

    def alpha(one: Trim) -> float:
        return float(frames.flow_angles(frames.unrotate(one.state.attitude, one.state.velocity))[1])

    lift = -flying().aerodynamics["CZ"].terms["alpha"].value
    weight = flying().mass.mass * GRAVITY / (0.5 * DENSITY * AIRSPEED**2 * 0.55)
    more = weight * (1.0 / math.cos(math.radians(50.0)) - 1.0) / lift
    # The elevator that holds the nose up takes a little of the lift.
    assert alpha(turning) - alpha(level) == pytest.approx(more, rel=0.15)
    assert turning.settings[0] > level.settings[0]


def test_what_was_found_is_told_as_it_was_solved_for() -> None:
    for bank, climb in CONDITIONS:
        one = found(bank, climb)
        again = trim.steady(jnp.asarray(one.unknown), jnp.asarray(one.condition))
        for part, other in zip(again, one.state, strict=True):
            np.testing.assert_allclose(part, other, atol=1e-9)


@pytest.mark.parametrize(
    ("bank", "climb", "words"),
    [
        (75.0, 0.0, "a turn of 75° bank, level, at 20 m/s"),
        (0.0, 50.0, "straight with a climb angle of 50°"),
    ],
)
def test_what_no_engine_can_do_is_said(bank, climb, words) -> None:
    [engine] = flying().propulsion
    weak = replace(engine, thrust=tuple(tuple(0.4 * t for t in row) for row in engine.thrust))
    with pytest.raises(UsageError, match=words):
        found(bank, climb, replace(flying(), propulsion=(weak,)))


@pytest.mark.parametrize("name", ["aerosonde", "ad1_60"])
def test_aircraft_of_other_kinds_turn_and_climb(name) -> None:
    """Without a rudder, and with an oblique wing, whose turns to both sides differ."""
    aircraft = aircraft_file.load(ROOT / "data" / "aircraft" / f"{name}.toml")
    assert aircraft.envelope is not None
    low, high = aircraft.envelope.airspeed
    speed = low + 0.45 * (high - low)
    for bank, climb in ((0.3, 0.0), (-0.3, 0.0), (0.0, 0.05)):
        one = trim.find(aircraft, speed, HEIGHT, DENSITY, bank=bank, climb=climb)
        moved = change(one, aircraft)
        turning = np.array([0.0, 0.0, one.turn_rate])
        pulled = np.asarray(moved.velocity) - np.cross(turning, np.asarray(one.state.velocity))
        assert np.abs(pulled).max() < trim.LEVEL
        assert np.abs(np.asarray(moved.rate)).max() < trim.LEVEL
        assert one.turn_rate == pytest.approx(GRAVITY * math.tan(bank) / speed, rel=0.1)
