"""Servos and surfaces: how they move, and what they do to moments."""

from __future__ import annotations

import math

import pytest

from gcs_sysid.sitl import servo
from gcs_sysid.sitl.flight import Flight
from tests.sitl.effects import hidden

DEGREE_US = 20.0
"""Pulse for a degree of the Ultra Stick's servos [µs]."""


def moved(made: Flight, surface: str, pulse: float, *times: float) -> list[float]:
    """Where a surface stands [rad] at times after one command."""
    [described] = [s for s in made.flown.servos if s.surface == surface]
    actuator = servo.surface(described, start=1500.0)
    actuator.command(0.0, pulse)
    return [actuator.advance(time) for time in times]


def test_a_slower_servo_takes_its_time():
    slow = hidden.hide("actuator_lag", control="elevator", time_constant=0.15)
    lag = 0.0265 + 0.15
    # The servo's own delay first.
    found = moved(slow, "elevator", 1700.0, 0.05 + lag, 0.05 + 3.0 * lag)
    wanted = [math.radians(10.0) * (1.0 - math.exp(-n)) for n in (1.0, 3.0)]
    assert found == pytest.approx(wanted)
    assert moved(slow, "rudder", 1700.0, 0.5) == moved(hidden.flight(), "rudder", 1700.0, 0.5)


@pytest.mark.parametrize("surface", ["aileron_left", "aileron_right"])
def test_a_limited_control_moves_no_faster(surface):
    """The aileron is half the difference of two surfaces: each moves at the control's rate."""
    limited = hidden.hide("actuator_rate_limit", control="aileron", rate_limit=0.8)
    [found] = moved(limited, surface, 2000.0, 0.05 + 0.2)
    assert found == pytest.approx(0.8 * 0.2)


def test_play_leaves_half_its_width_behind():
    loose = hidden.hide("actuator_backlash", control="elevator", width=0.03)
    out, back = (
        moved(loose, "elevator", 1500.0 + 200.0, 5.0)[0],
        moved(loose, "elevator", 1500.0 - 200.0, 5.0)[0],
    )
    assert out == pytest.approx(math.radians(10.0) - 0.015)
    assert back == pytest.approx(-math.radians(10.0) + 0.015)


def test_a_misrigged_control_is_off_and_others_are_not():
    rigged = hidden.hide("surface_offset", control="aileron", offset=0.05)
    at = {s.surface: s.offset for s in rigged.flown.servos}
    for control in rigged.flown.controls:
        stands = sum(gain * at[surface] for surface, gain in control.mix.items())
        assert stands == pytest.approx(0.05 if control.name == "aileron" else 0.0)
    assert moved(rigged, "aileron_left", 1500.0, 1.0) == pytest.approx([0.05])
    assert moved(rigged, "aileron_right", 1500.0, 1.0) == pytest.approx([-0.05])


def share_of(made: Flight, control: str, coefficient: str, **conditions: float) -> float:
    """Effect of a control's deflection on a coefficient, over what the file says."""
    shares = []
    for one in (made, hidden.flight()):
        none, _ = hidden.at_start(one, **conditions)
        some, _ = hidden.at_start(one, {control: 0.1}, **conditions)
        shares.append(getattr(some, coefficient) - getattr(none, coefficient))
    return shares[0] / shares[1]


def test_a_weaker_surface_does_less_in_all_its_coefficients():
    weak = hidden.hide("surface_effectiveness", control="rudder", ratio=0.7)
    for coefficient in ("CY", "Cl", "Cn"):
        assert share_of(weak, "rudder", coefficient) == pytest.approx(0.7)
    assert share_of(weak, "elevator", "Cm") == pytest.approx(1.0)


def test_a_soft_surface_loses_with_every_doubling_of_dynamic_pressure():
    state, _ = hidden.at_start(hidden.flight())
    half = hidden.hide("aeroelastic", control="elevator", loss=-0.3, qbar_ref=state.qbar / 2.0)
    twice = hidden.hide("aeroelastic", control="elevator", loss=-0.3, qbar_ref=state.qbar * 2.0)
    assert share_of(half, "elevator", "Cm") == pytest.approx(0.7)
    assert share_of(twice, "elevator", "CZ") == pytest.approx(1.3)
    assert share_of(half, "aileron", "Cl") == pytest.approx(1.0)


def test_the_reference_pressure_is_that_of_the_first_leg():
    made = hidden.hide("aeroelastic", control="elevator", loss=-0.3)
    assert made.hidden.feel["elevator"].qbar_ref == pytest.approx(0.5 * 1.225 * 18.0**2)


def test_two_causes_on_one_control_multiply():
    both = hidden.hide(
        "surface_effectiveness",
        hidden.hide("propwash", control="elevator", gain=0.5),
        control="elevator",
        ratio=0.5,
    )
    state, thrust = hidden.at_start(both, throttle=1.0)
    wash = 1.0 + 4.0 * 0.5 * thrust / (state.qbar * 0.3097)
    assert wash > 1.2
    assert share_of(both, "elevator", "Cm", throttle=1.0) == pytest.approx(0.5 * wash)
