"""A search that goes by what scores say, and what the flight says where it ends."""

from __future__ import annotations

from collections.abc import Iterator
from unittest.mock import Mock

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid.estimate import scoring, settling, weighed
from gcs_sysid.estimate.flight_rows import Unknowns
from gcs_sysid.estimate.intensities import Prior
from gcs_sysid.estimate.settling import Beliefs
from gcs_sysid.estimate.weighed import Relation, Weighed
from gcs_sysid.model import aided
from gcs_sysid.reconstruct import aided_smoother, causal
from tests.estimate import made_flight as made

pytestmark = pytest.mark.slow

KNOWN = made.unknowns(1.0)
FLAT = np.asarray(ravel_pytree(KNOWN.means)[0])
DERIVATIVES = np.arange(FLAT.size) < sum(len(terms) for terms in made.TERMS.values())
SIZES = np.where(DERIVATIVES, 0.3 * np.abs(FLAT), 0.0)
FLIGHT = made.made_flight()
EVERY = np.ones(made.COUNT, dtype=bool)


@pytest.fixture(scope="module", autouse=True)
def _short_chunks() -> Iterator[None]:
    # As other tests have them, so that one compilation serves all.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(aided_smoother, "CHUNK", made.COUNT // 2)
        yield


def beliefs() -> Beliefs:
    """Derivatives to a third, the gusts' strength to a factor of three."""
    held = jax.tree.map(jnp.zeros_like, KNOWN.log_noise)
    turbulence = held.turbulence._replace(gust=jnp.ones(3))
    sigma = held._replace(turbulence=turbulence)
    return Beliefs(FLAT, np.diag(SIZES**2), Prior(KNOWN.log_noise, sigma))


@pytest.fixture(scope="module")
def by() -> Relation:
    """Worked out where nothing was searched yet, with derivatives a tenth too large."""
    return weighed.relation(made.MODEL, FLIGHT, made.unknowns(1.1), beliefs())


def climbed(by: Relation, counts: np.ndarray, begun: Unknowns) -> tuple[Weighed, list[str]]:
    told: list[str] = []
    found = weighed.climbed(made.MODEL, FLIGHT, [begun], beliefs(), counts, by, told.append)
    return found, told


@pytest.fixture(scope="module")
def ended(by: Relation) -> Weighed:
    return climbed(by, EVERY, made.unknowns(1.2))[0]


def posterior(found: Weighed) -> tuple[np.ndarray, np.ndarray]:
    """Mean and deviation of the derivatives."""
    matrix = found.told.matrix[np.ix_(DERIVATIVES, DERIVATIVES)]
    precision = np.diag(SIZES[DERIVATIVES] ** -2.0)
    covariance = np.linalg.inv(matrix + precision)
    off = (found.settled.values - FLAT)[DERIVATIVES]
    score = found.told.score[DERIVATIVES] - precision @ off
    mean = found.settled.values[DERIVATIVES] + covariance @ score
    return mean, np.sqrt(np.diagonal(covariance))


@pytest.mark.parametrize(("share", "passes"), [(1.0001, 1), (1.5, 2)], ids=["next to it", "far"])
def test_a_point_is_told_by_a_path_that_has_followed_it(
    monkeypatch, share: float, passes: int
) -> None:
    """From the path of the true derivatives: as far as it moves it is looked at again."""
    path = settling.along(made.MODEL, FLIGHT, KNOWN)
    path = scoring.passed(made.MODEL, KNOWN, path, EVERY).path
    moved = made.unknowns(share)
    taken = Mock(wraps=causal.filtered)
    monkeypatch.setattr(causal, "filtered", taken)
    found = scoring.passed(made.MODEL, moved, path, EVERY)
    assert taken.call_count >= passes
    assert (taken.call_count == 1) == (passes == 1)
    for _ in range(5):
        path, _, steps = causal.filtered(path, causal.joined(made.MODEL, *moved, path))
    density = sum(float(np.sum(step.log_likelihood)) for step in steps)
    assert found.log_likelihood == pytest.approx(density, abs=0.3)


def test_it_ends_where_flight_and_beliefs_balance(ended) -> None:
    assert ended.settled.ended
    assert ended.settled.left < weighed.ENOUGH
    # Two deviations of each unknown, squared and halved.
    unknowns = DERIVATIVES.sum() + 3
    assert ended.settled.tolerated == pytest.approx(2.0 * unknowns)
    assert np.all(np.diff(ended.settled.log_likelihood) > -5.0)
    mean, deviation = posterior(ended)
    # Nothing is left to move by, and the truth is within what is said.
    np.testing.assert_array_less(np.abs(mean - ended.settled.values[DERIVATIVES]) / deviation, 1.0)
    np.testing.assert_array_less(np.abs(mean - FLAT[DERIVATIVES]) / deviation, 3.5)
    held = ~DERIVATIVES
    np.testing.assert_array_equal(ended.settled.values[held], FLAT[held])


def test_no_point_nearby_is_more_probable(ended) -> None:
    """Flight and beliefs at the end, and four deviations of each derivative away."""
    _, deviation = posterior(ended)

    def density(values: np.ndarray) -> float:
        means = ravel_pytree(KNOWN.means)[1](jnp.asarray(values))
        path = ended.settled.last.path
        for _ in range(3):
            rows = causal.joined(made.MODEL, means, ended.settled.log_noise, path)
            path, _, steps = causal.filtered(path, rows)
        each = np.concatenate([step.log_likelihood for step in steps])[: made.COUNT]
        off = (values - FLAT)[DERIVATIVES] / SIZES[DERIVATIVES]
        return float(each.sum()) - 0.5 * float(off @ off)

    there = density(ended.settled.values)
    for place, size in zip(np.flatnonzero(DERIVATIVES), deviation, strict=True):
        for sign in (-1.0, 1.0):
            values = ended.settled.values.copy()
            values[place] += sign * 4.0 * size
            assert density(values) < there, place


def test_it_says_less_than_scores_at_held_gains_promise(ended) -> None:
    """Gains and path take some of what these say of the response, none adds to it."""
    held = np.diagonal(ended.settled.last.told.matrix)[DERIVATIVES]
    said = np.diagonal(ended.told.matrix)[DERIVATIVES]
    assert np.all(said < 1.1 * held)
    assert np.min(said / held) < 0.8


def test_rows_apart_say_what_they_say_and_move_nothing(by, ended) -> None:
    half = np.cumsum(FLIGHT.found) <= FLIGHT.found.sum() // 2
    # From where the whole flight ended: for so short a one, instruments made elsewhere would serve.
    mine, told = climbed(by, half, settling.at(ended.settled, KNOWN.means))
    assert told
    assert mine.settled.fitted.sum() == mine.settled.apart.sum() > 0
    assert not (mine.settled.fitted | mine.settled.apart)[~FLIGHT.found].any()
    both = mine.told.matrix + mine.apart.matrix
    ratio = np.diagonal(both)[DERIVATIVES] / np.diagonal(ended.told.matrix)[DERIVATIVES]
    np.testing.assert_array_less(ratio, 2.0)
    np.testing.assert_array_less(0.5, ratio)
    begun = made.unknowns(1.1)
    none, told = climbed(by, ~EVERY, begun)
    assert not told
    np.testing.assert_array_equal(none.settled.values, np.asarray(ravel_pytree(begun.means)[0]))
    assert not none.settled.restless
    assert not none.told.matrix.any()
    assert np.all(np.diagonal(none.apart.matrix)[DERIVATIVES] > 0.0)


def test_what_is_known_nearby_serves(by, ended) -> None:
    """With relation and instruments of other points: the same end, as surely."""
    end = settling.at(ended.settled, KNOWN.means)
    anew = weighed.relation(made.MODEL, FLIGHT, end, beliefs())
    given = (made.MODEL, FLIGHT, [made.unknowns(0.9)], beliefs(), EVERY, anew, lambda _: None)
    again = weighed.climbed(*given, ended.asked)
    (mean, deviation), (other, _) = posterior(ended), posterior(again)
    np.testing.assert_array_less(np.abs(mean - other) / deviation, 0.5)
    np.testing.assert_allclose(deviation, posterior(again)[1], rtol=0.15)


def test_a_search_begins_about_the_path_where_another_ended(monkeypatch, by, ended) -> None:
    """Along the nominal flight only where that path is of other rows, or lost."""
    asked = Mock(wraps=settling.along)
    monkeypatch.setattr(settling, "along", asked)
    end = settling.at(ended.settled, KNOWN.means)
    path = ended.settled.last.path
    given = (made.MODEL, FLIGHT, [end], beliefs(), ~EVERY, by, lambda _: None, ended.asked)
    found = weighed.climbed(*given, sets=1, near=path)
    asked.assert_not_called()
    before, after = (one.settled.last.log_likelihood.sum() for one in (ended, found))
    assert after == pytest.approx(before, abs=0.01)
    lost = path._replace(start=path.start._replace(covariance=jnp.nan * path.start.covariance))
    for other in (path._replace(chunks=path.chunks[:1]), lost):
        again = weighed.climbed(*given, sets=1, near=other)
        assert again.settled.last.log_likelihood.sum() == pytest.approx(before, abs=0.3)
    assert asked.call_count == 2


def test_a_search_that_stays_is_where_it_was_worked_out_how_errors_show(ended) -> None:
    end = settling.at(ended.settled, KNOWN.means)
    anew = weighed.relation(made.MODEL, FLIGHT, end, beliefs())
    found, told = climbed(anew, EVERY, end)
    assert len(told) == 1
    assert not found.moved
    assert ended.moved


def test_instruments_serve_again_where_the_same_unknowns_are_asked(by, ended) -> None:
    assert ended.by is by
    assert ended.asked_again(by._replace(precision=2.0 * by.precision)) is ended.asked
    parameters, intensities = by.free
    assert ended.asked_again(by._replace(free=(~parameters, intensities))) is None
    assert ended.asked_again(by._replace(free=(parameters, ~intensities))) is None


def test_what_another_search_found_does_not_stay_where_it_is_held(by, ended) -> None:
    """A held parameter that comes in off is put back, and the end is the same."""
    flat = np.asarray(ravel_pytree(made.unknowns(1.2).means)[0]).copy()
    flat[~DERIVATIVES] += 0.01
    begun = Unknowns(ravel_pytree(KNOWN.means)[1](jnp.asarray(flat)), KNOWN.log_noise)
    found = climbed(by, EVERY, begun)[0]
    np.testing.assert_array_equal(found.settled.values[~DERIVATIVES], FLAT[~DERIVATIVES])
    (mean, deviation), (other, _) = posterior(ended), posterior(found)
    np.testing.assert_array_less(np.abs(mean - other) / deviation, 0.5)


def test_instruments_that_lead_nowhere_are_made_anew(by, ended) -> None:
    """Those of another point that point the wrong way: no share of a step gains."""
    away = ended.asked._replace(
        innovations=tuple(-part for part in ended.asked.innovations),
        spreads=tuple(-part for part in ended.asked.spreads),
    )
    begun = [made.unknowns(1.2)]
    found = weighed.climbed(made.MODEL, FLIGHT, begun, beliefs(), EVERY, by, lambda _: None, away)
    assert found.settled.ended
    (mean, deviation), (other, _) = posterior(ended), posterior(found)
    np.testing.assert_array_less(np.abs(mean - other) / deviation, 0.5)


def test_what_a_tube_tells_of_its_lag_is_told_where_the_lag_is() -> None:
    """Instruments that were made without a lag say of one of 0.1 s what they say of 0.2 s."""
    still = jnp.log(jnp.asarray(0.03))
    quiet = KNOWN.log_noise._replace(airspeed=still, airspeed_error=still)
    flight, begun = made.made_flight(0.1, quiet), KNOWN._replace(log_noise=quiet)
    lag = np.flatnonzero(np.asarray(ravel_pytree(made.unknowns(1.0, 0.1).means)[0]) != FLAT)
    sizes = np.where(np.arange(FLAT.size) == lag, 0.2, SIZES)
    loose = Beliefs(FLAT, np.diag(sizes**2), Prior(quiet, beliefs().noise.sigma))
    relation = weighed.relation(made.MODEL, flight, begun, loose)
    told: list[str] = []
    found = weighed.climbed(made.MODEL, flight, [begun], loose, EVERY, relation, told.append)
    ended = settling.at(found.settled, begun.means)
    assert 0.05 < float(ended.means.sensors.airspeed_lag) < 0.15
    made_at, there = (
        float(aided.tube_lag(made.AIRCRAFT, each.means.sensors))
        for each in (found.asked.about, ended)
    )
    assert there == pytest.approx(made_at, rel=weighed.ANOTHER_TUBE)
    # The first were of another tube, however little was left to gain with them.
    assert any(line.startswith("step 2.") for line in told)
    # Nor do those with a lag serve a search that begins without one.
    another = weighed.climbed(
        *(made.MODEL, flight, [begun], loose, ~EVERY, relation, told.append),
        found.asked,
        sets=1,
    )
    assert another.asked.about.same(begun)
