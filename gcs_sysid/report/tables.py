"""Rows of the report's tables: numbers already in words for people, nothing marked up."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.figures.data import SIGMAS_95
from gcs_sysid.figures.samples import Maneuver, Samples, column, residual
from gcs_sysid.report import labels
from gcs_sysid.report.numbers import (
    MINUS,
    NOTHING,
    duration,
    for_people,
    number,
    plus_minus,
    quantity,
)


@dataclass(frozen=True)
class Score:
    """How well one coefficient is predicted, for its tile."""

    name: str
    meaning: str
    error: str
    grade: str
    level: str
    coverage: str
    r2: str
    nlpd: str
    samples: str
    refused: str


def scores(summary: Mapping) -> tuple[Score, ...]:
    """One tile per coefficient, in the order CX to Cn, refused ones included."""
    table = summary["coefficients"]
    return tuple(_score(name, table[name]) for name in COEFFICIENTS if name in table)


def _score(name: str, entry: Mapping) -> Score:
    r2, coverage = entry.get("r2"), entry.get("coverage95")
    return Score(
        name=name,
        meaning=labels.meaning(name),
        error=number(entry.get("relative_error"), 2),
        grade=labels.grade(r2),
        level=_level(r2),
        coverage=NOTHING if coverage is None else f"{100.0 * coverage:.0f} %",
        r2=NOTHING if r2 is None else f"{r2:.2f}".replace("-", "\u2212"),
        nlpd=number(entry.get("nlpd")),
        samples=NOTHING if entry.get("samples") is None else f"{entry['samples']:d}",
        refused=str(entry.get("refused") or ""),
    )


def _level(r2: float | None) -> str:
    """Which of the three marks (yes, weak, no) goes with a share of variance explained."""
    if r2 is None:
        return ""
    return "yes" if r2 >= labels.GOOD else "weak" if r2 >= labels.USABLE else "no"


@dataclass(frozen=True)
class Channel:
    """One measured channel against the reconstruction; `lag` is empty where none is told."""

    name: str
    bias: str
    scale: str
    delay: str
    lag: str
    nis: str
    inside: bool | None
    whiteness: str
    rms: str
    verdict: str


def channels(summary: Mapping) -> tuple[Channel, ...]:
    """The compatibility table's rows; ± is one 95 % half width."""
    table = (summary.get("compatibility") or {}).get("channels") or {}
    return tuple(_channel(name, entry) for name, entry in table.items())


def _channel(name: str, entry: Mapping) -> Channel:
    unit = str(entry.get("unit") or "")
    nis, band = entry.get("nis"), entry.get("nis_band")
    inside = None
    if nis is not None and band:
        inside = bool(band[0] <= nis <= band[1])
    rms = entry.get("rms")
    shown, _, shown_unit = for_people(0.0 if rms is None else rms, 0.0, _keep_ratio(unit))
    return Channel(
        name=labels.sensor(name),
        bias=_interval(entry, "bias", _keep_ratio(unit)),
        scale=_interval(entry, "scale", "1"),
        delay=_interval(entry, "delay", "s"),
        lag="" if entry.get("lag") is None else _interval(entry, "lag", "s"),
        nis=NOTHING if nis is None else _with_band(nis, band),
        inside=inside,
        whiteness=_against(entry.get("whiteness"), entry.get("whiteness_limit")),
        rms=NOTHING if rms is None else f"{number(shown, 2)} {shown_unit}",
        verdict=str(entry.get("verdict") or ""),
    )


def _keep_ratio(unit: str) -> str:
    """A channel that is a ratio itself keeps its numbers; only scale errors read as percent."""
    return "" if unit == "1" else unit


def _interval(entry: Mapping, key: str, unit: str) -> str:
    sd = entry.get(f"{key}_sd")
    return quantity(entry.get(key), None if sd is None else SIGMAS_95 * sd, unit)


def _with_band(nis: float, band: Sequence[float] | None) -> str:
    if not band:
        return number(nis)
    return f"{number(nis)} ({number(band[0])} to {number(band[1])})"


def _against(value: float | None, limit: float | None) -> str:
    if value is None or limit is None:
        return number(value, 2)
    return f"{_correlation(value)} (under {_correlation(limit)})"


def _correlation(value: float) -> str:
    # Nothing is not less than nothing.
    return f"{round(value, 2) + 0.0:.2f}".replace("-", MINUS)


@dataclass(frozen=True)
class Item:
    """A name and a value with its interval."""

    name: str
    value: str


def sensors(summary: Mapping) -> tuple[Item, ...]:
    """Sensor errors, wind and gusts as reconstructed; ± is one 95 % half width."""
    reconstruction = summary.get("reconstruction") or {}
    items = [
        Item(labels.sensor(name), _value(entry))
        for name, entry in (reconstruction.get("sensor") or {}).items()
    ]
    wind = reconstruction.get("wind_ned")
    if wind:
        sds = wind["sd"] if wind.get("sd") is not None else (None, None, None)
        for axis, value, sd in zip(("north", "east", "down"), wind["value"], sds, strict=True):
            entry = {"value": value, "sd": sd, "unit": wind.get("unit", "m/s")}
            items.append(Item(f"wind toward {axis}", _value(entry)))
    items += [
        Item(words, _value(reconstruction[key]))
        for key, words in _GUSTS.items()
        if reconstruction.get(key)
    ]
    return tuple(items)


_GUSTS = {
    "gust_sd": "gusts, one sd",
    "gust_length": "gusts, length",
    "gust_sd_vertical": "vertical gusts, one sd",
    "gust_length_vertical": "vertical gusts, length",
}


def delays(summary: Mapping) -> tuple[Item, ...]:
    """Stream delays; positive: the stream is late."""
    table = (summary.get("reconstruction") or {}).get("delays") or {}
    return tuple(Item(name, _value(entry)) for name, entry in table.items())


def _value(entry: Mapping) -> str:
    sd = entry.get("sd")
    half = None if sd is None else SIGMAS_95 * sd
    return quantity(entry.get("value"), half, str(entry.get("unit") or ""))


@dataclass(frozen=True)
class Mode:
    """One mode of small motions about level flight; dashes for numbers it does not have."""

    name: str
    frequency: str
    period: str
    damping: str
    time: str
    stability: str


def modes(summary: Mapping) -> tuple[Mode, ...]:
    """Modes of the identified model."""
    return tuple(_mode(each) for each in (summary.get("modes") or {}).get("modes") or ())


def _mode(entry: Mapping) -> Mode:
    frequency, damping, roots = entry.get("frequency"), entry.get("damping"), entry["roots"]
    swings = max(abs(root["imag"]) for root in roots)
    decays = [_decays(root) for root in roots]
    return Mode(
        name=str(entry["name"]),
        frequency=NOTHING if frequency is None else _with_half(frequency, "rad/s"),
        period=f"{number(2.0 * math.pi / swings)} s" if swings > 0.0 else NOTHING,
        damping=NOTHING if damping is None else _with_half(damping, ""),
        # An oscillation has one time constant for its two roots.
        time=", ".join(map(_time, entry["time_constants"], roots, decays)),
        stability="diverges" if False in decays else "either" if None in decays else "stable",
    )


def _decays(root: Mapping) -> bool | None:
    """Whether a root decays, where its 95 % interval can tell."""
    return root["real"] < 0.0 if abs(root["real"]) > SIGMAS_95 * root["real_sd"] else None


def _time(entry: Mapping, root: Mapping, decays: bool | None) -> str:
    """A time constant; where it may be infinite, what it is longer than."""
    if decays is not None:
        return _with_half(entry, "s")
    return f"over {number(1.0 / (abs(root['real']) + SIGMAS_95 * root['real_sd']), 2)} s"


def _with_half(entry: Mapping, unit: str) -> str:
    """Value ± one 95 % half width, in the unit that it has."""
    return f"{plus_minus(entry['value'], SIGMAS_95 * entry['sd'])} {unit}".strip()


def trim(summary: Mapping) -> tuple[Item, ...]:
    """The trim found in steady legs."""
    entry = summary.get("trim") or {}
    items = []
    if entry.get("V") is not None:
        items.append(Item("airspeed", f"{number(entry['V'])} m/s"))
    angles = (("alpha", "angle of attack"), ("beta", "sideslip"), ("theta", "pitch attitude"))
    for key, name in angles:
        if entry.get(key) is not None:
            items.append(Item(name, f"{number(float(np.degrees(entry[key])), 2)} deg"))
    for name, value in (entry.get("controls") or {}).items():
        items.append(Item(name, f"{number(float(np.degrees(value)), 2)} deg"))
    if entry.get("thrust_coefficient") is not None:
        items.append(Item("thrust coefficient T/q̄S", number(entry["thrust_coefficient"], 2)))
    if entry.get("throttle") is not None:
        items.append(Item("throttle", f"{100.0 * entry['throttle']:.0f} %"))
    return tuple(items)


@dataclass(frozen=True)
class Flown:
    """One maneuver and how well it is predicted."""

    flight: int
    number: int
    name: str
    start_s: float
    end_s: float
    length: str
    airspeed: str
    held_out: bool
    errors: tuple[str, ...]


def flown(
    samples: Samples, maneuvers: Sequence[Maneuver], coefficients: Sequence[str]
) -> tuple[Flown, ...]:
    """One row a maneuver: rms of the residual in percent of the whole flight's measured spread."""
    left = {name: residual(samples, name) for name in coefficients}
    spread = {name: float(np.nanstd(column(samples, f"{name}_measured"))) for name in coefficients}
    speed = column(samples, "V")
    return tuple(
        Flown(
            flight=item.flight,
            number=item.number,
            name=item.name,
            start_s=item.start,
            end_s=item.end,
            length=duration(item.end - item.start),
            airspeed=number(_mean(speed[item.rows])),
            held_out=item.held_out,
            errors=tuple(
                number(100.0 * _rms(left[name][item.rows]) / spread[name], 2)
                if spread[name] > 0.0
                else NOTHING
                for name in coefficients
            ),
        )
        for item in maneuvers
    )


def _finite(values: np.ndarray) -> np.ndarray:
    return values[np.isfinite(values)]


def _mean(values: np.ndarray) -> float:
    values = _finite(values)
    return float(values.mean()) if values.size else float("nan")


def _rms(values: np.ndarray) -> float:
    values = _finite(values)
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def date(flight: Mapping) -> str:
    """When the log starts, UTC; empty when its clock does not know."""
    epoch = flight.get("epoch_us")
    if not epoch or epoch < _FIRST_PLAUSIBLE_US:
        return ""
    return f"{datetime.fromtimestamp(epoch / 1e6, tz=UTC):%Y-%m-%d %H:%M} UTC"


_FIRST_PLAUSIBLE_US = 946_684_800_000_000
"""2000-01-01: clocks that count from the boot of the autopilot lie before it."""
