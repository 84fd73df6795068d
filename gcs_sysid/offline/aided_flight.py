"""From a reconstructed flight to what the aided filter reads, and first values of its unknowns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft, CoefficientModel, StreamTiming, Value, Vanes
from gcs_sysid.estimate.flight_rows import Flight, Unknowns
from gcs_sysid.model import actuators, aided, air, runge_kutta
from gcs_sysid.model.aided import Means, Noise, Row, Sensors, State
from gcs_sysid.model.air import Air, Turbulence
from gcs_sysid.model.kinematics import Measurements
from gcs_sysid.offline import modes, servo_outputs
from gcs_sysid.offline.flight import SERVO_STREAM, setting
from gcs_sysid.offline.servo_outputs import control_channels, pulses
from gcs_sysid.reconstruct import measurements
from gcs_sysid.reconstruct.aided_smoother import Beginning
from gcs_sysid.reconstruct.airborne import settled
from gcs_sysid.reconstruct.reconstruction import Reconstruction
from gcs_sysid.recording import Recording

HOLE = 1.5
"""A step longer than this many usual ones is a hole, and is filled with rows without data."""
STEP_SHARE = 0.7
"""Of the fastest mode's 1/|λ|, that a row's step h may take. The scheme's growth over a step is off
e^(λh) by (λh)⁵/120, so that a mode is faster or slower by (λh)⁴/120 of itself: here 0.2 %, of a
mode half as fast again as guessed 1 %. No flight tells a damping so well."""
LONGEST_STEP = 0.034
"""Of one row [s] whatever the aircraft: what moves gusts and surfaces is looked up so often."""
SHORTEST_STEP = 0.005
"""Of one row [s]: a file whose modes ask for less is wrong, and its rows would be endless."""
QUICK = 0.95
"""Quantile of the airspeed for which steps are chosen."""
SLOPE_STEP = 2e-3
"""Shift [s] of the surfaces from which their change with delay is taken: into the past only. What
an autopilot commands at a sample answers the noise of that very sample; in the sensitivities it
would make noise tell of the surfaces, and feign a delay of a millisecond."""
PARTS = 8
"""Of a step, at whose ends the surfaces are looked at: to 2.5 ms at 50 Hz."""
HAIR = 1e-6
"""A step ends so much [s] before what is commanded at its end."""
ROTATION_LENGTH = 0.25
"""One standard deviation of the logarithm of the specification's lengths: what turns the air for
seconds is an error of the model."""
ATTITUDE_ERROR_TIME = 40.0
"""First guess of the correlation time of an autopilot's attitude error [s]."""
SPIN = 0.06
"""First guess of the gust's own rotation [rad/s]."""
UNMODELLED = 0.05
"""First guess of unmodelled accelerations, linear and angular [m/s²/√Hz, rad/s²/√Hz]."""
LOWEST = 30.0
"""A log whose usual height is less [m] began in the air, and does not tell the height."""
USUAL = 120.0
"""Height [m] that is then taken for the gusts: up to which small aircraft may fly."""
GYRO_BIAS, ACCELEROMETER_BIAS = 0.01, 0.1
"""One standard deviation [rad/s, m/s²], where the aircraft file does not say."""
AIRSPEED_SCALE, VANE_SCALE = 0.03, 0.1
"""Likewise, relative."""
VANE_BIAS = 0.035
"""Likewise [rad]: two degrees."""
MOMENT_LAG = 0.01
"""One standard deviation [s]: a chord or two of flight."""
AIRSPEED_LAG = 0.1
"""One standard deviation [s]: of tubing a metre long, and of the filters of autopilots."""
AIRSPEED_ERROR = 0.03
"""First guess of noise that an autopilot's filter has smoothed [m/s]: a pascal or two at 20 m/s."""
GYRO_DRIFT = 5e-4
"""First guess of the gyros' drift [rad/s]: 0.03 °/s."""
THRUST_ERROR = 0.1
"""First guess of the thrust maps' error [m/s²]: a hundredth of the weight."""
VELOCITY_ERROR, VELOCITY_ERROR_TIME = 0.05, 4.0
"""First guess of a satellite receiver's slow error [m/s], and of its correlation time [s]."""
START_DEVIATION = np.array(
    [0.03] * 3
    + [1.0] * 3
    + [0.1] * 3
    + [1.0]
    + [2.0, 2.0, 0.5]
    + [1.0] * 3
    + [0.06] * 3
    + [1.0] * 3
    + [0.01] * 3
    + [0.1]
    + [0.1] * 3
    + [0.03]
    + [5e-4] * 3
)
"""Of the first state, in the order of `aided.BLOCKS`."""


def prepare(
    recording: Recording,
    aircraft: Aircraft,
    states: Reconstruction,
    others: Sequence[tuple[Aircraft, float]] = (),
    *,
    moving: Aircraft | None = None,
    late: float = 0.0,
) -> Flight:
    """Rows of the aided filter on the inertial unit's clock, holes filled.

    Where servo outputs fell silent, on the ground and just after lift-off the equations of motion
    are not to be believed, and without servo outputs nowhere: the sensors are left to each other.

    Args:
        recording: the telemetry, of which servo outputs and engines are read.
        aircraft: its controls and engines.
        states: the kinematic reconstruction: sensors on one clock, and a first guess.
        others: the aircraft with one thing about its servos changed, and how much of it that is;
            each makes one of `Row.control_changes` and `Row.setting_changes`, per unit of it.
        moving: the aircraft of which `Row.control_slopes` are taken; None for the same.
        late: delay of the surfaces beyond the file's [s] about which `Row.control_slopes` are
            taken: commands come in steps, and over some milliseconds surfaces turn corners.
    """
    longest = longest_step(aircraft, states.airspeed, states.density)
    kept, time = _without_holes(states.time, longest)
    data = states.data
    before = np.concatenate([time[:1], time[:-1]])
    moments = within(before, time)
    told = SERVO_STREAM in recording.streams

    def moved(one: Aircraft, further: float = 0.0) -> Float[np.ndarray, "row three control"]:
        if not told:
            return np.zeros((time.size, 3, len(one.control_names)))
        return runge_kutta.inputs(_controls(recording, one, moments, late + further))

    controls = moved(aircraft)
    there, now = (aircraft, controls) if moving is None else (moving, moved(moving))
    slopes = (moved(there, SLOPE_STEP) - now) / SLOPE_STEP

    modelled = np.full(time.size, told)
    if told:
        flown = [(before >= first) & (time <= last) for first, last in settled(recording, aircraft)]
        modelled = servo_outputs.known(recording, aircraft, before, time) & np.any(flown, axis=0)

    def driven(one: Aircraft) -> Float[np.ndarray, "row three engine"]:
        return runge_kutta.inputs(_settings(recording, one, moments))

    settings = driven(aircraft)

    def changed(
        at: Callable[[Aircraft], Float[np.ndarray, "row three what"]],
        now: Float[np.ndarray, "row three what"],
    ) -> Float[np.ndarray, "row three what change"]:
        changes = [(at(other) - now) / size for other, size in others]
        return np.stack(changes, axis=-1) if changes else np.zeros((*now.shape, 0))

    rows = Row(
        step=np.diff(time, prepend=time[:1]),
        controls=controls - late * slopes,
        control_slopes=slopes,
        control_changes=changed(moved, controls),
        settings=settings,
        setting_changes=changed(driven, settings),
        density=np.interp(time, states.time, data.density),
        height=np.interp(time, states.time, data.height),
        climbed=np.interp(time, states.time, data.height - data.height[0]),
        passing=np.interp(time, states.time, _passing(states)),
        gyro=_spread(data.gyro, kept, time.size),
        accelerometer=_spread(data.accelerometer, kept, time.size),
        inertial=_flags(kept, time.size),
        modelled=modelled,
        measured=_measured(measurements.as_shown(data, aircraft.pitot.error.lag), kept, time.size),
    )
    nominal = _nominal(states, time)
    first = jax.tree.map(lambda part: part[0], nominal)
    return Flight(rows, nominal, Beginning(first, jnp.diag(jnp.asarray(START_DEVIATION) ** 2)))


def within(
    before: Float[np.ndarray, " row"], time: Float[np.ndarray, " row"]
) -> Float[np.ndarray, "row moment"]:
    """Moments of each row's step at which surfaces and engines are looked at [s].

    Args:
        before: where the steps begin [s].
        time: where they end [s].
    """
    return before[:, None] + (time - HAIR - before)[:, None] * np.linspace(0.0, 1.0, PARTS + 1)


def _passing(states: Reconstruction) -> Float[np.ndarray, " sample"]:
    """Speed through the steady wind, without the gusts that it carries [m/s]."""
    return np.linalg.norm(states.block("velocity") - states.block("wind"), axis=1)


def longest_step(
    aircraft: Aircraft,
    airspeed: Float[np.ndarray, " sample"],
    density: Float[np.ndarray, " sample"],
) -> float:
    """Longest step of a row [s], by the fastest mode of an ordinary aircraft of this mass and size.

    Surfaces do not count: they are looked up as their servos follow the commands, and integrated
    within a step. Nor do gusts, whose correlation times are not known to more than a few per cent.

    Args:
        aircraft: its mass and size.
        airspeed: at which it flies [m/s].
        density: of the air there [kg/m³].
    """
    equivalent = airspeed * np.sqrt(density / modes.DENSITY)
    quick = float(np.quantile(equivalent, QUICK))
    return float(np.clip(STEP_SHARE / modes.fastest(aircraft, quick), SHORTEST_STEP, LONGEST_STEP))


def kept_rows(rows: Row) -> np.ndarray:
    """Rows of `prepare` that are samples of the flight, in their order."""
    return np.flatnonzero(rows.inertial)


def with_structure(aircraft: Aircraft, terms: Mapping[str, Mapping[str, float]]) -> Aircraft:
    """The aircraft with these aerodynamic terms and no others."""
    models = {
        name: CoefficientModel({key: Value(value, 0.0) for key, value in values.items()})
        for name, values in terms.items()
    }
    return replace(aircraft, aerodynamics=models)


class Kinematics(NamedTuple):
    """What the kinematics of a flight say of sensors and gusts, where a search begins.

    Attributes:
        gyro_bias: [rad/s].
        accelerometer_bias: [m/s²].
        gust: one standard deviation along each axis, of which a pitot tube sees the horizontal
            ones [m/s].
    """

    gyro_bias: Float[np.ndarray, " axis"]
    accelerometer_bias: Float[np.ndarray, " axis"]
    gust: Float[np.ndarray, " axis"]


def kinematics(states: Reconstruction) -> Kinematics:
    """Of a whole flight."""
    return Kinematics(
        np.median(states.block("gyro_bias"), axis=0),
        np.median(states.block("accelerometer_bias"), axis=0),
        np.asarray(states.noise.gust),
    )


def first_unknowns(
    flight: Flight,
    aircraft: Aircraft,
    begun: Kinematics,
    terms: Mapping[str, Mapping[str, float]],
) -> Unknowns:
    """Where the search begins; white noise is taken from third differences."""
    aerodynamics = {
        name: {key: jnp.asarray(float(value)) for key, value in values.items()}
        for name, values in terms.items()
    }
    zero, pair = jnp.zeros(()), jnp.zeros(2)
    sensors = Sensors(
        *map(jnp.asarray, (begun.gyro_bias, begun.accelerometer_bias)),
        *(zero, zero, pair, pair),
        *(zero, zero, zero, zero, zero, zero, pair),
    )
    noise = _first_noise(flight.rows, aircraft, begun.gust)
    # Of one type from the beginning: numbers that only seem to be of float64 compile it all twice.
    return jax.tree.map(
        lambda value: jnp.asarray(value, jnp.float64), Unknowns(Means(aerodynamics, sensors), noise)
    )


def _first_noise(rows: Row, aircraft: Aircraft, gust: Float[np.ndarray, " axis"]) -> Noise:
    seen = rows.measured.valid
    level = float(gust[0])
    height = float(np.median(rows.climbed))
    if height < LOWEST:
        height = USUAL
    long, tall = air.scale_lengths(height)
    turning = air.rotation_lengths(aircraft.geometry.wing_span, height)
    turbulence = Turbulence(
        gust=jnp.log(jnp.array([level, level, max(float(gust[2]), level)])),
        gust_length=jnp.log(jnp.array([long, long, tall])),
        spin=jnp.log(jnp.full(3, SPIN)),
        spin_length=jnp.log(jnp.array(turning)),
        coupling=jnp.zeros(2),
        azimuth=jnp.zeros(()),
    )
    attitude = np.unwrap(
        frames.euler_from_quaternion(np.asarray(rows.measured.attitude)[seen[:, 2]]), axis=0
    )
    velocity = np.asarray(rows.measured.velocity)[seen[:, 1]]
    vanes = np.asarray(rows.measured.vanes)[seen[:, 3]]

    def log(value: float, least: float) -> jax.Array:
        return jnp.log(jnp.asarray(max(value, least)))

    tilt = log(_white(attitude), 1e-4)
    return Noise(
        turbulence=turbulence,
        force=log(UNMODELLED, 0.0),
        moment=jnp.log(jnp.full(3, UNMODELLED)),
        attitude_error=jnp.log(jnp.array([0.006, 0.008])),
        attitude_error_time=jnp.log(jnp.full(2, ATTITUDE_ERROR_TIME)),
        push=log(THRUST_ERROR, 0.0),
        velocity_error=log(VELOCITY_ERROR, 0.0),
        velocity_error_time=log(VELOCITY_ERROR_TIME, 0.0),
        airspeed_error=log(AIRSPEED_ERROR, 0.0),
        gyro_error=log(GYRO_DRIFT, 0.0),
        gyro=log(_white(rows.gyro[rows.inertial]), 1e-3),
        accelerometer=log(_white(rows.accelerometer[rows.inertial]), 0.02),
        airspeed=log(_white(np.asarray(rows.measured.airspeed)[seen[:, 0]]), 0.05),
        velocity=jnp.stack(
            [log(_white(velocity[:, :2]), 0.02), log(_white(velocity[:, 2:]), 0.02)]
        ),
        attitude=jnp.stack([tilt, tilt]),
        vanes=log(_white(vanes) if len(vanes) > 3 else 0.01, 1e-3),
    )


def _white(signal: Float[np.ndarray, "sample axis"]) -> float:
    """White noise of the quietest axis: third differences, to which motion adds little."""
    size = np.median(np.abs(np.diff(signal, n=3, axis=0)), axis=0)
    return float(np.min(size) / (0.6745 * np.sqrt(20.0)))


def beliefs(
    first: Unknowns,
    aircraft: Aircraft,
    *,
    used: Mapping[str, str],
    vanes: bool,
    known: Mapping[str, Mapping[str, float]],
) -> tuple[Unknowns, Unknowns]:
    """Prior means and standard deviations; departures from the file are held at none.

    Args:
        first: where the search begins; intensities are believed within factors of it.
        aircraft: what its file says of the sensors; what it says is exact is held.
        used: stream behind each kind of measurement.
        vanes: whether flow vanes were recorded.
        known: standard deviation of each derivative; infinite for none.
    """
    zeros = jax.tree.map(jnp.zeros_like, first.means.sensors)
    sensors = _sensor_deviations(aircraft, used, vanes=vanes)
    flow = 1.0 if vanes else 0.0
    wide = jax.tree.map(lambda value: jnp.full_like(value, 2.0), first.log_noise)
    span = aircraft.geometry.wing_span
    turbulence = wide.turbulence._replace(
        gust_length=jnp.full(3, 0.7),
        spin=jnp.full(3, 0.7),
        spin_length=jnp.full(3, ROTATION_LENGTH),
        coupling=jnp.full(2, np.pi / 4.0 / span),
        azimuth=jnp.asarray(1.0),
    )
    noise = wide._replace(
        turbulence=turbulence,
        attitude_error=jnp.full(2, 1.0),
        attitude_error_time=jnp.full(2, 0.7),
        velocity_error_time=jnp.asarray(0.7),
        airspeed_error=jnp.asarray(1.0),
        gyro_error=jnp.asarray(1.0),
        vanes=jnp.asarray(2.0 * flow),
    )
    spread = {
        name: {key: jnp.asarray(float(known[name][key])) for key in values}
        for name, values in first.means.aerodynamics.items()
    }
    held = jax.tree.map(jnp.zeros_like, first.means.departures)
    return (
        Unknowns(Means(first.means.aerodynamics, zeros, held), first.log_noise),
        Unknowns(Means(spread, sensors, held), noise),
    )


def _sensor_deviations(aircraft: Aircraft, used: Mapping[str, str], *, vanes: bool) -> Sensors:
    """What the aircraft file says of the sensors' errors, and what is usual where it says nothing.

    The inertial unit's scale and the pitot tube's bias are not among the model's unknowns.
    """

    def stated(sigma: float | None, usual: float) -> float:
        return usual if sigma is None else sigma

    def delay(stream: str, usual: float) -> float:
        return stated(aircraft.streams.get(stream, StreamTiming()).sigma, usual)

    unit, pitot = aircraft.imu, aircraft.pitot.error
    flow = Vanes() if aircraft.vanes is None else aircraft.vanes
    there = 1.0 if vanes else 0.0
    pair = (flow.alpha, flow.beta)
    return Sensors(
        gyro_bias=jnp.full(3, stated(unit.gyro.bias_sigma, GYRO_BIAS)),
        accelerometer_bias=jnp.full(3, stated(unit.accelerometer.bias_sigma, ACCELEROMETER_BIAS)),
        airspeed_scale=jnp.asarray(stated(pitot.scale_sigma, AIRSPEED_SCALE)),
        airspeed_lag=jnp.asarray(stated(pitot.lag_sigma, AIRSPEED_LAG)),
        vane_bias=there * jnp.array([stated(one.bias_sigma, VANE_BIAS) for one in pair]),
        vane_scale=there * jnp.array([stated(one.scale_sigma, VANE_SCALE) for one in pair]),
        surface_delay=jnp.asarray(delay(SERVO_STREAM, 0.1)),
        moment_lag=jnp.asarray(MOMENT_LAG),
        airspeed_delay=jnp.asarray(delay(used.get("airspeed", ""), 0.1)),
        velocity_delay=jnp.asarray(delay(used.get("velocity", ""), 0.1)),
        attitude_delay=jnp.asarray(delay(used.get("attitude", ""), 0.05)),
        vane_delay=jnp.asarray(there * delay(used.get("vanes", ""), 0.05)),
        attitude_tilt=jnp.full(2, aided.ATTITUDE_TILT),
    )


def _without_holes(
    time: Float[np.ndarray, " sample"], longest: float
) -> tuple[np.ndarray, Float[np.ndarray, " row"]]:
    """Rows of the samples among all rows, and the times of all rows.

    Slow telemetry is stepped through in as many steps as the fastest mode asks for.

    Args:
        time: of the samples [s].
        longest: step of a row, give or take a tenth of it for a clock that is not quite [s].
    """
    steps = np.diff(time)
    usual = float(np.median(steps))
    parts = max(int(np.ceil(usual / longest - 0.1)), 1)
    added = np.where(steps > HOLE * usual, parts * np.rint(steps / usual).astype(int), parts)
    row = np.concatenate([[0], np.cumsum(added)])
    return row, np.interp(np.arange(row[-1] + 1), row, time)


def _spread(
    values: Float[np.ndarray, "sample axis"], kept: np.ndarray, count: int
) -> Float[np.ndarray, "row axis"]:
    """Values of the samples at their rows, zero at the others."""
    out = np.zeros((count, *values.shape[1:]))
    out[kept] = values
    return out


def _flags(kept: np.ndarray, count: int) -> Bool[np.ndarray, " row"]:
    out = np.zeros(count, dtype=bool)
    out[kept] = True
    return out


def _measured(measured: Measurements, kept: np.ndarray, count: int) -> Measurements:
    measured = jax.tree.map(np.asarray, measured)
    attitude = np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (count, 1))
    attitude[kept] = measured.attitude
    valid = np.zeros((count, measured.valid.shape[1]), dtype=bool)
    valid[kept] = measured.valid
    return Measurements(
        airspeed=_spread(measured.airspeed, kept, count),
        velocity=_spread(measured.velocity, kept, count),
        attitude=attitude,
        vanes=_spread(measured.vanes, kept, count),
        valid=valid,
        age=_spread(measured.age, kept, count),
    )


def _controls(
    recording: Recording,
    aircraft: Aircraft,
    moments: Float[np.ndarray, "row moment"],
    late: float,
) -> Float[np.ndarray, "row moment control"]:
    """Deflections, with the servo stream later than stated by `late` [s]."""
    time, sent = pulses(recording.streams[SERVO_STREAM], control_channels(aircraft))
    stated = aircraft.streams.get(SERVO_STREAM, StreamTiming()).delay
    at = moments.ravel()
    found = actuators.controls(aircraft, sent, time, at=at, extra_delay=stated + late)
    each = [np.broadcast_to(np.asarray(found[name]), at.shape) for name in found]
    return np.stack(each, axis=-1).reshape(*moments.shape, len(each))


def _settings(
    recording: Recording, aircraft: Aircraft, moments: Float[np.ndarray, "row moment"]
) -> Float[np.ndarray, "row moment engine"]:
    each = [
        setting(recording, aircraft, engine, moments.ravel()).reshape(moments.shape)
        for engine in aircraft.propulsion
    ]
    return np.stack(each, axis=-1) if each else np.zeros((*moments.shape, 0))


def _nominal(states: Reconstruction, time: Float[np.ndarray, " row"]) -> State:
    """The kinematic reconstruction as a first guess, moved to the centre of gravity."""

    def at(values: Float[np.ndarray, "sample axis"]) -> Float[np.ndarray, "row axis"]:
        return np.stack(
            [np.interp(time, states.time, values[:, axis]) for axis in range(values.shape[1])],
            axis=-1,
        )

    sign = np.cumprod(
        np.where(np.sum(np.diff(states.smoothed.attitude, axis=0) ** 2, axis=1) > 2.0, -1.0, 1.0)
    )
    attitude = states.smoothed.attitude * np.concatenate([[1.0], sign])[:, None]
    attitude = at(attitude)
    attitude = attitude / np.linalg.norm(attitude, axis=1, keepdims=True)
    blocks = (at(states.block(name)) for name in ("velocity", "wind", "gust"))
    return first_states(
        attitude, *blocks, at(states.rate), at(states.airspeed[:, None]), states.lever
    )


def first_states(
    attitude: Float[np.ndarray, "row four"],
    velocity: Float[np.ndarray, "row axis"],
    wind: Float[np.ndarray, "row axis"],
    gust: Float[np.ndarray, "row axis"],
    rate: Float[np.ndarray, "row axis"],
    airspeed: Float[np.ndarray, "row one"],
    lever: Float[np.ndarray, " axis"],
) -> State:
    """A kinematic estimate as a first guess of the states.

    Args:
        attitude: quaternions, body to NED.
        velocity: of the inertial unit over ground [m/s].
        wind: steady part [m/s].
        gust: the rest of it [m/s].
        rate: angular [rad/s].
        airspeed: true [m/s].
        lever: from the centre of gravity to the inertial unit [m].
    """
    swing = frames.rotate(attitude, np.cross(rate, lever))
    none = np.zeros_like(rate)
    return State(
        attitude=attitude,
        velocity=velocity - swing,
        rate=rate,
        tube=airspeed,
        air=Air(wind, gust, none, none),
        attitude_error=none,
        push=np.zeros_like(airspeed),
        velocity_error=none,
        airspeed_error=np.zeros_like(airspeed),
        gyro_error=none,
    )
