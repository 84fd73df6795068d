"""A plain autopilot: damps rates, holds attitude, airspeed, height and heading.

Its gains come from the aircraft file, so that it flies any aircraft without tuning: every loop's
bandwidth is a fixed share of what the servos' lag and delay allow. It knows only what its sensors
say. Test inputs are added to its output, not to its targets.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gcs_sysid.aircraft import Aircraft, Servo
from gcs_sysid.sitl.coupling import Rates
from gcs_sysid.sitl.inputs import THROTTLE
from gcs_sysid.sitl.plan import Leg
from gcs_sysid.sitl.servo import control_range, interpolate
from gcs_sysid.sitl.slopes import GRAVITY, Slopes, Trim, slopes, thrust_at, trim

PERIOD = 0.02
"""Time between two runs of the control loops [s]."""

HEADING_GAIN = 1.2
"""Bank angle commanded per rad of heading error."""

# Shares of 1/(lag + delay): a rate loop with 60° of phase left, and half and a quarter of that
# for what is closed around it.
_RATE = 0.3
_RATE_INTEGRAL = 0.25
_ATTITUDE = 0.15

_ROLL_RATE = math.radians(60.0)
# Of the steady roll rate at full deflection: the rest is for gusts and for stopping.
_ROLL_SHARE = 0.35


@dataclass(frozen=True)
class Sensed:
    """What the autopilot knows: attitude [rad], rates [rad/s], air and height [m, m/s]."""

    phi: float
    theta: float
    psi: float
    p: float
    q: float
    r: float
    airspeed: float
    height: float
    climb: float


@dataclass(frozen=True)
class Memory:
    """Integrators: pitch, roll [rad/s²], pitch attitude [rad], forward acceleration [m/s²]."""

    pitch: float = 0.0
    roll: float = 0.0
    theta: float = 0.0
    thrust: float = 0.0


@dataclass(frozen=True)
class Autopilot:
    """An autopilot for one aircraft on one leg; build with `autopilot`.

    Attributes:
        slope: what the aircraft answers.
        bandwidth: what its servos allow [rad/s].
        mass: [kg].
        thrust_slope: by throttle [N].
        roll_rate: fastest to be commanded [rad/s].
        bank: of level flight [rad], none with a plane of symmetry.
        roll: that the controls must hold in level flight [rad/s²], none with a plane of symmetry.
        yaw: likewise.
    """

    slope: Slopes
    bandwidth: float
    mass: float
    thrust_slope: float
    roll_rate: float
    bank: float = 0.0
    roll: float = 0.0
    yaw: float = 0.0

    def settled(self, trim: Trim) -> Memory:
        """The integrators as they stand when the aircraft flies level."""
        return Memory(
            pitch=_held(self.slope, trim)[1],
            theta=trim.alpha,
            thrust=trim.throttle * self.thrust_slope / self.mass,
        )

    def command(
        self, memory: Memory, sensed: Sensed, leg: Leg
    ) -> tuple[Mapping[str, float], Memory]:
        """One run of the loops.

        Returns:
            Controls [rad] and `throttle` (0 to 1, not limited), and the integrators to go on with.
        """
        speed = max(sensed.airspeed, 0.6 * leg.airspeed)
        theta, integral_theta = self._climb(memory.theta, sensed, leg, speed)
        throttle, integral_thrust = self._throttle(memory.thrust, sensed, leg)
        bank = self.bank + _bank(sensed, leg)
        commands, memory = self.attitude(memory, sensed, theta=theta, bank=bank)
        return commands | {THROTTLE: throttle}, replace(
            memory, theta=integral_theta, thrust=integral_thrust
        )

    def attitude(
        self, memory: Memory, sensed: Sensed, *, theta: float, bank: float
    ) -> tuple[dict[str, float], Memory]:
        """One run of the inner loops, towards an attitude [rad]: controls and integrators."""
        speed = max(sensed.airspeed, 0.6 * self.slope.airspeed)
        pitch, integral_pitch = self._pitch(memory.pitch, sensed, theta, speed)
        roll, integral_roll = self._roll(memory.roll, sensed, bank)
        coordinated = GRAVITY / speed * math.sin(sensed.phi - self.bank) * math.cos(sensed.theta)
        yaw = 0.5 * _RATE * self.bandwidth * (coordinated - sensed.r) + self.yaw
        stiffness = (self.slope.airspeed / speed) ** 2
        memory = replace(memory, pitch=integral_pitch, roll=integral_roll)
        return self._controls((roll + self.roll, pitch, yaw), sensed, stiffness), memory

    def _controls(self, wanted: Rates, sensed: Sensed, stiffness: float) -> dict[str, float]:
        """Controls [rad] for angular accelerations about the three axes [rad/s²]."""
        slope = self.slope
        if slope.coupling is not None:
            rates = (sensed.p, sensed.q, sensed.r)
            found = slope.coupling.controls(wanted, rates)
            return {name: value * stiffness for name, value in found.items()}
        roll, pitch, yaw = wanted
        commands = {
            slope.pitch_name: pitch * stiffness / slope.pitch_control,
            slope.roll_name: roll * stiffness / slope.roll_control,
        }
        if slope.yaw_name is not None:
            commands[slope.yaw_name] = yaw * stiffness / slope.yaw_control
        return commands

    def _climb(
        self, integral: float, sensed: Sensed, leg: Leg, speed: float
    ) -> tuple[float, float]:
        limit = 0.12 * speed
        climb = _limit(0.25 * (leg.height - sensed.height), limit)
        error = (climb - sensed.climb) / speed
        integral = _limit(integral + 0.4 * error * PERIOD, math.radians(20.0))
        return _limit(integral + 0.8 * error, math.radians(25.0)), integral

    def _pitch(
        self, integral: float, sensed: Sensed, theta: float, speed: float
    ) -> tuple[float, float]:
        turn = GRAVITY / speed * math.sin(sensed.phi) * math.tan(_limit(sensed.phi, 1.2))
        rate = _ATTITUDE * self.bandwidth * (theta - sensed.theta) + turn
        error = rate - sensed.q
        # Of the steady pitch rate that a deflection makes, stiffness takes this share.
        steady = self.slope.lift / self.slope.short_period**2
        integral += _RATE_INTEGRAL * self.bandwidth / max(steady, 0.01) * error * PERIOD
        return _RATE * self.bandwidth * error + integral, integral

    def _roll(self, integral: float, sensed: Sensed, bank: float) -> tuple[float, float]:
        rate = _limit(_ATTITUDE * self.bandwidth * (bank - sensed.phi), self.roll_rate)
        error = rate - sensed.p
        damping = abs(self.slope.roll_damping)
        integral = _limit(integral + 0.2 * damping * error * PERIOD, 0.2 * damping)
        return _RATE * self.bandwidth * error + damping * rate + integral, integral

    def _throttle(self, integral: float, sensed: Sensed, leg: Leg) -> tuple[float, float]:
        error = leg.airspeed - sensed.airspeed
        limit = self.thrust_slope / self.mass
        integral = min(max(integral + 0.1 * error * PERIOD, -0.2 * limit), limit)
        climb = GRAVITY * sensed.climb / max(sensed.airspeed, 1.0)
        return (0.5 * error + 0.5 * climb + integral) * self.mass / self.thrust_slope, integral


def autopilot(aircraft: Aircraft, airspeed: float) -> Autopilot:
    """The autopilot with the gains for a leg at `airspeed` [m/s]."""
    lag = max((servo.delay + servo.time_constant for servo in aircraft.servos), default=0.0)
    low, high = (thrust_at(aircraft, airspeed, throttle) for throttle in (0.0, 1.0))
    slope = slopes(aircraft, airspeed)
    level = trim(aircraft, airspeed)
    roll, _, yaw = _held(slope, level)
    fastest = control_range(aircraft, slope.roll_name) * slope.roll_control / slope.roll_damping
    return Autopilot(
        slope=slope,
        # A command is held for one period, half of it on average, and computed from the last one.
        bandwidth=1.0 / (lag + PERIOD),
        mass=aircraft.mass.mass,
        thrust_slope=max(high - low, 0.05 * aircraft.mass.mass * GRAVITY),
        roll_rate=min(_ROLL_RATE, _ROLL_SHARE * abs(fastest)),
        bank=level.bank,
        roll=roll,
        yaw=yaw,
    )


def _held(slope: Slopes, level: Trim) -> Rates:
    """What the controls hold in level flight: angular accelerations [rad/s²]."""
    if slope.coupling is None:
        return 0.0, level.control * slope.pitch_control, 0.0
    controls = {**level.others, slope.pitch_name: level.control}
    roll, pitch, yaw = slope.coupling.accelerations(controls).tolist()
    return roll, pitch, yaw


class Mixer:
    """From commands to the pulses of one aircraft's output channels."""

    def __init__(self, aircraft: Aircraft) -> None:
        surfaces = [servo.surface for servo in aircraft.servos]
        mix = np.array([[c.mix.get(name, 0.0) for name in surfaces] for c in aircraft.controls])
        self._gains: list[list[float]] = np.linalg.pinv(mix).tolist()
        self._names = aircraft.control_names
        self._servos = aircraft.servos
        self._thrusters = aircraft.propulsion

    def pulses(self, commands: Mapping[str, float]) -> dict[int, int]:
        """Pulses [µs] by output channel for controls [rad] and `throttle` (0 to 1)."""
        wanted = [commands.get(name, 0.0) for name in self._names]
        pulses = {
            servo.channel: _pulse(servo, sum(g * w for g, w in zip(gains, wanted, strict=True)))
            for servo, gains in zip(self._servos, self._gains, strict=True)
        }
        share = min(max(commands.get(THROTTLE, 0.0), 0.0), 1.0)
        for thruster in self._thrusters:
            low, high = thruster.pwm[0], thruster.pwm[-1]
            pulses[thruster.throttle_channel] = round(low + share * (high - low))
        return pulses


def neutral(servo: Servo) -> int:
    """The pulse [µs] that commands no deflection."""
    return _pulse(servo, 0.0)


def _pulse(servo: Servo, deflection: float) -> int:
    points = sorted(zip(servo.deflection, servo.pwm, strict=True))
    return round(interpolate(deflection, [p[0] for p in points], [p[1] for p in points]))


def _bank(sensed: Sensed, leg: Leg) -> float:
    error = math.remainder(leg.heading - sensed.psi, 2.0 * math.pi)
    return _limit(HEADING_GAIN * error, leg.bank)


def _limit(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
