"""The scheme against closed forms: order of its error, and commands that arrive within a step."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float, Int

from gcs_sysid.model import runge_kutta

STEP = 0.02
RATE = 16.0
"""Of a roll mode that is as quick as those of small aircraft get [rad/s]."""
LAG = 0.0265
"""Of a servo [s]."""


def servo(time: np.ndarray, arrives: float) -> np.ndarray:
    """Answer of the servo to a unit step, closed form."""
    since = np.maximum(time - arrives, 0.0)
    return 1.0 - np.exp(-since / LAG)


def rolled(time: float, arrives: float) -> float:
    """Rate of the mode that the servo drives, ẋ = −λx + servo, closed form."""
    since = time - arrives
    slow, quick = np.exp(-RATE * since), np.exp(-since / LAG)
    return (1.0 - slow) / RATE - (slow - quick) / (1.0 / LAG - RATE)


def flown(given: np.ndarray) -> float:
    """The same by the scheme, with inputs given for each step."""

    def one(x: Float[Array, ""], row: Float[Array, " three"]) -> tuple[Float[Array, ""], None]:
        def slope(value: Float[Array, ""], when: Int[Array, ""]) -> Float[Array, ""]:
            return -RATE * value + row[when]

        return runge_kutta.advance(slope, x, jnp.asarray(STEP)), None

    return float(jax.lax.scan(one, jnp.zeros(()), jnp.asarray(given))[0])


def moments(steps: int, parts: int) -> np.ndarray:
    return STEP * (np.arange(steps)[:, None] + np.linspace(0.0, 1.0, parts + 1))


@pytest.mark.parametrize("arrives", [0.04, 0.043, 0.05, 0.057])
def test_a_command_that_arrives_within_a_step_is_not_late(arrives: float) -> None:
    steps = 5
    exact = rolled(steps * STEP, arrives)
    slope = (rolled(steps * STEP + 1e-4, arrives) - exact) / 1e-4
    asked = runge_kutta.inputs(servo(moments(steps, 8), arrives)[..., None])[..., 0]
    late = (exact - flown(asked)) / slope
    assert abs(late) < 1e-4


def test_taken_at_the_three_instants_it_is_late() -> None:
    steps, arrives = 5, 0.05
    exact = rolled(steps * STEP, arrives)
    slope = (rolled(steps * STEP + 1e-4, arrives) - exact) / 1e-4
    late = (exact - flown(servo(moments(steps, 2), arrives))) / slope
    assert late > 4e-4


def test_smooth_inputs_stay_what_they_are() -> None:
    times = moments(20, 8)
    found = runge_kutta.inputs(np.sin(9.0 * times)[..., None])[..., 0]
    np.testing.assert_allclose(found, np.sin(9.0 * times[:, [0, 4, 8]]), atol=3e-4)
