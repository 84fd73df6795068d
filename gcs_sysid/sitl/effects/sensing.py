"""Sensors that indicate something else than the aircraft file says, and streams that are late."""

from __future__ import annotations

from dataclasses import replace

from gcs_sysid.aircraft import Imu, SensorError, Vanes
from gcs_sysid.aircraft_toml.section import Section
from gcs_sysid.sitl.effects import changes
from gcs_sysid.sitl.flight import Flight
from gcs_sysid.sitl.telemetry import RATES

OUTPUTS = "SERVO_OUTPUT_RAW"


def airspeed_scale(flight: Flight, entry: Section) -> Flight:
    """`airspeed_scale`: indicated = (1 + s)·true."""
    entry.allow_only("name", "airspeed_scale")
    scale = entry.number("airspeed_scale", "1", above=-1.0)
    old = flight.flown.pitot.error
    return _pitot(flight, replace(old, scale=((1.0 + old.scale[0]) * (1.0 + scale) - 1.0,)))


def pitot_lag(flight: Flight, entry: Section) -> Flight:
    """`pitot_lag`: added to the first-order lag of the airspeed [s]."""
    entry.allow_only("name", "pitot_lag")
    old = flight.flown.pitot.error
    return _pitot(flight, replace(old, lag=old.lag + entry.number("pitot_lag", "s", least=0.0)))


def accelerometer_bias(flight: Flight, entry: Section) -> Flight:
    """`bias_x`, `bias_y`, `bias_z`: indicated less true specific force [m/s²]."""
    keys = ("bias_x", "bias_y", "bias_z")
    entry.allow_only("name", *keys)
    unit = flight.flown.imu
    error = unit.accelerometer
    bias = changes.plus(error.bias, changes.vector(entry, keys, "m/s²"))
    return _imu(flight, replace(unit, accelerometer=replace(error, bias=bias)))


def gyro_scale(flight: Flight, entry: Section) -> Flight:
    """`scale_x`, `scale_y`, `scale_z`: indicated = (1 + scale)·true rate."""
    keys = ("scale_x", "scale_y", "scale_z")
    entry.allow_only("name", *keys)
    unit = flight.flown.imu
    scale = changes.plus(unit.gyro.scale, changes.vector(entry, keys, "1"))
    return _imu(flight, replace(unit, gyro=replace(unit.gyro, scale=scale)))


def imu_misalignment(flight: Flight, entry: Section) -> Flight:
    """`tilt_x`, `tilt_y`, `tilt_z`: roll, pitch and yaw of the unit in the airframe [rad]."""
    keys = ("tilt_x", "tilt_y", "tilt_z")
    entry.allow_only("name", *keys)
    unit = flight.flown.imu
    tilt = changes.plus(unit.misalignment, changes.vector(entry, keys, "rad"))
    return _imu(flight, replace(unit, misalignment=tilt))


def imu_position(flight: Flight, entry: Section) -> Flight:
    """`dx`, `dy`, `dz`: the unit sits this far from where the file says, body axes [m]."""
    keys = ("dx", "dy", "dz")
    entry.allow_only("name", *keys)
    unit = flight.flown.imu
    position = changes.plus(unit.position, changes.vector(entry, keys, "m"))
    return _imu(flight, replace(unit, position=position))


def vane_bias(flight: Flight, entry: Section) -> Flight:
    """`alpha_bias`, `beta_bias`: indicated less true flow angle [rad]."""
    entry.allow_only("name", "alpha_bias", "beta_bias")
    vanes = flight.flown.vanes
    if vanes is None:
        raise entry.error(
            "name",
            found="an aircraft without vanes",
            allowed="an aircraft file with `[vanes]`",
            fix="give the aircraft vanes, or hide something else",
        )
    alpha, beta = changes.numbers(entry, {"alpha_bias": "rad", "beta_bias": "rad"}).values()
    biased: Vanes = replace(
        vanes, alpha=_more_bias(vanes.alpha, alpha), beta=_more_bias(vanes.beta, beta)
    )
    return changes.flying(flight, replace(flight.flown, vanes=biased))


def heading_bias(flight: Flight, entry: Section) -> Flight:
    """`heading_bias`: indicated less true heading [rad], in every message that tells it."""
    entry.allow_only("name", "heading_bias")
    bias = flight.hidden.heading_bias + entry.number("heading_bias", "rad")
    return replace(flight, hidden=replace(flight.hidden, heading_bias=bias))


def time_skew(flight: Flight, entry: Section) -> Flight:
    """`delay` of `stream` [s]: what a message says was true that long before its time stamp.

    Of SERVO_OUTPUT_RAW, as in the aircraft file: the surfaces move that long after it, or before
    it where the delay is negative.
    """
    entry.allow_only("name", "stream", "delay")
    stream = entry.text("stream", allowed=tuple(RATES))
    least = -1.0 if stream == OUTPUTS else 0.0
    delay = entry.number("delay", "s", least=least, most=1.0)
    delays = flight.hidden.delays
    late = {**delays, stream: delays.get(stream, 0.0) + delay}
    return replace(flight, hidden=replace(flight.hidden, delays=late))


def _pitot(flight: Flight, error: SensorError) -> Flight:
    aircraft = flight.flown
    return changes.flying(flight, replace(aircraft, pitot=replace(aircraft.pitot, error=error)))


def _imu(flight: Flight, unit: Imu) -> Flight:
    return changes.flying(flight, replace(flight.flown, imu=unit))


def _more_bias(error: SensorError, bias: float) -> SensorError:
    return replace(error, bias=(error.bias[0] + bias,))
