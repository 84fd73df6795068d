"""Gust and noise intensities of greatest likelihood, the parameters of the mean held.

Intensities enter the filter through the decay of the air and the covariances only. What the motion
of the aircraft contributes is worked out once for a path, and the gradient comes from the filter's
adjoint through matrices that are cheap to make. Steps are those of Fisher scoring, with the
information of innovations and of their covariance, ∂νᵀ S⁻¹ ∂ν + ½ tr(S⁻¹ ∂S S⁻¹ ∂S), on a stretch
of the flight, corrected by how the slope has changed and damped until the likelihood grows.

Which way the field of the gusts lies has as many answers as a circle, and no slope while nothing is
known of how gusts turn the air: `oriented` looks all around.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from enum import IntEnum
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float, Int

from gcs_sysid import parallel
from gcs_sysid.estimate import quasi_newton
from gcs_sysid.frames import Array
from gcs_sysid.model import aided, aided_linear, aided_step
from gcs_sysid.model.aided import Means, Noise, Row, State
from gcs_sysid.model.aided_linear import Linearised
from gcs_sysid.model.aided_step import Half
from gcs_sysid.model.air import Turbulence
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.reconstruct import aided_smoother, causal, linear_filter
from gcs_sysid.reconstruct.aided_smoother import LENGTHS, SHORTEST, Chunk
from gcs_sysid.reconstruct.causal import Path
from gcs_sysid.reconstruct.linear_filter import Belief

LONGEST_STEP = 0.7
"""An intensity changes by no more than this factor's logarithm in a step."""
DIFFERENCE = 1e-3
"""Step of a logarithm for the change of a covariance."""
SAMPLE_ROWS = 800
"""Rows on which the information is worked out."""
TOGETHER = 8
"""Unknowns whose changes are worked out side by side."""
MOST_TRIALS = 7
RENEWED = 4
"""After so many steps the information is worked out anew."""
WORTH = 1.0
"""A step that gained less than this is the last of its turn [nat]."""
AROUND, CLIMBED = 12, 4
"""Directions of the gusts' field that are tried, and steps after which the best is judged."""


class Prior(NamedTuple):
    """Log intensities believed before: their means and standard deviations, 0 for those held."""

    mean: Noise
    sigma: Noise


class Search(NamedTuple):
    """Where a search stands.

    Attributes:
        log_noise: the intensities.
        damping: of the next step.
        taken: steps so far.
        information: of the flight and the prior.
        before: values and slope before the last step.
        gained: log posterior density that the last step gained.
    """

    log_noise: Noise
    damping: float = 0.1
    taken: int = 0
    information: Float[np.ndarray, "intensity intensity"] | None = None
    before: tuple[np.ndarray, np.ndarray] | None = None
    gained: float = np.inf


def climbed(
    model: FlightModel, means: Means, path: Path, prior: Prior, search: Search, steps: int
) -> Search:
    """So many steps about one path; `gained` is that of all of them.

    Slopes of an earlier path, with other means, say nothing of the curvature here. Where all are
    held nothing is to be gained.
    """
    if not np.any(ravel_pytree(prior.sigma)[0]):
        return search._replace(gained=0.0)
    search, gained = search._replace(before=None), 0.0
    about = lined(model, means, path, search.log_noise)
    for _ in range(steps):
        search = _stepped(about, prior, search)
        gained += search.gained
        if search.gained < WORTH:
            break
    return search._replace(gained=gained)


def oriented(model: FlightModel, means: Means, path: Path, prior: Prior, log_noise: Noise) -> Noise:
    """The intensities with the gusts' field turned the way that the flight makes most likely.

    All around, with times and rotations as they were believed before: those found with a field
    that lies another way have grown to make up for it. The best of them, and the intensities as
    they are, then climb side by side; where the best is next to these, they are what they were.

    Args:
        model: the aircraft.
        means: parameters of the mean.
        path: about which the rows are linearised.
        prior: of whose deviations the coupling's is tried.
        log_noise: intensities.
    """
    about = lined(model, means, path, log_noise)
    pitching, yawing = np.asarray(prior.sigma.turbulence.coupling)
    believed, tried = prior.mean.turbulence, []
    level = jnp.mean(log_noise.turbulence.gust[:2])
    for azimuth in np.linspace(-np.pi, np.pi, AROUND, endpoint=False):
        for sign in (1.0, -1.0):
            turbulence = believed._replace(
                gust=log_noise.turbulence.gust.at[:2].set(level),
                coupling=jnp.array([pitching, sign * yawing]),
                azimuth=jnp.asarray(azimuth),
            )
            tried.append(log_noise._replace(turbulence=turbulence))
    turned = _likeliest(tried, about)
    if _alike(turned.turbulence, log_noise.turbulence):
        return log_noise

    def climb(begun: Noise) -> tuple[float, Noise]:
        search = climbed(model, means, path, prior, Search(begun), CLIMBED)
        return _density(search.log_noise, about), search.log_noise

    return max(parallel.each(climb, (log_noise, turned)), key=lambda end: end[0])[1]


class _Runner(NamedTuple):
    """Intensities, the log-likelihood of what they have gone over, and the belief there."""

    log_noise: Noise
    density: float
    end: Belief

    def onward(self, about: Lined, part: slice) -> _Runner:
        """Over the next chunks."""
        end, density = _flown(self.log_noise, about, part, self.end)
        return _Runner(self.log_noise, self.density + density, end)

    def rank(self) -> float:
        """The smaller the likelier; a flight that was lost comes last."""
        return -np.nan_to_num(self.density, nan=-np.inf)


def _likeliest(tried: Sequence[Noise], about: Lined) -> Noise:
    """Of some intensities those of greatest likelihood, in heats.

    All go over a part of the flight, the better half of them over the next, until the flight is at
    its end: two fifths of the work, and of directions next to each other either does.
    """
    heats = min(math.ceil(math.log2(len(tried))), len(about.rows))
    bounds = np.linspace(0, len(about.rows), heats + 1).astype(int)
    left = [_Runner(one, 0.0, about.path.start) for one in tried]
    for first, last in itertools.pairwise(bounds):
        part = slice(first, last)
        ahead = parallel.each(_Runner.onward, left, [about] * len(left), [part] * len(left))
        left = sorted(ahead, key=_Runner.rank)[: max(len(ahead) // 2, 1)]
    return left[0].log_noise


def _alike(first: Turbulence, second: Turbulence) -> bool:
    """Whether two fields lie within one of the directions that are tried of each other.

    A field is the same turned by half a circle with the rotations of its gusts reversed.
    """
    product = np.asarray(first.coupling * second.coupling)
    same, reversed_ = bool(np.all(product > 0.0)), bool(np.all(product < 0.0))
    between = float(first.azimuth - second.azimuth) + np.pi * reversed_
    near = abs((between + np.pi) % (2.0 * np.pi) - np.pi) < 2.0 * np.pi / AROUND
    return near and (same or reversed_)


class Lined(NamedTuple):
    """A flight linearised about a path under some intensities.

    Attributes:
        path: the path.
        rows: linearised, chunk by chunk.
        still: what of them no intensity changes.
    """

    path: Path
    rows: list[Linearised]
    still: list[Still]


class Still(NamedTuple):
    """What no intensity changes of linearised rows.

    Attributes:
        mechanics: their Jacobians, but for what decays by itself.
        slow: nominal air and slow errors that a step begins with, as an error state.
    """

    mechanics: Float[Array, "*sample moving state"]
    slow: Float[Array, "*sample state"]


def lined(model: FlightModel, means: Means, path: Path, log_noise: Noise) -> Lined:
    """A flight linearised about a path."""
    rows = list(causal.joined(model, means, log_noise, path))
    still = parallel.each(
        lambda chunk, last: jax.block_until_ready(
            Still(aided_smoother.mechanics(model, means, chunk), _slow(chunk, last))
        ),
        path.chunks,
        causal.last_ends(path),
    )
    return Lined(path, rows, still)


def _density(log_noise: Noise, about: Lined) -> float:
    """Log-likelihood of a flight."""
    return _flown(log_noise, about, slice(None), about.path.start)[1]


def _flown(log_noise: Noise, about: Lined, part: slice, start: Belief) -> tuple[Belief, float]:
    """The filter over some chunks of a flight: its end, and their log-likelihood."""
    total = []
    given = (about.path.chunks[part], about.rows[part], about.still[part])
    for piece in parallel.ahead(partial(_ready_at, log_noise), *given):
        start, density = linear_filter.likelihood(start, piece)
        total.append(density)
    return start, sum(float(density) for density in total)


def _stepped(about: Lined, prior: Prior, search: Search) -> Search:
    """One step of the search."""
    flat, unravel = ravel_pytree(search.log_noise)
    values = np.asarray(flat)
    centre, sigma = (np.asarray(ravel_pytree(part)[0]) for part in prior)
    free = sigma > 0.0
    weight = np.where(free, 1.0 / np.where(free, sigma, 1.0) ** 2, 0.0)
    density, found, begun = _slope(search.log_noise, about)
    slope = found - weight * (values - centre)
    information = search.information
    if information is None or search.taken % RENEWED == 0:
        information = _information(search.log_noise, about, begun, free)
        information = information + np.diag(np.where(free, weight, 1.0))
    if search.before is not None:
        information = quasi_newton.updated(
            information, values - search.before[0], search.before[1] - slope
        )

    def posterior(at: Float[np.ndarray, " intensity"]) -> float:
        penalty = 0.5 * float(np.sum(weight * (at - centre) ** 2))
        return _density(unravel(jnp.asarray(at)), about) - penalty

    here = density - 0.5 * float(np.sum(weight * (values - centre) ** 2))
    damping, diagonal = search.damping, np.diag(np.abs(np.diagonal(information)))
    chosen, longest = np.ix_(free, free), np.full(np.count_nonzero(free), LONGEST_STEP)
    for _ in range(MOST_TRIALS):
        move = np.zeros_like(values)
        move[free] = quasi_newton.bounded(
            (information + damping * diagonal)[chosen], slope[free], longest
        )
        there = posterior(values + move)
        if np.isfinite(there) and there > here:
            return Search(
                unravel(jnp.asarray(values + move)),
                max(damping / 5.0, 1e-5),
                search.taken + 1,
                information,
                (values, slope),
                there - here,
            )
        damping = max(6.0 * damping, 1e-2)
    # Nothing gained: from here the search begins anew, with fresh information.
    return Search(search.log_noise, information=information, gained=0.0)


def _slope(
    log_noise: Noise, about: Lined
) -> tuple[float, Float[np.ndarray, " intensity"], list[Belief]]:
    """Log-likelihood, its gradient, and the belief before each chunk."""
    path = about.path
    rows = parallel.each(partial(_ready_at, log_noise), path.chunks, *about[1:])
    begun, steps = [path.start], []
    for piece in rows:
        end, done = linear_filter.run(begun[-1], piece)
        begun.append(end)
        steps.append(done)
    later = jax.tree.map(jnp.zeros_like, path.start)
    slopes = []
    for piece, first, done in zip(rows[::-1], begun[-2::-1], steps[::-1], strict=True):
        later, slope = linear_filter.adjoint(first, piece, done, later)
        slopes.append(slope)

    def pulled(*at: Any) -> Noise:
        return jax.block_until_ready(_pulled_back(log_noise, *at))

    told = parallel.each(pulled, path.chunks, about.still, slopes[::-1])
    density = sum(float(np.sum(done.log_likelihood)) for done in steps)
    gradient = np.sum([np.asarray(ravel_pytree(part)[0]) for part in told], axis=0)
    return density, gradient, begun


class _Driven(NamedTuple):
    """What intensities are to a row: all that they enter by.

    Attributes:
        decay: how the air and the slow errors change by themselves, where `passing` is 1.
        driving: spectral density of the white noise there, where the equations are believed.
        doubted: where they are not.
        variance: of the measurements.
    """

    decay: Float[Array, "slow slow"]
    driving: Float[Array, "state state"]
    doubted: Float[Array, "state state"]
    variance: Float[Array, " row"]


def _driven(log_noise: Noise) -> _Driven:
    noise = aided_smoother.positive(log_noise)
    believed, doubted = (
        aided_linear.driving(aided_linear.doubted(noise, jnp.asarray(modelled)))
        for modelled in (True, False)
    )
    return _Driven(
        aided_linear.decay(noise), believed, doubted, aided_linear.measurement_variance(noise)
    )


class _Covered(NamedTuple):
    """The parts of a linearised row that intensities change."""

    transition: Float[Array, "*sample state state"]
    process: Float[Array, "*sample state state"]
    variance: Float[Array, "*sample row"]


@jax.jit
def _every(log_noise: Noise, chunk: Chunk, still: Still) -> _Covered:
    driven = _driven(log_noise)

    def one(row: Row, still: Still) -> _Covered:
        half = aided_step.half(still.mechanics, driven.decay, row)
        noise = jnp.where(row.modelled, driven.driving, driven.doubted)
        return _Covered(
            aided_step.whole(half),
            aided_step.process(half, row, noise),
            jnp.where(aided_linear.present_rows(row), driven.variance, 1.0),
        )

    return jax.vmap(one)(chunk.row, still)


@jax.jit
def _slow(chunk: Chunk, last: State | None) -> Float[Array, "sample state"]:
    ended = causal.ends(chunk, last)
    errors = (getattr(ended, name) for name in aided.ERRORS)
    slow = jnp.concatenate([*ended.air, *errors], axis=1)
    return jnp.pad(slow, ((0, 0), (aided.MOVING, 0)))


@jax.jit
def _pulled_back(log_noise: Noise, chunk: Chunk, still: Still, slope: Linearised) -> Noise:
    """Gradient with respect to intensities, from that with respect to every row's matrices.

    By hand as far as the few matrices that all rows share: taken through `_every` by the machine it
    takes nearly twice as long (114 ms for 2000 rows instead of 68).
    """
    driven, pull_back = jax.vjp(_driven, log_noise)
    unit = jnp.eye(aided.SIZE)
    slow = slice(aided.MOVING, aided.SIZE)

    def one(row: Row, still: Still, by: Linearised) -> tuple[Array, Array, Array]:
        passed = aided_step.passing(row)[:, None]
        decaying = jnp.pad(passed[slow] * driven.decay, ((0, 0), (aided.MOVING, 0)))
        rates = 0.5 * row.step * jnp.concatenate([still.mechanics, decaying])
        inmost = unit + rates / 4.0
        inner = unit + rates @ inmost / 3.0
        outer = unit + rates @ inner / 2.0
        half = unit + rates @ outer
        # Transition ½½, and process h/6 (D + 4 M + ½M½ᵀ) with M = ½D½ᵀ.
        noise = passed * jnp.where(row.modelled, driven.driving, driven.doubted)
        through = half @ noise
        middle = through @ half.T
        moved = by.transition + by.offset[:, None] * still.slow[None, :]
        early = row.step / 6.0 * by.process
        turned = early @ half
        of_middle = 4.0 * early + half.T @ turned
        of_half = moved @ half.T + half.T @ moved
        of_half = of_half + 2.0 * (turned @ middle + of_middle @ through)
        of_noise = early + half.T @ (of_middle @ half)
        # The series from its outermost bracket inward, columns of what decays.
        first = of_half[:, slow]
        second = rates.T @ first
        third = rates.T @ second / 2.0
        of_rates = first[slow] @ outer[slow, slow].T + second[slow] @ inner[slow, slow].T / 2.0
        of_rates = of_rates + third[slow] @ inmost[slow, slow].T / 3.0
        of_rates = of_rates + (rates.T @ third)[slow] / 12.0
        variance = jnp.where(aided_linear.present_rows(row), by.variance, 0.0)
        return 0.5 * row.step * passed[slow] * of_rates, passed * of_noise, variance

    decay, noise, variance = jax.vmap(one)(chunk.row, still, slope)
    believed = chunk.row.modelled[:, None, None]
    told = _Driven(
        jnp.sum(decay, axis=0),
        jnp.sum(jnp.where(believed, noise, 0.0), axis=0),
        jnp.sum(jnp.where(believed, 0.0, noise), axis=0),
        jnp.sum(variance, axis=0),
    )
    return pull_back(told)[0]


@jax.jit
def at(log_noise: Noise, chunk: Chunk, rows: Linearised, still: Still) -> Linearised:
    """The rows with other intensities.

    What is slow decays at another rate, which the offset takes up.
    """
    found = _every(log_noise, chunk, still)
    decayed = jnp.einsum("kij,kj->ki", found.transition - rows.transition, still.slow)
    return rows._replace(
        transition=found.transition,
        offset=rows.offset + decayed,
        process=found.process,
        variance=found.variance,
    )


class Reach(IntEnum):
    """How far an intensity reaches into a row's matrices, each kind as far as those before it."""

    MEASURED = 0
    DRIVEN = 1
    DECAYING = 2


def reaches(log_noise: Noise) -> list[Reach]:
    """Of each intensity, in the order of `ravel_pytree`."""
    return [
        Reach.DECAYING if slow else Reach.DRIVEN if loud else Reach.MEASURED
        for slow, loud in zip(*_touched(log_noise), strict=True)
    ]


def floors(log_noise: Noise) -> Float[np.ndarray, " intensity"]:
    """Logarithm of how much each intensity moves what it stands for, 0 for most.

    A length far below the shortest changes nothing.
    """
    none = jax.tree.map(jnp.zeros_like, log_noise)
    square = {name: jnp.exp(2.0 * getattr(log_noise.turbulence, name)) for name in LENGTHS}
    moved = {name: jnp.log(each / (each + SHORTEST**2)) for name, each in square.items()}
    found = none._replace(turbulence=none.turbulence._replace(**moved))
    return np.asarray(ravel_pytree(found)[0])


def deviations(log_noise: Noise) -> Int[np.ndarray, " intensity"]:
    """Place of the intensity that each one goes by, itself for most.

    Lengths, times and how gusts turn the air change nothing where there are no gusts or errors.
    """
    flat, unravel = ravel_pytree(log_noise)
    own: Noise = unravel(jnp.arange(flat.size, dtype=flat.dtype))
    gust, spin = own.turbulence.gust, own.turbulence.spin
    turned = {"coupling": jnp.stack([gust[2], gust[1]]), "azimuth": gust[1]}
    by = own._replace(
        turbulence=own.turbulence._replace(gust_length=gust, spin_length=spin, **turned),
        attitude_error_time=own.attitude_error,
        velocity_error_time=own.velocity_error,
    )
    return np.asarray(ravel_pytree(by)[0]).astype(int)


@jax.jit
def _touched(log_noise: Noise) -> tuple[Bool[Array, " intensity"], Bool[Array, " intensity"]]:
    """Which intensities change how the air decays, and which what drives it."""
    flat, unravel = ravel_pytree(log_noise)
    slopes = jax.jacfwd(lambda values: _driven(unravel(values)))(flat)
    loud = jnp.concatenate([slopes.driving, slopes.doubted])
    return jnp.any(slopes.decay != 0.0, axis=(0, 1)), jnp.any(loud != 0.0, axis=(0, 1))


@jax.jit
def halves(log_noise: Noise, chunk: Chunk, still: Still) -> Half:
    """Transitions over half of each step."""
    decay = _driven(log_noise).decay
    half = jax.vmap(aided_step.half, in_axes=(0, None, 0))
    return half(still.mechanics, decay, chunk.row)


def nearby(
    log_noise: Noise,
    reach: Reach,
    chunk: Chunk,
    rows: Linearised,
    still: Still,
    half: Half,
) -> Linearised:
    """`at`, where what the rows have been made with differs in an intensity of that reach only.

    Most of the work is for the transitions, which most intensities leave alone.
    """
    if reach is Reach.DECAYING:
        return at(log_noise, chunk, rows, still)
    found = rows._replace(variance=_variance(log_noise, chunk))
    if reach is Reach.DRIVEN:
        found = found._replace(process=_process(log_noise, chunk, half))
    return found


@jax.jit
def _variance(log_noise: Noise, chunk: Chunk) -> Float[Array, "sample row"]:
    present = jax.vmap(aided_linear.present_rows)(chunk.row)
    return jnp.where(present, _driven(log_noise).variance, 1.0)


@jax.jit
def _process(log_noise: Noise, chunk: Chunk, half: Half) -> Float[Array, "sample state state"]:
    driven = _driven(log_noise)

    def one(row: Row, half: Half) -> Array:
        noise = jnp.where(row.modelled, driven.driving, driven.doubted)
        return aided_step.process(half, row, noise)

    return jax.vmap(one)(chunk.row, half)


def _ready_at(log_noise: Noise, *item: Any) -> Linearised:
    return jax.block_until_ready(at(log_noise, *item))


def _information(
    log_noise: Noise, about: Lined, begun: Sequence[Belief], free: np.ndarray
) -> Float[np.ndarray, "intensity intensity"]:
    """Σ ∂νᵀ S⁻¹ ∂ν + ½ tr(S⁻¹ ∂S S⁻¹ ∂S), from the chunks in the middle.

    Intensities change the gains, and with them the innovations themselves.
    """
    size = about.path.chunks[0].row.step.shape[0]
    count = min(-(-SAMPLE_ROWS // size), len(about.path.chunks))
    first = (len(about.path.chunks) - count) // 2
    taken = slice(first, first + count)
    chunks, still, starts = about.path.chunks[taken], about.still[taken], begun[taken]
    flat, unravel = ravel_pytree(log_noise)
    here = [at(log_noise, *item) for item in zip(chunks, about.rows[taken], still, strict=True)]
    steps = [linear_filter.run(*item)[1] for item in zip(starts, here, strict=True)]
    half = [halves(log_noise, *item) for item in zip(chunks, still, strict=True)]
    kinds = reaches(log_noise)

    places = np.flatnonzero(free).tolist()
    none = jax.tree.map(lambda part: jnp.zeros((TOGETHER, *part.shape)), starts[0])

    def change(first: int) -> Float[np.ndarray, "intensity told"]:
        group, belief, told = places[first : first + TOGETHER], none, []
        moved = [unravel(flat.at[place].add(DIFFERENCE)) for place in group]
        for chunk, slow, start, rows, done, through in zip(
            chunks, still, starts, here, steps, half, strict=True
        ):
            others = [
                nearby(noise, kinds[place], chunk, rows, slow, through)
                for noise, place in zip(moved, group, strict=True)
            ]
            others += [rows] * (TOGETHER - len(group))
            belief, found = linear_filter.changes(start, rows, done, others, belief)
            for part, scale in zip(found, (1.0, np.sqrt(0.5)), strict=True):
                flat_part = np.moveaxis(np.asarray(part, float), 1, 0).reshape(TOGETHER, -1)
                told.append(scale * flat_part[: len(group)])
        return np.concatenate(told, axis=1) / DIFFERENCE

    changes = np.concatenate(parallel.each(change, range(0, len(places), TOGETHER)))
    every = sum(int(np.sum(np.asarray(part.row.step) > 0.0)) for part in about.path.chunks)
    seen = max(sum(int(np.sum(np.asarray(part.row.step) > 0.0)) for part in chunks), 1)
    out = np.zeros((flat.size, flat.size))
    out[np.ix_(free, free)] = every / seen * changes @ changes.T
    return out
