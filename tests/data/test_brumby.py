"""The Brumby file: made by its script, and of the published mass, speeds and lift."""

from __future__ import annotations

import math

import numpy as np
import pytest

from data.scripts import brumby
from data.scripts.brumby import Part
from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.sitl import record
from gcs_sysid.sitl.flight import Flight, Hidden
from gcs_sysid.sitl.inputs import TestInput
from gcs_sysid.sitl.jsbsim_aircraft import JsbsimAircraft, Start
from gcs_sysid.sitl.plan import Leg
from gcs_sysid.sitl.slopes import thrust_at, trim
from tests.sitl import examples

KNOT = 1852.0 / 3600.0


@pytest.fixture(scope="module")
def stored() -> Aircraft:
    return aircraft_file.load(examples.ROOT / "data" / "aircraft" / "brumby_mk3.toml")


def test_the_file_is_what_its_script_makes(stored):
    """To the last of four digits, which rounding may turn."""
    made = brumby.aircraft()
    for key in ("mass", "Ixx", "Iyy", "Izz", "Ixz"):
        assert getattr(stored.mass, key) == pytest.approx(getattr(made.mass, key), rel=1.1e-3)
    for coefficient, model in made.aerodynamics.items():
        terms = stored.aerodynamics[coefficient].terms
        assert set(terms) == set(model.terms)
        for key, value in model.terms.items():
            assert terms[key].value == pytest.approx(value.value, rel=1.1e-3), (coefficient, key)


def test_its_parts_weigh_what_it_weighs_and_balance_where_chosen(stored):
    parts = brumby.parts()
    assert sum(part.mass for part in parts) == pytest.approx(45.0)
    terms = {name: model.terms for name, model in stored.aerodynamics.items()}
    margin = terms["Cm"]["alpha"].value / terms["CZ"]["alpha"].value
    assert margin == pytest.approx(brumby.STATIC_MARGIN, rel=0.05)


def test_inertia_of_a_box_and_of_two_masses():
    box = brumby.inertia((Part(6.0, (0.4, 0.1, 0.0), (1.0, 2.0, 3.0)),))
    assert np.diag(box) == pytest.approx([0.5 * 13.0, 0.5 * 10.0, 0.5 * 5.0])
    pair = brumby.inertia((Part(2.0, (1.0, 0.0, 1.0)), Part(2.0, (-1.0, 0.0, -1.0))))
    assert pair == pytest.approx(np.array([[4.0, 0.0, -4.0], [0.0, 8.0, 0.0], [-4.0, 0.0, 4.0]]))


def test_it_flies_at_the_published_speeds(stored):
    """50 to 100 kt: it does not stall at the lowest, and 5.5 hp drive it at nearly the highest."""
    force = 0.5 * 1.225 * (50.0 * KNOT) ** 2 * stored.geometry.wing_area
    terms = {key: value.value for key, value in stored.aerodynamics["CZ"].terms.items()}
    most_lift = -(terms["1"] + terms["alpha"] * brumby.STALL)
    assert 1.2 < math.sqrt(force * most_lift / (stored.mass.mass * 9.81)) < 1.6
    assert trim(stored, 95.0 * KNOT).throttle < 0.99
    power = thrust_at(stored, 100.0 * KNOT, 1.0) * 100.0 * KNOT
    # 0.75 is as good as propellers of that size are.
    assert 0.6 * 5.5 * 745.7 < power < 0.85 * 5.5 * 745.7


def test_power_pitches_it_down(stored):
    """Its thrust line is above the centre of gravity: trim depends on thrust."""
    turning = []
    for throttle in (0.2, 0.9):
        flying = JsbsimAircraft(stored, start=Start(airspeed=36.0, elevation=0.0))
        flying.advance({}, [throttle])
        turning.append((flying.state().q_dot, flying.thrusts()[0]))
    (idle, little), (power, much) = turning
    z = stored.propulsion[0].position[2]
    assert z < -0.05
    assert power - idle == pytest.approx(z * (much - little) / stored.mass.Iyy, rel=0.02)


@pytest.mark.parametrize("lag", [0.0, 0.3])
def test_it_stalls_and_recovers(stored, lag):
    """Pulled up hard near its lowest speed; with a lag the flow leaves and comes back late."""
    pull = TestInput("elevator", "step", 2.0, 2.0, -0.2)
    leg = Leg("stall", 9.0, 27.0, 150.0, inputs=(pull,))
    flight = Flight(
        stored,
        stored,
        (leg,),
        start=Start(airspeed=27.0, height=150.0),
        hidden=Hidden(stall_lag=lag),
    )
    truth = record.fly(flight).truth
    alpha, airspeed = truth.column("alpha"), truth.column("V")
    assert stored.envelope is not None
    assert alpha.max() > brumby.STALL + 0.03
    assert np.abs(truth.column("phi")).max() < 0.3
    assert alpha[-50:].max() < stored.envelope.alpha[1]
    assert airspeed[-50:] == pytest.approx(27.0, abs=2.0)


def test_its_lift_coefficient_is_that_of_the_recorded_flight(stored):
    """CZ from -0.40 to -0.25 in the thesis's figure 5.11: 60 to 75 kt with this wing area."""
    for knots, CZ in ((59.0, -0.40), (74.0, -0.25)):
        force = 0.5 * 1.225 * (knots * KNOT) ** 2 * stored.geometry.wing_area
        assert -stored.mass.mass * 9.81 / force == pytest.approx(CZ, rel=0.05)
