"""Level flight: attitude, deflections and thrust at which nothing accelerates."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy import optimize

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import UsageError
from gcs_sysid.frames import Array
from gcs_sysid.model import rigid_body
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.model.rigid_body import Inputs, Parameters, State

LEVEL = 0.05
"""Accelerations that a trim may leave [m/s², rad/s²]."""
LEAST = 1e-2
"""Weight of deflections and angles against accelerations. The accelerations that it leaves are of
the order of its square; a much smaller one would not hold a sideslip that nothing else holds."""


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


def inputs(
    aircraft: Aircraft,
    controls: Float[Array, " control"],
    settings: Array,
    density: float | Float[Array, ""],
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
    model, values = FlightModel(aircraft), rigid_body.parameters(aircraft)
    count, engines = len(aircraft.controls), len(aircraft.propulsion)
    start = np.concatenate([[0.05, 0.0, 0.0], np.zeros(count), np.full(engines, 0.5)])
    low = np.concatenate([[-0.3, -0.3, -0.3], np.full(count, -0.6), np.zeros(engines)])
    high = np.concatenate([[0.4, 0.3, 0.3], np.full(count, 0.6), np.ones(engines)])
    high[3 + count :] = _most(aircraft)
    start[3 + count :] *= high[3 + count :]
    air = np.array([airspeed, height, density])
    found = optimize.least_squares(
        lambda unknown: np.asarray(_residual(unknown, model, values, air)),
        start,
        jac=lambda unknown: np.asarray(_slope(unknown, model, values, air)),
        bounds=(low, high),
        x_scale=np.where(high > 10.0, high, 0.1),
    )
    if np.abs(np.asarray(_residual(found.x, model, values, air))[:6]).max() > LEVEL:
        raise UsageError(
            f"{aircraft.name}: the model cannot fly level at {airspeed:.0f} m/s; check its thrust, "
            "or the airspeeds of `[envelope]`"
        )
    alpha, beta, bank = found.x[:3]
    return Trim(
        airspeed=airspeed,
        state=level(alpha, beta, bank, airspeed, height),
        controls=found.x[3 : 3 + count],
        settings=found.x[3 + count :],
        density=density,
    )


@jax.jit
def _residual(
    unknown: Float[Array, " unknown"],
    model: FlightModel,
    values: Parameters,
    air: Float[Array, " three"],
) -> Float[Array, " equation"]:
    return imbalance(model.aircraft, values, unknown, air[0], air[1], air[2])


_slope = jax.jit(jax.jacfwd(_residual))


def imbalance(
    aircraft: Aircraft,
    values: Parameters,
    unknown: Float[Array, " unknown"],
    airspeed: float | Float[Array, ""],
    height: float | Float[Array, ""],
    density: float | Float[Array, ""],
) -> Float[Array, " equation"]:
    """What keeps a flight from being level: zero, but for the last, at a trim.

    Args:
        aircraft: what is looked up.
        values: what may vary.
        unknown: alpha, beta, bank and the controls [rad], and the engines' settings.
        airspeed: [m/s].
        height: [m].
        density: of the air [kg/m³].

    Returns:
        Accelerations [m/s², rad/s²], and a small weight on every unknown: of all ways to fly level
        the one with the least bank, sideslip and deflection is taken.
    """
    count = len(aircraft.controls)
    state = level(unknown[0], unknown[1], unknown[2], airspeed, height)
    given = inputs(aircraft, unknown[3 : 3 + count], unknown[3 + count :], density)
    change = rigid_body.derivative(aircraft, values, state, given)
    scale = jnp.concatenate([jnp.ones(3 + count), _most(aircraft)])
    return jnp.concatenate([change.velocity, change.rate, LEAST * unknown / scale])


def _most(aircraft: Aircraft) -> Float[Array, " engine"]:
    """Largest setting of each engine."""
    most = [
        jnp.ones(()) if one.rpm is None else jnp.max(jnp.asarray(one.rpm))
        for one in aircraft.propulsion
    ]
    return jnp.stack(most) if most else jnp.zeros(0)


def level(
    alpha: Float[Array, ""],
    beta: Float[Array, ""],
    bank: Float[Array, ""],
    airspeed: float | Float[Array, ""],
    height: float | Float[Array, ""],
) -> State:
    """Flight without climb: the attitude whose velocity is level and towards north."""
    through = airspeed * jnp.stack(
        [jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)]
    )
    # Climb is u sin θ − (v sin φ + w cos φ) cos θ.
    pitch = jnp.arctan2(through[1] * jnp.sin(bank) + through[2] * jnp.cos(bank), through[0])
    attitude = frames.quaternion_from_euler(jnp.stack([bank, pitch, jnp.zeros_like(pitch)]))
    return State(
        position=jnp.stack([jnp.zeros(()), jnp.zeros(()), -jnp.asarray(height)]),
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
