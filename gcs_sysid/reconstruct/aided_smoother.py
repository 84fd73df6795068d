"""The aerodynamics-aided smoother: states, air and their covariance from the whole flight model.

A flight is linearised about a nominal one (all rows at once), filtered and smoothed as a linear
system, and the smoothed flight becomes the next nominal: Gauss–Newton on the states (Bell, *The
iterated Kalman smoother as a Gauss–Newton method*, 1994). Two or three rounds converge from a
kinematic reconstruction.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid import parallel
from gcs_sysid.frames import Array
from gcs_sysid.model import aided, aided_linear
from gcs_sysid.model.aided import Means, Noise, Row, State
from gcs_sysid.model.aided_linear import Linearised
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.reconstruct import linear_filter
from gcs_sysid.reconstruct.linear_filter import Belief

CHUNK = 200
"""Rows worked on at once: their matrices stay in a core's cache, and their memory with the program.
That of 2000 rows the system gave and took back page by page."""
SHORTEST = 0.5
"""Of the lengths of gusts [m]. A wing cannot be turned by air that turns within a part of its span,
and of what is passed in less than a third of a step the Runge–Kutta scheme makes more at each."""

LENGTHS = ("gust_length", "spin_length")
"""Which these are."""


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


def positive(log_noise: Noise) -> Noise:
    """Intensities from their logarithms; how gusts turn the air, which has a sign, as it is.

    Lengths are at least `SHORTEST`.
    """
    noise = jax.tree.map(jnp.exp, log_noise)
    signed = {name: getattr(log_noise.turbulence, name) for name in ("coupling", "azimuth")}
    lengths = {name: jnp.hypot(getattr(noise.turbulence, name), SHORTEST) for name in LENGTHS}
    return noise._replace(turbulence=noise.turbulence._replace(**signed, **lengths))


@jax.jit
def mechanics(
    model: FlightModel, means: Means, chunk: Chunk
) -> Float[Array, "sample moving state"]:
    """The motion's Jacobian in the middle of every step, but for what decays by itself.

    A program of its own: what needs it is compiled without it.
    """

    def one(part: Chunk) -> Array:
        return aided_linear.mechanics(model.aircraft, means, *part)

    return jax.vmap(one)(chunk)


def linearised(model: FlightModel, means: Means, log_noise: Noise, chunk: Chunk) -> Linearised:
    """Every row of a chunk about its nominal flight."""
    return _about(model, means, log_noise, chunk, mechanics(model, means, chunk))


@jax.jit
def _about(
    model: FlightModel,
    means: Means,
    log_noise: Noise,
    chunk: Chunk,
    inner: Float[Array, "sample moving state"],
) -> Linearised:
    noise = positive(log_noise)

    def one(part: Chunk, inner: Array) -> Linearised:
        return aided_linear.linearise(model.aircraft, means, noise, *part, inner)

    return jax.vmap(one)(chunk, inner)


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


def smooth(
    model: FlightModel, means: Means, log_noise: Noise, flight: Sequence[Chunk], start: Belief
) -> Belief:
    """Smooths a flight about its nominal; padding rows are kept."""
    rows = parallel.each(
        lambda chunk: jax.block_until_ready(linearised(model, means, log_noise, chunk)), flight
    )
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
    return Belief(*(np.concatenate(part) for part in zip(*pieces, strict=True)))


def iterated(
    model: FlightModel,
    means: Means,
    log_noise: Noise,
    rows: Row,
    nominal: State,
    beginning: Beginning,
    *,
    rounds: int,
) -> tuple[State, Belief]:
    """Smooths `rounds` times, each about the flight of the round before.

    Returns:
        The smoothed flight, one state a row, and the last round's deviations from its nominal.
    """
    count = rows.step.shape[0]
    for _ in range(rounds):
        pieces = chunks(rows, nominal)
        done = smooth(model, means, log_noise, pieces, belief(beginning, pieces))
        deviation = jnp.asarray(done.mean[:count])
        nominal = jax.tree.map(np.asarray, _composed(nominal, deviation))
    return nominal, done
