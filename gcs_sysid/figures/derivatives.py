"""Derivatives against the aircraft file's: one strip each, and how far apart they are."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from gcs_sysid.figures.data import SIGMAS_95, Interval, Mark, Strip

_SOURCES = {
    "sd_noise": "noise",
    "sd_scale": "mass, inertia and thrust",
    "sd_regressor": "flow angles and rates",
    "sd_lag": "lag of the moments",
}


@dataclass(frozen=True)
class Derivative:
    """One row of the derivatives' table.

    Attributes:
        coefficient: for instance "Cm".
        regressor: for instance "alpha".
        value: identified, per unit of the regressor.
        half: half width of its 95 % interval.
        file: the aircraft file's value, or None.
        file_sigma: its one sigma, or None.
        distance: flight minus file in standard deviations of that difference, or None. What the
            flight alone says is taken where the value has the file as prior.
        limited_by: what most of the interval comes from, in words; empty when not known.
        verdict: "yes", "weak" or "no": whether the flight determines it.
        reason: why, in words.
        strip: the same as a picture.
    """

    coefficient: str
    regressor: str
    value: float
    half: float
    file: float | None
    file_sigma: float | None
    distance: float | None
    limited_by: str
    verdict: str
    reason: str
    strip: Strip


def derivatives(table: Mapping[str, Mapping[str, Mapping]]) -> dict[str, tuple[Derivative, ...]]:
    """Rows by coefficient from `summary["derivatives"]`."""
    return {
        coefficient: tuple(_row(coefficient, key, entry) for key, entry in entries.items())
        for coefficient, entries in table.items()
    }


def _row(coefficient: str, regressor: str, entry: Mapping) -> Derivative:
    value, sd = float(entry["value"]), float(entry["sd"])
    file, sigma = entry.get("file"), entry.get("file_sigma")
    return Derivative(
        coefficient=coefficient,
        regressor=regressor,
        value=value,
        half=SIGMAS_95 * sd,
        file=file,
        file_sigma=sigma,
        distance=_distance(entry),
        limited_by=_limited_by(entry),
        verdict=str(entry.get("verdict", "")),
        reason=str(entry.get("reason") or ""),
        strip=strip(value, sd, file, sigma),
    )


def _distance(entry: Mapping) -> float | None:
    if entry.get("file") is None:
        return None
    alone = entry.get("flight_value")
    value = float(entry["value"] if alone is None else alone)
    own = (
        (float(entry["sd"]),)
        if alone is None
        else tuple(float(entry.get(key) or 0.0) for key in _SOURCES)
    )
    spread = math.hypot(*own, float(entry.get("file_sigma") or 0.0))
    return (value - float(entry["file"])) / spread if spread > 0.0 else None


def _limited_by(entry: Mapping) -> str:
    """The source of more than half of the variance; empty when none or not recorded."""
    parts = {key: float(entry.get(key) or 0.0) ** 2 for key in _SOURCES}
    total = sum(parts.values())
    largest = max(parts, key=lambda key: parts[key])
    return _SOURCES[largest] if total > 0.0 and parts[largest] > 0.5 * total else ""


def strip(value: float, sd: float, file: float | None, sigma: float | None) -> Strip:
    """Identified value ± 95 % over the file's value ± one sigma (solid) and ± 95 % (faint).

    The scale always contains zero, so a strip also shows how far from nothing a derivative is.
    """
    half = SIGMAS_95 * sd
    intervals = []
    marks = []
    words = f"identified {value:.3g} plus or minus {half:.2g}"
    if file is not None:
        wide = SIGMAS_95 * (sigma or 0.0)
        intervals.append(Interval(file - wide, file + wide, "file", emphasis=False))
        intervals.append(
            Interval(file - (sigma or 0.0), file + (sigma or 0.0), "file", emphasis=True)
        )
        marks.append(Mark(file, "file"))
        words += f", aircraft file {file:.3g}, sigma {sigma or 0.0:.2g}"
    intervals.append(Interval(value - half, value + half, "measured", emphasis=True))
    marks.append(Mark(value, "measured"))
    ends = [0.0, *(end for item in intervals for end in (item.low, item.high))]
    ends = [end for end in ends if math.isfinite(end)]
    low, high = min(ends), max(ends)
    if high == low:
        low, high = low - 1.0, high + 1.0
    return Strip((low, high), tuple(intervals), tuple(marks), words)
