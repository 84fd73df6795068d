"""Where a flight has been: airspeed, attitude, load, controls; and how gusty it was."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage, optimize

from gcs_sysid.reconstruct.airborne import Interval
from gcs_sysid.reconstruct.control_history import ControlHistory, activity
from gcs_sysid.reconstruct.measurements import (
    AIRSPEED_STREAMS,
    ATTITUDE_STREAMS,
    GYRO_STREAMS,
    IMU_STREAMS,
    VELOCITY_STREAMS,
)
from gcs_sysid.recording import Recording

GRAVITY = 9.80665
"""Standard gravity [m/s²]: what one unit of load factor is."""
CLOCK = 5.0
"""Rate [Hz] at which airspeed and speed over ground are compared."""
SCALE = (0.8, 1.4)
"""True over indicated airspeed: a bad pitot tube to a good one at 6000 m."""
SHORTEST_FOR_WIND = 60.0
"""A wind fitted to less flight [s] means nothing."""

_CHANNELS: tuple[tuple[str, tuple[str, ...], str, str], ...] = (
    ("airspeed", AIRSPEED_STREAMS, "airspeed", "m/s"),
    ("bank", ATTITUDE_STREAMS, "roll", "rad"),
    ("pitch", ATTITUDE_STREAMS, "pitch", "rad"),
    ("height", ("GLOBAL_POSITION_INT", "ALTITUDE", "LOCAL_POSITION_NED"), "height", "m"),
    ("p", GYRO_STREAMS, "p", "rad/s"),
    ("q", GYRO_STREAMS, "q", "rad/s"),
    ("r", GYRO_STREAMS, "r", "rad/s"),
    ("alpha", ("AOA_SSA",), "alpha", "rad"),
    ("beta", ("AOA_SSA",), "beta", "rad"),
)


@dataclass(frozen=True)
class Wind:
    """Mean wind and what was left of it: blowing toward north, east [m/s], gust sd [m/s]."""

    north: float
    east: float
    gust: float


def airborne_mask(
    time: Float[np.ndarray, " sample"], flights: tuple[Interval, ...]
) -> Bool[np.ndarray, " sample"]:
    """Which samples lie in one of the flights."""
    inside = np.zeros(time.size, dtype=bool)
    for start, end in flights:
        inside |= (time >= start) & (time <= end)
    return inside


def visited(recording: Recording, flights: tuple[Interval, ...]) -> dict[str, dict[str, Any]]:
    """Range, mean and standard deviation of each quantity while airborne.

    The range leaves out the outermost half per cent at each end: single bad samples.
    """
    result = {}
    for name, streams, channel, unit in _CHANNELS:
        stream = recording.first(streams, channel)
        if stream is None:
            continue
        inside = airborne_mask(stream.time, flights) & stream.valid(channel)
        values = np.asarray(stream.channels[channel])[inside]
        if name in ("alpha", "beta") and not np.any(values):
            continue  # a sender without vanes fills the message with zeros
        if values.size > 10:
            result[name] = _range(values, unit)
    inertial = recording.first(IMU_STREAMS, "acc_z")
    if inertial is not None:
        inside = airborne_mask(inertial.time, flights) & inertial.valid("acc_z")
        load = -np.asarray(inertial.channels["acc_z"])[inside] / GRAVITY
        if load.size > 10:
            result["load_factor"] = _range(load, "1")
    return result


def _range(values: Float[np.ndarray, " sample"], unit: str) -> dict[str, Any]:
    low, high = np.percentile(values, (0.5, 99.5))
    return {
        "min": float(low),
        "max": float(high),
        "mean": float(np.mean(values)),
        "sd": float(np.std(values)),
        "unit": unit,
    }


def controls(
    history: ControlHistory | None, flights: tuple[Interval, ...]
) -> dict[str, dict[str, Any]]:
    """Range of each control while airborne and how much it is moved (faster than two seconds).

    Surfaces of an aircraft file in rad, uncalibrated outputs in µs from 1500, throttle 0 to 1.
    """
    if history is None:
        return {}
    inside = airborne_mask(history.time, flights)
    result = {}
    for signal in history.signals:
        if signal.throttle:
            scale, unit, offset = 0.5, "1", 0.5
        elif signal.calibrated:
            scale, unit, offset = signal.deflection, "rad", 0.0
        else:
            scale, unit, offset = 500.0, "us", 0.0
        values = scale * signal.values[inside] + offset
        moved = scale * activity(signal.values, history.step)[inside]
        if values.size > 10:
            result[signal.name] = {
                **_range(values, unit),
                "activity": float(np.sqrt(np.mean(moved**2))),
            }
    return result


def wind(recording: Recording, flights: tuple[Interval, ...]) -> Wind | None:
    """Mean wind and gust along the path, from airspeed against velocity over ground.

    The wind is the constant one that best explains |ground velocity - wind| = scale · airspeed;
    what is left, slower than half a second and faster than twenty, is gust. An estimate for
    judging a flight, not for using: it takes a changing wind for gusts.

    Returns:
        None without airspeed and velocity, or from less than a minute of flight.
    """
    air = recording.first(AIRSPEED_STREAMS, "airspeed")
    ground = recording.first(VELOCITY_STREAMS, "v_north", "v_east")
    if air is None or ground is None:
        return None
    time = np.concatenate([np.arange(start, end, 1.0 / CLOCK) for start, end in flights] or [[]])
    if time.size < SHORTEST_FOR_WIND * CLOCK:
        return None
    good = air.valid("airspeed")
    speed = np.interp(time, air.time[good], air.channels["airspeed"][good])
    speed = ndimage.uniform_filter1d(speed, 3)
    valid = ground.valid("v_north") & ground.valid("v_east")
    known = ground.time[valid]
    north = np.interp(time, known, ground.channels["v_north"][valid])
    east = np.interp(time, known, ground.channels["v_east"][valid])
    down = _vertical(recording, time)

    def left(unknown: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " sample"]:
        through_air = np.sqrt((north - unknown[0]) ** 2 + (east - unknown[1]) ** 2 + down**2)
        return unknown[2] * speed - through_air

    # On a straight flight a scale of zero would explain any gust away as a tail wind.
    bounds = ([-np.inf, -np.inf, SCALE[0]], [np.inf, np.inf, SCALE[1]])
    guess = np.array([0.0, 0.0, 1.0])
    found = optimize.least_squares(left, guess, bounds=bounds, loss="soft_l1", f_scale=2.0)
    rest = left(found.x)
    rest = rest - ndimage.uniform_filter1d(rest, int(20.0 * CLOCK))
    spread = 1.4826 * float(np.median(np.abs(rest - np.median(rest))))
    return Wind(float(found.x[0]), float(found.x[1]), spread)


def restlessness(recording: Recording, flights: tuple[Interval, ...]) -> float | None:
    """How much the load factor jitters [g] in the quietest fifth of a flight; None unmeasured.

    Faster than two seconds, root mean square over as long: maneuvers come and go, gusts stay.
    """
    stream = recording.first(IMU_STREAMS, "acc_z")
    if stream is None or stream.rate < 4.0:
        return None
    good = stream.valid("acc_z") & airborne_mask(stream.time, flights)
    if good.sum() < 100:
        return None
    load = -np.asarray(stream.channels["acc_z"])[good] / GRAVITY
    # A tenth of a second is averaged away: engine vibration is no gust.
    load = ndimage.uniform_filter1d(load, max(1, round(0.1 * stream.rate)))
    wide = max(3, round(2.0 * stream.rate))
    fast = load - ndimage.uniform_filter1d(load, wide)
    return float(np.percentile(np.sqrt(ndimage.uniform_filter1d(fast**2, wide)), 20.0))


def _vertical(recording: Recording, time: Float[np.ndarray, " sample"]) -> np.ndarray:
    stream = recording.first(VELOCITY_STREAMS, "v_down")
    if stream is None:
        return np.zeros(time.size)
    good = stream.valid("v_down")
    return np.interp(time, stream.time[good], stream.channels["v_down"][good])


def speed_of(found: Mapping[str, Mapping[str, Any]]) -> float:
    """Mean airspeed [m/s] of an envelope; NaN where none was measured."""
    return float(found["airspeed"]["mean"]) if "airspeed" in found else float("nan")
