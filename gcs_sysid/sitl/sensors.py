"""What the sensors make of the true state: position, errors of the aircraft file, noise.

Known and hidden errors alike (bias, scale, lag, misalignment, position) stand in the `Aircraft`
that flies; only what is random is added here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import Aircraft, SensorError, Vector
from gcs_sysid.sitl.autopilot import PERIOD, Sensed
from gcs_sysid.sitl.jsbsim_aircraft import State
from gcs_sysid.sitl.slopes import SEA_LEVEL_DENSITY

EARTH_RADIUS = 6371000.0
"""Mean radius [m] (IUGG), good enough to turn a position error into an angle."""

_WHITE = 16


@dataclass(frozen=True)
class Noise:
    """One sigma of what is random in each sensor; the defaults are of a small electric aircraft.

    `*_drift` is a first-order Gauss-Markov error beside the white one: attitude and heading with a
    correlation time of 60 s, satellite velocity of 4 s, satellite position and height of 60 s.
    """

    accelerometer: float = 0.08  # m/s², with the airframe's vibration
    gyro: float = 0.004  # rad/s
    attitude: float = 0.0006  # rad
    attitude_drift: float = 0.004  # rad
    heading_drift: float = 0.015  # rad
    dynamic_pressure: float = 2.5  # Pa
    static_pressure: float = 3.0  # Pa
    velocity: float = 0.05  # m/s
    velocity_drift: float = 0.06  # m/s
    position_drift: float = 0.8  # m
    vane: float = 0.0035  # rad


@dataclass(frozen=True)
class Measurement:
    """Everything the flight computer measured at one instant, SI and rad, nothing quantised."""

    time: float
    specific_force: Vector
    rates: Vector
    attitude: Vector
    indicated_airspeed: float
    dynamic_pressure: float
    static_pressure: float
    temperature: float
    latitude: float
    longitude: float
    altitude: float
    height: float
    velocity: Vector
    alpha: float
    beta: float

    def sensed(self) -> Sensed:
        """What the autopilot uses of it."""
        return Sensed(
            *self.attitude,
            *self.rates,
            airspeed=self.indicated_airspeed,
            height=self.height,
            climb=-self.velocity[2],
        )


class Sensors:
    """The sensors of one aircraft; they remember their lags and drifts.

    Args:
        aircraft: that flies, its sensor errors included.
        noise: what is random.
        elevation: of home [m above sea level].
        generator: where randomness comes from.
        heading_bias: indicated less true heading [rad].
    """

    def __init__(
        self,
        aircraft: Aircraft,
        noise: Noise,
        *,
        elevation: float,
        generator: np.random.Generator,
        heading_bias: float = 0.0,
    ) -> None:
        self._heading_bias = heading_bias
        self._aircraft = aircraft
        self._noise = noise
        self._elevation = elevation
        self._generator = generator
        self._misalignment = _rotation(aircraft.imu.misalignment)
        self._lagged: dict[str, tuple[float, float]] = {}
        self._tilt = _Drift(noise.attitude_drift, 60.0, generator, 2)
        self._heading = _Drift(noise.heading_drift, 60.0, generator, 1)
        self._velocity = _Drift(noise.velocity_drift, 4.0, generator, 3)
        self._position = _Drift(noise.position_drift, 60.0, generator, 3)

    def measure(self, state: State) -> Measurement:
        """Sample all sensors once; call every `PERIOD`."""
        noise = self._noise
        white = self._generator.standard_normal(_WHITE).tolist()
        tilt, heading = self._tilt.next(), self._heading.next()
        velocity, position = self._velocity.next(), self._position.next()
        attitude = (
            state.phi + tilt[0] + noise.attitude * white[6],
            state.theta + tilt[1] + noise.attitude * white[7],
            state.psi + self._heading_bias + heading[0] + noise.attitude * white[8],
        )
        speed, pressure = self._airspeed(state, white[9])
        static = state.pressure + noise.static_pressure * white[10]
        alpha, beta = self._vanes(state, white[11:13])
        true_velocity = (state.v_north, state.v_east, state.v_down)
        return Measurement(
            time=state.time,
            specific_force=self._accelerometer(state, white[0:3]),
            rates=self._gyro(state, white[3:6]),
            attitude=attitude,
            indicated_airspeed=speed,
            dynamic_pressure=pressure,
            static_pressure=static,
            temperature=state.temperature,
            latitude=state.latitude + position[0] / EARTH_RADIUS,
            longitude=state.longitude + position[1] / (EARTH_RADIUS * math.cos(state.latitude)),
            altitude=state.altitude + position[2],
            height=state.altitude + position[2] - self._elevation,
            velocity=_vector(
                v + d + noise.velocity * w
                for v, d, w in zip(true_velocity, velocity, white[13:16], strict=True)
            ),
            alpha=alpha,
            beta=beta,
        )

    def _accelerometer(self, state: State, white: Sequence[float]) -> Vector:
        imu = self._aircraft.imu
        mass = self._aircraft.mass
        force = (state.force_x, state.force_y, state.force_z)
        x, y, z = (a - b for a, b in zip(imu.position, mass.cg, strict=True))
        rates = (state.p, state.q, state.r)
        tangential = _cross((state.p_dot, state.q_dot, state.r_dot), (x, y, z))
        centripetal = _cross(rates, _cross(rates, (x, y, z)))
        parts = zip(force, tangential, centripetal, strict=True)
        seen = self._misalignment @ np.array([f / mass.mass + t + c for f, t, c in parts])
        return self._three(
            "accelerometer", seen, imu.accelerometer, self._noise.accelerometer, white
        )

    def _gyro(self, state: State, white: Sequence[float]) -> Vector:
        seen = self._misalignment @ np.array([state.p, state.q, state.r])
        return self._three("gyro", seen, self._aircraft.imu.gyro, self._noise.gyro, white)

    def _three(
        self,
        name: str,
        true: Float[np.ndarray, " axis"],
        error: SensorError,
        noise: float,
        white: Sequence[float],
    ) -> Vector:
        return _vector(
            self._indicated(f"{name}{i}", float(true[i]), error, axis=i) + noise * white[i]
            for i in range(3)
        )

    def _airspeed(self, state: State, white: float) -> tuple[float, float]:
        pitot = self._aircraft.pitot
        u, v, w = self._flow(state, pitot.position)
        true = math.sqrt(u * u + v * v + w * w)
        sigma = state.density / SEA_LEVEL_DENSITY
        # Below 50 m/s calibrated and equivalent airspeed agree to 0.02 %.
        speed = true if pitot.measures == "TAS" else true * math.sqrt(sigma)
        indicated = self._indicated("pitot", speed, pitot.error)
        pressure = 0.5 * SEA_LEVEL_DENSITY * indicated * abs(indicated)
        pressure += self._noise.dynamic_pressure * white
        return math.sqrt(max(pressure, 0.0) * 2.0 / SEA_LEVEL_DENSITY), pressure

    def _vanes(self, state: State, white: Sequence[float]) -> tuple[float, float]:
        vanes = self._aircraft.vanes
        if vanes is None:
            return math.nan, math.nan
        u, v, w = self._flow(state, vanes.position)
        upwash = 1.0 + vanes.upwash
        alpha = self._indicated("alpha", upwash * math.atan2(w, u), vanes.alpha)
        beta = self._indicated("beta", math.atan2(v, math.hypot(u, w)), vanes.beta)
        return alpha + self._noise.vane * white[0], beta + self._noise.vane * white[1]

    def _flow(self, state: State, position: Vector) -> Vector:
        """Velocity of a point of the airframe against the air, whose gust rotates too [m/s]."""
        x, y, z = (a - b for a, b in zip(position, self._aircraft.mass.cg, strict=True))
        u, v, w = _cross((state.p_air, state.q_air, state.r_air), (x, y, z))
        return state.u_air + u, state.v_air + v, state.w_air + w

    def _indicated(self, name: str, true: float, error: SensorError, *, axis: int = 0) -> float:
        """What is told of a value that moves on a line from one sample to the next.

        So taken, τ ẏ = x − y is solved exactly. With the later value held over the step it would
        lag by half a step less.
        """
        lagged = true
        if error.lag > 0.0:
            before, there = self._lagged.get(name, (true, true))
            decay = math.exp(-PERIOD / error.lag)
            mean = (1.0 - decay) * error.lag / PERIOD
            lagged = decay * there + (mean - decay) * before + (1.0 - mean) * true
            self._lagged[name] = true, lagged
        return (1.0 + error.scale[axis]) * lagged + error.bias[axis]


class _Drift:
    """Independent first-order Gauss-Markov errors, stationary from the start."""

    def __init__(
        self, sigma: float, time: float, generator: np.random.Generator, count: int
    ) -> None:
        self._decay = math.exp(-PERIOD / time)
        self._kick = sigma * math.sqrt(1.0 - self._decay**2)
        self._generator = generator
        self._value = sigma * generator.standard_normal(count)

    def next(self) -> list[float]:
        kick = self._kick * self._generator.standard_normal(self._value.size)
        self._value = self._decay * self._value + kick
        return self._value.tolist()


def _rotation(angles: Vector) -> Float[np.ndarray, "unit body"]:
    """Body axes to the axes of a unit mounted with these roll, pitch and yaw angles [rad]."""
    roll, pitch, yaw = angles
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, sr], [0.0, -sr, cr]])
    about_y = np.array([[cp, 0.0, -sp], [0.0, 1.0, 0.0], [sp, 0.0, cp]])
    about_z = np.array([[cy, sy, 0.0], [-sy, cy, 0.0], [0.0, 0.0, 1.0]])
    return about_x @ about_y @ about_z


def _cross(a: Vector, b: Vector) -> Vector:
    """A × b; NumPy's own takes ten times as long for three numbers."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def _vector(values: Iterable[float]) -> Vector:
    x, y, z = values
    return x, y, z
