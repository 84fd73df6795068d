"""From the streams of a recording to the rows that the filter reads, on the gyro's clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid import atmosphere, frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import RefusedError
from gcs_sysid.model.kinematics import GRAVITY, MEASURED, Imu, Measurements
from gcs_sysid.reconstruct import cut, inertial_filter
from gcs_sysid.reconstruct.averaged import averaged
from gcs_sysid.reconstruct.smoother import Inputs
from gcs_sysid.recording import Recording, Stream

IMU_STREAMS = ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3")
GYRO_STREAMS = (*IMU_STREAMS, "ATTITUDE", "ATTITUDE_QUATERNION")
ATTITUDE_STREAMS = ("ATTITUDE", "ATTITUDE_QUATERNION")
AIRSPEED_STREAMS = ("AIRSPEED", "VFR_HUD")
VELOCITY_STREAMS = ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "GPS_RAW_INT")
ALTITUDE_STREAMS = ("GLOBAL_POSITION_INT", "GPS_RAW_INT", "VFR_HUD")
PRESSURE_STREAMS = ("SCALED_PRESSURE", "HIGHRES_IMU")

UNLIKE = 0.5
"""A height that differs from the altitude by more than a constant and this share of the altitude's
own spread is none: some logs have zeros there."""
SLOWEST_AIRSPEED = 3.0
"""Below this [m/s] a pitot tube's reading says nothing about the flow."""
ROUNDED = 0.01
"""Readings that are multiples of this may well be the same twice."""
GAP = 0.5
"""A hole in the inertial data longer than this [s] breaks the integration."""


@dataclass(frozen=True)
class FlightData:
    """One airborne interval on the clock of its inertial unit.

    Attributes:
        time: s after the recording's epoch.
        gyro: angular rate [rad/s], the file's known mounting and biases taken off.
        accelerometer: specific force [m/s²], likewise; zero-acceleration values when there is none.
        has_accelerometer: whether specific force was measured.
        measured: other sensors, each sample on the nearest inertial sample.
        density: air density [kg/m³].
        height: above home as the autopilot tells it, else above where the flight begins [m].
        above_home: whether it is above home.
        used: stream behind each group of `MEASURED` and behind `gyro`, `accelerometer`.
        rates: sample rate of each of them in this interval [Hz], as recorded.
    """

    time: Float[np.ndarray, " sample"]
    gyro: Float[np.ndarray, "sample axis"]
    accelerometer: Float[np.ndarray, "sample axis"]
    has_accelerometer: bool
    measured: Measurements
    density: Float[np.ndarray, " sample"]
    height: Float[np.ndarray, " sample"]
    above_home: bool
    used: Mapping[str, str]
    rates: Mapping[str, float]

    def inputs(self) -> Inputs:
        """Rows for `smoother.smooth`."""
        first = np.maximum(np.arange(self.time.size) - 1, 0)
        return Inputs(
            before=Imu(self.gyro[first], self.accelerometer[first]),
            after=Imu(self.gyro, self.accelerometer),
            step=np.diff(self.time, prepend=self.time[:1]),
            measured=self.measured,
        )


def select(recording: Recording, aircraft: Aircraft, window: tuple[float, float]) -> FlightData:
    """Picks the best stream for every quantity inside `window` [s after the epoch].

    Inertial samples that come more often than the motion asks for are averaged.

    Raises:
        RefusedError: when angular rate, airspeed, attitude or velocity is missing.
    """
    source = recording.source
    aircraft = inertial_filter.behind(aircraft, recording.parameters)
    inertial = _inertial(recording)
    gyro_stream = inertial or recording.first(GYRO_STREAMS, "p", "q", "r")
    if gyro_stream is None:
        raise _missing(source, "angular rate", "RAW_IMU or ATTITUDE", "at 50 Hz")
    time, gyro = _series(gyro_stream, ("p", "q", "r"), window)
    shortened = inertial is not None and cut.was_cut(inertial)
    if shortened:
        gyro = cut.restored(gyro, cut.STEPS[:3])
    time = time - lateness(aircraft, gyro_stream.name, "gyro")
    force_time, force = np.zeros(0), np.zeros((0, 3))
    if inertial is not None:
        force_time, force = _series(inertial, ("acc_x", "acc_y", "acc_z"), window)
        force_time = force_time - lateness(aircraft, inertial.name, "accelerometer")
        # What the accelerometers missed is bridged by the model, not by a straight line.
        time, gyro = (item[_beside(time, force_time)] for item in (time, gyro))
    if time.size < 100:
        raise _missing(source, "angular rate while airborne", gyro_stream.name, "at 50 Hz")
    time, keep = np.unique(time, return_index=True)
    felt, rates = gyro[keep], {"gyro": _rate(time)}
    if inertial is not None:
        if shortened:
            force = cut.restored(force, cut.STEPS[3:])
        felt = np.hstack([felt, _interpolate(time, force_time, force)])
    time, felt = averaged(time, felt)
    gyro = felt[:, :3]
    pressure = recording.first(PRESSURE_STREAMS, "static_pressure")
    static, height, above_home = _air(recording, pressure, time)
    used: dict[str, str] = {"gyro": gyro_stream.name}
    measured = _measurements(recording, aircraft, time, static, used, rates)
    if inertial is None:
        attitude = _attitude_at(recording, time)
        accelerometer = frames.unrotate(attitude, np.array([[0.0, 0.0, -GRAVITY]]))
    else:
        accelerometer = felt[:, 3:]
        used["accelerometer"] = inertial.name
        rates["accelerometer"] = _rate(force_time)
    gyro, without_errors = known_errors_off(aircraft, gyro, accelerometer)
    if inertial is not None:
        accelerometer = without_errors
    return FlightData(
        time=time,
        gyro=gyro,
        accelerometer=accelerometer,
        has_accelerometer=inertial is not None,
        measured=measured,
        density=atmosphere.density_from_pressure(static),
        height=height,
        above_home=above_home,
        used=used,
        rates=rates,
    )


def _inertial(recording: Recording) -> Stream | None:
    """The fastest stream that measured both rate and specific force."""
    both = [
        stream
        for name in IMU_STREAMS
        if (stream := recording.streams.get(name)) is not None
        and stream.has("p", "q", "r", "acc_x", "acc_y", "acc_z")
    ]
    return max(both, key=lambda stream: round(stream.rate), default=None)


def _missing(source: str, what: str, message: str, rate: str) -> RefusedError:
    return RefusedError(
        source, f"no {what} was recorded", fix=f"ask the autopilot for {message} {rate}"
    )


def _series(
    stream: Stream, channels: tuple[str, ...], window: tuple[float, float]
) -> tuple[Float[np.ndarray, " sample"], Float[np.ndarray, "sample channel"]]:
    """Times and values of the samples inside `window` in which every channel is valid."""
    values = np.stack([np.asarray(stream.channels[name]) for name in channels], axis=-1)
    inside = (stream.time >= window[0]) & (stream.time <= window[1])
    good = inside & np.all(np.isfinite(values), axis=-1)
    return np.asarray(stream.time)[good], values[good]


def _beside(
    time: Float[np.ndarray, " sample"], known: Float[np.ndarray, " known"]
) -> Bool[np.ndarray, " sample"]:
    """Samples that are near one of the `known` times: an interval and a half of theirs at most."""
    if known.size < 2:
        return np.zeros(time.size, dtype=bool)
    after = np.clip(np.searchsorted(known, time), 1, known.size - 1)
    apart = np.minimum(np.abs(time - known[after - 1]), np.abs(time - known[after]))
    return apart < 1.5 * np.median(np.diff(known))


def _rate(time: Float[np.ndarray, " sample"]) -> float:
    steps = np.diff(time)
    steps = steps[steps > 0.0]
    return float(1.0 / np.median(steps)) if steps.size else 0.0


def _interpolate(
    time: Float[np.ndarray, " sample"],
    known_time: Float[np.ndarray, " known"],
    known: Float[np.ndarray, "known channel"],
) -> Float[np.ndarray, "sample channel"]:
    return np.stack(
        [np.interp(time, known_time, known[:, i]) for i in range(known.shape[1])], axis=-1
    )


def _air(
    recording: Recording, pressure: Stream | None, time: Float[np.ndarray, " sample"]
) -> tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"], bool]:
    """Static pressure [Pa], and height [m] with whether it is above home.

    Density follows from the pressure by the standard atmosphere: the temperature that an autopilot
    reports is that of its own circuit board.
    """
    everything = (-np.inf, np.inf)
    altitude_stream = recording.first(ALTITUDE_STREAMS, "altitude")
    if altitude_stream is not None:
        known, altitude = _series(altitude_stream, ("altitude",), everything)
        altitude = np.interp(time, known, altitude[:, 0])
    elif pressure is None:
        raise _missing(recording.source, "height or static pressure", "SCALED_PRESSURE", "at 10 Hz")
    if pressure is not None:
        known, values = _series(pressure, ("static_pressure",), everything)
        static = np.interp(time, known, values[:, 0])
    else:
        static = atmosphere.pressure(altitude)
    if altitude_stream is None:
        altitude = atmosphere.pressure_altitude(static)
    told = recording.first(ALTITUDE_STREAMS, "height")
    if told is None:
        return static, altitude - altitude[0], False
    known, above = _series(told, ("height",), everything)
    height = np.interp(time, known, above[:, 0])
    if np.std(height - altitude) > UNLIKE * np.std(altitude):
        return static, altitude - altitude[0], False
    # Below home is an error of the height, or a valley: no place for the ground's influence.
    return static, np.maximum(height, 0.0), True


def _attitude_at(
    recording: Recording, time: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, "sample four"]:
    stream = recording.first(ATTITUDE_STREAMS, "roll", "pitch", "yaw")
    if stream is None:
        raise _missing(recording.source, "attitude", "ATTITUDE", "at 50 Hz")
    known, angles = _series(stream, ("roll", "pitch", "yaw"), (-np.inf, np.inf))
    return frames.quaternion_from_euler(_interpolate(time, known, np.unwrap(angles, axis=0)))


def _measurements(
    recording: Recording,
    aircraft: Aircraft,
    time: Float[np.ndarray, " sample"],
    static: Float[np.ndarray, " sample"],
    used: dict[str, str],
    rates: dict[str, float],
) -> Measurements:
    """All groups slotted onto `time`; a sample belongs to the nearest inertial sample."""
    count = time.size
    valid = np.zeros((count, len(MEASURED)), dtype=bool)
    age = np.zeros((count, len(MEASURED)))
    values = {
        "airspeed": np.zeros((count, 1)),
        "velocity": np.zeros((count, 3)),
        "attitude": np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (count, 1)),
        "vanes": np.zeros((count, 2)),
    }
    sources = {
        "airspeed": (AIRSPEED_STREAMS, ("airspeed",)),
        "velocity": (VELOCITY_STREAMS, ("v_north", "v_east", "v_down")),
        "attitude": (ATTITUDE_STREAMS, ("roll", "pitch", "yaw")),
    }
    if aircraft.vanes is not None:
        sources["vanes"] = (("AOA_SSA",), ("alpha", "beta"))
    asked = {"airspeed": "VFR_HUD or AIRSPEED", "velocity": "GLOBAL_POSITION_INT"}
    for group, (names, channels) in sources.items():
        stream = recording.first(names, *channels)
        if stream is None:
            if group == "vanes":
                continue
            message = asked.get(group, "ATTITUDE")
            raise _missing(recording.source, group, message, "at 10 Hz or faster")
        delay = lateness(aircraft, stream.name, group)
        known, data = _series(stream, channels, (time[0] - 0.1 + delay, time[-1] + 0.1 + delay))
        known = known - delay
        if group == "airspeed":
            moving = data[:, 0] > SLOWEST_AIRSPEED
            moving[1:] &= ~held(data[:-1, 0], data[1:, 0])
            known, data = known[moving], data[moving]
            data = true_airspeed(aircraft, data, np.interp(known, time, static))
        elif group == "attitude":
            data = frames.quaternion_from_euler(data)
        rows, chosen, offset = _slots(time, known)
        values[group][rows] = data[chosen]
        index = list(MEASURED).index(group)
        valid[rows, index] = True
        age[rows, index] = offset
        used[group] = stream.name
        rates[group] = _rate(known)
    return Measurements(
        airspeed=values["airspeed"],
        velocity=values["velocity"],
        attitude=values["attitude"],
        vanes=vane_errors_off(aircraft, values["vanes"]),
        valid=valid,
        age=age,
    )


def held(
    before: Float[np.ndarray, "*sample"], now: Float[np.ndarray, "*sample"]
) -> Bool[np.ndarray, "*sample"]:
    """Whether an airspeed [m/s] is the one before, shown again.

    Autopilots measure it ten times a second and tell it in streams of fifty. Taken for measurements
    the repeats feign a staircase that no delay and no lag describes. Two of them are not the same
    to the last digit, unless they were rounded.
    """
    rest = np.abs(now / ROUNDED - np.round(now / ROUNDED))
    fine = rest > np.abs(now) * np.finfo(np.float32).eps / ROUNDED
    return (before == now) & fine


def lateness(aircraft: Aircraft, stream: str, group: str) -> float:
    """How long before its stamp a message describes the aircraft, as the file has it [s].

    A sensor's first-order lag counts as a delay: to first order in the lag they are the same.
    """
    delay = aircraft.streams[stream].delay if stream in aircraft.streams else 0.0
    if group == "gyro":
        return delay + aircraft.imu.gyro.lag
    if group == "accelerometer":
        return delay + aircraft.imu.accelerometer.lag
    if group == "airspeed":
        return delay + aircraft.pitot.error.lag
    if group == "vanes" and aircraft.vanes is not None:
        return delay + 0.5 * (aircraft.vanes.alpha.lag + aircraft.vanes.beta.lag)
    return delay


def as_shown(data: FlightData, lag: float) -> Measurements:
    """Measurements with the airspeed at the time when it was shown.

    Whoever has a model of the pitot tube's lag wants no delay in place of it.

    Args:
        data: with the airspeed at the time that it tells of, by a delay of `lag`.
        lag: of the pitot tube [s].
    """
    measured, group = data.measured, list(MEASURED).index("airspeed")
    old = np.flatnonzero(np.asarray(measured.valid)[:, group])
    age, valid = np.array(measured.age), np.array(measured.valid)
    airspeed = np.zeros_like(np.asarray(measured.airspeed))
    rows, taken, offset = _slots(data.time, data.time[old] + age[old, group] + lag)
    airspeed[rows] = np.asarray(measured.airspeed)[old[taken]]
    valid[:, group], age[:, group] = False, 0.0
    valid[rows, group], age[rows, group] = True, offset
    return measured._replace(airspeed=airspeed, valid=valid, age=age)


def _slots(
    time: Float[np.ndarray, " sample"], known: Float[np.ndarray, " known"]
) -> tuple[np.ndarray, np.ndarray, Float[np.ndarray, " kept"]]:
    """Nearest inertial sample of each measurement: its row, which measurement, and its age.

    Where two measurements fall to one row the nearer stays; one further than half a `GAP` from any
    inertial sample is left out.
    """
    if not known.size:
        return np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros(0)
    right = np.clip(np.searchsorted(time, known), 1, time.size - 1)
    row = np.where(known - time[right - 1] < time[right] - known, right - 1, right)
    offset = known - time[row]
    order = np.lexsort((np.abs(offset), row))
    rows, first = np.unique(row[order], return_index=True)
    chosen = order[first]
    near: Bool[np.ndarray, " kept"] = np.abs(offset[chosen]) < 0.5 * GAP
    return rows[near], chosen[near], offset[chosen][near]


def true_airspeed(
    aircraft: Aircraft,
    indicated: Float[np.ndarray, "sample one"],
    static: Float[np.ndarray, " sample"],
) -> Float[np.ndarray, "sample one"]:
    """True airspeed from what the file says the sensor measures, known errors taken off."""
    error = aircraft.pitot.error
    clean = (indicated[:, 0] - error.bias[0]) / (1.0 + error.scale[0])
    if aircraft.pitot.measures == "TAS":
        return clean[:, None]
    if aircraft.pitot.measures == "CAS":
        clean = atmosphere.cas_to_eas(clean, static)
    return atmosphere.eas_to_tas(clean, atmosphere.density_from_pressure(static))[:, None]


def vane_errors_off(
    aircraft: Aircraft, angles: Float[np.ndarray, "sample two"]
) -> Float[np.ndarray, "sample two"]:
    """Angle of attack and sideslip at the vanes, with the file's biases, scales, upwash undone."""
    vanes = aircraft.vanes
    if vanes is None:
        return angles
    bias = np.array([vanes.alpha.bias[0], vanes.beta.bias[0]])
    scale = np.array([vanes.alpha.scale[0], vanes.beta.scale[0]])
    # The wing turns the flow up and down, not sideways.
    upwash = np.array([vanes.upwash, 0.0])
    return (angles - bias) / ((1.0 + scale) * (1.0 + upwash))


def known_errors_off(
    aircraft: Aircraft,
    gyro: Float[np.ndarray, "sample axis"],
    accelerometer: Float[np.ndarray, "sample axis"],
) -> tuple[Float[np.ndarray, "sample axis"], Float[np.ndarray, "sample axis"]]:
    """Rate and specific force in body axes, with the file's biases, scales and mounting undone."""
    imu = aircraft.imu
    rate = (gyro - np.array(imu.gyro.bias)) / (1.0 + np.array(imu.gyro.scale))
    force = (accelerometer - np.array(imu.accelerometer.bias)) / (
        1.0 + np.array(imu.accelerometer.scale)
    )
    if not any(imu.misalignment):
        return rate, force
    mounting = frames.quaternion_from_euler(np.array([imu.misalignment]))
    return frames.rotate(mounting, rate), frames.rotate(mounting, force)
