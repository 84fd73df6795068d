"""Data compatibility inside the aided filter: do the sensors agree with the whole flight model?

What `compatibility` asks of the kinematics, asked of the filter that knows the aerodynamics as
well: sensor errors as they were found with them, and innovations of every sensor, those of the
inertial unit included. The filter finds its noises too, and what a sensor has wrong may all go into
these: innovations are then as large as is expected, and as white. So noise that is no longer
ordinary counts as well, and an error that lasts for tenths of a second or for seconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gcs_sysid import frames
from gcs_sysid.estimate import scoring
from gcs_sysid.estimate.filter_error import Fit
from gcs_sysid.model import aided, aided_linear
from gcs_sysid.model.aided import Noise
from gcs_sysid.offline.flight import Flight
from gcs_sysid.reconstruct import aided_smoother
from gcs_sysid.reconstruct.compatibility import (
    Channel,
    Compatibility,
    Estimate,
    innovations,
    readable,
    stands_out,
    together,
    words,
)

CORRELATED = 0.3
"""Correlation of successive innovations from which on it counts: the 95 % limit of thousands of
innovations is a hundredth, and no model of a real aircraft is right to that."""
LAG = 0.1
"""Lag up to which a pitot tube counts as ordinary [s]."""
NOISE: Mapping[str, tuple[float, float]] = {
    "accelerometer": (np.inf, np.inf),
    "gyro": (np.inf, np.deg2rad(0.3)),
    "airspeed": (0.7, 0.5),
    "velocity": (0.5, 0.3),
    "roll": (np.deg2rad(1.0), np.deg2rad(1.5)),
    "pitch": (np.deg2rad(1.0), np.deg2rad(1.5)),
    "yaw": (np.deg2rad(3.0), np.deg2rad(5.0)),
    "alpha": (np.deg2rad(2.0), np.inf),
    "beta": (np.deg2rad(2.0), np.inf),
}
"""White noise, and size of an error that lasts, up to which a sensor of a small aircraft counts as
ordinary. White noise of the inertial unit is vibration, of any size."""


def check(fit: Fit, flight: Flight) -> Compatibility:
    """Judges every channel that took part in a fit inside the filter.

    Args:
        fit: of the flight.
        flight: with the aircraft as its file has it, and the names of the streams.
    """
    used = flight.reconstruction.data.used
    found, sure = fit.unknowns.means.sensors, fit.deviation.means.sensors
    channels: dict[str, Channel] = {}

    def error(name: str, unit: str, *index: int) -> Estimate:
        value, deviation = (np.asarray(getattr(part, name))[index] for part in (found, sure))
        return Estimate(float(value), float(deviation), unit)

    inertial = {"accelerometer": "m/s²", "gyro": "rad/s"}
    if not flight.reconstruction.data.has_accelerometer:
        del inertial["accelerometer"]
    for sensor, unit in inertial.items():
        for index, axis in enumerate("xyz"):
            bias = error(f"{sensor}_bias", unit, index)
            if sensor == "gyro":
                bias = _with_mean(fit, "gyro_bias", "gyro_error", index, unit)
            channels[f"{sensor}_{axis}"] = _channel(fit, sensor, index, unit, bias=bias)
    if "airspeed" in used:
        lag = error("airspeed_lag", "s")
        channels["airspeed"] = _channel(
            *(fit, "airspeed", 0, "m/s"),
            scale=error("airspeed_scale", "1"),
            delay=error("airspeed_delay", "s"),
            lag=replace(lag, value=flight.aircraft.pitot.error.lag + lag.value),
        )
    if "velocity" in used:
        delay = error("velocity_delay", "s")
        for index, axis in enumerate(("north", "east", "down")):
            channels[f"velocity_{axis}"] = _channel(*(fit, "velocity", index, "m/s"), delay=delay)
    if "attitude" in used:
        delay = error("attitude_delay", "s")
        for index, name in enumerate(("roll", "pitch", "yaw")):
            tilt = None if name == "yaw" else "attitude_tilt"
            channels[name] = _channel(
                *(fit, "attitude", index, "rad"),
                bias=_with_mean(fit, tilt, "attitude_error", index, "rad"),
                delay=delay,
                name=name,
            )
    if "vanes" in used:
        delay = error("vane_delay", "s")
        for index, name in enumerate(("alpha", "beta")):
            channels[name] = _channel(
                *(fit, "vanes", index, "rad"),
                bias=error("vane_bias", "rad", index),
                scale=error("vane_scale", "1", index),
                delay=delay,
                name=name,
            )
    return Compatibility(channels, together(channels, "the flight model and the others"), "aided")


def _with_mean(fit: Fit, constant: str | None, drift: str, index: int, unit: str) -> Estimate:
    """A constant error, where there is one, and the mean of what drifts beside it.

    The two are hardly told apart, so that their sum is known better than either.
    """
    path = np.asarray(getattr(fit.states, drift))
    if drift == "attitude_error":
        path = frames.unrotate(np.asarray(fit.states.attitude), path)
    place = aided.BLOCKS[drift].start + index
    value, by = float(path[:, index].mean()), fit.moved[place].copy()
    if constant is not None:
        value += float(getattr(fit.unknowns.means.sensors, constant)[index])
        by[np.flatnonzero(scoring.marked(fit.unknowns.means, (constant,)))[index]] += 1.0
    own = np.asarray(fit.smoothed.covariance)[: len(path), place, place].mean()
    return Estimate(value, float(np.sqrt(own + by @ fit.parameters @ by)), unit)


def size(fit: Fit, intensity: str, index: int, unit: str) -> Estimate:
    """An intensity of the filter, of which the logarithm was found.

    Args:
        fit: inside the filter.
        intensity: a field of `Noise`.
        index: axis; of two entries the first is for all but the last axis.
        unit: of the intensity.
    """
    place = max(index - 1, 0) if np.size(getattr(fit.unknowns.log_noise, intensity)) == 2 else 0
    log, share = (
        float(np.ravel(getattr(part.log_noise, intensity))[place])
        for part in (fit.unknowns, fit.deviation)
    )
    return Estimate(float(np.exp(log)), float(np.exp(log)) * share, unit)


def _channel(
    fit: Fit,
    sensor: str,
    index: int,
    unit: str,
    *,
    bias: Estimate | None = None,
    scale: Estimate | None = None,
    delay: Estimate | None = None,
    lag: Estimate | None = None,
    name: str | None = None,
) -> Channel:
    name, row = name or sensor, aided.ROWS[sensor].start + index
    white = fit.whitened[:, row]
    nis, band, whiteness, limit = innovations(white[white != 0.0])
    variance = aided_linear.measurement_variance(aided_smoother.positive(fit.unknowns.log_noise))
    more = []
    for label, intensity, ordinary in zip(
        ("noise", "lasting error"), (sensor, f"{sensor}_error"), NOISE[name], strict=True
    ):
        if intensity in Noise._fields and stands_out(
            each := size(fit, intensity, index, unit), ordinary
        ):
            more.append(f"{label} {readable(each)}")
    if lag is not None and stands_out(lag, LAG):
        more.append(f"lag {readable(lag)}")
    if abs(whiteness) > CORRELATED:
        more.append(f"successive innovations correlate by {whiteness:+.2f}")
    return Channel(
        *(unit, bias, scale, delay, float(np.sqrt(variance[row]))),
        *(nis, band, whiteness, limit),
        words(name, bias, scale, delay, nis, *more),
        lag,
    )
