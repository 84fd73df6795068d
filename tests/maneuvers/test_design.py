"""Trim, linear motion, excursions and amplitudes of a made-up aircraft."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid.aircraft import Aircraft, CoefficientModel, Envelope, Value
from gcs_sysid.errors import UsageError
from gcs_sysid.estimate.result import AeroModel, CoefficientFit
from gcs_sysid.maneuvers import design, flown, holding
from gcs_sysid.maneuvers.design import Condition
from gcs_sysid.maneuvers.envelope import excursion
from gcs_sysid.maneuvers.flown import Flown, Simulator
from gcs_sysid.model import rigid_body, trim
from tests.offline.made_aircraft import small

TERMS = {
    "CX": {"1": -0.05, "alpha^2": 2.0},
    "CY": {"beta": -0.9, "rudder": 0.2},
    "CZ": {"1": -0.3, "alpha": -5.0, "qhat": -8.0},
    "Cl": {"beta": -0.1, "phat": -0.5, "rhat": 0.2, "aileron": 0.17},
    "Cm": {"1": 0.01, "alpha": -1.5, "qhat": -30.0, "elevator": -0.99},
    "Cn": {"beta": 0.08, "phat": -0.05, "rhat": -0.1, "rudder": -0.07},
}


def aircraft() -> Aircraft:
    models = {
        name: CoefficientModel(
            {key: Value(value, 0.05 * abs(value)) for key, value in terms.items()}
        )
        for name, terms in TERMS.items()
    }
    return replace(small(), aerodynamics=models)


def model() -> AeroModel:
    fits = {}
    for name, terms in TERMS.items():
        value = np.array(list(terms.values()))
        zero = np.zeros(value.size)
        fits[name] = CoefficientFit(
            keys=tuple(terms),
            value=value,
            covariance=np.diag((0.05 * value) ** 2),
            flight_value=value,
            deviations={"scale": zero},
            white_deviation=zero,
            repeated_covariance=np.diag((0.05 * value) ** 2),
            discrepancy=0.0,
            calibration=1.0,
            residual=0.01,
            correlation=np.eye(value.size),
            excitation=zero,
            lowest=zero,
            highest=zero,
            samples=10000,
            effective_samples=1000.0,
        )
    return AeroModel(fits, ("aileron", "elevator", "rudder"))


@pytest.fixture(scope="module")
def at() -> Condition:
    made = aircraft()
    level = trim.find(made, 22.0, 100.0, 1.2)
    linear = holding.linearised(made, level)
    drawn = flown.draws(made, model(), np.random.default_rng(0))
    assert made.envelope is not None
    return Condition(
        made, model(), made.envelope, level, linear, Simulator(made, level, linear, drawn)
    )


def test_trim_is_level_and_still(at) -> None:
    given = trim.inputs(
        at.aircraft, jnp.asarray(at.trim.controls), jnp.asarray(at.trim.settings), at.trim.density
    )
    change = rigid_body.derivative(
        at.aircraft, rigid_body.parameters(at.aircraft), at.trim.state, given
    )
    np.testing.assert_allclose(change.velocity, 0.0, atol=1e-3)
    np.testing.assert_allclose(change.rate, 0.0, atol=1e-3)
    assert abs(float(at.trim.state.velocity[2])) < 1e-9
    assert float(jnp.linalg.norm(at.trim.state.velocity)) == pytest.approx(22.0)


def test_an_airspeed_that_the_thrust_does_not_reach_is_refused() -> None:
    with pytest.raises(UsageError, match="cannot fly level at 70 m/s"):
        trim.find(aircraft(), 70.0, 100.0, 1.2)


def test_the_short_period_is_that_of_the_two_state_approximation(at) -> None:
    """ω² ≈ Z_w M_q − U M_w (Stevens, Lewis & Johnson 2015, section 4.2), Z_w and M_w by hand."""
    speed, pressure, area = 22.0, 0.5 * 1.2 * 22.0**2, 0.55
    lift = -5.0 * pressure * area / (11.0 * speed)
    chord = at.aircraft.geometry.mean_chord
    stiffness = -1.5 * pressure * area * chord / 1.135
    damping = -30.0 * pressure * area * chord / 1.135 * chord / (2.0 * speed)
    expected = np.sqrt(lift * damping - stiffness)
    assert at.linear.natural_frequency(lateral=False) == pytest.approx(expected, rel=0.05)


def test_the_controller_holds_the_trim_and_lets_inputs_through(at) -> None:
    still = at.simulator.fly(np.zeros((400, 3)))
    np.testing.assert_allclose(still.airspeed[0], 22.0, atol=0.02)
    np.testing.assert_allclose(still.bank[0], 0.0, atol=1e-3)
    added = np.zeros((400, 3))
    added[:50, 1] = 0.02
    pushed = at.simulator.fly(added)
    # Trailing edge down by 0.02 rad for a second: alpha falls by about Cm_elevator/Cm_alpha of it.
    assert pushed.alpha[0].min() - still.alpha[0, 0] == pytest.approx(-0.02 * 0.99 / 1.5, rel=0.5)
    assert abs(pushed.controls[0, 25, 1] - at.trim.controls[1] - 0.02) < 0.01


def test_the_probability_counts_the_aircraft_that_leave() -> None:
    allowed = Envelope((10.0, 30.0), (-0.1, 0.2), (-0.2, 0.2), (-1.0, 3.0), 1.0, 50.0)
    level = {
        "airspeed": np.full((4, 5), 20.0),
        "alpha": np.full((4, 5), 0.05),
        "beta": np.zeros((4, 5)),
        "rate": np.zeros((4, 5, 3)),
        "bank": np.zeros((4, 5)),
        "load_factor": np.ones((4, 5)),
        "height": np.full((4, 5), 100.0),
        "controls": np.zeros((4, 5, 3)),
    }
    assert excursion(Flown(**level), allowed).violation_probability == pytest.approx(1.0 / 6.0)
    level["alpha"] = level["alpha"].copy()
    level["alpha"][2, 3] = 0.19  # inside the limit, beyond its margin
    found = excursion(Flown(**level), allowed)
    assert found.violation_probability == pytest.approx(2.0 / 6.0)
    assert found.ranges["alpha"] == (0.05, 0.05)


@pytest.mark.parametrize("kind", design.KINDS)
def test_an_input_teaches_and_stays_inside(at, kind) -> None:
    found = design.suggest(at, ("elevator",), ("Cm",), kind)
    assert found.excursion.violation_probability <= 0.02
    low, high = at.allowed.alpha
    assert low < found.excursion.ranges["alpha"][0] < found.excursion.ranges["alpha"][1] < high
    assert found.gains["Cm"].after < 0.7 * found.gains["Cm"].before
    assert found.worth > 0.0
    assert np.ptp(found.flown.alpha[0]) > np.radians(1.0)
    assert found.added.shape == (found.time.size, 1)


def test_a_narrower_envelope_makes_a_smaller_input(at) -> None:
    wide = design.suggest(at, ("elevator",), ("Cm",), "multisine")
    narrow = replace(at, allowed=replace(at.allowed, alpha=(-0.05, 0.12)))
    found = design.suggest(narrow, ("elevator",), ("Cm",), "multisine")
    assert np.abs(found.added).max() < np.abs(wide.added).max()
    assert found.excursion.violation_probability <= 0.02


def test_an_envelope_without_room_is_refused(at) -> None:
    none = replace(at, allowed=replace(at.allowed, load_factor=(0.99, 1.01)))
    with pytest.raises(UsageError, match="leaves the envelope"):
        design.suggest(none, ("elevator",), ("Cm",), "doublet")


def test_controls_are_those_that_do_most() -> None:
    made = aircraft()
    assert design.strongest_control(made, model(), "Cm") == "elevator"
    found = design.groups(made, model(), ("Cl", "Cm", "Cn"))
    assert found == {("elevator",): ("Cm",), ("aileron", "rudder"): ("Cl", "Cn")}
    assert design.groups(made, model(), ("Cn",)) == {("aileron", "rudder"): ("Cn",)}
    assert design.travel(made, "elevator") == pytest.approx(0.5)
