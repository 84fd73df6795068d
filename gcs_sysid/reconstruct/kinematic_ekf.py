"""The kinematic filter, sample by sample: filterpy's extended Kalman filter over the model.

The live form. `smoother` runs the same equations over whole flights inside `jax.lax.scan`; a test
holds both together. filterpy adds K·y to its state, so the attitude enters as an error that is
folded back into the quaternion after every update.
"""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from jaxtyping import Array, Float

from gcs_sysid.model.kinematic_jacobians import transition
from gcs_sysid.model.kinematics import (
    BLOCKS,
    MEASURED,
    SIZE,
    Imu,
    Levers,
    Measurements,
    Noise,
    State,
    compose,
    process_covariance,
)
from gcs_sysid.reconstruct.observation import ROWS, observation

OFTEN = ("attitude",)
"""Most rows hold nothing else, and cost half of one with everything: a program of their own."""
EVERY = tuple(MEASURED)
_OTHERS = np.array([name not in OFTEN for name in MEASURED])


def _step(
    state: State, before: Imu, after: Imu, step: Float[Array, ""], noise: Noise
) -> tuple[State, Float[Array, "state state"], Float[Array, "state state"]]:
    """State after a step, the whole Jacobian and the process noise, as filterpy wants them."""
    ahead, jacobian = transition(state, before, after, step, noise)
    return ahead, jacobian.dense(), jnp.diag(process_covariance(step, noise))


@functools.cache
def _compiled() -> tuple[Any, Any, Any]:
    """The model's functions, compiled once for a process."""
    return jax.jit(_step), jax.jit(observation, static_argnames="groups"), jax.jit(compose)


class KinematicFilter(ExtendedKalmanFilter):  # filterpy ships no type information
    """Live kinematic reconstruction: `predict_x` is the kinematic model.

    Args:
        state: first estimate.
        covariance: its error covariance.
        levers: sensor positions.
        noise: intensities.
    """

    def __init__(
        self,
        state: State,
        covariance: Float[np.ndarray, "state state"],
        levers: Levers,
        noise: Noise,
    ) -> None:
        super().__init__(dim_x=SIZE, dim_z=ROWS)
        self.attitude = np.asarray(state.attitude)
        self.x = np.asarray(state.rest)
        self.P = np.asarray(covariance)
        self.levers = levers
        self.noise = noise
        self.nis = np.zeros(len(MEASURED))

    @property
    def state(self) -> State:
        """Current estimate."""
        return State(self.attitude, self.x)

    def predict_x(self, u: tuple[Imu, Imu, float] | int = 0) -> None:
        """Moves the state over one step; `u` is the inertial sample before, after, and the step."""
        if not isinstance(u, tuple):
            raise TypeError("`u` must be (Imu before, Imu after, step)")
        before, after, step = u
        move, _, _ = _compiled()
        length = np.asarray(step, dtype=np.float64)
        ahead, jacobian, spread = move(self.state, before, after, length, self.noise)
        self.attitude = np.asarray(ahead.attitude)
        self.x = np.asarray(ahead.rest)
        self.F = np.asarray(jacobian)
        self.Q = np.asarray(spread)

    def observe(self, imu: Imu, measured: Measurements) -> None:
        """Takes in what arrived since the last step and folds the attitude error back."""
        _, look, fold = _compiled()
        groups = EVERY if (measured.valid & _OTHERS).any() else OFTEN
        known = (self.state, self.P, imu, measured, self.levers, self.noise)
        residual, jacobian, variance, nis = map(np.asarray, look(*known, groups=groups))
        self.nis = nis
        self.R = np.diag(variance)
        before = self.x
        self.update(residual, HJacobian=lambda _: jacobian, Hx=lambda _: np.zeros(ROWS))
        folded = fold(State(self.attitude, before), self.x - before)
        self.attitude = np.asarray(folded.attitude)
        self.x = np.asarray(folded.rest)

    def deviation(self, name: str) -> Float[np.ndarray, " size"]:
        """One standard deviation of a block of the state."""
        return np.sqrt(np.diagonal(self.P)[BLOCKS[name]])
