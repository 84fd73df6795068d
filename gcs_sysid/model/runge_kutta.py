"""The classical Runge–Kutta scheme over states of any kind, its equations compiled once."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from gcs_sysid.frames import Array

State = TypeVar("State")
STAGES = (
    np.array([0.0, 0.5, 0.5, 1.0]),
    np.array([1.0, 2.0, 2.0, 1.0]) / 6.0,
    np.array([0, 1, 1, 2]),
)
"""How far each stage reaches, its weight, and when its inputs are taken."""


def advance(
    slope: Callable[[State, Int[Array, ""]], State],
    state: State,
    step: Float[Array, ""],
    *,
    first: State | None = None,
) -> State:
    """State one step later, with an error of fifth order in the step.

    Args:
        slope: rate of change of a state; its second argument is 0, 1, 2 for inputs at the step's
            beginning, middle, end.
        state: at the beginning, a tree of arrays.
        step: [s].
        first: rate of change at its beginning, where that is known already.
    """

    def moved(by: Float[Array, ""], change: State) -> State:
        return jax.tree.map(lambda value, rate: value + by * rate, state, change)

    def stage(
        sofar: tuple[State, State], item: tuple[Float[Array, ""], Float[Array, ""], Int[Array, ""]]
    ) -> tuple[tuple[State, State], None]:
        last, mean = sofar
        reach, weight, when = item
        change = slope(moved(reach * step, last), when)
        return (change, jax.tree.map(lambda whole, part: whole + weight * part, mean, change)), None

    # A loop, so that the equations are compiled once instead of four times.
    reaches, weights, moments = STAGES
    if first is None:
        still = jax.tree.map(jnp.zeros_like, state)
        (_, mean), _ = jax.lax.scan(stage, (still, still), (reaches, weights, moments))
        return moved(step, mean)
    begun = (first, jax.tree.map(lambda part: weights[0] * part, first))
    (_, mean), _ = jax.lax.scan(stage, begun, (reaches[1:], weights[1:], moments[1:]))
    return moved(step, mean)


def inputs(within: Float[np.ndarray, "row moment what"]) -> Float[np.ndarray, "row three what"]:
    """Inputs at beginning, middle and end of each step, the middle one so that the mean is right.

    Where a command arrives within a step its response has a kink there. Taken at the three instants
    themselves it would act too late or too early: 0.6 ms late for a servo of 26 ms whose commands
    arrive in the middle of steps of 20 ms, and a flight tells a tenth of that. For the mean over a
    step, the scheme's is that of Simpson's rule: (first + 4·middle + last)/6.

    Args:
        within: at moments evenly spread over each step, its ends among them.
    """
    first, last = within[:, 0], within[:, -1]
    mean = (0.5 * (first + last) + within[:, 1:-1].sum(axis=1)) / (within.shape[1] - 1)
    return np.stack([first, (6.0 * mean - first - last) / 4.0, last], axis=1)
