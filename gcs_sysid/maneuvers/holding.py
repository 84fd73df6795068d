"""Small motions about a trim, and the attitude and heading that an autopilot holds meanwhile."""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.atmosphere import GRAVITY
from gcs_sysid.frames import Array
from gcs_sysid.model import rigid_body
from gcs_sysid.model.rigid_body import Inputs, Parameters
from gcs_sysid.model.trim import Trim, inputs

PERIOD = 0.02
"""Of an autopilot's loops [s]."""
RATE = 0.3
"""Bandwidth of the rate loop over 1/(lag + delay) of the servos: 60° of phase are left."""
ATTITUDE = 0.15
"""Of the attitude loop around it."""
YAW = 0.5
"""Of the yaw damper, over the rate loop's."""
HEADING = 1.2
"""Bank by heading that is missing. On a leg of a mission an autopilot holds it (ArduPlane's L1
controller at a period of 17 s and 20 m/s: 1.1), and to a flying wing without a yaw damper that is
what damps its Dutch roll."""
SIZE = 9
"""Of a deviation, see `Linear`."""
INTEGRAL = 0.25
"""Of the integral of the pitch rate's error, where an autopilot has one: over the same 1/(lag +
delay), of the pitch rate that a deflection makes once the short period is over."""
LEAST_ANSWER = 0.01
"""Of that pitch rate over the first angular acceleration [s]: less is taken as so much."""


@dataclass(frozen=True)
class Frequencies:
    """How fast each motion answers: the short period, the roll mode, the Dutch roll [rad/s]."""

    pitch: float
    roll: float
    yaw: float


@dataclass(frozen=True)
class Linear:
    """Small motions: deviation of (velocity in body axes, rate, roll, pitch, heading), and inputs.

    Attributes:
        dynamics: [1/s and the like].
        inputs: of the controls, and last of the throttle of all engines together.
        gain: controls = −gain·deviation holds attitude and heading.
        winding: rate of change of the integral of the pitch rate's error, −winding·deviation.
        unwinding: of the controls by that integral.
    """

    dynamics: Float[np.ndarray, "nine nine"]
    inputs: Float[np.ndarray, "nine input"]
    gain: Float[np.ndarray, "control nine"]
    winding: Float[np.ndarray, " nine"]
    unwinding: Float[np.ndarray, " control"]

    def turning(self) -> Linear:
        """The same where only the attitude is held: turns are flown so."""
        gain = self.gain.copy()
        gain[:, 8] = 0.0
        return replace(self, gain=gain)

    def natural_frequency(self, *, lateral: bool) -> float:
        """Of the fastest oscillation of one motion [rad/s]; 0 where none oscillates."""
        roots = self._roots(lateral=lateral)
        swinging = np.abs(roots[np.abs(roots.imag) > 1e-3])
        return float(swinging.max()) if swinging.size else 0.0

    def frequencies(self) -> Frequencies:
        """Of the three motions that test inputs excite; real roots count by their speed."""
        along, across = self._roots(lateral=False), self._roots(lateral=True)
        fastest = np.sort(np.abs(along))[-2:]
        roll = np.abs(across[np.abs(across.imag) < 1e-3])
        swing = self.natural_frequency(lateral=True)
        slow = np.sort(np.abs(across))[1:3]
        return Frequencies(
            pitch=float(np.sqrt(np.prod(fastest))),
            roll=float(roll.max()) if roll.size else float(np.abs(across).max()),
            yaw=swing or float(np.sqrt(np.prod(slow))),
        )

    @property
    def held(self) -> Float[np.ndarray, "nine nine"]:
        """Dynamics with attitude and heading held, servos without lag."""
        return self.dynamics - self.inputs[:, : self.gain.shape[0]] @ self.gain

    def _roots(self, *, lateral: bool) -> np.ndarray:
        rows = [1, 3, 5, 6] if lateral else [0, 2, 4, 7]
        return np.linalg.eigvals(self.dynamics[np.ix_(rows, rows)])


def linearised(aircraft: Aircraft, trim: Trim) -> Linear:
    """Small motions about a trim, by the exact derivatives of the equations of motion."""
    values = rigid_body.parameters(aircraft)
    zero, still = jnp.zeros(SIZE), jnp.zeros(len(aircraft.controls) + 1)

    def rate(change: Array, moved: Array) -> Array:
        return _rate(aircraft, values, trim, change, moved)

    dynamics, control = (
        np.asarray(value) for value in jax.jit(jax.jacfwd(rate, argnums=(0, 1)))(zero, still)
    )
    effect = control[:, :-1]
    given = _given_axes(effect)
    return Linear(
        dynamics,
        control,
        given @ _wanted(aircraft, trim, dynamics)[: given.shape[1]],
        _winding(aircraft, dynamics, effect @ given[:, 1]),
        given[:, 1],
    )


def lag(aircraft: Aircraft) -> float:
    """Slowest servo's time constant and delay [s]."""
    return max((servo.delay + servo.time_constant for servo in aircraft.servos), default=0.0)


def _given_axes(effect: Float[np.ndarray, "nine control"]) -> Float[np.ndarray, "control axis"]:
    """Controls by angular acceleration; without a third control yaw is left to the aircraft."""
    axes = [3, 4, 5] if effect.shape[1] > 2 else [3, 4]
    return np.linalg.pinv(effect[axes])


def _wanted(
    aircraft: Aircraft, trim: Trim, dynamics: Float[np.ndarray, "nine nine"]
) -> Float[np.ndarray, "axis nine"]:
    """Angular accelerations by deviation, less: of an autopilot as fast as its servos allow.

    Roll and pitch angles command rates, and rates command angular accelerations; in roll what
    damping takes of that is fed forward, as autopilots do. Without it a flying wing whose roll
    damps eight times as fast as its loops are never reaches the roll rate asked for, and its Dutch
    roll grows to 30° of sideslip where the autopilot that flew it keeps it within a few degrees.
    """
    fast = RATE / (lag(aircraft) + PERIOD)
    slow = ATTITUDE / (lag(aircraft) + PERIOD)
    wanted = np.zeros((3, SIZE))
    wanted[0, 3], wanted[0, 6] = fast, (fast + max(-dynamics[3, 3], 0.0)) * slow
    wanted[0, 8] = HEADING * wanted[0, 6]
    wanted[1, 4], wanted[1, 7] = fast, fast * slow
    wanted[2, 5], wanted[2, 6] = YAW * fast, -YAW * fast * GRAVITY / trim.airspeed
    return wanted


def _winding(
    aircraft: Aircraft,
    dynamics: Float[np.ndarray, "nine nine"],
    pushed: Float[np.ndarray, " nine"],
) -> Float[np.ndarray, " nine"]:
    """How fast the integral of the pitch rate's error grows, less, by deviation.

    Args:
        aircraft: whose servos limit it.
        dynamics: small motions.
        pushed: their rates by one unit of angular acceleration in pitch.
    """
    short = [2, 4]
    steady = -np.linalg.solve(dynamics[np.ix_(short, short)], pushed[short])[1]
    allowed = 1.0 / (lag(aircraft) + PERIOD)
    found = np.zeros(SIZE)
    found[4], found[7] = 1.0, ATTITUDE * allowed
    return INTEGRAL * allowed / max(abs(float(steady)), LEAST_ANSWER) * found


def _rate(aircraft: Aircraft, values: Parameters, trim: Trim, change: Array, moved: Array) -> Array:
    """Rate of change of the deviation, for a deviation and moved controls and throttle."""
    euler = frames.euler_from_quaternion(trim.state.attitude)
    euler = euler + change[6:]
    attitude = frames.quaternion_from_euler(euler)
    body = frames.unrotate(trim.state.attitude, trim.state.velocity) + change[:3]
    state = trim.state._replace(
        velocity=frames.rotate(attitude, body), attitude=attitude, rate=change[3:6]
    )
    slope = rigid_body.derivative(aircraft, values, state, _given(aircraft, trim, moved))
    turned = frames.unrotate(attitude, slope.velocity) - frames.cross(change[3:6], body)
    roll, pitch = euler[0], euler[1]
    p, q, r = change[3], change[4], change[5]
    swing = q * jnp.sin(roll) + r * jnp.cos(roll)
    turned_by = [p + swing * jnp.tan(pitch), q * jnp.cos(roll) - r * jnp.sin(roll)]
    angles = jnp.stack([*turned_by, swing / jnp.cos(pitch)])
    return jnp.concatenate([turned, slope.rate, angles])


def _given(aircraft: Aircraft, trim: Trim, moved: Array) -> Inputs:
    # The table of an engine over rotation speed is not over throttle: it stays as it is.
    share = np.array([0.0 if engine.rpm else 1.0 for engine in aircraft.propulsion])
    settings = jnp.asarray(trim.settings) + share * moved[-1]
    return inputs(aircraft, jnp.asarray(trim.controls) + moved[:-1], settings, trim.density)
