"""Level flight, small motions about it, and a controller gentle enough to let inputs through."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy import linalg, optimize

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import UsageError
from gcs_sysid.frames import Array
from gcs_sysid.model import rigid_body
from gcs_sysid.model.rigid_body import Inputs, Parameters, State

LEVEL = 0.05
"""Accelerations that a trim may leave [m/s², rad/s²]."""
GENTLE = 0.02
"""Weight of motion against control in the controller: it holds attitude, and is slow enough not to
take a test input away."""


@dataclass(frozen=True)
class Trim:
    """Steady level flight.

    Attributes:
        airspeed: [m/s].
        state: motion.
        controls: deflections [rad], in the order of the aircraft's controls.
        settings: of the engines.
        density: of the air [kg/m³].
    """

    airspeed: float
    state: State
    controls: Float[np.ndarray, " control"]
    settings: Float[np.ndarray, " engine"]
    density: float


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


def inputs(
    aircraft: Aircraft, controls: Float[Array, " control"], settings: Array, density: float
) -> Inputs:
    """Controls in still air."""
    return Inputs(
        controls=dict(zip(aircraft.control_names, controls, strict=True)),
        settings=settings,
        wind=jnp.zeros(3),
        gust_rate=jnp.zeros(3),
        density=jnp.asarray(density),
    )


def find(aircraft: Aircraft, airspeed: float, height: float, density: float) -> Trim:
    """Level flight at an airspeed.

    Raises:
        UsageError: the model cannot fly level there.
    """
    values = rigid_body.parameters(aircraft)
    count, engines = len(aircraft.controls), len(aircraft.propulsion)

    def left(unknown: Array) -> Array:
        state = _level(unknown[0], unknown[1], unknown[2], airspeed, height)
        given = inputs(aircraft, unknown[3 : 3 + count], unknown[3 + count :], density)
        change = rigid_body.derivative(aircraft, values, state, given)
        # Of all ways to fly level the one with the least bank, sideslip and deflection.
        return jnp.concatenate([change.velocity, change.rate, 1e-4 * unknown])

    start = np.concatenate([[0.05, 0.0, 0.0], np.zeros(count), np.full(engines, 0.5)])
    low = np.concatenate([[-0.3, -0.3, -0.3], np.full(count, -0.6), np.zeros(engines)])
    high = np.concatenate([[0.4, 0.3, 0.3], np.full(count, 0.6), np.ones(engines)])
    high[3 + count :] = [_most(engine.rpm) for engine in aircraft.propulsion]
    start[3 + count :] *= high[3 + count :]
    residual, slope = jax.jit(left), jax.jit(jax.jacfwd(left))
    found = optimize.least_squares(
        lambda unknown: np.asarray(residual(unknown)),
        start,
        jac=lambda unknown: np.asarray(slope(unknown)),
        bounds=(low, high),
        x_scale=np.where(high > 10.0, high, 0.1),
    )
    if np.abs(np.asarray(residual(found.x))[:6]).max() > LEVEL:
        raise UsageError(
            f"{aircraft.name}: the model cannot fly level at {airspeed:.0f} m/s; check its thrust, "
            "or the airspeeds of `[envelope]`"
        )
    alpha, beta, bank = found.x[:3]
    return Trim(
        airspeed=airspeed,
        state=_level(alpha, beta, bank, airspeed, height),
        controls=found.x[3 : 3 + count],
        settings=found.x[3 + count :],
        density=density,
    )


def _most(rpm: tuple[float, ...] | None) -> float:
    return 1.0 if rpm is None else max(rpm)


def _level(alpha: Array, beta: Array, bank: Array, airspeed: float, height: float) -> State:
    """Flight without climb: the attitude whose velocity is level and towards north."""
    through = airspeed * jnp.stack(
        [jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)]
    )
    # Climb is u sin θ − (v sin φ + w cos φ) cos θ.
    pitch = jnp.arctan2(through[1] * jnp.sin(bank) + through[2] * jnp.cos(bank), through[0])
    attitude = frames.quaternion_from_euler(jnp.stack([bank, pitch, jnp.zeros_like(pitch)]))
    return State(
        position=jnp.array([0.0, 0.0, -height]),
        velocity=frames.rotate(attitude, through),
        attitude=attitude,
        rate=jnp.zeros(3),
    )


def deviation(state: State, trim: Trim) -> Float[Array, " eight"]:
    """Body velocity, rate, roll and pitch less those of a trim; heading and place are free."""

    def described(one: State) -> Array:
        euler = frames.euler_from_quaternion(one.attitude)
        body = frames.unrotate(one.attitude, one.velocity)
        return jnp.concatenate([body, one.rate, euler[:2]])

    return described(state) - described(trim.state)


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
