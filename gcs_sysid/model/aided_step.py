"""How an error state goes over a step, and what the noise of the step leaves at its end.

Half a step is the exponential of its Jacobian, the whole one half after half. The motion feels
everything; the air and the slow errors go their own way, and most of them each by itself:

    Φ½ = [ motion ]        motion: MOVING rows, of all states
         [ 0  own ]        own: gusts and what turns with them among each other, the others alone

Worked out so a step takes a third of the time that it takes as a full matrix.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid.frames import Array
from gcs_sysid.model.aided import BLOCKS, MOVING, SIZE, Row

BLOWN = slice(BLOCKS["gust"].start - MOVING, BLOCKS["memory"].stop - MOVING)
"""Among what is slow: gusts, how they turn the air, and their memory. They are passed as they come,
and turn into each other."""


class Own(NamedTuple):
    """A matrix of what is slow: gusts among each other, the wind and the errors each by itself.

    Attributes:
        blown: of gusts, their rotation and memory.
        alone: the rest's diagonal, with 0 in place of the former's.
    """

    blown: Float[Array, "*sample blown blown"]
    alone: Float[Array, "*sample slow"]


AROUND = (BLOWN.start, SIZE - MOVING - BLOWN.stop)
"""What is slow before them, and behind them."""
_ALONE = np.ones(SIZE - MOVING)
_ALONE[BLOWN] = 0.0
UNIT = Own(np.eye(BLOWN.stop - BLOWN.start), _ALONE)
"""What is slow as it is."""


class Half(NamedTuple):
    """Transition over half a step.

    Attributes:
        motion: how the motion at its end depends on all states.
        own: how what is slow decays.
    """

    motion: Float[Array, "*sample moving state"]
    own: Own


def passing(row: Row) -> Float[Array, " state"]:
    """How fast what changes by itself does so: gusts as they are passed [m/s], all else at 1."""
    blown = slice(MOVING + BLOWN.start, MOVING + BLOWN.stop)
    return jnp.ones(SIZE).at[blown].set(row.passing)


def half(
    mechanics: Float[Array, "moving state"],
    decay: Float[Array, "slow slow"],
    row: Row,
) -> Half:
    """Transition over half a step: the exponential's series to the order of the scheme.

    Args:
        mechanics: the motion's Jacobian in the middle of the step.
        decay: how what is slow changes by itself, where `passing` is 1.
        row: of the step.
    """
    length = 0.5 * row.step
    rates, slowly = length * mechanics, Own(*(length * part for part in _passed(decay, row)))
    within, felt = rates[:, :MOVING], rates[:, MOVING:]
    motion, own = 0.25 * rates, _sum(UNIT, Own(*(0.25 * part for part in slowly)))
    for order in (3.0, 2.0, 1.0):
        motion = (rates + within @ motion + _beside(_through(felt, own) - felt)) / order
        own = _sum(UNIT, _product(Own(*(part / order for part in slowly)), own))
    return Half(jnp.eye(MOVING, SIZE) + motion, own)


def whole(half: Half) -> Float[Array, "state state"]:
    """Transition over a whole step."""
    within, felt = half.motion[:, :MOVING], half.motion[:, MOVING:]
    motion = within @ half.motion + _beside(_through(felt, half.own))
    return jnp.concatenate([motion, _beside(_full(_product(half.own, half.own)))])


def process(
    half: Half, row: Row, driving: Float[Array, "state state"]
) -> Float[Array, "state state"]:
    """Covariance that a step's white noise leaves at its end, ∫ Φ(s) D Φ(s)ᵀ ds by Simpson's rule.

    A gust that arrives early in the step has moved the aircraft by its end, one that arrives late
    has not: taken as arriving together they would tell the filter what no sensor can know.

    Args:
        half: transition over half the step.
        row: of the step.
        driving: D where `passing` is 1: gusts drive each other, all else is driven by itself.
    """
    within, felt = half.motion[:, :MOVING], half.motion[:, MOVING:]
    pushed, blown = jnp.diagonal(driving)[:MOVING], _passed(driving[MOVING:, MOVING:], row)

    def back(columns: Float[Array, "moving slow"]) -> Float[Array, "moving slow"]:
        return _through(columns, Own(half.own.blown.T, half.own.alone))

    def carried(slow: Own) -> Own:
        """What is slow, half a step later."""
        through = half.own.blown @ slow.blown @ half.own.blown.T
        return Own(through, half.own.alone**2 * slow.alone)

    # What comes late, in the middle, and early, as it is at the end: rows of the motion, and slow.
    once = carried(blown)
    fed = _through(felt, blown)
    moved = (within * pushed[None, :]) @ within.T + fed @ felt.T
    middle = jnp.concatenate([moved, back(fed)], axis=1)
    through = within @ middle
    fed = through[:, MOVING:] + _through(felt, once)
    moved = (through[:, :MOVING] + felt @ middle[:, MOVING:].T) @ within.T + fed @ felt.T
    motion = 4.0 * middle + jnp.concatenate([moved + jnp.diag(pushed), back(fed)], axis=1)
    slow = (
        late + 4.0 * half_way + early
        for late, half_way, early in zip(blown, once, carried(once), strict=True)
    )
    below = jnp.concatenate([motion[:, MOVING:].T, _full(Own(*slow))], axis=1)
    return row.step / 6.0 * jnp.concatenate([motion, below])


def _passed(matrix: Float[Array, "slow slow"], row: Row) -> Own:
    """A matrix of what is slow where `passing` is 1, as it is at a row."""
    return Own(row.passing * matrix[BLOWN, BLOWN], UNIT.alone * jnp.diagonal(matrix))


def _through(columns: Float[Array, "moving slow"], own: Own) -> Float[Array, "moving slow"]:
    """Columns of what is slow, times a matrix of it."""
    return columns * own.alone[None, :] + jnp.pad(columns[:, BLOWN] @ own.blown, ((0, 0), AROUND))


def _product(first: Own, second: Own) -> Own:
    return Own(first.blown @ second.blown, first.alone * second.alone)


def _sum(first: Own, second: Own) -> Own:
    return Own(first.blown + second.blown, first.alone + second.alone)


def _beside(columns: Float[Array, "moving slow"]) -> Float[Array, "moving state"]:
    """As columns of all states, those of the motion 0."""
    return jnp.pad(columns, ((0, 0), (MOVING, 0)))


def _full(own: Own) -> Float[Array, "slow slow"]:
    """All of a matrix of what is slow."""
    return jnp.pad(own.blown, (AROUND, AROUND)) + jnp.diag(own.alone)
