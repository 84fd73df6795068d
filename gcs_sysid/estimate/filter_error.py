"""Filter error: derivatives, sensor errors and gust intensities from the innovations of the filter.

The innovations of the aided filter are independent of the past if the model is right (Maine &
Iliff, NASA RP-1138, 1985; Jategaonkar, *Flight Vehicle System Identification*, 2nd ed. 2015,
chapter 5). On the stretch with the most control `settling` comes near what they say by turns that
take seconds, and `scoring` ends the search there by steps that know all that a filter changes; from
there its steps over the whole flight are few.

Stated deviations are those of the equations that are solved, with the prior, and wider where the
scores of stretches of flight scatter more than independent innovations would make them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float, Int

from gcs_sysid.estimate import in_common, innovation_spectrum, quick_air, scoring, settling
from gcs_sysid.estimate.flight_rows import Flight, Unknowns
from gcs_sysid.estimate.in_common import Said
from gcs_sysid.estimate.innovation_spectrum import Sensing
from gcs_sysid.estimate.likelihood import Curvature
from gcs_sysid.estimate.scoring import LostError, Scored
from gcs_sysid.estimate.settling import Beliefs, Settled
from gcs_sysid.model.aided import State
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.reconstruct import aided_smoother
from gcs_sysid.reconstruct.linear_filter import Belief

SMOOTHED = 3
"""Rounds of the smoother at the end."""
SILENT = 1e-12
"""Share of what flight and belief say together, of which less is rounding."""


@dataclass(frozen=True)
class Fit:
    """What a maximisation found.

    Attributes:
        unknowns: where the search ended.
        deviation: one standard deviation of each.
        keys: coefficient and regressor of each derivative, then those of the body, if it is sought.
        said: what this flight says of `keys`.
        bound: Cramér–Rao of the derivatives by the flight alone, were innovations independent; of
            infinite variance where the flight says nothing.
        states: smoothed flight, one state a row.
        smoothed: deviations from it, and their covariance were the parameters known.
        parameters: covariance of all parameters of the mean, in the order of `ravel_pytree`.
        moved: how the last state moves with them; of what hardly changes, as the wind, every state.
        sensing: what the filter had to go by.
        whitened: innovations over the root of their covariance.
        log_likelihood: of the rows that count, where the last steps began and after each.
        converged: whether the derivatives are told, to the deviations that are stated.
        moving: how far the last step wanted to move a derivative at most, in its deviations.
        stretch: curvature of the part of the flight on which the search began.
    """

    unknowns: Unknowns
    deviation: Unknowns
    keys: tuple[tuple[str, str], ...]
    said: Said
    bound: Float[np.ndarray, "term term"]
    states: State
    smoothed: Belief
    parameters: Float[np.ndarray, "parameter parameter"]
    moved: Float[np.ndarray, "state parameter"]
    sensing: Sensing
    whitened: Float[np.ndarray, "sample row"]
    log_likelihood: tuple[float, ...]
    converged: bool
    moving: float
    stretch: Curvature


def fit(
    model: FlightModel,
    flight: Flight,
    first: Unknowns,
    beliefs: Beliefs,
    counts: Bool[np.ndarray, " sample"],
    progress: Callable[[str], None],
    *,
    stretch: Curvature | None = None,
) -> Fit:
    """Fits one flight.

    Args:
        model: the aircraft; its aerodynamic terms are those of `first`.
        flight: measurements and first states.
        first: where to begin.
        beliefs: before this flight, about the parameters of the mean in the order of
            `ravel_pytree`, and about the intensities.
        counts: rows from which derivatives are learned.
        progress: told about every turn.
        stretch: from an earlier fit of this flight, near which `first` then is.

    Raises:
        LostError: the filter lost the aircraft.
        QuickAirError: the air changes too quickly for a filter to tell it from the aircraft.
    """
    search = _Search(model, flight, beliefs, counts, progress)
    if stretch is None:
        done, stretch = _from_stretches(search, first)
    else:
        done = _over_all(search, first, stretch)
    unknowns = done.unknowns
    states, smoothed = aided_smoother.iterated(
        model, *unknowns, flight.rows, flight.nominal, flight.beginning, rounds=SMOOTHED
    )
    common = in_common.places(unknowns.means)
    covariance, deviation = _covariance(done)
    return Fit(
        unknowns=unknowns,
        deviation=deviation,
        keys=in_common.keys(unknowns.means),
        said=_said(done, beliefs.mean, common),
        bound=_bound(done, len(in_common.derivative_keys(unknowns.means.aerodynamics))),
        states=states,
        smoothed=smoothed,
        parameters=covariance,
        moved=done.moved,
        sensing=innovation_spectrum.sensing(
            flight.rows, unknowns.log_noise, deviation.means.sensors
        ),
        whitened=done.whitened,
        log_likelihood=done.log_likelihood,
        converged=done.settled,
        moving=done.moving,
        stretch=stretch,
    )


class _Search(NamedTuple):
    """What is searched, wherever it begins; see `fit`."""

    model: FlightModel
    flight: Flight
    beliefs: Beliefs
    counts: Bool[np.ndarray, " sample"]
    progress: Callable[[str], None]


def _from_stretches(search: _Search, first: Unknowns) -> tuple[Scored, Curvature]:
    """Where the steps ended on a flight, begun on a stretch of it, and that stretch's curvature.

    Where they end astray on the whole flight another stretch is begun on. On one of a hundred
    (7063 of `tests/benchmarks/bench_filter_error.py`) they had seemed near on the second stretch
    and were 22 deviations from anywhere on the whole.
    """
    tried: list[tuple[Scored, Curvature]] = []
    lost: LostError | None = None
    for done, whole in _beginnings(search, first):
        curvature = done.curvature
        try:
            if not whole:
                done = _over_all(search, done.unknowns, curvature)
        except LostError as error:
            lost = error
            continue
        tried.append((done, curvature))
        if done.near:
            break
    if not tried:
        raise lost or LostError
    return max(tried, key=lambda one: (one[0].ended, one[0].log_likelihood[-1]))


def _over_all(search: _Search, first: Unknowns, stretch: Curvature) -> Scored:
    """Where the steps end on the whole flight, begun near."""
    model, flight, beliefs, counts, progress = search
    begun = settling.rested(model, flight, first, beliefs, counts)
    return scoring.climbed(model, first.means, begun, beliefs, progress, stretch)


def _beginnings(search: _Search, first: Unknowns) -> Iterator[tuple[Scored, bool]]:
    """Where the steps ended on stretches of a flight, and whether each is all of the flight.

    On two of twenty flights (those of `tests/benchmarks/bench_filter_error.py`) the turns run into
    setbacks on the stretch with the most control, and from where they stand the steps lead nowhere.
    Another stretch has other gusts, and another way there. Where they lead nowhere on all, the one
    that came nearest is told.
    """
    model, flight, beliefs, counts, progress = search
    astray: list[tuple[Scored, bool]] = []
    settled: list[Settled] = []
    any_near = False
    for part, taken, whole in settling.beginnings(flight, counts, progress):
        begun = settling.settle(model, part, first, beliefs, taken, progress, rough=True)
        quick_air.check(begun.log_noise, beliefs.noise.mean, part.rows.passing)
        settled.append(begun)
        if begun.restless:
            continue
        try:
            done = scoring.climbed(model, first.means, begun, beliefs, progress)
        except LostError:
            continue
        if done.near:
            any_near = True
            yield done, whole
        else:
            astray.append((done, whole))
    if any_near:
        return
    if astray:
        yield min(astray, key=lambda one: one[0].moving)
    else:
        # The one with the least to gain, for want of a better; a lost one is lost here too.
        begun = settling.least_left(settled)
        yield scoring.climbed(model, first.means, begun, beliefs, progress), whole


def _covariance(done: Scored) -> tuple[Float[np.ndarray, "parameter parameter"], Unknowns]:
    """Covariance of the parameters of the mean, and one deviation of everything; 0 where held."""
    means, noises = done.free
    known, logs = np.flatnonzero(means), np.zeros(noises.size)
    found = done.covariance()
    covariance = np.zeros((means.size, means.size))
    covariance[np.ix_(known, known)] = found[: known.size, : known.size]
    logs[noises] = np.sqrt(np.diagonal(found)[known.size :])
    like = done.unknowns
    deviation = Unknowns(
        ravel_pytree(like.means)[1](jnp.asarray(np.sqrt(np.diagonal(covariance)))),
        ravel_pytree(like.log_noise)[1](jnp.asarray(logs)),
    )
    return covariance, deviation


def _said(
    done: Scored, believed: Float[np.ndarray, " parameter"], common: Int[np.ndarray, " key"]
) -> Said:
    """What a flight says of what flights have in common.

    Taken from the flight's own equations, and not as what the posterior says more than the prior:
    where the gains take most of the information away these equations weigh a flight less than they
    could, and the posterior is wider than the prior.

    Args:
        done: where the steps ended.
        believed: means of the beliefs.
        common: which parameters flights have in common.
    """
    means, noises = done.free
    known = np.flatnonzero(means)
    doubted = np.concatenate([np.isin(known, common), np.zeros(int(noises.sum()), dtype=bool)])
    bare = done.doubting(doubted)
    values = np.array(ravel_pytree(done.unknowns.means)[0])
    off = np.zeros(doubted.size)
    off[: known.size] = (values - believed)[known]
    # Where scores and beliefs balance, scores are what the beliefs pull.
    values[known] += bare.balanced((done.precision - bare.precision) @ off)[: known.size]
    late, found = np.zeros(values.size), bare.equations()
    late[known] = bare.timing(found)[: known.size]
    sought = means[common]
    rows = np.searchsorted(known, common[sought])
    chosen = np.ix_(sought, sought)
    # Of what was told and believed the belief, which is little, is taken off.
    both, little = np.zeros((2, common.size, common.size))
    both[chosen] = scoring.inverse(bare.as_ended(found)[np.ix_(rows, rows)])
    little[chosen] = bare.precision[np.ix_(rows, rows)]
    return Said(
        both - little, both @ values[common] - little @ believed[common], both @ late[common]
    )


def _bound(done: Scored, count: int) -> Float[np.ndarray, "term term"]:
    """Cramér–Rao: what no unbiased estimate of the first `count` parameters can beat.

    Nothing is believed of them before; of sensors and gusts what the priors say. Infinite where the
    flight says nothing; parameters that are held count as known, and have none.
    """
    free = np.flatnonzero(done.free[0][:count])
    matrix = done.curvature.information + done.precision
    stated = np.diagonal(matrix).copy()
    matrix[: free.size, : free.size] -= done.precision[: free.size, : free.size]
    # Of a belief that is taken off again rounding is left, off the diagonal too.
    silent = np.diagonal(matrix) <= SILENT * stated
    matrix[silent, :] = matrix[:, silent] = 0.0
    size = np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    seen = values > 1e-12 * values[-1]
    spread = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T / np.outer(size, size)
    hidden = np.sum(vectors[: free.size, ~seen] ** 2, axis=1) > 1e-6
    bound = np.zeros((count, count))
    bound[np.ix_(free, free)] = spread[: free.size, : free.size]
    bound[free[hidden], free[hidden]] = np.inf
    return bound
