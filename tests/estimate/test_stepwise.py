from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.aircraft import Aircraft, Control, Geometry, Mass
from gcs_sysid.estimate import stepwise
from gcs_sysid.estimate.coefficients import Samples
from tests.estimate.made_structures import AIRCRAFT, false_entries, flight

TRUE = {"1": -0.1, "alpha": -4.6, "elevator": -0.9, "alpha^2": 8.0}


def chosen(samples: Samples, usual: tuple[str, ...] = ("1", "alpha")) -> set[str]:
    piece = np.zeros(samples.time.size, dtype=int)
    return set(stepwise.choose([samples], AIRCRAFT, {"CZ": usual}, [piece])["CZ"])


def test_the_true_terms_are_found_and_no_others_without_noise() -> None:
    assert chosen(flight(TRUE, seed=1, noise=1e-6)) == set(TRUE)


@pytest.mark.parametrize("seed", range(4))
def test_the_true_terms_are_found_in_coloured_noise(seed: int) -> None:
    assert chosen(flight(TRUE, seed=seed, noise=0.02, memory=0.95)) >= set(TRUE)


def test_coloured_noise_lets_few_false_terms_in() -> None:
    """20 flights, each with 14 terms that are not there: fewer than one false term in ten flights.

    On the raw number of samples, as textbooks have it, ten times as many would get in.
    """
    entries, offered = false_entries(TRUE, seeds=range(20), noise=0.02, memory=0.95)
    assert offered == 20 * 14
    assert entries <= 2


def test_usual_terms_that_do_nothing_are_dropped() -> None:
    samples = flight({"1": -0.1, "alpha": -4.6}, seed=2, noise=0.01)
    assert chosen(samples, ("1", "alpha", "qhat", "elevator")) == {"1", "alpha"}


def test_terms_that_cancel_are_found_together() -> None:
    """Damping and aileron of a well damped roll: neither explains anything without the other.

    Selection that starts from the constant alone ended there.
    """
    samples = flight({"1": 0.0, "phat": -0.5, "aileron": 0.17}, seed=5, noise=0.0005)
    roll = samples.regressors["aileron"] * 0.17 / 0.5 + 0.002 * samples.regressors["phat"] / 0.03
    moment = -0.5 * roll + 0.17 * samples.regressors["aileron"]
    remains = samples.measured["CZ"] + 0.5 * samples.regressors["phat"]
    remains = remains - 0.17 * samples.regressors["aileron"] + moment
    tied = replace(
        samples,
        regressors={**samples.regressors, "phat": roll},
        measured={"CZ": remains},
    )
    assert chosen(tied, ("1", "beta", "phat", "rhat", "aileron")) == {"1", "phat", "aileron"}


def test_a_refused_coefficient_keeps_its_usual_terms() -> None:
    samples = replace(flight(TRUE, seed=3, noise=0.01), refused={"CZ": "no accelerometer"})
    assert chosen(samples, ("1", "alpha", "qhat")) == {"1", "alpha", "qhat"}


def test_candidates_are_all_linear_terms_squares_and_products_with_alpha() -> None:
    aircraft = Aircraft(
        "plain", Mass(1.0, 1.0, 1.0, 1.0), Geometry(1.0, 1.0, 1.0), controls=(Control("flap", {}),)
    )
    assert set(stepwise.candidates(aircraft)) == {
        "alpha", "beta", "phat", "qhat", "rhat", "flap", "alpha^2", "beta^2",
        "alpha*beta", "alpha*phat", "alpha*qhat", "alpha*rhat", "alpha*flap",
    }  # fmt: skip


def test_evidence_is_the_bayes_factor_of_two_linear_models() -> None:
    """Against the marginal likelihood in closed form, the prior of the term worth one sample.

    Residual variance known: y ~ N(0, s² I) against N(0, s² (I + n x xᵀ/xᵀx)).
    """
    generator = np.random.default_rng(11)
    count, noise = 4000, 0.3
    column = generator.standard_normal(count)
    for slope in (0.0, 0.01, 0.03):
        measured = slope * column + noise * generator.standard_normal(count)
        size = float(column @ column)
        best = float(column @ measured) / size
        left = measured - best * column
        exact = 0.5 * best**2 * size * count / (count + 1) / noise**2 - 0.5 * np.log(count + 1.0)
        found = stepwise.evidence(
            float(np.mean(measured**2)), float(np.mean(left**2)), float(count)
        )
        assert found == pytest.approx(exact, abs=0.05 * abs(exact) + 0.1)


def test_a_term_that_is_weak_but_there_has_evidence_that_grows_with_the_flight() -> None:
    one = stepwise.evidence(1.0, 0.98, 300.0)
    four = stepwise.evidence(1.0, 0.98, 1200.0)
    assert one < stepwise.ENTER < four
    assert stepwise.evidence(1.0, 1.0, 1200.0) < 0.0
