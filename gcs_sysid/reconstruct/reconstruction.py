"""Reconstruction of a flight: attitude, air-relative velocity, wind and sensor errors with bands.

Noise intensities are found from the flight itself: sensor noise from sample-to-sample differences,
measurement noise and gust intensity by two rounds of expectation–maximisation on the smoothed
flight (Shumway & Stoffer 1982), then the whole flight is smoothed once.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft, SensorError
from gcs_sysid.model.kinematics import (
    BLOCKS,
    MEASURED,
    SIZE,
    Levers,
    Measurements,
    Noise,
    State,
)
from gcs_sysid.reconstruct.measurements import FlightData
from gcs_sysid.reconstruct.smoother import CHUNK, Inputs, Smoothed, smooth
from gcs_sysid.reconstruct.vane_scale import ScaleBelief, scale_belief

ROUNDS = 2
SAMPLE_ROWS = 24 * CHUNK
"""Rows of the flight's middle on which the noise intensities are found."""

MEASURED_NOISE = np.array([0.6, 0.3, 0.3, 0.3, 0.01, 0.01, 0.02, 0.01, 0.01])
"""First guess of white noise: airspeed [m/s], velocity [m/s], attitude [rad], vanes [rad]."""
MEASURED_FLOOR = np.array([0.1, 0.03, 0.03, 0.03, 0.002, 0.002, 0.004, 0.002, 0.002])

FRESH = {"airspeed": 10.0, "velocity": 10.0, "vanes": 10.0}
"""Independent samples a second [Hz]: what comes faster repeats the errors of tubing, of the flow
around the airframe and of the navigation filter."""

PRIOR = {
    "attitude": 0.05,
    "velocity": 2.0,
    "wind": 8.0,
    "gust": 1.0,
    "accelerometer_bias": 0.1,
    "gyro_bias": np.deg2rad(0.3),
    "attitude_error": np.deg2rad(1.5),
    "airspeed_scale": 0.05,
    "vane_bias": np.deg2rad(2.0),
    "vane_scale": 0.1,
    "airspeed_delay": 0.05,
    "velocity_delay": 0.1,
    "attitude_delay": 0.02,
    # Gusts move the aircraft before the filter has seen all of them, and so feign that vanes are
    # late: by 31 ms where they were not, and with it 1.2° of bias. The file's word counts.
    "vane_delay": 0.001,
    "gyro_scale": 0.01,
    "accelerometer_scale": 0.01,
    "attitude_offset": np.deg2rad(1.0),
}
"""One standard deviation before the flight is looked at; the aircraft file may say otherwise."""
VERTICAL_WIND = 0.3
VERTICAL_DRIFT = 0.005
"""Air neither rises nor sinks for minutes, but over hills and in thermals [m/s, m/s/√s]."""
LEAST_ATTITUDE_ERROR = np.deg2rad(0.1)
ABSENT = 1e-6
GUST_TIME = 3.0
UNSEEN_VERTICAL_GUST = 1.4
"""Vertical over horizontal gust intensity where no vane sees the vertical one: low-level turbulence
has less (MIL-F-8785C), convective more; the larger keeps the bands honest."""


@dataclass(frozen=True)
class States:
    """Motion of an aircraft through the air, as far as the equations of motion ask.

    Attributes:
        time: sample times [s after the epoch].
        noise: intensities the estimate rests on.
        airspeed: true airspeed at the centre of gravity [m/s].
        alpha: angle of attack there [rad].
        beta: sideslip there [rad].
        flow_covariance: of the three.
        rate: angular rate, sensor errors off [rad/s].
        force: specific force at the inertial unit, sensor errors off [m/s²].
        lever: position of the inertial unit from the centre of gravity [m].
        density: of the air [kg/m³].
        height: above the ground at take-off or start [m].
    """

    time: Float[np.ndarray, " sample"]
    noise: Noise
    airspeed: Float[np.ndarray, " sample"]
    alpha: Float[np.ndarray, " sample"]
    beta: Float[np.ndarray, " sample"]
    flow_covariance: Float[np.ndarray, "sample three three"]
    rate: Float[np.ndarray, "sample axis"]
    force: Float[np.ndarray, "sample axis"]
    lever: Float[np.ndarray, " axis"]
    density: Float[np.ndarray, " sample"]
    height: Float[np.ndarray, " sample"]


@dataclass(frozen=True)
class Reconstruction(States):
    """A flight as the kinematics explain it, on the inertial unit's clock.

    Attributes:
        data: what it was made from.
        smoothed: the smoother's answer.
        euler: roll, pitch, yaw [rad].
        wind: steady wind plus gust, blowing toward NED [m/s].
        gust_rate: rotation of the air, body axes [rad/s]; None where it is not known.
    """

    data: FlightData
    smoothed: Smoothed
    euler: Float[np.ndarray, "sample axis"]
    wind: Float[np.ndarray, "sample axis"]
    gust_rate: Float[np.ndarray, "sample axis"] | None = None

    def block(self, name: str) -> Float[np.ndarray, "sample size"]:
        """Smoothed values of one block of the state."""
        return self.smoothed.rest[:, BLOCKS[name]]

    def deviation(self, name: str) -> Float[np.ndarray, "sample size"]:
        """Their one standard deviation."""
        return self.smoothed.deviation[:, BLOCKS[name]]


def reconstruct(data: FlightData, aircraft: Aircraft) -> Reconstruction:
    """Smooths a flight and describes it at the centre of gravity.

    Args:
        data: one airborne interval.
        aircraft: positions of the sensors, their known errors and how well these are known.

    Returns:
        States, wind and sensor errors with their uncertainty. Without flow vanes, angles of attack
        and sideslip see gusts only through the airspeed: their bands then hold the gust.
    """
    levers, reference = sensor_levers(aircraft)
    noise = first_noise(data)
    inputs = data.inputs()
    first, rows = _middle(inputs)
    believed: ScaleBelief | None = None
    for _ in range(ROUNDS):
        state, covariance = first_state(data, aircraft, first)
        prior = covariance if believed is None else believed.held(covariance, rows)
        part = smooth(state, prior, rows, levers, reference, noise)
        noise = _refined(noise, part, rows)
        if believed is None and "vanes" in data.used:
            believed = scale_belief(noise, part, rows, covariance)
    state, covariance = first_state(data, aircraft, 0)
    if believed is None:
        smoothed = smooth(state, covariance, inputs, levers, reference, noise)
    else:
        prior = believed.held(covariance, inputs)
        smoothed = believed.told(smooth(state, prior, inputs, levers, reference, noise))
    return _described(data, smoothed, noise, -reference)


def sensor_levers(aircraft: Aircraft) -> tuple[Levers, Float[np.ndarray, " axis"]]:
    """Sensor positions, and the centre of gravity, from the inertial unit.

    Velocity over ground is that of the centre of gravity: a navigation filter corrects for where
    its inertial unit and its antenna sit.
    """
    unit = np.array(aircraft.imu.position)
    vanes = np.array(aircraft.vanes.position) if aircraft.vanes is not None else unit
    centre = np.array(aircraft.mass.cg) - unit
    levers = Levers(
        pitot=jnp.asarray(np.array(aircraft.pitot.position) - unit),
        vanes=jnp.asarray(vanes - unit),
        velocity=jnp.asarray(centre),
    )
    return levers, centre


def first_noise(data: FlightData) -> Noise:
    """Intensities before the flight has been smoothed.

    White noise of a signal is its third difference's median size: motion contributes little to it
    and bursts of motion do not move a median (a third difference of white noise has 20 times its
    variance). The change between neighbouring samples, at full rate, says how far the motion may
    have gone in a hole.
    """

    def white(signal: Float[np.ndarray, "sample axis"]) -> float:
        size = np.median(np.abs(np.diff(signal, n=3, axis=0)), axis=0)
        return float(np.max(size) / (0.6745 * np.sqrt(20.0)))

    step = float(np.median(np.diff(data.time)))

    def change(signal: Float[np.ndarray, "sample axis"]) -> float:
        usual = np.diff(data.time) < 1.5 * step
        square = np.mean(np.diff(signal, axis=0)[usual] ** 2, axis=0)
        return float(np.sqrt(np.max(square) / step))

    accelerometer = white(data.accelerometer) if data.has_accelerometer else 3.0
    # Of a type of their own, not a Python number's: else the smoother is compiled once more for
    # the intensities that the flight gives.
    return Noise(
        gyro=jnp.asarray(np.hypot(white(data.gyro), 0.002)),
        accelerometer=jnp.asarray(np.hypot(accelerometer, 0.05)),
        gyro_change=jnp.asarray(change(data.gyro)),
        accelerometer_change=jnp.asarray(change(data.accelerometer)),
        accelerometer_drift=jnp.asarray(1e-3, dtype=float),
        gyro_drift=jnp.asarray(1e-5, dtype=float),
        wind_drift=jnp.asarray(np.array([0.05, 0.05, VERTICAL_DRIFT])),
        gust=jnp.asarray(np.array([1.0, 1.0, UNSEEN_VERTICAL_GUST])),
        gust_time=jnp.asarray(GUST_TIME, dtype=float),
        attitude_error=jnp.asarray(np.deg2rad([1.0, 1.0, 3.0])),
        attitude_error_time=jnp.asarray(20.0, dtype=float),
        measured=jnp.asarray(MEASURED_NOISE * np.sqrt(repeated(data.time, data.measured))),
    )


def repeated(
    time: Float[np.ndarray, " sample"], measured: Measurements
) -> Float[np.ndarray, " row"]:
    """How many samples of each row share one error: its white noise has this times the variance."""
    counts = np.ones(MEASURED_NOISE.size)
    for group, (name, rows) in enumerate(MEASURED.items()):
        rate = np.count_nonzero(measured.valid[:, group]) / max(float(np.ptp(time)), 1e-6)
        counts[rows] = max(1.0, rate / FRESH.get(name, np.inf))
    return counts


def first_state(
    data: FlightData, aircraft: Aircraft, row: int
) -> tuple[State, Float[np.ndarray, "state state"]]:
    """Estimate at a row of the flight from the first measurements after it, and its covariance."""
    first = _first_seen(data, row)
    rest = np.zeros(SIZE)
    rest[BLOCKS["velocity"]] = first["velocity"]
    # Without it a strong wind looks like sideslip of tens of degrees, from which the vanes' scale
    # never finds back. The prior stays as wide as if nothing had been seen.
    through_air = frames.rotate(first["attitude"], first["airspeed"] * np.array([1.0, 0.0, 0.0]))
    rest[BLOCKS["wind"]][:2] = (first["velocity"] - through_air)[:2]
    deviation = np.zeros(SIZE)
    for name, rows in BLOCKS.items():
        deviation[rows] = PRIOR[name]
    deviation[BLOCKS["wind"]][2] = VERTICAL_WIND
    if not data.has_accelerometer:
        deviation[BLOCKS["accelerometer_bias"]] = ABSENT
        deviation[BLOCKS["accelerometer_scale"]] = ABSENT
        # Motion that was not measured tells no stream's lateness.
        for name in ("airspeed_delay", "velocity_delay", "attitude_delay", "vane_delay"):
            deviation[BLOCKS[name]] = ABSENT
    if "vanes" not in data.used:
        for name in ("vane_bias", "vane_scale", "vane_delay"):
            deviation[BLOCKS[name]] = ABSENT
    _stated(deviation, data, aircraft)
    state = State(jnp.asarray(first["attitude"]), jnp.asarray(rest))
    return state, np.diag(deviation**2)


def _first_seen(data: FlightData, row: int) -> dict[str, Float[np.ndarray, " size"]]:
    """First measurement of each kind at or after a row."""
    valid = data.measured.valid[row:]
    return {
        name: np.asarray(getattr(data.measured, name))[row + int(np.argmax(valid[:, group]))]
        for group, name in enumerate(MEASURED)
    }


def _stated(deviation: Float[np.ndarray, " state"], data: FlightData, aircraft: Aircraft) -> None:
    """Writes what the aircraft file says of its sensors' uncertainty over the defaults."""

    def put(name: str, sigma: float | None, row: int | None = None) -> None:
        if sigma is not None:
            rows = BLOCKS[name]
            deviation[rows if row is None else rows.start + row] = max(sigma, ABSENT)

    def put_error(bias: str, scale: str, error: SensorError, row: int | None = None) -> None:
        put(bias, error.bias_sigma, row)
        put(scale, error.scale_sigma, row)

    put_error("accelerometer_bias", "accelerometer_scale", aircraft.imu.accelerometer)
    put_error("gyro_bias", "gyro_scale", aircraft.imu.gyro)
    put("airspeed_scale", aircraft.pitot.error.scale_sigma)
    put("airspeed_delay", aircraft.pitot.error.lag_sigma)
    if aircraft.vanes is not None:
        put_error("vane_bias", "vane_scale", aircraft.vanes.alpha, 0)
        put_error("vane_bias", "vane_scale", aircraft.vanes.beta, 1)
        put("vane_delay", aircraft.vanes.alpha.lag_sigma)
    for group in ("airspeed", "velocity", "attitude", "vanes"):
        timing = aircraft.streams.get(data.used.get(group, ""))
        if timing is not None:
            put(f"{group.removesuffix('s')}_delay", timing.sigma)


def _middle(inputs: Inputs) -> tuple[int, Inputs]:
    """The middle of the flight, at most `SAMPLE_ROWS` long, and where it starts."""
    count = inputs.step.shape[0]
    first = max(0, (count - SAMPLE_ROWS) // 2)
    rows = slice(first, first + SAMPLE_ROWS)
    return first, jax.tree.map(lambda values: values[rows], inputs)


def _refined(noise: Noise, smoothed: Smoothed, inputs: Inputs) -> Noise:
    """One round of expectation–maximisation: measurement noise, attitude error, gust intensity.

    The gust's is taken from its horizontal component along the flight path, which the pitot tube
    sees; with vanes from all three components. Steps are plain: taken further, a gust that two
    sensors disagree about grows from round to round, and one in light air falls below what flew.
    """
    repeats = repeated(np.cumsum(inputs.step), inputs.measured)
    gross = 5.0 * np.asarray(noise.measured) / np.sqrt(repeats)
    residual = np.where(
        np.isfinite(smoothed.residual),
        np.clip(smoothed.residual, -gross, gross),
        np.nan,
    )
    present = np.isfinite(residual).any(axis=0)
    square = np.nanmean(
        np.where(present, residual, 0.0) ** 2 + np.where(present, smoothed.residual_variance, 0.0),
        axis=0,
    )
    measured = np.maximum(np.sqrt(square), MEASURED_FLOOR) * np.sqrt(repeats)
    gust = smoothed.rest[:, BLOCKS["gust"]]
    second = gust**2 + smoothed.deviation[:, BLOCKS["gust"]] ** 2
    if inputs.measured.valid[:, list(MEASURED).index("vanes")].any():
        level = np.sqrt(np.mean(second[:, :2]))
        vertical = np.sqrt(np.mean(second[:, 2]))
    else:
        ahead = frames.rotate(smoothed.attitude, np.array([[1.0, 0.0, 0.0]]))[:, :2]
        level = np.sqrt(np.sum(second[:, :2] * ahead**2) / np.sum(ahead**2))
        vertical = UNSEEN_VERTICAL_GUST * level
    slow = BLOCKS["attitude_error"]
    error = np.mean(smoothed.rest[:, slow] ** 2 + smoothed.deviation[:, slow] ** 2, axis=0)
    # North and east are like each other: the vertical has no heading.
    error = np.sqrt(np.array([error[:2].mean(), error[:2].mean(), error[2]]))
    error = np.clip(error, LEAST_ATTITUDE_ERROR, np.deg2rad(5.0))
    return noise._replace(
        attitude_error=jnp.asarray(error),
        measured=jnp.asarray(np.where(present, measured, np.asarray(noise.measured))),
        gust=jnp.asarray(gust_intensities(level, vertical)),
    )


def gust_intensities(level: float, vertical: float) -> Float[np.ndarray, " axis"]:
    """Standard deviation of the gust toward north, east, down [m/s], within what is credible."""
    return np.clip(np.array([level, level, vertical]), 0.1, 6.0)


def _described(
    data: FlightData, smoothed: Smoothed, noise: Noise, lever: Float[np.ndarray, " axis"]
) -> Reconstruction:
    def block(name: str) -> Float[np.ndarray, "sample size"]:
        return smoothed.rest[:, BLOCKS[name]]

    rate = (data.gyro - block("gyro_bias")) / (1.0 + block("gyro_scale"))
    force = (data.accelerometer - block("accelerometer_bias")) / (
        1.0 + block("accelerometer_scale")
    )
    return Reconstruction(
        data=data,
        smoothed=smoothed,
        time=data.time,
        noise=noise,
        density=data.density,
        height=data.height,
        airspeed=smoothed.flow[:, 0],
        alpha=smoothed.flow[:, 1],
        beta=smoothed.flow[:, 2],
        flow_covariance=smoothed.flow_covariance,
        rate=rate,
        force=force,
        euler=frames.euler_from_quaternion(smoothed.attitude),
        wind=block("wind") + block("gust"),
        lever=lever,
    )
