"""A flight settled under beliefs about its aircraft: parameters, intensities, and what is left.

The mean follows the estimating equation of `causal` by Gauss–Newton steps, the intensities their
likelihood by the steps of `intensities`, in turns, first on the stretch with the most control. The
two hardly disturb each other: one asks the innovations' mean, the other their size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float

from gcs_sysid.estimate import intensities
from gcs_sysid.estimate.filter_error import Flight, Unknowns, most_controlled
from gcs_sysid.estimate.intensities import Prior, Search
from gcs_sysid.model.aided import Means, Noise
from gcs_sysid.reconstruct import causal
from gcs_sysid.reconstruct.aided_smoother import FlightModel
from gcs_sysid.reconstruct.causal import Pass, Path

STRETCH = 4000
"""Rows of the stretch on which a search begins."""
FIRST_TURNS, TURNS = 12, 4
FORERUNS = 2
"""Passes that find the path before anything is asked of it."""
SETBACK = 30.0
"""A turn that loses more than this went too far [nat]; less may come with a path that moves."""
MOST_SETBACKS, SHORTENED = 3, 0.3
ENOUGH = 2.0
"""A turn that gains less than this, of mean and intensities together, ends the search [nat]."""


@dataclass(frozen=True)
class Beliefs:
    """Gaussian beliefs about the parameters of the mean, flat, and about the intensities.

    Attributes:
        mean: of the parameters.
        covariance: of them; a parameter of variance 0 is held.
        noise: about the intensities.
    """

    mean: Float[np.ndarray, " parameter"]
    covariance: Float[np.ndarray, "parameter parameter"]
    noise: Prior


@dataclass(frozen=True)
class Settled:
    """Where a search ended.

    Attributes:
        values: parameters of the mean, flat.
        log_noise: intensities.
        last: the pass at these values.
        fitted: rows from which the parameters of the mean were taken.
        ended: whether nothing more was to be gained.
    """

    values: Float[np.ndarray, " parameter"]
    log_noise: Noise
    last: Pass
    fitted: Bool[np.ndarray, " sample"]
    ended: bool


def settle(
    model: FlightModel,
    flight: Flight,
    first: Unknowns,
    beliefs: Beliefs,
    counts: Bool[np.ndarray, " sample"],
    progress: Callable[[str], None],
    *,
    near: bool = False,
) -> Settled:
    """Settles a flight.

    Args:
        model: the aircraft.
        flight: measurements and first states.
        first: where to begin.
        beliefs: about everything.
        counts: rows from which the parameters of the mean are taken.
        progress: told about every turn.
        near: whether `first` and the flight's states are near what is sought.
    """
    if not near and flight.rows.step.shape[0] > STRETCH:
        part = most_controlled(flight, STRETCH)
        every = np.ones(STRETCH, dtype=bool)
        begun = _turns(model, part, first, beliefs, every, FIRST_TURNS, progress)
        first = Unknowns(_means(first.means, begun.values), begun.log_noise)
    return _turns(model, flight, first, beliefs, counts, TURNS, progress)


def _turns(
    model: FlightModel,
    flight: Flight,
    first: Unknowns,
    beliefs: Beliefs,
    counts: Bool[np.ndarray, " sample"],
    turns: int,
    progress: Callable[[str], None],
) -> Settled:
    search = Search(first.log_noise)
    path = causal.along(flight.rows, flight.nominal, flight.beginning)
    for _ in range(FORERUNS):
        rows = causal.joined(model, first.means, first.log_noise, path)
        path, _, _ = causal.filtered(path, rows)
    values = np.asarray(ravel_pytree(first.means)[0])
    free, ended = np.diagonal(beliefs.covariance) > 0.0, False
    best, setbacks = _Turn(-np.inf, values, first.log_noise, path), 0
    for turn in range(turns):
        means = _means(first.means, values)
        done = causal.passed(model, means, search.log_noise, path, counts, chosen=free)
        density = float(done.log_likelihood.sum())
        progress(f"turn {turn + 1}: log-likelihood {density:.0f}")
        if not density > best.density - SETBACK:
            setbacks += 1
            if setbacks > MOST_SETBACKS:
                break
            # Too far: a part of the way from the best turn so far, by smaller steps.
            values = best.values + SHORTENED * (values - best.values)
            path, search = best.path, Search(best.log_noise, damping=1.0)
            continue
        if density > best.density:
            best = _Turn(density, values, search.log_noise, path)
        move, gain = _newton(done, beliefs, values)
        if gain + search.gained < ENOUGH:
            ended = True
            break
        values = values + move
        path = done.path
        search = intensities.step(model, _means(first.means, values), path, beliefs.noise, search)
    # The last move has not been looked at: it stays if it did no harm.
    last = causal.passed(model, _means(first.means, values), search.log_noise, path, counts)
    if not float(last.log_likelihood.sum()) > best.density - SETBACK:
        values, noise = best.values, best.log_noise
        last = causal.passed(model, _means(first.means, values), noise, best.path, counts)
        return Settled(values, noise, last, counts, ended=False)
    return Settled(values, search.log_noise, last, counts, ended)


class _Turn(NamedTuple):
    """The best turn of a search."""

    density: float
    values: Float[np.ndarray, " parameter"]
    log_noise: Noise
    path: Path


def _newton(
    done: Pass, beliefs: Beliefs, values: Float[np.ndarray, " parameter"]
) -> tuple[Float[np.ndarray, " parameter"], float]:
    """Step to where score and prior balance, and what it gains [nat].

    In terms of the prior's root R, θ = m + R ε, so that what is held stays.
    """
    root = _root(beliefs.covariance)
    matrix, score, _ = done.told
    inner = np.eye(root.shape[1]) + root.T @ matrix @ root
    pull = root.T @ (score + matrix @ (values - beliefs.mean))
    wanted = beliefs.mean + root @ np.linalg.solve(inner, pull)
    move = wanted - values
    return move, 0.5 * float(move @ matrix @ move)


def _root(covariance: Float[np.ndarray, "parameter parameter"]) -> np.ndarray:
    """Columns whose outer products make the covariance, those of nothing left out."""
    sizes = np.sqrt(np.diagonal(covariance))
    scale = np.where(sizes > 0.0, sizes, 1.0)
    roots, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = roots > 1e-12
    return scale[:, None] * vectors[:, kept] * np.sqrt(roots[kept])


def _means(like: Means, values: Float[np.ndarray, " parameter"]) -> Means:
    return ravel_pytree(like)[1](jnp.asarray(values))


def at(settled: Settled, like: Means) -> Unknowns:
    """Parameters and intensities of a settled flight."""
    return Unknowns(_means(like, settled.values), settled.log_noise)
