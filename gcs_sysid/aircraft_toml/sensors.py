"""What the aircraft measures with: inertial unit, pitot, vanes, and how late each stream is.

Each sensor may state its known error and how well that is known:
indicated = (1 + scale)·true + bias, `lag` s late.
"""

from __future__ import annotations

import math
from typing import Literal

from gcs_sysid.aircraft import (
    ZERO,
    Geometry,
    Imu,
    Pitot,
    SensorError,
    StreamTiming,
    Vanes,
)
from gcs_sysid.aircraft_toml.checks import check_seconds, lag, position, vector
from gcs_sysid.aircraft_toml.keys import KEYS, SENSOR_KEYS
from gcs_sysid.aircraft_toml.section import Section, describe

_AIRSPEEDS: tuple[Literal["EAS", "CAS", "TAS"], ...] = ("EAS", "CAS", "TAS")
_LARGEST_SCALE_ERROR = 0.5
_EARLIEST = -5.0
_VANES = ("alpha", "beta")
_VANE_UNITS = {
    "bias": "deg",
    "bias_sigma": "deg",
    "scale": "1",
    "scale_sigma": "1",
    "lag": "s",
    "lag_sigma": "s",
}


def read_imu(section: Section | None, geometry: Geometry) -> Imu:
    """The table `[imu]` with `[imu.accelerometer]` and `[imu.gyro]`."""
    if section is None:
        return Imu()
    section.allow_only(*KEYS["[imu]"])
    return Imu(
        position=position(section, geometry),
        misalignment=vector(section, "misalignment", "deg"),
        misalignment_sigma=section.optional_number("misalignment_sigma", "deg", least=0.0),
        accelerometer=_triad(section.child("accelerometer"), "m/s²"),
        gyro=_triad(section.child("gyro"), "deg/s"),
    )


def _triad(section: Section | None, unit: str) -> SensorError:
    if section is None:
        return SensorError(bias=ZERO, scale=ZERO)
    section.allow_only(*SENSOR_KEYS)
    return SensorError(
        bias=vector(section, "bias", unit),
        scale=_checked_scale(section, vector(section, "scale", "1")),
        lag=lag(section, "lag"),
        bias_sigma=section.optional_number("bias_sigma", unit, least=0.0),
        scale_sigma=section.optional_number("scale_sigma", "1", least=0.0),
        lag_sigma=section.optional_number("lag_sigma", "s", least=0.0),
    )


def read_pitot(section: Section | None, geometry: Geometry) -> Pitot:
    """The table `[pitot]`."""
    if section is None:
        return Pitot()
    section.allow_only(*KEYS["[pitot]"])
    measures = section.text("measures", allowed=_AIRSPEEDS, default="EAS")
    return Pitot(
        position=position(section, geometry),
        measures=_AIRSPEEDS[_AIRSPEEDS.index(measures)],
        error=SensorError(
            bias=(section.number("bias", "m/s", default=0.0),),
            scale=_checked_scale(section, (section.number("scale", "1", default=0.0),)),
            lag=lag(section, "lag"),
            bias_sigma=section.optional_number("bias_sigma", "m/s", least=0.0),
            scale_sigma=section.optional_number("scale_sigma", "1", least=0.0),
            lag_sigma=section.optional_number("lag_sigma", "s", least=0.0),
        ),
    )


def read_vanes(section: Section | None, geometry: Geometry) -> Vanes | None:
    """The table `[vanes]`; each error is `[alpha, beta]`, a table, or one number for both."""
    if section is None:
        return None
    section.allow_only(*KEYS["[vanes]"])
    alpha, beta = (_vane(section, index) for index in range(len(_VANES)))
    return Vanes(
        position=position(section, geometry),
        upwash=section.number("upwash", "1", default=0.0, above=-1.0),
        alpha=alpha,
        beta=beta,
        upwash_sigma=section.optional_number("upwash_sigma", "1", least=0.0),
    )


def _vane(section: Section, index: int) -> SensorError:
    entry = {key: _vane_entry(section, key, unit)[index] for key, unit in _VANE_UNITS.items()}
    check_seconds(section, "lag", entry["lag"] or 0.0)
    return SensorError(
        bias=(entry["bias"] or 0.0,),
        scale=_checked_scale(section, (entry["scale"] or 0.0,)),
        lag=entry["lag"] or 0.0,
        bias_sigma=entry["bias_sigma"],
        scale_sigma=entry["scale_sigma"],
        lag_sigma=entry["lag_sigma"],
    )


def _vane_entry(section: Section, key: str, unit: str) -> tuple[float | None, ...]:
    """What `key` says of the alpha and of the beta vane, None where it says nothing."""
    least = -math.inf if key in ("bias", "scale") else 0.0
    entry = section.data.get(key)
    if entry is None:
        return None, None
    if isinstance(entry, dict):
        table = section.table(key)
        table.allow_only(*_VANES)
        return tuple(table.optional_number(vane, unit, least=least) for vane in _VANES)
    if isinstance(entry, list):
        pair = section.numbers(key, unit, count=2)
        if min(pair) < least:
            raise section.error(
                key, found=describe(entry), allowed="numbers from 0", fix="remove the minus sign"
            )
        return pair
    both = section.number(key, unit, least=least)
    if key == "bias":
        # Two vanes never have the same mounting error, so one number must be a misunderstanding.
        raise section.error(
            key,
            found=describe(entry),
            allowed="[alpha, beta] or { alpha = ..., beta = ... } in deg",
            fix=f"for the alpha vane alone write bias = {{ alpha = {entry} }}",
        )
    return both, both


def read_streams(section: Section | None) -> dict[str, StreamTiming]:
    """The tables `[streams.NAME]`, by message type."""
    if section is None:
        return {}
    streams: dict[str, StreamTiming] = {}
    for name in section.data:
        stream = section.table(name)
        stream.allow_only(*KEYS["[streams.NAME]"])
        streams[name] = StreamTiming(
            delay=lag(stream, "delay", least=_EARLIEST),
            sigma=stream.optional_number("sigma", "s", least=0.0),
        )
    return streams


def _checked_scale(section: Section, scale: tuple[float, ...]) -> tuple[float, ...]:
    if max(map(abs, scale)) >= _LARGEST_SCALE_ERROR:
        raise section.error(
            "scale",
            found=describe(section.data["scale"]),
            allowed=f"the scale error, below {_LARGEST_SCALE_ERROR:g}",
            fix="write 0.03 for a sensor that reads 3 % high, 0 for a perfect one",
        )
    return scale
