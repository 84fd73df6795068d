"""Small motions about a trim, and a controller gentle enough to let inputs through."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy import linalg

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.frames import Array
from gcs_sysid.model import rigid_body
from gcs_sysid.model.rigid_body import Parameters
from gcs_sysid.model.trim import Trim, inputs

GENTLE = 0.02
"""Weight of motion against control in the controller: it holds attitude, and is slow enough not to
take a test input away."""


@dataclass(frozen=True)
class Linear:
    """Small motions: deviation of (velocity in body axes, rate, roll, pitch), and controls.

    Attributes:
        dynamics: [1/s and the like].
        inputs: of the controls.
        gain: controls = −gain·deviation holds the trim.
    """

    dynamics: Float[np.ndarray, "eight eight"]
    inputs: Float[np.ndarray, "eight control"]
    gain: Float[np.ndarray, "control eight"]

    def natural_frequency(self, *, lateral: bool) -> float:
        """Of the fastest oscillation of one motion [rad/s]; 0 where none oscillates."""
        rows = [1, 3, 5, 6] if lateral else [0, 2, 4, 7]
        roots = np.linalg.eigvals(self.dynamics[np.ix_(rows, rows)])
        swinging = np.abs(roots[np.abs(roots.imag) > 1e-3])
        return float(swinging.max()) if swinging.size else 0.0


def linearised(aircraft: Aircraft, trim: Trim) -> Linear:
    """Small motions about a trim, by the exact derivatives of the equations of motion."""
    values = rigid_body.parameters(aircraft)

    def rate(change: Array, moved: Array) -> Array:
        return _rate(aircraft, values, trim, change, moved)

    zero, still = jnp.zeros(8), jnp.zeros(len(aircraft.controls))
    dynamics, control = (
        np.asarray(value) for value in jax.jit(jax.jacfwd(rate, argnums=(0, 1)))(zero, still)
    )
    scale = np.array([trim.airspeed] * 3 + [1.0] * 3 + [0.3, 0.3])
    weight = GENTLE * np.diag(scale**-2.0)
    riccati = linalg.solve_continuous_are(
        dynamics - 1e-3 * np.eye(8), control, weight, np.eye(control.shape[1])
    )
    return Linear(dynamics, control, control.T @ riccati)


def _rate(aircraft: Aircraft, values: Parameters, trim: Trim, change: Array, moved: Array) -> Array:
    """Rate of change of the deviation, for a deviation and moved controls."""
    euler = frames.euler_from_quaternion(trim.state.attitude)
    euler = euler + jnp.concatenate([change[6:], jnp.zeros(1)])
    attitude = frames.quaternion_from_euler(euler)
    body = frames.unrotate(trim.state.attitude, trim.state.velocity) + change[:3]
    state = trim.state._replace(
        velocity=frames.rotate(attitude, body), attitude=attitude, rate=change[3:6]
    )
    given = inputs(
        aircraft, jnp.asarray(trim.controls) + moved, jnp.asarray(trim.settings), trim.density
    )
    slope = rigid_body.derivative(aircraft, values, state, given)
    turned = frames.unrotate(attitude, slope.velocity) - frames.cross(change[3:6], body)
    roll, pitch = euler[0], euler[1]
    p, q, r = change[3], change[4], change[5]
    swing = q * jnp.sin(roll) + r * jnp.cos(roll)
    angles = jnp.stack([p + swing * jnp.tan(pitch), q * jnp.cos(roll) - r * jnp.sin(roll)])
    return jnp.concatenate([turned, slope.rate, angles])
