"""Readings that several tables share, with the limits beyond which a unit must be wrong."""

from __future__ import annotations

import math

from gcs_sysid.aircraft import ZERO, Geometry, Vector
from gcs_sysid.aircraft_toml.section import Section, describe

# No aircraft has a part further out, nor a servo or a telemetry stream that is slower.
_FARTHEST_OVER_SPAN = 5.0
_SLOWEST = 5.0


def vector(section: Section, key: str, unit: str, *, default: Vector = ZERO) -> Vector:
    """Three numbers along body x, y, z."""
    x, y, z = section.numbers(key, unit, count=3, default=default)
    return x, y, z


def position(section: Section, geometry: Geometry, key: str = "position") -> Vector:
    """A place in body axes [m] from the airframe point."""
    place = vector(section, key, "m")
    if math.hypot(*place) > _FARTHEST_OVER_SPAN * geometry.wing_span:
        raise section.error(
            key,
            found=describe(section.data[key]),
            allowed=f"metres, within {_FARTHEST_OVER_SPAN:g} spans of the airframe point",
            fix=f"if these are millimetres: {key} = {[round(x / 1000.0, 4) for x in place]}",
        )
    return place


def relative_sigma(section: Section, key: str, default: float) -> float:
    """A relative standard deviation below 1."""
    sigma = section.number(key, "1", default=default, least=0.0)
    if sigma >= 1.0:
        raise section.error(
            key,
            found=f"{sigma:g}",
            allowed="a relative standard deviation from 0, below 1",
            fix=f"for {sigma:g} % write {key} = {sigma / 100.0:g}",
        )
    return sigma


def lag(section: Section, key: str, *, least: float = 0.0, most: float = _SLOWEST) -> float:
    """A time [s], by default 0."""
    time = section.number(key, "s", default=0.0, least=least)
    check_seconds(section, key, time, most=most)
    return time


def check_seconds(section: Section, key: str, time: float, *, most: float = _SLOWEST) -> None:
    """Refuse a time that must be in milliseconds."""
    if time > most:
        raise section.error(
            key,
            found=f"{time:g} s",
            allowed=f"seconds up to {most:g}",
            fix=f"for {time:g} ms write {key} = {time / 1000.0:g}",
        )
