"""Mass properties: what they do to accelerations, in closed form."""

from __future__ import annotations

import dataclasses

import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.errors import AircraftFileError
from tests.sitl import examples
from tests.sitl.effects import hidden

SLOW_TURN = {"elevator": -0.05, "rudder": 0.2}


def test_a_heavier_aircraft_accelerates_less_under_the_same_force():
    light, heavy = hidden.flight(), hidden.hide("mass", mass_ratio=1.1)
    before, _ = hidden.at_start(light)
    after, _ = hidden.at_start(heavy)
    assert after.force_z == pytest.approx(before.force_z, rel=1e-9)
    one = hidden.measured(light, hidden.MOVING).specific_force
    # At the centre of gravity; elsewhere the lever arm's part stays as it is.
    moved = hidden.hide("imu_position", dx=-0.03, dz=-0.01)
    other = hidden.hide("mass", moved, mass_ratio=1.1)
    assert hidden.measured(moved, hidden.MOVING).specific_force[2] == pytest.approx(-20.0 / 1.959)
    assert hidden.measured(other, hidden.MOVING).specific_force[2] == pytest.approx(
        -20.0 / (1.1 * 1.959)
    )
    assert one[2] != pytest.approx(-20.0 / 1.959, abs=1e-3)


def test_a_centre_of_gravity_further_forward_pitches_down_by_the_lift():
    """About the new centre: dq/dt gains x·Z/Iyy, and yaw loses x·Y with its cross inertia."""
    base = hidden.flight()
    before, _ = hidden.at_start(base, SLOW_TURN)
    after, _ = hidden.at_start(hidden.hide("cg_shift", cg_x_chord=0.08), SLOW_TURN)
    forward = 0.08 * 0.25
    assert after.CZ == pytest.approx(before.CZ)
    pitch = forward * before.force_z / 0.08636
    assert pitch < 0.0
    assert after.q_dot - before.q_dot == pytest.approx(pitch, rel=1e-6)
    determinant = 0.07151 * 0.15364 - 0.014**2
    yaw = -forward * before.force_y * 0.07151 / determinant
    assert after.r_dot - before.r_dot == pytest.approx(yaw, rel=1e-6)


@pytest.mark.parametrize("axis", ["Ixx", "Iyy", "Izz"])
def test_more_inertia_turns_an_axis_more_slowly(axis):
    changed = hidden.hide("inertia", **{f"{axis}_ratio": 1.25})
    before, _ = hidden.at_start(hidden.flight(), {"elevator": -0.2})
    after, _ = hidden.at_start(changed, {"elevator": -0.2})
    expected = 1.25 if axis == "Iyy" else 1.0
    assert before.q_dot / after.q_dot == pytest.approx(expected, rel=1e-9)
    names = ("Ixx", "Iyy", "Izz")
    ratios = [
        getattr(changed.flown.mass, name) / getattr(changed.believed.mass, name) for name in names
    ]
    assert ratios == pytest.approx([1.25 if name == axis else 1.0 for name in names])


def test_an_inertia_that_no_body_has_is_refused():
    """The flying wing's Ixz is that of a body with hardly any roll inertia left."""
    wing = aircraft_file.load(examples.ROOT / "data" / "aircraft" / "skywalker_x8.toml")
    flight = dataclasses.replace(hidden.flight(), believed=wing, flown=wing)
    with pytest.raises(AircraftFileError, match=r"Izz_ratio.*positive definite"):
        hidden.hide("inertia", flight, Izz_ratio=0.7)
    assert hidden.hide("inertia", flight, Izz_ratio=1.3).flown.mass.Izz > wing.mass.Izz
