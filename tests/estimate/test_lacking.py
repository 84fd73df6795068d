"""Terms that a model lacks, on a made flight and by the closed form of their evidence."""

from __future__ import annotations

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from scipy.stats import norm

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.estimate import in_common, lacking
from gcs_sysid.estimate.flight_rows import Flight
from gcs_sysid.estimate.intensities import Prior
from gcs_sysid.estimate.lacking import Scores
from gcs_sysid.estimate.settling import Beliefs
from gcs_sysid.reconstruct import aided_smoother
from tests.estimate import made_flight as made

KEYS = ("alpha", "qhat", "alpha^2", "alpha*elevator")
LIFT = COEFFICIENTS.index("CZ") * len(KEYS)
EVERY = np.ones(made.COUNT, dtype=bool)


@pytest.fixture(scope="module", autouse=True)
def _short_chunks() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(aided_smoother, "CHUNK", made.COUNT)
        yield


@pytest.fixture(scope="module")
def flight() -> Flight:
    return made.made_flight()


def asked(flight: Flight, lift_slope: float, *, held: bool) -> Scores:
    """With everything as it was but the lift slope, which is known or sought."""
    found = made.unknowns(1.0)
    terms = {name: dict(each) for name, each in found.means.aerodynamics.items()}
    terms["CZ"]["alpha"] = jnp.asarray(lift_slope)
    found = found._replace(means=found.means._replace(aerodynamics=terms))
    keys = in_common.derivative_keys(terms)
    sigma = np.zeros(ravel_pytree(found.means)[0].size)
    sigma[: len(keys)] = 1e3
    if held:
        sigma[keys.index(("CZ", "alpha"))] = 0.0
    none = Prior(found.log_noise, jax.tree.map(jnp.zeros_like, found.log_noise))
    beliefs = Beliefs(np.zeros(sigma.size), np.diag(sigma**2), none)
    return lacking.scores(made.MODEL, flight, found, beliefs, EVERY, KEYS)


@pytest.mark.slow
def test_what_a_slope_is_off_is_what_the_term_is_told_to_be(flight) -> None:
    off = 0.5
    told = asked(flight, made.TERMS["CZ"]["alpha"] + off, held=True)
    value = told.score[LIFT] / told.information[LIFT]
    deviation = np.sqrt(told.scatter[LIFT]) / told.information[LIFT]
    assert abs(value + off) < 3.0 * deviation
    assert deviation < off / 3.0


@pytest.mark.slow
def test_of_a_model_that_lacks_nothing_scores_scatter_by_their_information(flight) -> None:
    told = asked(flight, made.TERMS["CZ"]["alpha"], held=False)
    # What is sought already has nothing left to tell; there is no constant of CX to move.
    assert told.information[LIFT] < 1e-3
    assert not told.information[: len(KEYS)].any()
    seen = told.information > 1e-3
    assert np.abs(told.score[seen] / np.sqrt(told.information[seen])).max() < 3.5
    # Four blocks in eight seconds scatter by chance.
    assert 1.0 <= (told.scatter[seen] / told.information[seen]).max() < 2.5


def test_evidence_is_the_bayes_factor_among_all_that_were_tried() -> None:
    rng = np.random.default_rng(4)
    flow = {name: 0.1 * rng.standard_normal(500) for name in ("alpha", "elevator", "qhat")}
    measured = {name: rng.standard_normal(500) for name in COEFFICIENTS}
    keys, structure = ("alpha", "elevator"), dict.fromkeys(COEFFICIENTS, ("1", "alpha"))
    count = len(COEFFICIENTS) * len(keys)
    score, information = np.zeros(count), np.full(count, 4.0)
    scatter = 2.0 * information
    place = COEFFICIENTS.index("Cm") * len(keys) + 1
    score[place] = 40.0
    told = Scores(score, information, scatter)
    (one,) = lacking.strongest(told, made.AIRCRAFT, structure, keys, flow, measured)
    assert (one.coefficient, one.key) == ("Cm", "elevator")
    assert one.value == pytest.approx(10.0)
    assert one.deviation == pytest.approx(np.sqrt(0.5))
    matrix = np.stack([np.ones(500), flow["alpha"]], axis=1)
    left = flow["elevator"] - matrix @ np.linalg.lstsq(matrix, flow["elevator"], rcond=None)[0]
    sigma = lacking.SIZE * np.std(measured["Cm"]) / np.std(left)
    factor = norm.logpdf(10.0, scale=np.hypot(sigma, np.sqrt(0.5))) - norm.logpdf(
        10.0, scale=np.sqrt(0.5)
    )
    assert one.evidence == pytest.approx(factor - np.log(count))
    assert one.share == pytest.approx(10.0 * np.std(left) / np.std(measured["Cm"]))
    score[place] = 4.0  # less than two deviations
    assert lacking.strongest(told, made.AIRCRAFT, structure, keys, flow, measured) == []


def test_two_flights_add_up() -> None:
    one = Scores(np.array([1.0]), np.array([2.0]), np.array([3.0]))
    assert one.plus(one) == Scores(*(2.0 * part for part in one))
