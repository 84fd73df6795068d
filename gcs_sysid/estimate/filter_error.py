"""Filter error: derivatives, sensor errors and gust intensities from the innovations of the filter.

The innovations of the aided filter are independent of the past if the model is right (Maine &
Iliff, NASA RP-1138, 1985; Jategaonkar, *Flight Vehicle System Identification*, 2nd ed. 2015,
chapter 5). What multiplies the mean is found from their mean, by the unbiased estimating equation
of `reconstruct.causal`; the intensities from their size, by the likelihood; `settling` takes turns.

Stated deviations are those of the information that the estimating equation has, with the prior, and
wider where the scores of stretches of flight scatter more than independent innovations would make
them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float

from gcs_sysid import regressors
from gcs_sysid.estimate import sandwich, settling
from gcs_sysid.estimate.flight_rows import Flight, Unknowns
from gcs_sysid.estimate.settling import Beliefs, Settled
from gcs_sysid.frames import Array
from gcs_sysid.model.aided import State
from gcs_sysid.reconstruct import aided_smoother
from gcs_sysid.reconstruct.aided_smoother import FlightModel
from gcs_sysid.reconstruct.causal import Pass
from gcs_sysid.reconstruct.linear_filter import Belief

SMOOTHED = 3
"""Rounds of the smoother at the end."""


@dataclass(frozen=True)
class Fit:
    """What a maximisation found.

    Attributes:
        unknowns: where the search ended.
        deviation: one standard deviation of each.
        covariance: of the derivatives, in the order of `keys`.
        keys: coefficient and regressor of each derivative.
        bound: covariance of the derivatives by the flight alone, were all intensities known and
            innovations independent; of infinite variance where the flight says nothing.
        states: smoothed flight, one state a row.
        smoothed: deviations from it, and their covariance.
        last: the last pass of the filter, its innovations among it.
        log_likelihood: after each turn of the search.
        converged: whether the search ended because nothing more was to be gained.
    """

    unknowns: Unknowns
    deviation: Unknowns
    covariance: Float[np.ndarray, "term term"]
    keys: tuple[tuple[str, str], ...]
    bound: Float[np.ndarray, "term term"]
    states: State
    smoothed: Belief
    last: Pass
    log_likelihood: tuple[float, ...]
    converged: bool


def fit(
    model: FlightModel,
    flight: Flight,
    first: Unknowns,
    beliefs: Beliefs,
    counts: Bool[np.ndarray, " sample"],
    progress: Callable[[str], None],
    *,
    near: bool = False,
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
        near: whether `first` is near what is sought.
    """
    done = settling.settle(model, flight, first, beliefs, counts, progress, near=near)
    unknowns = settling.at(done, first.means)
    states, smoothed = aided_smoother.iterated(
        model, *unknowns, flight.rows, flight.nominal, flight.beginning, rounds=SMOOTHED
    )
    progress("how sure all this is")
    covariance, deviation = _deviations(model, unknowns, done, beliefs)
    keys = derivative_keys(unknowns.means.aerodynamics)
    taken = slice(len(keys))
    free = np.diagonal(beliefs.covariance) > 0.0
    return Fit(
        unknowns=unknowns,
        deviation=deviation,
        covariance=covariance[taken, taken],
        keys=keys,
        bound=_bound(done.last.told.matrix, free)[taken, taken],
        states=states,
        smoothed=smoothed,
        last=done.last,
        log_likelihood=done.log_likelihood,
        converged=done.ended,
    )


def _deviations(
    model: FlightModel, unknowns: Unknowns, done: Settled, beliefs: Beliefs
) -> tuple[Float[np.ndarray, "parameter parameter"], Unknowns]:
    """Covariance of the parameters of the mean, and one deviation of everything; 0 where held."""
    sigma = np.asarray(ravel_pytree(beliefs.noise.sigma)[0])
    free = (np.diagonal(beliefs.covariance) > 0.0, sigma > 0.0)
    known, noises = np.flatnonzero(free[0]), np.flatnonzero(free[1])
    prior = np.zeros((known.size + noises.size,) * 2)
    prior[: known.size, : known.size] = np.linalg.inv(beliefs.covariance[np.ix_(known, known)])
    places = known.size + np.arange(noises.size)
    prior[places, places] = 1.0 / sigma[noises] ** 2
    information = np.diagonal(done.last.told.matrix)[known] + np.diagonal(prior)[: known.size]
    sizes = np.zeros(free[0].size)
    sizes[known] = 1.0 / np.sqrt(information)
    keys = derivative_keys(unknowns.means.aerodynamics)
    moving = [any(name in key for name in regressors.VARIABLES) for _, key in keys]
    turning = np.pad(np.array(moving), (0, free[0].size - len(keys)))
    told = sandwich.slopes(model, *unknowns, done.last.path, done.fitted, free, sizes, turning)
    found = sandwich.covariance(told, prior, settling.scatter(done, beliefs))
    covariance = np.zeros_like(beliefs.covariance)
    covariance[np.ix_(known, known)] = found[: known.size, : known.size]
    logs = np.zeros(sigma.size)
    logs[noises] = np.sqrt(np.diagonal(found)[known.size :])
    deviation = Unknowns(
        ravel_pytree(unknowns.means)[1](jnp.asarray(np.sqrt(np.diagonal(covariance)))),
        ravel_pytree(unknowns.log_noise)[1](jnp.asarray(logs)),
    )
    return covariance, deviation


def derivative_keys(
    aerodynamics: Mapping[str, Mapping[str, Array]],
) -> tuple[tuple[str, str], ...]:
    """Coefficient and regressor of every derivative in the order of the flat vector.

    They come first in it: `Means.aerodynamics` is the first field, and dictionaries are flattened
    in the order of their sorted keys.
    """
    return tuple((name, key) for name in sorted(aerodynamics) for key in sorted(aerodynamics[name]))


def _bound(
    information: Float[np.ndarray, "parameter parameter"], free: Bool[np.ndarray, " parameter"]
) -> Float[np.ndarray, "parameter parameter"]:
    """Cramér–Rao: what no unbiased estimate can beat, infinite where the flight says nothing.

    Parameters that are held count as known, and have none.
    """
    chosen = np.ix_(free, free)
    size = np.sqrt(np.maximum(np.diagonal(information)[free], 1e-300))
    values, vectors = np.linalg.eigh(information[chosen] / np.outer(size, size))
    seen = values > 1e-12 * values[-1]
    spread = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T / np.outer(size, size)
    hidden = np.sum(vectors[:, ~seen] ** 2, axis=1) > 1e-6
    bound = np.zeros_like(information)
    bound[chosen] = spread
    places = np.flatnonzero(free)[hidden]
    bound[places, places] = np.inf
    return bound
