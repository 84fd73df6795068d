"""Kinematic flights with known truth: chosen motion, sensors drawn from the filter's own prior.

The still-air motion is a closed form in time; rate and specific force follow from its exact time
derivatives (`jax.jvp`), so the truth obeys the kinematics to rounding. A gust changes the flow but
not the motion.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np
from scipy.signal import lfilter

from gcs_sysid import atmosphere, frames
from gcs_sysid.aircraft import Aircraft, Geometry, Imu, Mass, Pitot, Vanes
from gcs_sysid.model.kinematics import GRAVITY
from gcs_sysid.reconstruct.reconstruction import PRIOR
from gcs_sysid.recording import Recording, Stream, Vehicle

ALTITUDE = 300.0
DENSITY = float(atmosphere.density(np.array(ALTITUDE)))
WIND_DRIFT = np.array([0.05, 0.05, 0.005])
GUST_TIME = 3.0
ATTITUDE_ERROR = np.deg2rad([1.0, 1.0, 3.0])
ATTITUDE_ERROR_TIME = 20.0
FINE = 0.005
"""Step [s] of the random histories."""
LEVER = (0.05, 0.02, -0.03)
PITOT = (0.3, -0.6, 0.02)
VANES = (0.35, 0.5, 0.0)


def aircraft(*, vanes: bool = True) -> Aircraft:
    """Sensors off the centre of gravity, no known errors."""
    return Aircraft(
        name="kinematic",
        mass=Mass(11.0, 0.824, 1.135, 1.759),
        geometry=Geometry(0.55, 2.9, 0.19),
        imu=Imu(position=LEVER),
        pitot=Pitot(position=PITOT),
        vanes=Vanes(position=VANES) if vanes else None,
    )


@dataclass(frozen=True)
class Errors:
    """What the sensors do wrong; names are those of the filter's state."""

    accelerometer_bias: np.ndarray = field(default_factory=lambda: np.zeros(3))
    gyro_bias: np.ndarray = field(default_factory=lambda: np.zeros(3))
    accelerometer_scale: np.ndarray = field(default_factory=lambda: np.zeros(3))
    gyro_scale: np.ndarray = field(default_factory=lambda: np.zeros(3))
    airspeed_scale: float = 0.0
    vane_bias: np.ndarray = field(default_factory=lambda: np.zeros(2))
    vane_scale: np.ndarray = field(default_factory=lambda: np.zeros(2))
    airspeed_delay: float = 0.0
    velocity_delay: float = 0.0
    attitude_delay: float = 0.0
    vane_delay: float = 0.0
    attitude_offset: np.ndarray = field(default_factory=lambda: np.zeros(3))


def drawn_errors(seed: int) -> Errors:
    """Every error from the prior of the reconstruction."""
    rng = np.random.default_rng([seed, 1])
    sizes = {
        "accelerometer_bias": 3,
        "gyro_bias": 3,
        "accelerometer_scale": 3,
        "gyro_scale": 3,
        "vane_bias": 2,
        "vane_scale": 2,
    }
    vectors = {name: PRIOR[name] * rng.standard_normal(size) for name, size in sizes.items()}
    delays = ("airspeed_delay", "velocity_delay", "attitude_delay", "vane_delay")
    scalars = {name: PRIOR[name] * rng.standard_normal() for name in (*delays, "airspeed_scale")}
    return Errors(**vectors, **scalars)


@dataclass(frozen=True)
class Flight:
    """Telemetry and the truth behind it, on the clock of the inertial unit.

    `alpha`, `beta`, `airspeed` are those of the centre of gravity; `wind` holds the gust;
    `steady_wind` does not.
    """

    recording: Recording
    errors: Errors
    time: np.ndarray
    euler: np.ndarray
    rate: np.ndarray
    force: np.ndarray
    airspeed: np.ndarray
    alpha: np.ndarray
    beta: np.ndarray
    wind: np.ndarray
    steady_wind: np.ndarray


def _bump(t: jax.Array, start: float, end: float, edge: float = 1.5) -> jax.Array:
    """One between start and end, zero elsewhere, smooth."""
    return 0.5 * (jnp.tanh((t - start) / edge) - jnp.tanh((t - end) / edge))


def _still_air(t: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Euler angles, velocity in still air [m/s] (NED) and its heading at one time.

    Turns both ways, a climb, a speed change, and doublet-like wiggles in roll, pitch and yaw;
    calm after 80 s.
    """
    turns = _bump(t, 4.0, 16.0) - _bump(t, 24.0, 36.0) + _bump(t, 62.0, 74.0)
    bank = jnp.deg2rad(35.0) * turns
    climb = jnp.deg2rad(8.0) * (_bump(t, 40.0, 48.0) - _bump(t, 52.0, 58.0))
    speed = 22.0 + 3.0 * jnp.sin(0.37 * t) + 1.5 * jnp.sin(1.1 * t)
    # Speed over ground turns as in a coordinated turn; the integral of tan(bank) has no closed
    # form, that of its own smooth edges has.
    edge = 1.5
    rate = GRAVITY * np.tan(np.deg2rad(35.0)) / 22.0

    def turned(start: float, end: float) -> jax.Array:
        return (
            0.5 * edge * (jnp.logaddexp(2 * (t - start) / edge, 0.0)
                          - jnp.logaddexp(2 * (t - end) / edge, 0.0))
        )  # fmt: skip

    course = 0.6 + rate * (turned(4.0, 16.0) - turned(24.0, 36.0) + turned(62.0, 74.0))
    wiggle = jnp.sin(2.0 * np.pi * 0.7 * t) * _bump(t, 17.0, 22.0, 0.8)
    alpha = 0.05 + 0.03 * turns**2 + 0.04 * wiggle + 0.01 * jnp.sin(1.9 * t)
    beta = 0.03 * jnp.sin(0.8 * t) + 0.04 * jnp.sin(2.3 * t) * _bump(t, 36.0, 41.0, 0.8)
    roll = bank + 0.1 * jnp.sin(2.0 * np.pi * 0.9 * t) * _bump(t, 44.0, 50.0, 0.8)
    velocity = speed * jnp.stack(
        [jnp.cos(course) * jnp.cos(climb), jnp.sin(course) * jnp.cos(climb), -jnp.sin(climb)]
    )
    path = frames.quaternion_from_euler(jnp.stack([jnp.zeros(()), climb, course]))
    about_path = frames.exponential(jnp.stack([roll, jnp.zeros(()), jnp.zeros(())]))
    # Wind axes to body axes: up by alpha, then left by beta.
    up = frames.exponential(jnp.stack([jnp.zeros(()), alpha, jnp.zeros(())]))
    left = frames.exponential(jnp.stack([jnp.zeros(()), jnp.zeros(()), -beta]))
    attitude = frames.multiply(frames.multiply(path, about_path), frames.multiply(left, up))
    return attitude, velocity, course


BATCH = 2048
"""Times are padded to whole batches, so that one compilation serves."""


def _motion(time: np.ndarray) -> tuple[np.ndarray, ...]:
    """Attitude, still-air velocity of the inertial unit, rate, specific force at some times."""
    padded = jnp.asarray(np.pad(time, (0, -time.size % BATCH), mode="edge"))
    return tuple(np.asarray(values)[: time.size] for values in _moved(padded))


@jax.jit
@jax.vmap
def _moved(t: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """The same at one time; the closed form is that of the inertial unit itself."""
    (attitude, velocity, _), (turning, acceleration, _) = jax.jvp(
        _still_air, (t,), (jnp.ones_like(t),)
    )
    rate = 2.0 * frames.multiply(frames.conjugate(attitude), turning)[1:]
    force = frames.unrotate(attitude, acceleration - jnp.array([0.0, 0.0, GRAVITY]))
    return attitude, velocity, rate, force


def _gauss_markov(
    rng: np.random.Generator, count: int, deviation: np.ndarray, time: float
) -> np.ndarray:
    """Stationary first-order process at steps of `FINE`."""
    decay = np.exp(-FINE / time)
    kick = np.sqrt(1.0 - decay**2) * rng.standard_normal((count, deviation.size))
    kick[0] = rng.standard_normal(deviation.size)
    return deviation * lfilter([1.0], [1.0, -decay], kick, axis=0)


@dataclass(frozen=True)
class Air:
    """Constant wind, random histories at steps of `FINE`, and their values at any time.

    The drift of the wind is no force: the flow feels it, the motion over ground does not.
    """

    start: float
    wind: np.ndarray
    drift: np.ndarray
    gust: np.ndarray
    attitude_error: np.ndarray

    def at(self, name: str, time: np.ndarray) -> np.ndarray:
        values = getattr(self, name)
        clock = self.start + FINE * np.arange(values.shape[0])
        return np.stack([np.interp(time, clock, column) for column in values.T], axis=-1)


def flight(
    seed: int,
    *,
    errors: Errors | None = None,
    duration: float = 40.0,
    rate: float = 50.0,
    gust: float = 1.0,
    wind: tuple[float, float, float] | None = None,
    noise: float = 1.0,
    begin: float = 0.0,
    lost: float = 0.03,
    accelerometer: bool = True,
    attitude_error: bool = True,
) -> Flight:
    """A flight as a ground station would have recorded it.

    Args:
        seed: of everything random.
        errors: of the sensors; drawn from the prior when None.
        duration: s.
        rate: of the inertial unit [Hz]; others come at 10, 5, 25 and 20 Hz.
        gust: standard deviation [m/s] of each horizontal component, 1.4 times that vertically.
        wind: steady wind blowing toward NED [m/s]; drawn from the prior when None.
        noise: factor on all white noise.
        begin: time of the first sample [s].
        lost: share of messages lost.
        accelerometer: whether the inertial unit has one.
        attitude_error: whether the attitude source has its slow error.
    """
    rng = np.random.default_rng([seed, 2])
    errors = drawn_errors(seed) if errors is None else errors
    if wind is None:
        wind = tuple(rng.standard_normal(3) * [PRIOR["wind"], PRIOR["wind"], 0.3])
    count = round((duration + 2.0) / FINE)
    drift = WIND_DRIFT * np.sqrt(FINE) * np.cumsum(rng.standard_normal((count, 3)), axis=0)
    slow = _gauss_markov(rng, count, ATTITUDE_ERROR, ATTITUDE_ERROR_TIME)
    air = Air(
        start=begin - 1.0,
        wind=np.array(wind),
        drift=drift * (gust > 0.0),
        gust=_gauss_markov(rng, count, gust * np.array([1.0, 1.0, 1.4]), GUST_TIME),
        attitude_error=slow * attitude_error,
    )
    time = begin + np.arange(round(duration * rate)) / rate
    streams = _streams(rng, time, errors, air, noise, lost, accelerometer)
    attitude, _, angular_rate, force = _motion(time)
    speed, alpha, beta = _flow(air, time, np.zeros(3) - np.array(LEVER))
    steady = air.wind + air.at("drift", time)
    return Flight(
        recording=Recording(
            source="kinematic",
            sha256="",
            vehicle=Vehicle(1, 1, "MAV_AUTOPILOT_ARDUPILOTMEGA", "MAV_TYPE_FIXED_WING", 1),
            epoch_us=0,
            streams=streams,
        ),
        errors=errors,
        time=time,
        euler=frames.euler_from_quaternion(attitude),
        rate=angular_rate,
        force=force,
        airspeed=speed,
        alpha=alpha,
        beta=beta,
        wind=steady + air.at("gust", time),
        steady_wind=steady,
    )


def _flow(air: Air, time: np.ndarray, lever: np.ndarray) -> tuple[np.ndarray, ...]:
    """True airspeed and flow angles at a point `lever` from the inertial unit."""
    attitude, velocity, rate, _ = _motion(time)
    through_air = frames.unrotate(attitude, velocity - air.at("gust", time) - air.at("drift", time))
    return frames.flow_angles(through_air + np.cross(rate, lever))


def _streams(
    rng: np.random.Generator,
    time: np.ndarray,
    errors: Errors,
    air: Air,
    noise: float,
    lost: float,
    accelerometer: bool,
) -> dict[str, Stream]:
    unit = np.array(LEVER)

    def clock(rate: float) -> np.ndarray:
        """Times of messages that arrived: uneven by a tenth of a period, some lost."""
        even = np.arange(time[0] + 0.013, time[-1], 1.0 / rate)
        jitter = rng.uniform(-0.1, 0.1, even.size) / rate
        return (even + jitter)[rng.random(even.size) >= lost]

    def white(size: tuple[int, ...], deviation: float) -> np.ndarray:
        return noise * deviation * rng.standard_normal(size)

    _, _, rate, force = _motion(time)
    gyro = (1.0 + errors.gyro_scale) * rate + errors.gyro_bias + white(rate.shape, 0.004)
    felt = (1.0 + errors.accelerometer_scale) * force + errors.accelerometer_bias
    felt = felt + white(force.shape, 0.1)

    at = clock(10.0)
    speed, _, _ = _flow(air, at - errors.airspeed_delay, np.array(PITOT) - unit)
    shown = (1.0 + errors.airspeed_scale) * speed + white(at.shape, 0.3)
    airspeed = {"airspeed": shown * np.sqrt(DENSITY / 1.225)}
    streams = [_stream("VFR_HUD", at, airspeed)]

    at = clock(5.0)
    attitude, through, turning, _ = _motion(at - errors.velocity_delay)
    centre = through + frames.rotate(attitude, np.cross(turning, -unit))
    ground = centre + air.wind + white(through.shape, 0.15)
    names = ("v_north", "v_east", "v_down")
    streams.append(
        _stream(
            "GLOBAL_POSITION_INT",
            at,
            dict(zip(names, ground.T, strict=True)) | {"altitude": np.full(at.size, ALTITUDE)},
        )
    )

    at = clock(25.0)
    attitude, _, turning, _ = _motion(at - errors.attitude_delay)
    drift = frames.exponential(air.at("attitude_error", at - errors.attitude_delay))
    wrong = frames.exponential(errors.attitude_offset + white((at.size, 3), 0.004))
    angles = frames.euler_from_quaternion(frames.multiply(frames.multiply(drift, attitude), wrong))
    columns = dict(zip(("roll", "pitch", "yaw"), angles.T, strict=True))
    columns |= dict(zip("pqr", (turning + errors.gyro_bias + white(turning.shape, 0.004)).T,
                        strict=True))  # fmt: skip
    streams.append(_stream("ATTITUDE", at, columns))

    at = clock(20.0)
    _, alpha, beta = _flow(air, at - errors.vane_delay, np.array(VANES) - unit)
    angles = (1.0 + errors.vane_scale) * np.stack([alpha, beta], axis=-1) + errors.vane_bias
    angles = angles + white(angles.shape, 0.005)
    streams.append(_stream("AOA_SSA", at, {"alpha": angles[:, 0], "beta": angles[:, 1]}))

    if accelerometer:
        columns = dict(zip("pqr", gyro.T, strict=True))
        columns |= dict(zip(("acc_x", "acc_y", "acc_z"), felt.T, strict=True))
        streams.append(_stream("RAW_IMU", time, columns))
    return {stream.name: stream for stream in streams}


def _stream(name: str, time: np.ndarray, channels: dict[str, np.ndarray]) -> Stream:
    return Stream(name, time, time, channels)


def without(recording: Recording, *names: str) -> Recording:
    """The same recording had some messages not been sent."""
    kept = {name: stream for name, stream in recording.streams.items() if name not in names}
    return replace(recording, streams=kept)
