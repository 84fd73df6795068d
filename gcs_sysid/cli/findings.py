"""A summary in ten lines, for the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

KEY_DERIVATIVES = (
    ("CZ", ("alpha",)),
    ("Cm", ("alpha", "qhat", "elevator")),
    ("Cl", ("phat", "beta", "aileron")),
    ("CY", ("beta",)),
    ("Cn", ("beta", "rhat", "rudder")),
)
"""What a flight-test engineer asks first: lift slope, stability, damping, control."""

_INTERVAL = 1.96  # sds on either side of the mean that hold 95 % of a normal distribution


def text(summary: Mapping[str, Any], out: Path) -> str:
    """What was found, at most ten lines.

    Args:
        summary: document of `identify` or `predict`.
        out: folder that holds the results.

    Returns:
        Lines for a person; the last one is the path of the report, or of the summary.
    """
    lines = [_flights(summary), _errors(summary), *_derivatives(summary)]
    lines += [*_wind_and_delays(summary), *_cannot_tell(summary)]
    report = out / "report.html"
    return "\n".join([*lines, str(report if report.exists() else out / "summary.json")])


def _flights(summary: Mapping[str, Any]) -> str:
    names = ", ".join(Path(flight["source"]).name for flight in summary["flights"])
    airborne = sum(flight["airborne_s"] for flight in summary["flights"])
    maneuvers = summary["maneuvers"]
    held_out = sum(bool(maneuver["held_out"]) for maneuver in maneuvers)
    return (
        f"{names}: {airborne / 60.0:.1f} min airborne, {len(maneuvers)} maneuvers, "
        f"{held_out} held out of the fit"
    )


def _errors(summary: Mapping[str, Any]) -> str:
    """Error of each coefficient on maneuvers held out, % of its own spread."""
    words = [
        f"{name} refused" if score.get("refused") else f"{name} {score['relative_error']:.0f} %"
        for name, score in summary["coefficients"].items()
    ]
    return "Error on held-out maneuvers: " + "  ".join(words)


def _derivatives(summary: Mapping[str, Any]) -> Iterator[str]:
    """Key derivatives with their 95 % interval and what the aircraft file says."""
    found = summary.get("derivatives", {})
    for coefficient, regressors in KEY_DERIVATIVES:
        entries = found.get(coefficient, {})
        words = [
            _derivative(f"{coefficient}_{name}", entries[name])
            for name in regressors
            if name in entries
        ]
        if words:
            yield "  ".join(words)


def _derivative(name: str, entry: Mapping[str, Any]) -> str:
    value, half = entry["value"], _INTERVAL * entry["sd"]
    digits = max(0, 1 - math.floor(math.log10(half))) if half > 0.0 else 3
    words = f"{name} {value:+.{digits}f} ± {half:.{digits}f}"
    if entry.get("file") is not None:
        words += f" (file {entry['file']:+.{digits}f})"
    return words


def _wind_and_delays(summary: Mapping[str, Any]) -> Iterator[str]:
    reconstruction = summary.get("reconstruction", {})
    words = []
    if wind := reconstruction.get("wind_ned"):
        north, east = wind["value"][:2]
        come_from = math.degrees(math.atan2(-east, -north)) % 360.0
        words.append(f"Wind {math.hypot(north, east):.1f} m/s from {come_from:.0f}°")
    words += [
        f"{stream} late by {1e3 * delay['value']:.0f} ± {1e3 * _INTERVAL * delay['sd']:.0f} ms"
        for stream, delay in reconstruction.get("delays", {}).items()
    ]
    if words:
        yield "; ".join(words)


def _cannot_tell(summary: Mapping[str, Any]) -> Iterator[str]:
    """The first thing this flight cannot tell, and how many more there are."""
    unknown = summary.get("cannot_tell", [])
    if unknown:
        first = unknown[0]
        more = f"; {len(unknown) - 1} more in the report" if len(unknown) > 1 else ""
        yield f"Cannot tell {first['what']}: {first['why']}; {first['fly']}{more}"
