"""The Ultra Stick file beyond its linear table: its propeller and motor are the published ones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from data.scripts import ultra_stick
from gcs_sysid import aircraft_file
from tests.sitl import examples
from tests.sitl.published import AIRSPEED, PUBLISHED, STATES, Placed


@pytest.fixture(scope="module")
def stored():
    return aircraft_file.load(examples.ROOT / "data" / "aircraft" / "ultra_stick_25e_full.toml")


@pytest.fixture(scope="module")
def trimmed(stored):
    return Placed(stored)


def steady_motor():
    """The published A once the motor has settled, which it does within 0.2 s."""
    motor = PUBLISHED["motor"]
    return np.array(PUBLISHED["A"]) - np.outer(motor["column"], motor["row"]) / motor["itself"]


def with_motor():
    """The published A with the motor's speed as ninth state."""
    motor, whole = PUBLISHED["motor"], np.zeros((9, 9))
    whole[:8, :8], whole[:8, 8] = PUBLISHED["A"], motor["column"]
    whole[8, :8], whole[8, 8] = motor["row"], motor["itself"]
    return whole


def test_the_file_is_what_its_script_makes(stored):
    made = ultra_stick.aircraft()
    assert stored.mass == made.mass
    assert np.array(stored.propulsion[0].thrust) == pytest.approx(
        np.array(made.propulsion[0].thrust), rel=1.1e-3
    )
    for coefficient, model in made.aerodynamics.items():
        found = {key: value.value for key, value in stored.aerodynamics[coefficient].terms.items()}
        assert found == pytest.approx({key: value.value for key, value in model.terms.items()})


def test_the_propeller_turns_as_fast_as_published(trimmed):
    """The published gyroscopic coupling is its speed: A[q, r]·Iyy over the rotor's inertia."""
    coupling = np.array(PUBLISHED["A"])[STATES.index("q"), STATES.index("r")]
    published = coupling * 0.08636 / 0.00012991
    found = 2.0 * math.pi * ultra_stick.turns(trimmed.throttle, AIRSPEED)
    assert found == pytest.approx(published, rel=0.02)


def test_drag_and_thrust_change_with_speed_as_published(trimmed):
    A, _ = trimmed.linear()
    u = STATES.index("u")
    assert A[u, u] == pytest.approx(steady_motor()[u, u], rel=0.05)


def test_the_phugoid_is_the_published_one(trimmed):
    """With the motor. Without the wash over the tail there; 10 %."""
    poles = np.linalg.eigvals(with_motor())
    published = next(pole for pole in poles if 0.3 < abs(pole) < 1.0 and pole.imag > 0.0)
    found = np.linalg.eigvals(trimmed.linear()[0])
    assert np.abs(found - published).min() < 0.1 * abs(published)


def test_the_elevator_works_in_the_propellers_wash(trimmed, stored):
    """More by half of what momentum theory adds to the dynamic pressure far behind, Tc·S/disc."""
    q = STATES.index("q")
    published = np.array(PUBLISHED["B"])[q, 0]
    geometry = stored.geometry
    force = 0.5 * 1.2133 * AIRSPEED**2 * geometry.wing_area
    # Thrust is drag and the weight's share in level flight: 2.35 N.
    wash = 0.5 * (2.35 / force) * geometry.wing_area / (0.25 * math.pi * 0.3048**2)
    assert trimmed.linear()[1][q, 0] / published == pytest.approx(1.0 + wash, rel=0.01)


def test_power_takes_up_elevator(stored):
    """The thrust line is above the centre of gravity: trim depends on thrust."""
    x, _, z = stored.propulsion[0].position
    assert x == pytest.approx(0.297)
    assert z == pytest.approx(-0.046)
    # Against the file without wash and lever: -0.0793 rad.
    assert Placed(stored).elevator < Placed(examples.ultra_stick()).elevator - 0.005


def test_a_polynomial_goes_on_straight_where_it_was_not_measured():
    edge, far = (ultra_stick.coefficient((1.0, 0.0, 0.0), x) for x in (0.6, 1.0))
    assert edge == pytest.approx(0.36)
    assert far == pytest.approx(0.36 + 1.2 * 0.4)
