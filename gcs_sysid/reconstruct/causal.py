"""The aided filter about its own predictions, and what its innovations say of the parameters.

Every row is linearised about the state that the filter expects before the row's measurements, so
that innovation ν and its sensitivity J to the parameters depend on the past only. With the right
intensities the innovations are independent of the past, and

    g = Σ Jᵀ S⁻¹ ν        H = Σ Jᵀ S⁻¹ J

have E g = 0 and E g gᵀ = H at the true parameters: an unbiased estimating equation (Godambe,
Biometrika 72, 1985; Ljung, *System Identification*, 2nd ed. 1999, chapter 7). Gains are held in J:
their own change with a parameter multiplies an innovation. About a *smoothed* flight neither would
hold, since its gusts were made from the accelerations that they are then asked to explain.

The flight the filter predicts moves with the parameters, and the pass about the old one gives the
new one, so that a search needs one pass a step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float, Int

from gcs_sysid import parallel, regressors
from gcs_sysid.aircraft import COEFFICIENTS, Aircraft
from gcs_sysid.frames import Array
from gcs_sysid.model import aided, aided_linear, aided_step
from gcs_sysid.model.aided import Means, Noise, Row, State
from gcs_sysid.model.aided_linear import Linearised
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.reconstruct import aided_smoother, linear_filter
from gcs_sysid.reconstruct.aided_smoother import Beginning, Chunk
from gcs_sysid.reconstruct.linear_filter import Belief
from gcs_sysid.regressors import Regressor

BLOCK = 100
"""Rows whose scores are told together: a second or two of flight."""

ASIDE = 32
"""Parameters that are asked about at once: a question with more or fewer of them, a cause's or
none, needs no program of its own, which takes seconds to trace and fifteen to compile. A hundred
and twenty-eight at once take as long as in four parts."""


class Path(NamedTuple):
    """A flight as the filter predicts it.

    Attributes:
        chunks: states that the filter believed after the row before, and expects at the row.
        start: belief about the deviation from the first of them.
    """

    chunks: list[Chunk]
    start: Belief


class Told(NamedTuple):
    """What innovations say of the parameters of the mean, in the order of `ravel_pytree`.

    Attributes:
        matrix: H, their information.
        score: g.
        count: number of measurements.
    """

    matrix: Float[np.ndarray, "parameter parameter"]
    score: Float[np.ndarray, " parameter"]
    count: float


class More(NamedTuple):
    """Terms that the model does not have, of which a pass is to tell as well.

    They come behind the parameters, coefficient by coefficient.

    Attributes:
        terms: regressors.
        constants: parameters that are the constants of the coefficients.
    """

    terms: tuple[Regressor, ...]
    constants: tuple[int, ...]


class Pass(NamedTuple):
    """One pass of the filter over a flight.

    Attributes:
        told: by the rows that count.
        apart: by the others.
        path: about which the next pass goes.
        blocks: scores of every `BLOCK` rows.
        log_likelihood: of every row.
        whitened: innovations over the root of their covariance.
        moved: how the state that is believed at the end moves with the parameters.
    """

    told: Told
    apart: Told
    path: Path
    blocks: Float[np.ndarray, "block parameter"]
    log_likelihood: Float[np.ndarray, " sample"]
    whitened: Float[np.ndarray, "sample row"]
    moved: Float[np.ndarray, "state parameter"]


def along(rows: Row, nominal: State, beginning: Beginning) -> Path:
    """A path along a nominal flight, where nothing better is known."""
    chunks = aided_smoother.chunks(rows, nominal)
    return Path(chunks, aided_smoother.belief(beginning, chunks))


def taken_up(path: Path, rows: Row, nominal: State) -> Path | None:
    """A path with the rows of a flight, where it is one of the same samples; None where it is not.

    Surfaces may be looked up otherwise in these rows.
    """
    chunks = aided_smoother.chunks(rows, nominal)
    if len(chunks) != len(path.chunks) or not all(
        np.array_equal(one.row.gyro, other.row.gyro)
        for one, other in zip(chunks, path.chunks, strict=True)
    ):
        return None
    pairs = zip(path.chunks, chunks, strict=True)
    return path._replace(chunks=[one._replace(row=other.row) for one, other in pairs])


def joined(model: FlightModel, means: Means, log_noise: Noise, path: Path) -> Iterator[Linearised]:
    """Every row about a path, chunk by chunk as they are asked for."""

    def one(chunk: Chunk, last: State | None) -> Linearised:
        return jax.block_until_ready(_joined(model, means, log_noise, chunk, last))

    return parallel.ahead(one, path.chunks, last_ends(path))


def _joined(
    model: FlightModel, means: Means, log_noise: Noise, chunk: Chunk, last: State | None
) -> Linearised:
    """The rows of a chunk, the deviation handed on where the path leaps at a measurement."""
    rows = aided_smoother.linearised(model, means, log_noise, chunk)
    return rows._replace(offset=_handed_on(rows, chunk, last))


def last_ends(path: Path) -> list[State | None]:
    """Where the row before each chunk ended; the first has none."""
    return [None, *(last_end(chunk) for chunk in path.chunks[:-1])]


def filtered(
    path: Path, rows: Iterable[Linearised]
) -> tuple[Path, Belief, list[linear_filter.Filtered]]:
    """The filter over a path: the path of its predictions, what is believed at its end, steps."""
    belief, steps, chunks = path.start, [], []
    for chunk, last, piece in zip(path.chunks, last_ends(path), rows, strict=True):
        predicted, belief, done = _stepped(chunk, last, belief, piece)
        chunks.append(predicted)
        steps.append(done)
    return _ahead(path, chunks), belief, steps


def _stepped(
    chunk: Chunk, last: State | None, begun: Belief, rows: Linearised
) -> tuple[Chunk, Belief, linear_filter.Filtered]:
    """The filter over a chunk: the chunk along its predictions, its end, its steps."""
    end, done = linear_filter.innovations(begun, rows)
    return _predicted(chunk, last, begun, done), end, done


def _ahead(path: Path, chunks: list[Chunk]) -> Path:
    """The path of a filter's predictions over another."""
    return Path(chunks, path.start._replace(mean=jnp.zeros_like(path.start.mean)))


def passed(
    model: FlightModel,
    means: Means,
    log_noise: Noise,
    path: Path,
    counts: Bool[np.ndarray, " sample"],
    *,
    chosen: Bool[np.ndarray, " parameter"] | None = None,
    more: More | None = None,
    apart: Bool[np.ndarray, " sample"] | None = None,
) -> Pass:
    """One pass over a flight.

    Args:
        model: the aircraft.
        means: parameters of the mean.
        log_noise: log intensities.
        path: about which the rows are linearised.
        counts: which rows `told` is made of.
        chosen: parameters that are asked about; of the others nothing is told. None for all.
        more: terms to tell of as well.
        apart: which rows `apart` is made of; None for all others.
    """
    every = ravel_pytree(means)[0].size
    asked = np.arange(every) if chosen is None else np.flatnonzero(chosen)
    size = asked.size
    if more is not None:
        size += len(more.terms) * len(more.constants)
    sensitivity = jnp.zeros((aided.SIZE, size))
    told, beside = _nothing(size), _nothing(size)
    others = ~counts if apart is None else apart
    first, blocks, places = 0, [], jnp.asarray(asked)
    belief, chunks, density, whitened = path.start, list[Chunk](), [], []

    def changed(chunk: Chunk, last: State | None) -> tuple[Linearised, Array, Array]:
        piece = _joined(model, means, log_noise, chunk, last)
        both = sensitivities(model, means, log_noise, chunk, piece, places)
        if more is not None:
            both = _with_more(model, more, means, chunk, *both)
        return jax.block_until_ready((piece, *both))

    lasts = last_ends(path)
    changes = parallel.ahead(changed, path.chunks, lasts)
    for chunk, last, (piece, motion, seen) in zip(path.chunks, lasts, changes, strict=True):
        predicted, belief, done = _stepped(chunk, last, belief, piece)
        chunks.append(predicted)
        density.append(done.log_likelihood)
        whitened.append(done.whitened)
        count = piece.offset.shape[0]
        wanted, further = (_piece(rows, first, count) for rows in (counts, others))
        sensitivity, white = _carried(sensitivity, piece, done, motion, seen)
        mine, its, sums = _gathered(white, done.whitened, jnp.asarray(wanted), jnp.asarray(further))
        blocks.append(np.asarray(sums))
        present = np.asarray(piece.present).sum(axis=1)
        told = _sum(told, mine, float(present[wanted].sum()))
        beside = _sum(beside, its, float(present[further].sum()))
        first += count
    scores, moved = np.concatenate(blocks), np.asarray(sensitivity)
    if chosen is not None:
        told, beside = _placed(told, asked, every), _placed(beside, asked, every)
        scores, moved = _columns(scores, asked, every), _columns(moved, asked, every)
    return Pass(
        told,
        beside,
        _ahead(path, chunks),
        scores,
        np.concatenate(density),
        np.concatenate(whitened),
        moved,
    )


def _piece(rows: Bool[np.ndarray, " sample"], first: int, count: int) -> Bool[np.ndarray, " piece"]:
    """Which rows of a chunk are meant; what fills it up beyond the flight never is."""
    part = rows[first : first + count]
    return np.pad(part, (0, count - part.size))


def _nothing(size: int) -> Told:
    return Told(np.zeros((size, size)), np.zeros(size), 0.0)


def _sum(told: Told, more: tuple[Array, Array], count: float) -> Told:
    matrix, score = more
    return Told(
        told.matrix + np.asarray(matrix), told.score + np.asarray(score), told.count + count
    )


def _placed(told: Told, asked: np.ndarray, size: int) -> Told:
    matrix = np.zeros((size, size))
    matrix[np.ix_(asked, asked)] = told.matrix
    return Told(matrix, _columns(told.score[None], asked, size)[0], told.count)


def _columns(values: np.ndarray, asked: np.ndarray, size: int) -> np.ndarray:
    out = np.zeros((*values.shape[:-1], size))
    out[..., asked] = values
    return out


@jax.jit
def _handed_on(rows: Linearised, chunk: Chunk, last: State | None) -> Float[Array, "sample state"]:
    """Offsets of rows that begin where the rows before them ended."""
    leap = leaps(ends(chunk, last), chunk.before)
    return rows.offset + jnp.einsum("kij,kj->ki", rows.transition, leap)


@jax.jit
def _predicted(
    chunk: Chunk, last: State | None, begun: Belief, done: linear_filter.Filtered
) -> Chunk:
    """A chunk along the states that the filter believed and expected."""
    before = jnp.concatenate([begun.mean[None], done.updated.mean[:-1]])
    return Chunk(
        moved(ends(chunk, last), before), moved(chunk.after, done.predicted.mean), chunk.row
    )


@jax.jit
def last_end(chunk: Chunk) -> State:
    """Where a chunk's last row ended, as a stretch of one."""
    return jax.tree.map(lambda part: part[-1:], chunk.after)


@jax.jit
def ends(chunk: Chunk, last: State | None) -> State:
    """Where the row before each one ended; `last` is the end of the chunk before."""
    first = jax.tree.map(lambda part: part[:1], chunk.before) if last is None else last
    return jax.tree.map(lambda one, rest: jnp.concatenate([one, rest[:-1]]), first, chunk.after)


@jax.jit
def leaps(first: State, second: State) -> Float[Array, "sample state"]:
    """By how much a row ends beside where the next one begins."""
    return jax.vmap(aided.difference)(first, second)


@jax.jit
def moved(state: State, error: Float[Array, "sample state"]) -> State:
    """States that differ by error states."""
    return jax.vmap(aided.compose)(state, error)


def sensitivities(
    model: FlightModel,
    means: Means,
    log_noise: Noise,
    chunk: Chunk,
    rows: Linearised,
    asked: Int[Array, " asked"],
) -> tuple[Float[Array, "sample state asked"], Float[Array, "sample row asked"]]:
    """Change of each row's offset and residual with the parameters asked about.

    What a parameter adds during a step, b in its middle, is carried to the step's end by Simpson's
    rule, h/6 (b + 4 Φ½ b + Φ b), consistent with the transition: what a change of state can make
    up for must cancel to its last digits.

    Args:
        model: the aircraft.
        means: parameters of the mean.
        log_noise: log intensities.
        chunk: of a path.
        rows: of the chunk, linearised about it.
        asked: places in the order of `ravel_pytree`, ascending.
    """
    # Parameters come in the order of `ravel_pytree`: aerodynamic terms before all others.
    terms, every = (ravel_pytree(part)[0].size for part in (means.aerodynamics, means))
    places = np.asarray(asked)
    own, others = places[places < terms], places[places >= terms]
    inner = aided_smoother.mechanics(model, means, chunk)
    about = (model, means, log_noise, chunk, rows, inner)
    found = [[np.zeros((*part.shape[:2], 0)) for part in (rows.transition, rows.sensitivity)]]
    if own.size:
        found.append([np.asarray(part)[..., own] for part in _of_terms(*about)])
    for first in range(0, others.size, ASIDE):
        group = others[first : first + ASIDE]
        # What lies behind the last parameter changes nothing.
        padded = np.pad(group, (0, ASIDE - group.size), constant_values=every)
        told = _of_others(*about, jnp.asarray(padded))
        found.append([np.asarray(part)[..., : group.size] for part in told])
    motion, seen = (jnp.asarray(np.concatenate(part, axis=-1)) for part in zip(*found, strict=True))
    return motion, seen


@jax.jit
def _of_others(
    model: FlightModel,
    means: Means,
    log_noise: Noise,
    chunk: Chunk,
    rows: Linearised,
    inner: Float[Array, "sample moving state"],
    asked: Int[Array, " asked"],
) -> tuple[Array, Array]:
    """Of any parameters, as many as `asked` is long."""
    flat, unravel = ravel_pytree(means)

    def with_(values: Float[Array, " asked"]) -> tuple[Aircraft, Means]:
        return model.aircraft, unravel(flat.at[asked].set(values))

    return _slopes(with_, flat[asked], log_noise, chunk, rows, inner)


@jax.jit
def _of_terms(
    model: FlightModel,
    means: Means,
    log_noise: Noise,
    chunk: Chunk,
    rows: Linearised,
    inner: Float[Array, "sample moving state"],
) -> tuple[Array, Array]:
    """Of all aerodynamic terms: how the six coefficients act, times what each is made of.

    That is taken at the rate of which moments know that lag behind it, in both rounds that find it:
    with a lag of 5 ms a damping is asked about half a percent too much or too little.
    """
    aircraft, controls = model.aircraft, model.aircraft.control_names
    beyond = aircraft.beyond
    terms = {
        name: {key: regressors.parse(key, controls=controls) for key in values}
        for name, values in means.aerodynamics.items()
    }
    own = {name: dict.fromkeys(some, COEFFICIENTS.index(name)) for name, some in terms.items()}
    coefficient = np.array(jax.tree.leaves(own), dtype=int)

    def with_(added: Float[Array, " six"]) -> tuple[Aircraft, Means]:
        def more(flow: Mapping[str, Array]) -> Array:
            return added if beyond is None else added + beyond(flow)

        return replace(aircraft, beyond=more), means

    def made(state: State, row: Row, when: int) -> Float[Array, " term"]:
        _, rate = aided.changing(aircraft, means, state, row, when)
        flow = aided.flow(aircraft, means, state._replace(rate=rate), row, when)
        values = jax.tree.map(lambda term: regressors.evaluate(term, flow), terms)
        return jnp.stack(jax.tree.leaves(values))

    def both(part: Chunk) -> tuple[Array, Array]:
        return made(_middle(part), part.row, 1), made(part.after, part.row, 2)

    slopes = _slopes(with_, jnp.zeros(len(COEFFICIENTS)), log_noise, chunk, rows, inner)
    motion, seen = (
        slope[..., coefficient] * values[:, None, :]
        for slope, values in zip(slopes, jax.vmap(both)(chunk), strict=True)
    )
    return motion, seen


def _slopes(
    with_: Callable[[Array], tuple[Aircraft, Means]],
    at: Float[Array, " number"],
    log_noise: Noise,
    chunk: Chunk,
    rows: Linearised,
    inner: Float[Array, "sample moving state"],
) -> tuple[Float[Array, "sample state number"], Float[Array, "sample row number"]]:
    """Of numbers of which aircraft and parameters are made."""
    decay = aided_linear.decay(aided_smoother.positive(log_noise))

    def one(part: Chunk, whole: Array, inner: Array) -> tuple[Array, Array]:
        middle = _middle(part)

        def ahead(values: Float[Array, " number"]) -> Float[Array, " state"]:
            return part.row.step * aided.motion(*with_(values), middle, part.row)

        def seen(values: Float[Array, " number"]) -> Float[Array, " row"]:
            return aided.innovation(*with_(values), part.after, part.row)

        moving = slice(0, aided.MOVING)  # nothing else is moved by a parameter
        added = jax.jacfwd(ahead)(at)[moving]
        half = aided_step.half(inner, decay, part.row)
        weight = 4.0 * half.motion[:, moving] + whole[moving, moving]
        carried = (added + weight @ added) / 6.0
        rest = ((0, aided.SIZE - aided.MOVING), (0, 0))
        return jnp.pad(carried, rest), jax.jacfwd(seen)(at)

    return jax.vmap(one)(chunk, rows.transition, inner)


def _middle(part: Chunk) -> State:
    """The nominal state in the middle of a row's step."""
    return aided.compose(part.before, 0.5 * aided.difference(part.after, part.before))


@partial(jax.jit, static_argnums=1)
def _with_more(
    model: FlightModel,
    more: More,
    means: Means,
    chunk: Chunk,
    motion: Float[Array, "sample state parameter"],
    seen: Float[Array, "sample row parameter"],
) -> tuple[Array, Array]:
    """Sensitivities to terms as well: those to a constant, times what the term is made of."""

    def one(part: Chunk) -> tuple[Array, Array]:
        found = []
        for at, when in ((_middle(part), 1), (part.after, 2)):
            felt = aided.flow(model.aircraft, means, at, part.row, when)
            values = [regressors.evaluate(term, felt) for term in more.terms]
            found.append(jnp.stack(values))
        return found[0], found[1]

    within, at_end = jax.vmap(one)(chunk)
    constants = np.array(more.constants)

    def stretched(columns: Array, values: Array) -> Array:
        products = columns[:, :, constants, None] * values[:, None, None, :]
        return jnp.concatenate([columns, products.reshape(*columns.shape[:2], -1)], axis=2)

    return stretched(motion, within), stretched(seen, at_end)


@jax.jit
def _gathered(
    white: Float[Array, "sample row parameter"],
    whitened: Float[Array, "sample row"],
    wanted: Bool[Array, " sample"],
    others: Bool[Array, " sample"],
) -> tuple[tuple[Array, Array], tuple[Array, Array], Float[Array, "block parameter"]]:
    """What a chunk tells: sums over some rows and over others, scores of blocks.

    Args:
        white: whitened sensitivities of the innovations.
        whitened: innovations.
        wanted: rows of the first sum.
        others: rows of the second.
    """

    def sums(chosen: Bool[Array, " sample"]) -> tuple[Array, Array]:
        own = jnp.where(chosen[:, None, None], white, 0.0)
        flat = own.reshape(-1, own.shape[-1])
        return flat.T @ flat, -flat.T @ whitened.reshape(-1)

    scores = -jnp.einsum("krp,kr->kp", white, whitened)
    return sums(wanted), sums(others), scores.reshape(-1, BLOCK, scores.shape[-1]).sum(axis=1)


class Moving(NamedTuple):
    """How rows move with parameters, gains held.

    Attributes:
        before: what the filter believed after the row before.
        after: what it expects at the row.
        motion: the row's offset.
        seen: its residual.
    """

    before: Float[Array, "sample state *parameter"]
    after: Float[Array, "sample state *parameter"]
    motion: Float[Array, "sample state *parameter"]
    seen: Float[Array, "sample row *parameter"]


@jax.jit
def followed(
    sensitivity: Float[Array, "state parameter"],
    rows: Linearised,
    done: linear_filter.Filtered,
    motion: Float[Array, "sample state parameter"],
    seen: Float[Array, "sample row parameter"],
) -> tuple[Array, Moving, Float[Array, "sample row parameter"]]:
    """Sensitivity of the filter's mean at a chunk's end, of its rows, and of its innovations."""
    seen = jnp.where(rows.present[:, :, None], seen, 0.0)

    def ahead(now: Array, item: tuple[Array, ...]) -> tuple[Array, tuple[Array, ...]]:
        transition, view, root, gain, moved, changed = item
        predicted = transition @ now + moved
        white = root @ (changed - view @ predicted)
        return predicted + gain.T @ white, (now, predicted, white)

    end, (before, after, white) = jax.lax.scan(
        ahead,
        sensitivity,
        (rows.transition, rows.sensitivity, done.root, done.gain, motion, seen),
    )
    return end, Moving(before, after, motion, seen), white


_carried = jax.jit(lambda *given: followed(*given)[::2])
"""Of `followed` the end and the innovations: the rest is not kept."""
