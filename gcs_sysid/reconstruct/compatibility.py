"""Data compatibility: do the sensors tell one story, and which errors must each have if they do?

The kinematics tie the channels together without any aerodynamics (Klein & Morelli 2006, chapter
10). Each sensor's bias, scale and delay are states of the smoother; a channel is judged by the size
of its estimated error against what an ordinary sensor has, by its innovations' size (NIS) and by
their whiteness.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from gcs_sysid import frames
from gcs_sysid.model.kinematics import MEASURED
from gcs_sysid.reconstruct.reconstruction import Reconstruction

LARGE = 3.0
"""An error counts as found when it is this many standard deviations from zero."""
CONSISTENT = "consistent"
SPEED_DAMPING = 0.15
"""Drag and propeller slow a small aircraft that meets a head gust, 1/s."""


@dataclass(frozen=True)
class Estimate:
    """A number with one standard deviation and its unit."""

    value: float
    deviation: float
    unit: str

    def document(self) -> dict[str, Any]:
        """As it appears in result files."""
        return {"value": self.value, "sd": self.deviation, "unit": self.unit}


@dataclass(frozen=True)
class Channel:
    """One sensor channel's verdict; None where the quantity does not apply.

    `noise` is the white noise found; `nis` the mean squared normalised innovation of one value (1
    for a consistent filter), `whiteness` the correlation of successive innovations with its 95 %
    limit. `lag` is that of first order behind what is measured, which only the aided filter finds.
    """

    unit: str
    bias: Estimate | None
    scale: Estimate | None
    delay: Estimate | None
    noise: float
    nis: float | None
    nis_band: tuple[float, float] | None
    whiteness: float | None
    whiteness_limit: float | None
    verdict: str
    lag: Estimate | None = None


@dataclass(frozen=True)
class Compatibility:
    """All channels, the whole in words, and by which filter."""

    channels: Mapping[str, Channel]
    verdict: str
    filter: Literal["kinematic", "aided"] = "kinematic"


ORDINARY: Mapping[str, tuple[float, float, float]] = {
    "accelerometer": (0.3, 0.02, np.inf),
    "gyro": (np.deg2rad(0.5), 0.02, np.inf),
    "airspeed": (np.inf, 0.04, 0.1),
    "velocity": (np.inf, np.inf, 0.25),
    "roll": (np.deg2rad(2.0), np.inf, 0.05),
    "pitch": (np.deg2rad(2.0), np.inf, 0.05),
    "yaw": (np.deg2rad(5.0), np.inf, 0.05),
    "alpha": (np.deg2rad(1.0), 0.1, 0.1),
    "beta": (np.deg2rad(1.0), 0.1, 0.1),
}
"""Bias, scale and delay up to which a sensor of a small aircraft counts as ordinary."""


def check(reconstruction: Reconstruction) -> Compatibility:
    """Judges every channel that took part in a reconstruction."""
    channels: dict[str, Channel] = {}
    data = reconstruction.data
    noise = reconstruction.noise
    for index, axis in enumerate("xyz"):
        if data.has_accelerometer:
            channels[f"accelerometer_{axis}"] = _inertial(
                reconstruction, "accelerometer", index, "m/s²", float(noise.accelerometer)
            )
        channels[f"gyro_{axis}"] = _inertial(
            reconstruction, "gyro", index, "rad/s", float(noise.gyro)
        )
    confounded = SPEED_DAMPING * float(noise.gust[0]) ** 2 / _along_acceleration(reconstruction)
    channels["airspeed"] = _measured(
        reconstruction,
        "airspeed",
        0,
        unit="m/s",
        scale=_estimate(reconstruction, "airspeed_scale", 0, "1"),
        delay=_estimate(reconstruction, "airspeed_delay", 0, "s", confounded),
    )
    for index, axis in enumerate(("north", "east", "down")):
        channels[f"velocity_{axis}"] = _measured(
            reconstruction,
            "velocity",
            index,
            unit="m/s",
            delay=_estimate(reconstruction, "velocity_delay", 0, "s"),
        )
    for index, name in enumerate(("roll", "pitch", "yaw")):
        bias = _attitude_bias(reconstruction, index)
        delay = _estimate(reconstruction, "attitude_delay", 0, "s")
        channels[name] = _measured(
            reconstruction, "attitude", index, unit="rad", bias=bias, delay=delay, name=name
        )
    if "vanes" in data.used:
        for index, name in enumerate(("alpha", "beta")):
            channels[name] = _measured(
                reconstruction,
                "vanes",
                index,
                unit="rad",
                bias=_estimate(reconstruction, "vane_bias", index, "rad"),
                scale=_estimate(reconstruction, "vane_scale", index, "1"),
                delay=_estimate(reconstruction, "vane_delay", 0, "s"),
                name=name,
            )
    return Compatibility(channels, together(channels, "the kinematics of the others"))


def _attitude_bias(reconstruction: Reconstruction, index: int) -> Estimate:
    """Mean error of the attitude about a body axis: how it is mounted, and how it has drifted."""
    drift = frames.unrotate(
        reconstruction.smoothed.attitude, reconstruction.block("attitude_error")
    )
    value = drift[:, index] + reconstruction.block("attitude_offset")[:, index]
    # Each error's two parts are told apart only by turns: their sum is known better than this.
    spread = np.hypot(
        reconstruction.deviation("attitude_error")[:, index],
        reconstruction.deviation("attitude_offset")[:, index],
    )
    return Estimate(float(value.mean()), float(spread.mean()), "rad")


def _along_acceleration(reconstruction: Reconstruction) -> float:
    """Mean square of the acceleration along the flight path [m²/s⁴].

    A head gust both shows in the airspeed and slows the aircraft, which looks like a pitot tube
    that is late by (speed damping)·σ²_gust/σ²_acceleration; the delay's uncertainty must hold that.
    """
    slope = np.gradient(reconstruction.airspeed, reconstruction.time)
    return float(np.mean(slope**2))


def _estimate(
    reconstruction: Reconstruction, name: str, index: int, unit: str, extra: float = 0.0
) -> Estimate:
    """A constant of the smoother's state: all samples agree, the first stands for them."""
    value = float(reconstruction.block(name)[0, index])
    return Estimate(value, float(np.hypot(reconstruction.deviation(name)[0, index], extra)), unit)


def _inertial(
    reconstruction: Reconstruction, sensor: str, index: int, unit: str, noise: float
) -> Channel:
    drift = reconstruction.block(f"{sensor}_bias")[:, index]
    spread = reconstruction.deviation(f"{sensor}_bias")[:, index]
    bias = Estimate(float(drift.mean()), float(spread.mean()), unit)
    scale = _estimate(reconstruction, f"{sensor}_scale", index, "1")
    verdict = words(sensor, bias, scale, None, None)
    return Channel(unit, bias, scale, None, noise, None, None, None, None, verdict)


def _measured(
    reconstruction: Reconstruction,
    group: str,
    index: int,
    *,
    unit: str,
    bias: Estimate | None = None,
    scale: Estimate | None = None,
    delay: Estimate | None = None,
    name: str | None = None,
) -> Channel:
    row = MEASURED[group].start + index
    smoothed = reconstruction.smoothed
    seen = np.isfinite(smoothed.innovation_deviation[:, row])
    ratio = (smoothed.innovation[:, row] / smoothed.innovation_deviation[:, row])[seen]
    nis, band, whiteness, limit = innovations(ratio)
    noise = float(reconstruction.noise.measured[row])
    verdict = words(name or group, bias, scale, delay, nis)
    return Channel(unit, bias, scale, delay, noise, nis, band, whiteness, limit, verdict)


def innovations(
    ratio: Float[np.ndarray, " sample"],
) -> tuple[float, tuple[float, float], float, float]:
    """Mean square of normalised innovations with its 95 % band, lag-one correlation with its limit.

    The band is that of independent samples (a mean of squares of n normal numbers has variance
    2/n).
    """
    count = max(ratio.size, 2)
    half = 1.96 * np.sqrt(2.0 / count)
    centred = ratio - ratio.mean()
    power = float(np.mean(centred**2))
    lag = float(np.mean(centred[1:] * centred[:-1]) / power) if power > 0.0 else 0.0
    nis = float(np.mean(ratio**2))
    return nis, (float(1.0 - half), float(1.0 + half)), lag, float(1.96 / np.sqrt(count))


def words(
    sensor: str,
    bias: Estimate | None,
    scale: Estimate | None,
    delay: Estimate | None,
    nis: float | None,
    *more: str,
) -> str:
    """What stands out of one channel, in a flight-test engineer's words."""
    found = []
    limits = ORDINARY[sensor]
    for label, estimate, limit in zip(
        ("bias", "scale error", "delay"), (bias, scale, delay), limits, strict=True
    ):
        if estimate is None:
            continue
        if stands_out(estimate, limit):
            found.append(f"{label} {readable(estimate)}")
    if nis is not None and nis > 2.0:
        found.append(f"innovations {np.sqrt(nis):.1f} times larger than the filter expects")
    found += more
    return "; ".join(found) if found else CONSISTENT


def stands_out(estimate: Estimate, ordinary: float) -> bool:
    """Whether an error is surely there, and larger than is ordinary."""
    return bool(abs(estimate.value) > max(LARGE * estimate.deviation, ordinary))


def readable(estimate: Estimate) -> str:
    """Value ± one standard deviation in the unit a person would use."""
    factor, unit = {
        "rad": (np.rad2deg(1.0), "°"),
        "rad/s": (np.rad2deg(1.0), "°/s"),
        "1": (100.0, " %"),
        "s": (1000.0, " ms"),
    }.get(estimate.unit, (1.0, f" {estimate.unit}"))
    return f"{factor * estimate.value:+.3g} ± {factor * estimate.deviation:.2g}{unit}"


def together(channels: Mapping[str, Channel], agree_with: str) -> str:
    """The whole in words."""
    odd = [
        f"{name}: {channel.verdict}"
        for name, channel in channels.items()
        if channel.verdict != CONSISTENT
    ]
    if not odd:
        return f"The sensors tell one story: every channel agrees with {agree_with}."
    return "The sensors do not quite agree. " + ". ".join(odd) + "."
