"""The aerodynamics-aided smoother: states, air and their covariance from the whole flight model.

A flight is linearised about a nominal one (all rows at once), filtered and smoothed as a linear
system, and the smoothed flight becomes the next nominal: Gauss–Newton on the states (Bell, *The
iterated Kalman smoother as a Gauss–Newton method*, 1994). Two or three rounds converge from a
kinematic reconstruction. The likelihood and its gradient refer to the converged nominal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Float

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.frames import Array
from gcs_sysid.model import aided
from gcs_sysid.model.aided import Linearised, Means, Noise, Row, State
from gcs_sysid.reconstruct import linear_filter
from gcs_sysid.reconstruct.linear_filter import Belief, Filtered, Information

CHUNK = 2000
BATCH = 400
"""Rows that are differentiated together: what they need in between stays in the cache."""


@dataclass(frozen=True, eq=False)
class FlightModel:
    """An aircraft as the filter looks it up; compared by identity, compiled once each."""

    aircraft: Aircraft


class Chunk(NamedTuple):
    """A stretch of a flight with its nominal states at both ends of every step."""

    before: State
    after: State
    row: Row


class Beginning(NamedTuple):
    """Belief about the state before the first row.

    Attributes:
        state: its mean.
        covariance: of the deviation from it.
    """

    state: State
    covariance: Float[Array, "state state"]


class Smoothed(NamedTuple):
    """Deviation of the smoothed from the nominal flight, and how well the model foretold it.

    Attributes:
        belief: mean and covariance of the deviation at every row.
        log_likelihood: of every row's innovation.
        whitened: innovations over their standard deviation.
    """

    belief: Belief
    log_likelihood: Float[np.ndarray, " sample"]
    whitened: Float[np.ndarray, "sample row"]


def positive(log_noise: Noise) -> Noise:
    """Intensities from their logarithms; the coupling of the gusts, which has a sign, as it is."""
    noise = jax.tree.map(jnp.exp, log_noise)
    coupling = log_noise.turbulence.coupling
    return noise._replace(turbulence=noise.turbulence._replace(coupling=coupling))


@partial(jax.jit, static_argnums=0)
def linearised(model: FlightModel, means: Means, log_noise: Noise, chunk: Chunk) -> Linearised:
    """Every row of a chunk about its nominal flight."""
    noise = positive(log_noise)

    def one(part: Chunk) -> Linearised:
        return aided.linearise(model.aircraft, means, noise, part.before, part.after, part.row)

    return jax.vmap(one)(chunk)


@partial(jax.jit, static_argnums=0)
def _pulled_back(
    model: FlightModel, means: Means, log_noise: Noise, chunk: Chunk, slope: Linearised
) -> tuple[Means, Noise, Float[Array, "sample state"], Float[Array, "sample state"]]:
    """From a gradient with respect to the matrices to that with respect to what they come from.

    Returns:
        With respect to means, log intensities, and error states of the nominal flight at the
        beginning and the end of each row's step.
    """

    def matrices(
        part: Chunk, values: Means, logs: Noise, before: Array, after: Array
    ) -> Linearised:
        moved = Chunk(_composed(part.before, before), _composed(part.after, after), part.row)
        rows = linearised(model, values, logs, moved)
        return rows._replace(present=rows.present.astype(rows.residual.dtype))

    def pulled(item: tuple[Chunk, Linearised]) -> tuple[Means, Noise, Array, Array]:
        part, of_part = item
        zero = jnp.zeros((part.row.step.shape[0], aided.SIZE))
        _, pull_back = jax.vjp(partial(matrices, part), means, log_noise, zero, zero)
        return pull_back(of_part)

    count = chunk.row.step.shape[0]
    size = BATCH if count % BATCH == 0 else count
    batches = jax.tree.map(
        lambda part: part.reshape(count // size, size, *part.shape[1:]), (chunk, slope)
    )
    *parameters, before, after = jax.lax.map(pulled, batches)
    total = jax.tree.map(partial(jnp.sum, axis=0), parameters)
    return *total, before.reshape(count, -1), after.reshape(count, -1)


@partial(jax.jit, static_argnums=0)
def _sensitivities(
    model: FlightModel, means: Means, chunk: Chunk, rows: Linearised
) -> tuple[Float[Array, "sample state parameter"], Float[Array, "sample row parameter"]]:
    """Change of each row's offset and residual with every parameter of the mean.

    That of the offset is the change of what the step adds in its middle, which half a transition,
    to its first order, carries to the step's end.
    """
    flat, unravel = ravel_pytree(means)

    def one(part: Chunk, transition: Array) -> tuple[Array, Array]:
        middle = aided.compose(part.before, 0.5 * aided.difference(part.after, part.before))

        def ahead(values: Float[Array, " parameter"]) -> Float[Array, " state"]:
            return part.row.step * aided.motion(model.aircraft, unravel(values), middle, part.row)

        def seen(values: Float[Array, " parameter"]) -> Float[Array, " row"]:
            return aided.innovation(model.aircraft, unravel(values), part.after, part.row)

        added = jax.jacfwd(ahead)(flat)
        return 0.5 * (added + transition @ added), jax.jacfwd(seen)(flat)

    return jax.vmap(one)(chunk, rows.transition)


@jax.jit
def _composed(state: State, error: Float[Array, "sample state"]) -> State:
    return jax.vmap(aided.compose)(state, error)


def chunks(rows: Row, nominal: State) -> list[Chunk]:
    """A flight in chunks of `CHUNK` rows, the last one padded with rows that change nothing.

    Args:
        rows: the flight, arrays of NumPy.
        nominal: state at the end of each row's step.
    """
    count = rows.step.shape[0]
    pieces = []
    for first in range(0, count, CHUNK):
        index = np.arange(first, first + CHUNK)
        inside = index < count
        index = np.minimum(index, count - 1)
        earlier = np.where(inside, np.maximum(index - 1, 0), index)
        take = partial(_taken, index)
        row = jax.tree.map(take, rows)
        row = row._replace(
            step=jnp.where(inside, row.step, 0.0),
            inertial=row.inertial & inside,
            measured=row.measured._replace(valid=row.measured.valid & inside[:, None]),
        )
        before = jax.tree.map(partial(_taken, earlier), nominal)
        pieces.append(Chunk(before, jax.tree.map(take, nominal), row))
    return pieces


def _taken(index: np.ndarray, values: Array) -> Array:
    return jnp.asarray(np.asarray(values)[index])


def belief(beginning: Beginning, flight: Sequence[Chunk]) -> Belief:
    """What is believed about the deviation from a nominal flight before its first row."""
    first = jax.tree.map(lambda part: part[0], flight[0].before)
    return Belief(aided.difference(beginning.state, first), beginning.covariance)


def log_likelihood(
    model: FlightModel, means: Means, log_noise: Noise, flight: Sequence[Chunk], start: Belief
) -> float:
    """Log-likelihood of a flight about its nominal."""
    total = 0.0
    for chunk in flight:
        start, part = linear_filter.likelihood(start, linearised(model, means, log_noise, chunk))
        total += float(part)
    return total


def gradient(
    model: FlightModel, means: Means, log_noise: Noise, flight: Sequence[Chunk], start: Belief
) -> tuple[Means, Noise]:
    """Gradient of the log-likelihood with respect to means and log intensities.

    The nominal flight is the smoothed one, and the smoothed flight moves with the parameters: the
    determinants of the innovations' covariances, which depend on the nominal, move with it. About a
    fixed nominal the gradient would not be that of what `log_likelihood` gives once the flight has
    been smoothed anew, and a search would end where nothing is largest.
    """
    rows = [linearised(model, means, log_noise, chunk) for chunk in flight]
    starts, steps = [start], []
    for piece in rows:
        end, done = linear_filter.run(starts[-1], piece)
        starts.append(end)
        steps.append(done)
    later = jax.tree.map(jnp.zeros_like, start)
    slopes = []
    for begun, piece, done in zip(starts[-2::-1], rows[::-1], steps[::-1], strict=True):
        later, slope = linear_filter.adjoint(begun, piece, done, later)
        slopes.append(slope)
    slopes.reverse()
    pull = partial(_pulled_back, model, means, log_noise)
    of_nominal = [pull(chunk, slope) for chunk, slope in zip(flight, slopes, strict=True)]
    force = _force([part[2] for part in of_nominal], [part[3] for part in of_nominal], later)
    moved = _moved(starts, rows, steps, force)
    total = [
        pull(chunk, jax.tree.map(jnp.add, *parts))[:2]
        for chunk, *parts in zip(flight, slopes, moved, strict=True)
    ]
    means_slope, noise_slope = jax.tree.map(lambda *parts: sum(parts), *total)
    return means_slope, noise_slope


def _force(
    before: Sequence[Float[Array, "sample state"]],
    after: Sequence[Float[Array, "sample state"]],
    start: Belief,
) -> list[Float[Array, "sample state"]]:
    """Gradient with respect to the nominal flight, row by row, in chunks.

    Args:
        before: gradient with respect to the nominal at each step's beginning.
        after: at its end.
        start: with respect to the belief before the first row, whose mean is relative to it.
    """
    force = jnp.concatenate(after)
    earlier = jnp.concatenate(before)
    force = force.at[:-1].add(earlier[1:]).at[0].add(earlier[0] - start.mean)
    return jnp.split(force, len(after))


def _moved(
    starts: Sequence[Belief],
    rows: Sequence[Linearised],
    steps: Sequence[Filtered],
    force: Sequence[Array],
) -> list[Linearised]:
    """Gradient of Σ forceᵀ (smoothed flight) with respect to the matrices, in chunks."""
    zero = jnp.zeros_like(starts[0].mean)
    means, answers = [zero], []
    for piece, done, pull in zip(rows, steps, force, strict=True):
        mean, pushed = linear_filter.push(means[-1], piece, done, pull)
        means.append(mean)
        answers.append(pushed)
    later = (zero, zero)
    slopes = []
    for index in reversed(range(len(rows))):
        later, slope = linear_filter.implicit(
            starts[index],
            means[index],
            rows[index],
            steps[index],
            answers[index],
            force[index],
            later,
        )
        slopes.append(slope)
    return slopes[::-1]


def information(
    model: FlightModel,
    means: Means,
    log_noise: Noise,
    flight: Sequence[Chunk],
    start: Belief,
    *,
    air_known: bool,
) -> Float[np.ndarray, "parameter parameter"]:
    """Fisher information about the parameters of the mean, in the order of `ravel_pytree`.

    Args:
        model: the aircraft.
        means: parameters of the mean.
        log_noise: log intensities.
        flight: about its smoothed nominal.
        start: belief before the first row.
        air_known: whether what a derivative multiplies is taken as the smoothed flight has it, or
            as the filter knew it before each sample. The smoothed flight knows the gusts from the
            very accelerations that they caused, so that the flow angle of every gust counts as a
            known input: too much information, but the right curvature for derivatives that are
            still far off.
    """
    count = ravel_pytree(means)[0].size
    rows = [linearised(model, means, log_noise, chunk) for chunk in flight]
    known: Sequence[Chunk] = flight
    if not air_known:
        known, begun = [], start
        for chunk, piece in zip(flight, rows, strict=True):
            end, done = linear_filter.run(begun, piece)
            known.append(_as_predicted(chunk, begun, done))
            begun = end
    sofar = Information(start, jnp.zeros((aided.SIZE, count)), jnp.zeros((count, count)))
    for chunk, piece in zip(known, rows, strict=True):
        motion, seen = _sensitivities(model, means, chunk, piece)
        sofar = linear_filter.inform(sofar, piece, motion, seen)
    return np.asarray(sofar.matrix)


def _as_predicted(chunk: Chunk, start: Belief, done: Filtered) -> Chunk:
    """A chunk about the states that the filter expects before each sample."""
    updated = jnp.concatenate([start.mean[None], done.updated.mean[:-1]])
    return Chunk(
        _composed(chunk.before, updated), _composed(chunk.after, done.predicted.mean), chunk.row
    )


def smooth(
    model: FlightModel, means: Means, log_noise: Noise, flight: Sequence[Chunk], start: Belief
) -> Smoothed:
    """Smooths a flight about its nominal; padding rows are kept."""
    rows = [linearised(model, means, log_noise, chunk) for chunk in flight]
    begun, steps = [start], []
    for piece in rows:
        end, done = linear_filter.run(begun[-1], piece)
        begun.append(end)
        steps.append(done)
    later, pieces = begun[-1], []
    for piece, first, done in zip(rows[::-1], begun[-2::-1], steps[::-1], strict=True):
        later, smoothed = linear_filter.smooth(later, first, piece, done)
        pieces.append(jax.tree.map(np.asarray, smoothed))
    pieces.reverse()
    return Smoothed(
        Belief(*(np.concatenate(part) for part in zip(*pieces, strict=True))),
        np.concatenate([done.log_likelihood for done in steps]),
        np.concatenate([done.whitened for done in steps]),
    )


def iterated(
    model: FlightModel,
    means: Means,
    log_noise: Noise,
    rows: Row,
    nominal: State,
    beginning: Beginning,
    *,
    rounds: int,
) -> tuple[State, Smoothed]:
    """Smooths `rounds` times, each about the flight of the round before.

    Returns:
        The smoothed flight, one state a row, and the last round's deviations from its nominal.
    """
    count = rows.step.shape[0]
    for _ in range(rounds):
        pieces = chunks(rows, nominal)
        done = smooth(model, means, log_noise, pieces, belief(beginning, pieces))
        deviation = jnp.asarray(done.belief.mean[:count])
        nominal = jax.tree.map(np.asarray, _composed(nominal, deviation))
    return nominal, done
