"""What a flight is asked: the likelihood's slope and information, with all that a filter changes.

With ν ~ N(0, S) and S = L Lᵀ, w = L⁻¹ν, T = L⁻¹∂ν and V = L⁻¹ ∂S L⁻ᵀ (Schweppe, IEEE Trans.
Information Theory 11, 1965; Gupta & Mehra, IEEE Trans. Automatic Control 19, 1974),

    ∂ log L = Σ −Tᵀw + ½ (wᵀ V w − tr V)        information = Σ Tᵀ T + ½ tr(V V)

T and V hold how gains change, of parameters and intensities alike, and how the flight that the
filter predicts moves with a parameter. A constant of the angle of attack is made up for by the
wind: about the flight as it was, slopes of curved coefficients would change and seem to tell it.

In place of the slope a parameter can be asked by its sensitivity J at held gains, Σ −Jᵀw. An error
e of all unknowns moves such sums by −A e, A = Σ Jᵀ T.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float, Int

from gcs_sysid.estimate import intensities
from gcs_sysid.frames import Array
from gcs_sysid.model import aided
from gcs_sysid.model.aided import Linearised, Means, Noise, State
from gcs_sysid.reconstruct import aided_smoother, causal, linear_filter
from gcs_sysid.reconstruct.aided_smoother import Chunk, FlightModel
from gcs_sysid.reconstruct.causal import Moving, Path
from gcs_sysid.reconstruct.linear_filter import Belief, Changed, Filtered

TOGETHER = 4
"""Unknowns whose changes are worked out side by side."""


class Instruments(NamedTuple):
    """What a flight is asked with, chunk by chunk, and what it can answer.

    T and V depend on the past only, so that the slope made of them has no bias where innovations
    are independent of the past, be they those of unknowns a little off or of approximate equations:
    worked out once, they serve for all steps of a search nearby.

    Attributes:
        chunks: T and V of each unknown, V as the pairs of `_pairs`; 0 in rows that are not asked.
            Of parameters that are not asked by the likelihood, J and no V.
        slope: by how much an error of each unknown, in columns, moves the sums that `scores` makes.
        scatter: of these sums, were innovations independent.
        information: Fisher's, of T and V of all.
    """

    chunks: tuple[Changed, ...]
    slope: Float[np.ndarray, "unknown unknown"]
    scatter: Float[np.ndarray, "unknown unknown"]
    information: Float[np.ndarray, "unknown unknown"]


def instruments(
    model: FlightModel,
    means: Means,
    log_noise: Noise,
    path: Path,
    counts: Bool[np.ndarray, " sample"],
    free: tuple[Bool[np.ndarray, " parameter"], Bool[np.ndarray, " intensity"]],
    sizes: Float[np.ndarray, " parameter"],
    by_likelihood: Bool[np.ndarray, " parameter"],
) -> Instruments:
    """Instruments of a flight.

    Args:
        model: the aircraft.
        means: parameters of the mean.
        log_noise: log intensities.
        path: that the filter predicts with them.
        counts: rows that are asked.
        free: parameters and intensities that are asked about, in the order of `ravel_pytree`.
        sizes: one deviation of each parameter, over which matrices are taken as linear. A map of
            thrust has corners: over a step too small, a sample that crosses one seems to tell much.
        by_likelihood: parameters that are found by the slope of the likelihood; the others by
            sensitivities at held gains.
    """
    found, noises = np.flatnonzero(free[0]), np.flatnonzero(free[1])
    asked = _Asked(model, means, log_noise, path, found, noises, sizes[found])
    about = intensities.lined(model, means, path, log_noise)
    start, first, chunks = path.start, 0, []
    sums = np.zeros((3, found.size + noises.size, found.size + noises.size))
    robust = np.flatnonzero(~by_likelihood[found])
    for chunk, rows, still in zip(path.chunks, *about[1:], strict=True):
        end, done = linear_filter.run(start, rows)
        wanted = np.zeros(chunk.row.step.size, dtype=bool)
        part = counts[first : first + wanted.size]
        wanted[: part.size] = part
        changed, held = asked.chunk(chunk, start, rows, done, still, wanted)
        every = _flat(changed)
        changed.innovation[robust], changed.spread[robust] = held[robust], 0.0
        own = _flat(changed)
        sums += np.stack([own @ every.T, own @ own.T, every @ every.T])
        chunks.append(changed)
        start, first = end, first + part.size
    return Instruments(tuple(chunks), *sums)


def _flat(changed: Changed) -> Float[np.ndarray, "unknown part"]:
    """T and V of a chunk so that their products are T·T + ½ tr(V V)."""
    count = len(changed.innovation)
    weight = np.sqrt(0.5 * _pairs(aided.ROW_COUNT)[2])
    parts = changed.innovation.reshape(count, -1), (changed.spread * weight).reshape(count, -1)
    return np.concatenate(parts, axis=1)


def scores(
    asked: Instruments, white: Float[np.ndarray, "sample row"]
) -> Float[np.ndarray, "block unknown"]:
    """Slope of the log-likelihood by every `causal.BLOCK` rows.

    Args:
        asked: instruments.
        white: innovations over the root of their covariance, of every chunk's every row.
    """
    first, second, weight = _pairs(white.shape[1])
    excess = 0.5 * weight * (white[:, first] * white[:, second] - (first == second))
    blocks, begin = [], 0
    for change, spread in asked.chunks:
        size, count, _ = change.shape
        rows = slice(begin, begin + count)
        each = np.einsum("ukp,kp->ku", spread, excess[rows])
        each -= np.einsum("ukr,kr->ku", change, white[rows])
        blocks.append(each.reshape(-1, causal.BLOCK, size).sum(axis=1))
        begin += count
    return np.concatenate(blocks)


class _Asked:
    """What unknowns change, chunk after chunk of one flight.

    Args:
        model: the aircraft.
        means: parameters of the mean.
        log_noise: log intensities.
        path: of the flight.
        found: parameters that are asked about.
        noises: intensities likewise.
        steps: of the parameters.
    """

    def __init__(
        self,
        model: FlightModel,
        means: Means,
        log_noise: Noise,
        path: Path,
        found: Int[np.ndarray, " parameter"],
        noises: Int[np.ndarray, " intensity"],
        steps: Float[np.ndarray, " parameter"],
    ) -> None:
        flat, unravel = ravel_pytree(means)
        logs, unravel_logs = ravel_pytree(log_noise)
        self._at = (model, means, log_noise)
        self._found, self._steps = jnp.asarray(found), steps
        self._moved = [
            unravel(flat.at[index].add(step)) for index, step in zip(found, steps, strict=True)
        ]
        self._louder = [unravel_logs(logs.at[at].add(intensities.DIFFERENCE)) for at in noises]
        self._beliefs = [jax.tree.map(jnp.zeros_like, path.start)] * (found.size + noises.size)
        self._sensitivity = jnp.zeros((aided.SIZE, found.size))
        self._last: State | None = None

    def chunk(
        self,
        chunk: Chunk,
        start: Belief,
        rows: Linearised,
        done: Filtered,
        still: intensities.Still,
        wanted: Bool[np.ndarray, " sample"],
    ) -> tuple[Changed, Float[np.ndarray, "parameter sample row"]]:
        """T and V of a chunk's rows that are wanted, an unknown each, and J of the parameters."""
        model, means, log_noise = self._at
        motion, seen = causal.sensitivities(model, means, log_noise, chunk, rows, self._found)
        self._sensitivity, follows, white = causal.followed(
            self._sensitivity, rows, done, motion, seen
        )
        leap = causal.leaps(causal.ends(chunk, self._last), chunk.before)
        self._last = jax.tree.map(lambda part: part[-1:], chunk.after)
        count, width = done.whitened.shape
        size, pairs = len(self._beliefs), _pairs(width)[0].size
        every = Changed(
            np.zeros((size, count, width), np.float32), np.zeros((size, count, pairs), np.float32)
        )
        for first in range(0, size, TOGETHER):
            group = range(first, min(first + TOGETHER, size))
            others = [self._other(number, chunk, rows, still, leap, follows) for number in group]
            spare = TOGETHER - len(others)
            begun = [*self._beliefs[first : first + TOGETHER], *[start] * spare]
            both = _changes(start, rows, done, [*others, *[rows] * spare], begun)
            for number, (belief, told) in zip(group, both, strict=False):
                self._beliefs[number] = belief
                every.innovation[number, wanted] = np.asarray(told.innovation)[wanted]
                every.spread[number, wanted] = np.asarray(told.spread)[wanted]
        steps = np.concatenate([self._steps, np.full(len(self._louder), intensities.DIFFERENCE)])
        held = np.where(wanted[:, None], np.moveaxis(np.asarray(white), 2, 0), 0.0)
        return Changed(*(part / steps.astype(np.float32)[:, None, None] for part in every)), held

    def _other(
        self,
        number: int,
        chunk: Chunk,
        rows: Linearised,
        still: intensities.Still,
        leap: Float[Array, "sample state"],
        follows: Moving,
    ) -> Linearised:
        """The rows with one unknown a step further."""
        model, _, log_noise = self._at
        if number >= len(self._moved):
            return intensities.at(self._louder[number - len(self._moved)], chunk, rows, still)
        moving = Moving(*(part[..., number] for part in follows))
        return _turned(
            model, self._moved[number], log_noise, chunk, leap, rows, moving, self._steps[number]
        )


@partial(jax.jit, static_argnums=0)
def _turned(
    model: FlightModel,
    means: Means,
    log_noise: Noise,
    chunk: Chunk,
    leap: Float[Array, "sample state"],
    rows: Linearised,
    moving: Moving,
    size: Float[Array, ""],
) -> Linearised:
    """The rows with a parameter's step of `size` taken in `means`.

    Matrices are those about the flight that has moved with it, offsets those that moved it there.
    """
    shifted = Chunk(
        causal.moved(chunk.before, size * moving.before),
        causal.moved(chunk.after, size * moving.after),
        chunk.row,
    )
    about = aided_smoother.linearised(model, means, log_noise, shifted)
    carried = jnp.einsum("kij,kj->ki", about.transition - rows.transition, leap)
    return about._replace(
        offset=rows.offset + carried + size * moving.motion,
        residual=rows.residual + size * moving.seen,
    )


@jax.jit
def _changes(
    start: Belief,
    rows: Linearised,
    done: Filtered,
    others: Sequence[Linearised],
    earlier: Sequence[Belief],
) -> list[tuple[Belief, Changed]]:
    """What other rows change, several side by side, which takes half the time."""
    first, second, _ = _pairs(aided.ROW_COUNT)
    stacked, begun = (
        jax.tree.map(lambda *parts: jnp.stack(parts), *all_) for all_ in (others, earlier)
    )
    change = jax.vmap(linear_filter.change, in_axes=(None, None, None, 0, 0))
    beliefs, told = change(start, rows, done, stacked, begun)
    told = told._replace(spread=told.spread[..., first, second])
    return [
        jax.tree.map(lambda part, at=at: part[at], (beliefs, told)) for at in range(len(others))
    ]


def _pairs(width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows and columns of the upper triangle, and how often each of its elements counts."""
    first, second = np.triu_indices(width)
    return first, second, np.where(first == second, 1.0, 2.0)
