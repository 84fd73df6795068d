"""Steady flight: attitude, deflections and thrust at which nothing changes.

Straight flight, level or not, at the bank that its asymmetries ask for; and coordinated turns, in
which the ball is centred: no specific force acts sideways. With φ the bank a level one turns at

    ψ̇ = g tan φ cos α / V      load factor √(1 + (V ψ̇/g)²) ≈ 1/cos φ

(Stevens, Lewis & Johnson 2015, section 3.6, of the bank about the velocity, tan μ = tan φ cos α).
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy import optimize

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.atmosphere import GRAVITY
from gcs_sysid.errors import UsageError
from gcs_sysid.frames import Array
from gcs_sysid.model import rigid_body
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.model.rigid_body import Inputs, Parameters, State

LEVEL = 0.05
"""Accelerations that a trim may leave [m/s², rad/s²]."""
BALANCED = 7
"""Equations of a trim that must be zero, of which the last is that of a turn."""
LEAST = 1e-2
"""Weight of deflections and angles against accelerations. The accelerations that it leaves are of
the order of its square; a much smaller one would not hold a sideslip that nothing else holds."""


@dataclass(frozen=True)
class Trim:
    """Steady flight.

    Attributes:
        airspeed: [m/s].
        state: motion.
        controls: deflections [rad], in the order of the aircraft's controls.
        settings: of the engines.
        density: of the air [kg/m³].
        bank: of a turn [rad]; 0 in straight flight.
        climb: angle of the flight path above level [rad].
    """

    airspeed: float
    state: State
    controls: Float[np.ndarray, " control"]
    settings: Float[np.ndarray, " engine"]
    density: float
    bank: float = 0.0
    climb: float = 0.0

    @property
    def turn_rate(self) -> float:
        """About the vertical, to the right [rad/s]."""
        return float(frames.rotate(self.state.attitude, self.state.rate)[2])

    @property
    def condition(self) -> Float[np.ndarray, " five"]:
        """Airspeed [m/s], height [m], density [kg/m³], bank and climb angle [rad]."""
        height = -float(self.state.position[2])
        return np.array([self.airspeed, height, self.density, self.bank, self.climb])

    @property
    def unknown(self) -> Float[np.ndarray, " unknown"]:
        """What was solved for, as `imbalance` has it."""
        flow = frames.flow_angles(frames.unrotate(self.state.attitude, self.state.velocity))
        lean = frames.euler_from_quaternion(self.state.attitude)[0]
        if self.bank:
            lean = self.turn_rate / _turning(self.airspeed, self.bank) - 1.0
        angles = [float(flow[1]), float(flow[2]), float(lean)]
        return np.concatenate([angles, self.controls, self.settings])


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


def find(
    aircraft: Aircraft,
    airspeed: float,
    height: float,
    density: float,
    *,
    bank: float = 0.0,
    climb: float = 0.0,
) -> Trim:
    """Steady flight at an airspeed.

    Args:
        aircraft: with its aerodynamics.
        airspeed: true [m/s].
        height: [m].
        density: of the air [kg/m³].
        bank: of a coordinated turn, right wing down [rad]; 0 flies straight.
        climb: angle of the flight path above level [rad]. The air stays as dense as it is.

    Raises:
        UsageError: the model cannot fly so.
    """
    model, values = FlightModel(aircraft), rigid_body.parameters(aircraft)
    count, engines = len(aircraft.controls), len(aircraft.propulsion)
    start = np.concatenate([[0.05, 0.0, 0.0], np.zeros(count), np.full(engines, 0.5)])
    low = np.concatenate([[-0.3, -0.3, -0.3], np.full(count, -0.6), np.zeros(engines)])
    high = np.concatenate([[0.4, 0.3, 0.3], np.full(count, 0.6), np.ones(engines)])
    high[3 + count :] = _most(aircraft)
    start[3 + count :] *= high[3 + count :]
    air = np.array([airspeed, height, density, bank, climb])
    found = optimize.least_squares(
        lambda unknown: np.asarray(_residual(unknown, model, values, air)),
        start,
        jac=lambda unknown: np.asarray(_slope(unknown, model, values, air)),
        bounds=(low, high),
        x_scale=np.where(high > 10.0, high, 0.1),
    )
    if np.abs(np.asarray(_residual(found.x, model, values, air))[:BALANCED]).max() > LEVEL:
        raise UsageError(
            f"{aircraft.name}: the model cannot fly {_words(bank, climb)} at {airspeed:.0f} m/s; "
            "check its thrust, or the airspeeds of `[envelope]`"
        )
    return Trim(
        airspeed=airspeed,
        state=steady(jnp.asarray(found.x), jnp.asarray(air)),
        controls=found.x[3 : 3 + count],
        settings=found.x[3 + count :],
        density=density,
        bank=bank,
        climb=climb,
    )


def _words(bank: float, climb: float) -> str:
    """A flight condition."""
    if not bank and not climb:
        return "level"
    turn = f"a turn of {np.rad2deg(bank):.0f}° bank" if bank else "straight"
    return f"{turn} with a climb angle of {np.rad2deg(climb):.0f}°" if climb else f"{turn}, level,"


@jax.jit
def _residual(
    unknown: Float[Array, " unknown"],
    model: FlightModel,
    values: Parameters,
    air: Float[Array, " five"],
) -> Float[Array, " equation"]:
    return imbalance(model.aircraft, values, unknown, *air)


_slope = jax.jit(jax.jacfwd(_residual))


def imbalance(
    aircraft: Aircraft,
    values: Parameters,
    unknown: Float[Array, " unknown"],
    airspeed: float | Float[Array, ""],
    height: float | Float[Array, ""],
    density: float | Float[Array, ""],
    bank: float | Float[Array, ""] = 0.0,
    climb: float | Float[Array, ""] = 0.0,
) -> Float[Array, " equation"]:
    """What keeps a flight from being steady: zero, but for the last, at a trim.

    Args:
        aircraft: what is looked up.
        values: what may vary.
        unknown: alpha, beta and the bank [rad], or in a turn by which share it turns faster than at
            g tan φ/V, then the controls [rad], and the engines' settings.
        airspeed: [m/s].
        height: [m].
        density: of the air [kg/m³].
        bank: of a turn [rad]; 0 flies straight.
        climb: angle of the flight path above level [rad].

    Returns:
        Accelerations beyond those of the turn [m/s², rad/s²], of a turn the specific force sideways
        [m/s²], and a small weight on every unknown: of all ways to fly so the one with the least
        bank, sideslip and deflection is taken.
    """
    count = len(aircraft.controls)
    air = (jnp.asarray(part, jnp.float64) for part in (airspeed, height, density, bank, climb))
    state = steady(unknown, jnp.stack(list(air)))
    given = inputs(aircraft, unknown[3 : 3 + count], unknown[3 + count :], density)
    change = rigid_body.derivative(aircraft, values, state, given)
    scale = jnp.concatenate([jnp.ones(3 + count), _most(aircraft)])
    turning = frames.rotate(state.attitude, state.rate)
    pulled = change.velocity - frames.cross(turning, state.velocity)
    felt = frames.unrotate(state.attitude, change.velocity - jnp.array([0.0, 0.0, GRAVITY]))
    ball = jnp.where(jnp.asarray(bank) == 0.0, 0.0, felt[1:2])
    return jnp.concatenate([pulled, change.rate, ball, LEAST * unknown / scale])


def _most(aircraft: Aircraft) -> Float[Array, " engine"]:
    """Largest setting of each engine."""
    most = [
        jnp.ones(()) if one.rpm is None else jnp.max(jnp.asarray(one.rpm))
        for one in aircraft.propulsion
    ]
    return jnp.stack(most) if most else jnp.zeros(0)


def steady(unknown: Float[Array, " unknown"], condition: Float[Array, " five"]) -> State:
    """Motion of steady flight towards north.

    Args:
        unknown: as for `imbalance`, of which the first three are looked at.
        condition: as of `Trim.condition`.
    """
    alpha, beta, lean = unknown[0], unknown[1], unknown[2]
    airspeed, height, _, asked, climb = condition
    straight = asked == 0.0
    bank = jnp.where(straight, lean, asked)
    through = airspeed * jnp.stack(
        [jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)]
    )
    # Climb is u sin θ − (v sin φ + w cos φ) cos θ.
    lift = through[1] * jnp.sin(bank) + through[2] * jnp.cos(bank)
    along = jnp.hypot(through[0], lift)
    pitch = jnp.arctan2(lift, through[0]) + jnp.arcsin(airspeed * jnp.sin(climb) / along)
    attitude = frames.quaternion_from_euler(jnp.stack([bank, pitch, jnp.zeros_like(pitch)]))
    rate = jnp.where(straight, 0.0, _turning(airspeed, asked) * (1.0 + lean))
    return State(
        position=jnp.stack([jnp.zeros(()), jnp.zeros(()), -height]),
        velocity=frames.rotate(attitude, through),
        attitude=attitude,
        rate=frames.unrotate(attitude, rate * jnp.array([0.0, 0.0, 1.0])),
    )


def _turning(airspeed: float | Array, bank: float | Array) -> Float[Array, ""]:
    """Rate of a turn where lift is across the velocity and level wings would hold the weight."""
    return GRAVITY * jnp.tan(bank) / airspeed


def deviation(state: State, trim: Trim) -> Float[Array, " eight"]:
    """Body velocity, rate, roll and pitch less those of a trim; heading and place are free."""

    def described(one: State) -> Array:
        euler = frames.euler_from_quaternion(one.attitude)
        body = frames.unrotate(one.attitude, one.velocity)
        return jnp.concatenate([body, one.rate, euler[:2]])

    return described(state) - described(trim.state)
