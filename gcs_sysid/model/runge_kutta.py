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
    slope: Callable[[State, Int[Array, ""]], State], state: State, step: Float[Array, ""]
) -> State:
    """State one step later, with an error of fifth order in the step.

    Args:
        slope: rate of change of a state; its second argument is 0, 1, 2 for inputs at the step's
            beginning, middle, end.
        state: at the beginning, a tree of arrays.
        step: [s].
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
    still = jax.tree.map(jnp.zeros_like, state)
    (_, mean), _ = jax.lax.scan(stage, (still, still), STAGES)
    return moved(step, mean)
