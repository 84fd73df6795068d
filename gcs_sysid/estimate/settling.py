"""A flight settled under beliefs about its aircraft: parameters, intensities, and what is left.

The mean follows the estimating equation of `causal` by Gauss–Newton steps, the intensities their
likelihood by the steps of `intensities`, in turns, first on the stretch with the most control. The
two hardly disturb each other: one asks the innovations' mean, the other their size.

Once the parameters are near, the way the gusts' field lies is looked for all around. With a wrong
one a gust turns the air about the wrong axis, the angle of attack is stretched to make up for it,
and with it everything that depends on it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float

from gcs_sysid.estimate import intensities, quasi_newton
from gcs_sysid.estimate.flight_rows import Flight, Unknowns, busy
from gcs_sysid.estimate.intensities import Prior, Search
from gcs_sysid.model.aided import Means, Noise
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.reconstruct import causal
from gcs_sysid.reconstruct.causal import Pass, Path

STRETCH = 2500
"""Rows of the stretch on which a search begins."""
BEGINNINGS = 3
"""Stretches on which a search begins, one after the other, until it finds rest."""
FIRST_TURNS, TURNS = 16, 24
ORIENTED = 1
"""Turn of the first stretch in which the gusts' field is looked for; and once more, when little is
left to gain."""
STEPS = 2
"""Steps of the intensities in a turn."""
FAR = 1000.0
"""While the parameters of the mean have more than this to gain, the intensities wait [nat]: with
wrong derivatives a filter would rather believe in gusts that turn the air for seconds."""
LONGEST_WAIT = 20
"""Passes after which they no longer do."""
CLIMBED = 4
"""Steps of the intensities after which two beginnings are compared."""
DAMPED = 0.3
"""Damping after the first of these steps that went too far; after the next, ten times as much."""
FORERUNS = 2
"""Passes that find the path before anything is asked of it."""
SETBACK = 300.0
"""A turn that loses more than this went too far [nat]; less may come with a path that moves."""
MOST_SETBACKS, SHORTENED = 3, 0.3
QUIET = 100.0
"""Where the intensities gained more than this, the slope has changed by them [nat]. A turn that
grew by less is quiet."""
CALMED = 2
"""Quiet turns, one after the other, that end a search where finer steps follow."""
CALM = 20.0
"""Where they gained more than this, a slope that changed less than was expected may have done so by
them."""
STALE = 5
"""Turns that bring the likelihood no further, one after the other, after which the best stands."""
HALF = 0.5
"""Share of what was expected that a change counts as at least: no step more than doubles."""
LEAST_CURVED, MOST_CURVED = 0.1, 5.0
"""A slope that changed by less or more than so many times what was expected is not believed."""
ENOUGH = (2.0, 10.0)
"""A turn that would gain less than the one, of mean and intensities together, and has gained less
than the other over the best before, ends the search [nat]. Where the gains take most of the
information away this is not the end of it: see `scoring`."""


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
        apart: rows that took no part and are told of as well.
        log_likelihood: after each turn.
        ended: whether nothing more was to be gained.
        left: what a further step of the parameters would gain [nat].
        tolerated: what a search that has not ended may leave to gain [nat].
    """

    values: Float[np.ndarray, " parameter"]
    log_noise: Noise
    last: Pass
    fitted: Bool[np.ndarray, " sample"]
    apart: Bool[np.ndarray, " sample"]
    log_likelihood: tuple[float, ...]
    ended: bool
    left: float = 0.0
    tolerated: float = QUIET

    @property
    def restless(self) -> bool:
        """Whether the search ended far from its end: what it says of parameters is no number."""
        # A filter that lost the aircraft leaves what is no number.
        return not self.ended and not self.left <= self.tolerated


def settle(
    model: FlightModel,
    flight: Flight,
    first: Unknowns,
    beliefs: Beliefs,
    counts: Bool[np.ndarray, " sample"],
    progress: Callable[[str], None],
    *,
    rough: bool = False,
) -> Settled:
    """Settles a flight.

    Args:
        model: the aircraft.
        flight: measurements and first states.
        first: where to begin.
        beliefs: about everything.
        counts: rows from which the parameters of the mean are taken.
        progress: told about every turn.
        rough: whether finer steps follow (`scoring`), so that nothing has to end here.
    """
    near, part = begun(model, flight, first, beliefs, counts, progress, rough=rough)
    if part is flight:
        return near
    first = at(near, first.means)
    return _turns(model, flight, first, beliefs, counts, TURNS, progress)


def begun(
    model: FlightModel,
    flight: Flight,
    first: Unknowns,
    beliefs: Beliefs,
    counts: Bool[np.ndarray, " sample"],
    progress: Callable[[str], None],
    *,
    rough: bool = False,
) -> tuple[Settled, Flight]:
    """Where turns on a stretch came to rest, and the stretch, which may be all of the flight.

    Where they do not on the stretch with the most control, another has other gusts, and another
    way there; where they do on none, the one with the least left to gain. Arguments are those of
    `settle`.
    """
    tried: list[tuple[Settled, Flight]] = []
    for part, every, whole in beginnings(flight, counts, progress):
        near = _neared(model, part, first, beliefs, every, progress)
        done = _turns(
            *(model, part, near, beliefs, every, FIRST_TURNS, progress),
            oriented=True,
            rough=rough or not whole,
        )
        if whole or not done.restless:
            return done, part
        tried.append((done, part))
    best = least_left([done for done, _ in tried])
    return next(one for one in tried if one[0] is best)


def beginnings(
    flight: Flight, counts: Bool[np.ndarray, " sample"], progress: Callable[[str], None]
) -> Iterator[tuple[Flight, Bool[np.ndarray, " stretch"], bool]]:
    """Stretches of a flight to begin on, the rows that take part, and whether each is all of it."""
    stretches = islice(busy(flight, counts, STRETCH), BEGINNINGS)
    for number, (part, every) in enumerate(stretches):
        if number:
            progress("no end there: begun anew on another stretch of the flight")
        yield part, every, part is flight


def least_left(tried: Sequence[Settled]) -> Settled:
    """Of searches without rest the one with the least to gain; those that lost the flight last."""
    return min(tried, key=lambda each: np.nan_to_num(each.left, nan=np.inf))


def rested(
    model: FlightModel,
    flight: Flight,
    unknowns: Unknowns,
    beliefs: Beliefs,
    counts: Bool[np.ndarray, " sample"],
) -> Settled:
    """A flight at unknowns that were found otherwise."""
    path = along(model, flight, unknowns)
    chosen = np.diagonal(beliefs.covariance) > 0.0
    last = causal.passed(model, *unknowns, path, counts, chosen=chosen)
    values = np.asarray(ravel_pytree(unknowns.means)[0])
    density = float(last.log_likelihood.sum())
    return Settled(values, unknowns.log_noise, last, counts, ~counts, (density,), ended=True)


def _neared(
    model: FlightModel,
    flight: Flight,
    first: Unknowns,
    beliefs: Beliefs,
    counts: Bool[np.ndarray, " sample"],
    progress: Callable[[str], None],
) -> Unknowns:
    """A flight's unknowns brought near enough for turns.

    With intensities far too small (gusts of a metre, where long ones are expected) a step of the
    mean goes astray: what shakes the aircraft is taken for derivatives. Then it may be the
    intensities that have to come first. Which, is told by the likelihood of either beginning.
    """
    approached, astray = _approached(model, flight, first, beliefs, counts, progress)
    if not astray:
        return approached
    progress("the parameters went astray: gusts and noise are tried first")
    both = [_climbed(model, flight, begun, beliefs) for begun in (first, approached)]
    likelier = max(both, key=lambda climbed: climbed[0])[1]
    return _approached(model, flight, likelier, beliefs, counts, progress)[0]


def _climbed(
    model: FlightModel, flight: Flight, begun: Unknowns, beliefs: Beliefs
) -> tuple[float, Unknowns]:
    """Unknowns with intensities some steps on, and their log-likelihood; −∞ for a lost flight."""
    path, search = along(model, flight, begun), Search(begun.log_noise)
    search = intensities.climbed(model, begun.means, path, beliefs.noise, search, CLIMBED)
    begun = begun._replace(log_noise=search.log_noise)
    steps = causal.filtered(path, causal.joined(model, *begun, path))[2]
    density = sum(float(np.sum(done.log_likelihood)) for done in steps)
    return density if np.isfinite(density) else -np.inf, begun


def _approached(
    model: FlightModel,
    flight: Flight,
    first: Unknowns,
    beliefs: Beliefs,
    counts: Bool[np.ndarray, " sample"],
    progress: Callable[[str], None],
) -> tuple[Unknowns, bool]:
    """Parameters of the mean brought near by damped steps, with intensities as they are.

    And whether a step went astray.
    """
    values = np.asarray(ravel_pytree(first.means)[0])
    free = np.diagonal(beliefs.covariance) > 0.0
    path, damping, best, astray = along(model, flight, first), 0.0, None, False
    for turn in range(LONGEST_WAIT):
        means = _means(first.means, values)
        done = causal.passed(model, means, first.log_noise, path, counts, chosen=free)
        density = float(done.log_likelihood.sum())
        progress(f"approach {turn + 1}: log-likelihood {density:.0f}")
        if best is None or density > best[0]:
            best, damping = (density, values, done), 0.2 * damping
        else:
            astray = astray or not density > best[0] - SETBACK
            damping = max(10.0 * damping, DAMPED)
        move, gain, _ = _newton(best[2], beliefs, best[1], None, damping)
        if gain < FAR:
            break
        values, path = best[1] + move, best[2].path
    return first._replace(means=_means(first.means, best[1])), astray


def along(model: FlightModel, flight: Flight, unknowns: Unknowns) -> Path:
    """The path that the filter predicts, from one along the nominal flight."""
    path = causal.along(flight.rows, flight.nominal, flight.beginning)
    for _ in range(FORERUNS):
        path = _renewed(model, unknowns, path)
    return path


def _renewed(model: FlightModel, unknowns: Unknowns, path: Path) -> Path:
    """The path that the filter predicts, linearised about another."""
    return causal.filtered(path, causal.joined(model, *unknowns, path))[0]


def _turns(
    model: FlightModel,
    flight: Flight,
    first: Unknowns,
    beliefs: Beliefs,
    counts: Bool[np.ndarray, " sample"],
    turns: int,
    progress: Callable[[str], None],
    *,
    oriented: bool = False,
    rough: bool = False,
) -> Settled:
    search = Search(first.log_noise)
    path = along(model, flight, first)
    values = np.asarray(ravel_pytree(first.means)[0])
    free, ended = np.diagonal(beliefs.covariance) > 0.0, False
    looks, quiet, stale = 2 if oriented else 0, 0, 0
    best, setbacks = _Turn(-np.inf, values, first.log_noise, path, None), 0
    history: list[float] = []
    before: _Slope | None = None
    for turn in range(turns):
        means = _means(first.means, values)
        done = causal.passed(model, means, search.log_noise, path, counts, chosen=free)
        density = float(done.log_likelihood.sum())
        history.append(density)
        progress(f"turn {turn + 1}: log-likelihood {density:.0f}")
        if not density > best.density - SETBACK:
            setbacks += 1
            if setbacks > MOST_SETBACKS:
                break
            # Too far: a part of the way from the best turn so far, by smaller steps.
            values = best.values + SHORTENED * (values - best.values)
            path, search, before = best.path, Search(best.log_noise, damping=1.0), best.slope
            continue
        grown = density - best.density
        move, gain, before = _newton(done, beliefs, values, before)
        if grown > 0.0:
            best = _Turn(density, values, search.log_noise, path, before)
        enough = gain + search.gained < ENOUGH[0] and grown < ENOUGH[1]
        quiet = quiet + 1 if turn > ORIENTED and grown < QUIET else 0
        if enough or (rough and quiet == CALMED and not looks):
            ended = True
            break
        stale = 0 if grown > ENOUGH[1] else stale + 1
        if stale == STALE:
            values, path, search = best.values, best.path, Search(best.log_noise)
            break
        values = values + move
        path, means = done.path, _means(first.means, values)
        if gain + search.gained > QUIET:
            path = _renewed(model, Unknowns(means, search.log_noise), path)
        if (looks == 2 and turn == ORIENTED) or (looks == 1 and quiet):
            looks -= 1
            turned = intensities.oriented(model, means, path, beliefs.noise, search.log_noise)
            if turned is not search.log_noise:
                search = Search(turned)
        search = intensities.climbed(model, means, path, beliefs.noise, search, STEPS)
        if search.gained > QUIET:
            before = None
        elif search.gained > CALM:
            before = before._replace(least=1.0)
    # The last move has not been looked at: it stays if it did no harm.
    means = _means(first.means, values)
    told_of = free if rough else None
    last = causal.passed(model, means, search.log_noise, path, counts, chosen=told_of)
    if not float(last.log_likelihood.sum()) > best.density - SETBACK:
        values, search, ended = best.values, search._replace(log_noise=best.log_noise), False
        means = _means(first.means, values)
        last = causal.passed(model, means, best.log_noise, best.path, counts, chosen=told_of)
    history.append(float(last.log_likelihood.sum()))
    left = _newton(last, beliefs, values, None)[1]
    return Settled(values, search.log_noise, last, counts, ~counts, tuple(history), ended, left)


class _Turn(NamedTuple):
    """The best turn of a search."""

    density: float
    values: Float[np.ndarray, " parameter"]
    log_noise: Noise
    path: Path
    slope: _Slope | None


class _Slope(NamedTuple):
    """Where the posterior's slope was taken, in units of the prior's root R: θ = m + R ε.

    A change since then is believed if it is at least `least` of what was expected.
    """

    at: Float[np.ndarray, " unit"]
    slope: Float[np.ndarray, " unit"]
    least: float = LEAST_CURVED


def _newton(
    done: Pass,
    beliefs: Beliefs,
    values: Float[np.ndarray, " parameter"],
    before: _Slope | None,
    damping: float = 0.0,
) -> tuple[Float[np.ndarray, " parameter"], float, _Slope]:
    """Step to where score and prior balance, what it gains [nat], and the slope here.

    In units of the prior's root, so that what is held stays. The gains' own part in how the score
    changes is missing in the information; along a constant sideslip, which a constant wind makes up
    for, it doubles it, and the step would swing from side to side; along all that makes the
    response in roll quicker it takes most of it away, and steps would be a fifth of what is
    missing. One update by how the slope has changed since the turn before ends both.
    """
    units = root(beliefs.covariance)
    matrix, score, _ = done.told
    inner = np.eye(units.shape[1]) + units.T @ matrix @ units
    at = np.linalg.lstsq(units, values - beliefs.mean, rcond=None)[0]
    slope = units.T @ score - at
    if before is not None:
        step, change = at - before.at, before.slope - slope
        expected = step @ inner @ step
        if before.least * expected < step @ change < MOST_CURVED * expected:
            inner = quasi_newton.updated(inner, step, change, least=HALF)
    damped = inner + damping * np.diag(np.diagonal(inner))
    move = units @ np.linalg.solve(damped, slope)
    return move, 0.5 * float(move @ matrix @ move), _Slope(at, slope)


def root(covariance: Float[np.ndarray, "parameter parameter"]) -> np.ndarray:
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


def scatter(done: Settled, beliefs: Beliefs) -> float:
    """`overdispersion` of a flight's scores at held gains."""
    free = np.diagonal(beliefs.covariance) > 0.0
    information = np.diagonal(done.last.told.matrix + done.last.apart.matrix)[free]
    return overdispersion(done.last.blocks[:, free], information)


def overdispersion(
    blocks: Float[np.ndarray, "block parameter"], information: Float[np.ndarray, " parameter"]
) -> float:
    """Variance of the scores of blocks over that of independent innovations, at least 1."""
    spread = np.sum((blocks - blocks.mean(axis=0)) ** 2, axis=0)
    seen = information > 0.0
    return max(float(np.median(spread[seen] / information[seen])), 1.0)
