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

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float, Int

from gcs_sysid import parallel
from gcs_sysid.estimate import intensities
from gcs_sysid.estimate.flight_rows import Unknowns
from gcs_sysid.frames import Array
from gcs_sysid.model import aided
from gcs_sysid.model.aided import Means, Noise, State
from gcs_sysid.model.aided_linear import Linearised
from gcs_sysid.model.aided_step import Half
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.reconstruct import aided_smoother, causal, linear_filter
from gcs_sysid.reconstruct.aided_smoother import Chunk
from gcs_sysid.reconstruct.causal import Moving, Path
from gcs_sysid.reconstruct.linear_filter import Belief, Changed, Filtered

HIDDEN = 1e-8
"""A stretch that tells less of a combination of unknowns than this share of what it could tells
nothing of how much gains and path take away."""

SWOLLEN = 2.0
"""Scores that an error moves by more than so many times what they scatter tell that of gains alone:
a bend that a stretch hardly reaches changes covariances there, and next to nothing that is
predicted. (A stall beyond an angle of attack flown for a tenth of a second: 65 times, and with it
everything else seemed to be known tens of times better on what took no part.)"""


class Curvature(NamedTuple):
    """What an error of the unknowns does to the sums that `scores` makes, and how these scatter.

    Attributes:
        slope: by how much an error of each unknown, in columns, moves the sums.
        scatter: of the sums, were innovations independent.
        information: Fisher's, of T and V of all.
    """

    slope: Float[np.ndarray, "unknown unknown"]
    scatter: Float[np.ndarray, "unknown unknown"]
    information: Float[np.ndarray, "unknown unknown"]

    def on(
        self,
        scatter: Float[np.ndarray, "unknown unknown"],
        precision: Float[np.ndarray, "unknown unknown"],
    ) -> Curvature:
        """As on a flight of which only the scatter is known, this being that of a stretch of it.

        How much of what J promises the gains and the path take away hangs on the aircraft and its
        gusts. In units of the scatter's symmetric root both are near one matrix, and what is taken
        from one to the other is how they differ from it: deviations by two busy stretches of 40 s
        are within 6 % of those by the whole flight. Sums that are moved by more than `SWOLLEN`
        times what they scatter are taken to be moved by that.

        Args:
            scatter: of the whole flight.
            precision: of the beliefs about the unknowns.
        """
        size, values, vectors = _unit(self.scatter + precision)
        seen = values > HIDDEN
        known, hidden = vectors[:, seen] / np.sqrt(values[seen]), vectors[:, ~seen]
        own, values, own_vectors = _unit(scatter + precision)
        root = (own_vectors * np.sqrt(np.maximum(values, 0.0))) @ own_vectors.T * own

        def carried(matrix: Float[np.ndarray, "unknown unknown"], most: float) -> np.ndarray:
            inner = known.T @ ((matrix + precision) / np.outer(size, size)) @ known
            left, factor, right = np.linalg.svd(inner)
            inner = (left * np.minimum(factor, most)) @ right
            relation = vectors[:, seen] @ inner @ vectors[:, seen].T + hidden @ hidden.T
            return root.T @ relation @ root - precision

        # What sums know of the unknowns goes with the square of how far they move.
        slope = carried(self.slope, SWOLLEN)
        return Curvature(slope, scatter, carried(self.information, SWOLLEN**2))


class Instruments(NamedTuple):
    """What a flight is asked with, chunk by chunk.

    T and V depend on the past only, so that the slope made of them has no bias where innovations
    are independent of the past, be they those of unknowns a little off or of approximate equations:
    worked out once, they serve for all steps of a search nearby.

    Attributes:
        innovations: of each chunk, T of the unknowns that are asked by the likelihood, J of the
            others; 0 in rows that are not asked.
        spreads: V of the former, as the pairs of `_pairs`.
        by_likelihood: which they are.
        about: unknowns with which they were worked out.
    """

    innovations: tuple[Float[np.ndarray, "unknown sample row"], ...]
    spreads: tuple[Float[np.ndarray, "asked sample pair"], ...]
    by_likelihood: Bool[np.ndarray, " unknown"]
    about: Unknowns


class Asking(NamedTuple):
    """Of what instruments are worked out.

    Attributes:
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

    model: FlightModel
    means: Means
    log_noise: Noise
    path: Path
    counts: Bool[np.ndarray, " sample"]
    free: tuple[Bool[np.ndarray, " parameter"], Bool[np.ndarray, " intensity"]]
    sizes: Float[np.ndarray, " parameter"]
    by_likelihood: Bool[np.ndarray, " parameter"]

    @property
    def asked(self) -> Bool[np.ndarray, " unknown"]:
        """Which unknowns are found by the slope of the likelihood: of intensities all."""
        found, noises = (np.flatnonzero(part) for part in self.free)
        return np.concatenate([self.by_likelihood[found], np.ones(noises.size, dtype=bool)])


def instruments(of: Asking) -> Instruments:
    """Instruments of a flight, without T and V of what the likelihood is not asked for.

    Those are most of the work; what they are for, a stretch of the flight tells: `Curvature.on`.
    """
    parts = [own for own, _ in _worked_out(of, np.flatnonzero(of.asked))]
    return Instruments(*zip(*parts, strict=True), of.asked, Unknowns(of.means, of.log_noise))


def curved(of: Asking) -> tuple[Instruments, Curvature]:
    """Instruments of a flight, and the curvature of the sums made with them."""
    asked, parts = of.asked, []
    slope, scatter, information = np.zeros((3, asked.size, asked.size))
    weight = np.sqrt(0.5 * _pairs(aided.ROW_COUNT)[2])
    for (own, turned), changed in _worked_out(of, np.arange(asked.size)):
        parts.append((own, turned))
        scatter += _scatter(own, turned, asked)
        flat, every = (_flat(each) for each in (own, changed.innovation))
        spread = _flat(changed.spread * weight)
        told = spread @ spread.T
        slope += flat @ every.T
        slope[asked] += told[asked]
        information += every @ every.T + told
    made = Instruments(*zip(*parts, strict=True), asked, Unknowns(of.means, of.log_noise))
    return made, Curvature(slope, scatter, information)


def _worked_out(
    of: Asking, wanted_of: Int[np.ndarray, " wanted"]
) -> Iterator[tuple[tuple[np.ndarray, np.ndarray], Changed]]:
    """Innovations and spreads of `Instruments`, and T and V of those wanted, of every chunk."""
    found, noises = (np.flatnonzero(part) for part in of.free)
    asked, part_of = of.asked, np.flatnonzero(of.asked[wanted_of])
    known = (of.model, of.means, of.log_noise)
    change = _Asked(*known, of.path, found, noises, of.sizes[found], wanted_of)
    about = intensities.lined(of.model, of.means, of.path, of.log_noise)
    start, first = of.path.start, 0
    for chunk, rows, still in zip(of.path.chunks, *about[1:], strict=True):
        end, done = linear_filter.run(start, rows)
        wanted = np.zeros(chunk.row.step.size, dtype=bool)
        part = of.counts[first : first + wanted.size]
        wanted[: part.size] = part
        changed, held = change.chunk(chunk, start, rows, done, still, wanted)
        own = np.zeros((asked.size, *held.shape[1:]), np.float32)
        own[~asked] = held[~of.by_likelihood[found]]
        own[asked] = changed.innovation[part_of]
        yield (own, changed.spread[part_of]), changed
        start, first = end, first + part.size


def _flat(parts: Float[np.ndarray, "unknown sample part"]) -> Float[np.ndarray, "unknown all"]:
    return parts.reshape(len(parts), math.prod(parts.shape[1:])).astype(np.float64)


def _unit(
    matrix: Float[np.ndarray, "row row"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Roots of a matrix's diagonal, and eigenvalues and vectors of what it is in units of them."""
    size = np.sqrt(np.maximum(np.diagonal(matrix), np.finfo(float).tiny))
    return size, *np.linalg.eigh(matrix / np.outer(size, size))


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
    for change, spread in zip(asked.innovations, asked.spreads, strict=True):
        size, count, _ = change.shape
        rows = slice(begin, begin + count)
        each = -np.einsum("ukr,kr->ku", change, white[rows])
        each[:, asked.by_likelihood] += np.einsum("ukp,kp->ku", spread, excess[rows])
        blocks.append(each.reshape(-1, causal.BLOCK, size).sum(axis=1))
        begin += count
    return np.concatenate(blocks)


def sums(
    asked: Instruments, white: Float[np.ndarray, "sample row"], counts: Bool[np.ndarray, " sample"]
) -> Float[np.ndarray, " unknown"]:
    """Slope of the log-likelihood by the rows that count.

    Instruments are of single precision, and so are the sums over a chunk: to 1e-6 of what they
    scatter.

    Args:
        asked: instruments of these rows and perhaps of others.
        white: innovations over the root of their covariance, of every chunk's every row.
        counts: rows that are summed.
    """
    first, second, weight = _pairs(white.shape[1])
    counted = np.zeros((white.shape[0], 1), dtype=bool)
    counted[: counts.size, 0] = counts
    shown = np.where(counted, white, 0.0)
    excess = 0.5 * weight * (shown[:, first] * shown[:, second] - (first == second) * counted)
    shown, excess = shown.astype(np.float32), excess.astype(np.float32)
    found, begin = np.zeros(asked.by_likelihood.size), 0
    for change, spread in zip(asked.innovations, asked.spreads, strict=True):
        rows = slice(begin, begin + change.shape[1])
        found -= change.reshape(len(change), -1) @ shown[rows].ravel()
        found[asked.by_likelihood] += spread.reshape(len(spread), -1) @ excess[rows].ravel()
        begin = rows.stop
    return found


def shares(asked: Instruments, count: int) -> Float[np.ndarray, " intensity"]:
    """Share of the covariance that each of the last `count` unknowns makes where it has a part.

    Where an intensity makes a share ρ of some rows' covariance and nothing of the others', V has
    2ρ in those, and tr VV over 2 tr V is ρ. Gains adapt, by which what is smaller falls off more
    slowly; the root of that foretells what half an intensity does to a tenth or two
    (`tests/estimate/test_likelihood.py`).
    """
    first, second, weight = _pairs(aided.ROW_COUNT)
    traces, squares = np.zeros((2, count))
    for spread in asked.spreads:
        own = spread[len(spread) - count :]
        traces += own[..., first == second].sum(axis=(1, 2))
        squares += np.einsum("ukp,ukp,p->u", own, own, weight)
    made = np.divide(squares, 2.0 * traces, out=np.zeros(count), where=traces > 0.0)
    return np.sqrt(np.minimum(made, 1.0))


def faded(
    louder: Float[np.ndarray, " intensity"], shares: Float[np.ndarray, " intensity"]
) -> Float[np.ndarray, " intensity"]:
    """What V has become of unknowns whose intensity is not what it was, as a share of what it was.

    dS goes with the square of the intensity, and S by as much of it as the intensity makes. Without
    that, less and less of what is not there went on promising as much as at first: of a flight in
    calm air gusts that had long been nothing were most of what was left to gain.

    Args:
        louder: change of the logarithm of each unknown's intensity.
        shares: of that intensity in the covariance.
    """
    square = np.exp(2.0 * louder)
    return square / (1.0 - shares + shares * square)


def scatter(
    asked: Instruments, counts: Bool[np.ndarray, " sample"]
) -> Float[np.ndarray, "unknown unknown"]:
    """Of the sums of the rows that count; the same wherever the flight is asked from."""
    size, begin = asked.by_likelihood.size, 0
    found = np.zeros((size, size))
    for change, spread in zip(asked.innovations, asked.spreads, strict=True):
        rows = np.flatnonzero(counts[begin : begin + change.shape[1]])
        if rows.size:
            found += _scatter(change[:, rows], spread[:, rows], asked.by_likelihood)
        begin += change.shape[1]
    return found


def _scatter(
    own: Float[np.ndarray, "unknown sample row"],
    turned: Float[np.ndarray, "asked sample pair"],
    by_likelihood: Bool[np.ndarray, " unknown"],
) -> Float[np.ndarray, "unknown unknown"]:
    """Of the sums of some rows, were innovations independent."""
    flat = _flat(own)
    spread = _flat(turned * np.sqrt(0.5 * _pairs(aided.ROW_COUNT)[2]))
    scatter = flat @ flat.T
    scatter[np.ix_(by_likelihood, by_likelihood)] += spread @ spread.T
    return scatter


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
        wanted_of: which of all these T and V are wanted of.
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
        wanted_of: Int[np.ndarray, " wanted"],
    ) -> None:
        flat, unravel = ravel_pytree(means)
        logs, unravel_logs = ravel_pytree(log_noise)
        self._at = (model, means, log_noise)
        self._found, self._steps, self._wanted_of = jnp.asarray(found), steps, wanted_of
        self._moved = [
            unravel(flat.at[index].add(step)) for index, step in zip(found, steps, strict=True)
        ]
        self._louder = [unravel_logs(logs.at[at].add(intensities.DIFFERENCE)) for at in noises]
        kinds = intensities.reaches(log_noise)
        self._reaches = [kinds[at] for at in noises]
        none = jax.tree.map(lambda part: jnp.zeros((intensities.TOGETHER, *part.shape)), path.start)
        self._beliefs = [none] * -(-wanted_of.size // intensities.TOGETHER)
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
        """T and V of a chunk's rows that are wanted, an unknown each, and J of all parameters."""
        model, means, log_noise = self._at
        motion, seen = causal.sensitivities(model, means, log_noise, chunk, rows, self._found)
        self._sensitivity, follows, white = causal.followed(
            self._sensitivity, rows, done, motion, seen
        )
        # Unknown by unknown, at once: taken out of JAX's arrays one by one each costs a program.
        follows = Moving(*(np.moveaxis(np.asarray(part), -1, 0).copy() for part in follows))
        leap = causal.leaps(causal.ends(chunk, self._last), chunk.before)
        self._last = causal.last_end(chunk)
        count, width = done.whitened.shape
        size, pairs = self._wanted_of.size, _pairs(width)[0].size
        half = intensities.halves(log_noise, chunk, still)
        every = Changed(
            np.zeros((size, count, width), np.float32), np.zeros((size, count, pairs), np.float32)
        )

        def together(first: int) -> None:
            group = range(first, min(first + intensities.TOGETHER, size))
            others = [
                self._other(int(self._wanted_of[place]), chunk, rows, still, half, leap, follows)
                for place in group
            ]
            others += [rows] * (intensities.TOGETHER - len(others))
            number = first // intensities.TOGETHER
            self._beliefs[number], told = _changes(start, rows, done, others, self._beliefs[number])
            for part, found in zip(every, told, strict=True):
                part[first : group.stop, wanted] = np.asarray(found)[: len(group), wanted]

        parallel.each(together, range(0, size, intensities.TOGETHER))
        steps = np.concatenate([self._steps, np.full(len(self._louder), intensities.DIFFERENCE)])
        steps = steps[self._wanted_of]
        held = np.where(wanted[:, None], np.moveaxis(np.asarray(white), 2, 0), 0.0)
        return Changed(*(part / steps.astype(np.float32)[:, None, None] for part in every)), held

    def _other(
        self,
        number: int,
        chunk: Chunk,
        rows: Linearised,
        still: intensities.Still,
        half: Half,
        leap: Float[Array, "sample state"],
        follows: Moving,
    ) -> Linearised:
        """The rows with one unknown a step further."""
        model, _, log_noise = self._at
        if number >= len(self._moved):
            at = number - len(self._moved)
            return intensities.nearby(self._louder[at], self._reaches[at], chunk, rows, still, half)
        moving = Moving(*(part[number] for part in follows))
        return _turned(
            model, self._moved[number], log_noise, chunk, leap, rows, moving, self._steps[number]
        )


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
    about = aided_smoother.linearised(model, means, log_noise, _shifted(chunk, moving, size))
    return _carried_there(about, rows, leap, moving, size)


@jax.jit
def _shifted(chunk: Chunk, moving: Moving, size: Float[Array, ""]) -> Chunk:
    return Chunk(
        causal.moved(chunk.before, size * moving.before),
        causal.moved(chunk.after, size * moving.after),
        chunk.row,
    )


@jax.jit
def _carried_there(
    about: Linearised,
    rows: Linearised,
    leap: Float[Array, "sample state"],
    moving: Moving,
    size: Float[Array, ""],
) -> Linearised:
    carried = jnp.einsum("kij,kj->ki", about.transition - rows.transition, leap)
    return about._replace(
        offset=rows.offset + carried + size * moving.motion,
        residual=rows.residual + size * moving.seen,
    )


@jax.jit
def _changes(
    start: Belief, rows: Linearised, done: Filtered, others: Sequence[Linearised], earlier: Belief
) -> tuple[Belief, Changed]:
    """`linear_filter.changes`, unknown by unknown, and of V one triangle."""
    first, second, _ = _pairs(aided.ROW_COUNT)
    end, told = linear_filter.changes(start, rows, done, others, earlier)
    told = told._replace(spread=told.spread[..., first, second])
    return end, jax.tree.map(lambda part: jnp.moveaxis(part, 0, 1), told)


def _pairs(width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows and columns of the upper triangle, and how often each of its elements counts."""
    first, second = np.triu_indices(width)
    return first, second, np.where(first == second, 1.0, 2.0)
