"""Aerodynamics and air: what they do to the coefficients of the same state."""

from __future__ import annotations

import math

import pytest

from gcs_sysid.errors import AircraftFileError
from gcs_sysid.sitl.effects import air, changes
from gcs_sysid.sitl.jsbsim_aircraft import STEP, Wind
from tests.sitl import examples
from tests.sitl.effects import hidden

COEFFICIENTS = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
SLIP = {"elevator": -0.1, "rudder": 0.3, "aileron": 0.05}


def differences(name: str, **sizes):
    """What an effect adds to the coefficients of one state, and that state."""
    without, _ = hidden.at_start(hidden.flight(), SLIP)
    made, _ = hidden.at_start(hidden.hide(name, **sizes), SLIP)
    assert made.alpha == pytest.approx(without.alpha)
    added = {c: getattr(made, c) - getattr(without, c) for c in COEFFICIENTS}
    return {c: value for c, value in added.items() if abs(value) > 1e-12}, made


def test_drag_pulls_back():
    added, _ = differences("drag_increase", CX0=-0.02)
    assert added == pytest.approx({"CX": -0.02})


def test_an_asymmetric_aircraft_rolls_and_yaws_by_itself():
    added, _ = differences("asymmetry", Cl0=0.008, Cn0=-0.002)
    assert added == pytest.approx({"Cl": 0.008, "Cn": -0.002})


def test_angle_of_attack_rolls_a_cross_coupled_aircraft():
    added, state = differences("cross_coupling", Cl_alpha=-0.1)
    assert added == pytest.approx({"Cl": -0.1 * state.alpha})
    made = hidden.hide("cross_coupling", Cm_beta=0.2)
    assert made.flown.aerodynamics["Cm"].terms["beta"].value == 0.2


def test_a_wrong_derivative_is_wrong_by_its_ratio():
    added, state = differences("aero_derivative", derivative="Cm.alpha", ratio=0.8)
    assert added == pytest.approx({"Cm": -0.2 * -0.723 * state.alpha})


def test_terms_outside_the_catalogue():
    terms = {"Cn": {"rudder*alpha": 0.5, "elevator^2": 2.0}, "CY": {"aileron": -0.3}}
    added, state = differences("unlisted", terms=terms)
    wanted = {"Cn": 0.5 * 0.3 * state.alpha + 2.0 * 0.01, "CY": -0.3 * 0.05}
    assert added == pytest.approx(wanted)


def test_the_lift_slope_breaks_beyond_the_stall():
    added, state = differences("stall", alpha_break=0.03, slope_loss=0.6)
    assert state.alpha > 0.05
    assert added == pytest.approx({"CZ": 0.6 * 4.625 * (state.alpha - 0.03)})
    assert differences("stall", alpha_break=0.2, slope_loss=0.6)[0] == {}


def test_lift_is_lost_late_and_comes_back_late():
    """Against an integration of the lag over the angle of attack flown."""
    made = hidden.hide("stall", alpha_break=0.08, slope_loss=0.6, lag=0.2)
    aircraft = hidden.flying(made)
    separated, rising, falling, alpha = 0.0, [], [], aircraft.state().alpha
    for step in range(500):
        elevator = -0.25 if step < 200 else 0.15
        separated += -math.expm1(-STEP / 0.2) * (max(0.0, alpha - 0.08) - separated)
        aircraft.advance({"elevator": elevator}, [0.3])
        state = aircraft.state()
        qhat = state.q_air * 0.25 / (2.0 * state.V)
        plain = -0.1086 - 4.625 * state.alpha - 8.136 * qhat - 0.0983 * elevator
        assert state.CZ - plain == pytest.approx(0.6 * 4.625 * separated, abs=1e-9)
        (rising if state.alpha > alpha else falling).append((state.alpha, state.CZ - plain))
        alpha = state.alpha
    at = 0.12
    lost_rising = min(rising, key=lambda point: abs(point[0] - at))
    lost_falling = min(falling, key=lambda point: abs(point[0] - at))
    assert abs(lost_rising[0] - at) < 0.01
    assert abs(lost_falling[0] - at) < 0.01
    assert lost_falling[1] > lost_rising[1] + 0.02


def test_a_stall_of_the_file_itself_can_come_late():
    """Every knot in every coefficient, against an integration over the angle of attack flown."""
    beyond = {"CZ": {"max(0, alpha - 0.1)": 3.0}, "CX": {"alpha*max(0, alpha - 0.07)^2": -9.0}}
    stalling = changes.add_terms(examples.ultra_stick(), beyond)
    aircraft = hidden.flying(hidden.hide("stall", hidden.flight(stalling), lag=0.2))
    late, alpha, largest = {0.07: 0.0, 0.1: 0.0}, aircraft.state().alpha, 0.0
    for step in range(300):
        elevator = -0.25 if step < 200 else 0.15
        for knot in late:
            late[knot] += -math.expm1(-STEP / 0.2) * (max(0.0, alpha - knot) - late[knot])
        aircraft.advance({"elevator": elevator}, [0.3])
        state = aircraft.state()
        alpha = state.alpha
        qhat = state.q_air * 0.25 / (2.0 * state.V)
        force = -0.1086 - 4.625 * alpha - 8.136 * qhat - 0.0983 * elevator + 3.0 * late[0.1]
        axial = -0.0446 + 0.199 * alpha + 2.89 * alpha**2 - 0.0135 * elevator
        axial -= 9.0 * alpha * late[0.07] ** 2
        assert [state.CZ, state.CX] == pytest.approx([force, axial], abs=1e-9)
        largest = max(largest, abs(late[0.1] - max(0.0, alpha - 0.1)))
    assert largest > 0.01


def test_without_a_stall_in_the_file_a_late_one_needs_a_size():
    with pytest.raises(AircraftFileError, match="alpha_break"):
        hidden.hide("stall", lag=0.3)


def test_the_ground_adds_lift_takes_drag_and_pitches_down():
    span = 1.27
    near, _ = hidden.at_start(hidden.flight(), height=0.1 * span)
    made = hidden.hide("ground_effect", lift=0.3, drag=0.5, moment=0.1)
    low, _ = hidden.at_start(made, height=0.1 * span)
    share = air.ground_share(low.height / span)
    assert share == pytest.approx(math.exp(-2.48 * (2.0 * low.height / span) ** 0.768))
    force = -0.1086 - 4.625 * low.alpha
    # Linear between tabulated heights.
    assert low.CZ - near.CZ == pytest.approx(0.3 * share * force, rel=0.02)
    induced = force**2 / (math.pi * span**2 / 0.3097)
    assert low.CX - near.CX == pytest.approx(0.5 * share * induced, rel=0.02)
    assert low.Cm - near.Cm == pytest.approx(0.1 * share * force, rel=0.02)
    high, _ = hidden.at_start(made, height=3.0 * span)
    away, _ = hidden.at_start(hidden.flight(), height=3.0 * span)
    assert high.CZ == pytest.approx(away.CZ, rel=1e-9)
    assert air.ground_share(0.5) < 0.1


def test_wind_grows_with_height():
    made = hidden.hide("wind_shear", hidden.flight(wind=Wind((3.0, 4.0, 0.0))), gradient=0.05)
    aircraft = hidden.flying(made)
    aircraft.advance({}, [0.0])
    first = aircraft.state()
    assert math.hypot(first.wind_north, first.wind_east) == pytest.approx(5.0, abs=1e-3)
    for _ in range(500):
        aircraft.advance({"elevator": -0.1}, [0.0])
    state = aircraft.state()
    fallen = state.altitude - first.altitude
    assert abs(fallen) > 1.0
    # The wind of a step is that of the height before it.
    speed = 5.0 + 0.05 * fallen
    assert state.wind_north == pytest.approx(0.6 * speed, abs=0.01)
    assert state.wind_east == pytest.approx(0.8 * speed, abs=0.01)


def test_in_calm_air_the_wind_grows_towards_the_north():
    assert Wind(gradient=0.1).at(10.0) == (1.0, 0.0, 0.0)
