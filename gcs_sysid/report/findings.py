"""What a run found, in sentences: one source of words for the page and for the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.figures.data import SIGMAS_95
from gcs_sysid.figures.derivatives import Derivative, derivatives
from gcs_sysid.report import labels
from gcs_sysid.report.numbers import duration, number, plus_minus, quantity

_SHOWN = 5
_DISAGREES = 3.0
"""Standard deviations beyond which a derivative is said to disagree with the aircraft file."""


@dataclass(frozen=True)
class Finding:
    """One sentence or two; `topic` is its heading."""

    topic: str
    text: str


def findings(summary: Mapping) -> tuple[Finding, ...]:
    """The headline findings, most important first.

    Args:
        summary: the summary document of `identify` or `predict`.
    """
    found = (
        _flight(summary),
        _accuracy(summary),
        _trust(summary),
        _refused(summary),
        _lacking(summary),
        _learned(summary),
        _against_file(summary),
        _sensors(summary),
        _delays(summary),
        _air(summary),
    )
    return tuple(finding for finding in found if finding is not None)


def ten_lines(summary: Mapping, report_path: str | PathLike[str]) -> str:
    """The findings for a terminal: at most ten lines of plain text, the last naming the report.

    Args:
        summary: the summary document of `identify` or `predict`.
        report_path: where the report was written.
    """
    closing = [*_open_question(summary), *_warnings(summary)]
    room = 9 - len(closing)
    lines = [*findings(summary)[:room], *closing, Finding("Report", fspath(report_path))]
    width = max(len(line.topic) for line in lines)
    return "\n".join(f"{line.topic:<{width}}  {_one_line(line.text)}" for line in lines)


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _flight(summary: Mapping) -> Finding:
    flights = summary["flights"]
    maneuvers = summary["maneuvers"]
    held_out = sum(bool(item.get("held_out")) for item in maneuvers)
    airborne = duration(sum(float(item.get("airborne_s") or 0.0) for item in flights))
    if summary["command"] == "predict":
        seen = "none of them seen by the model" if maneuvers else "not seen by the model"
    else:
        seen = f"{held_out} held out of the fit"
    return Finding(
        "Flight",
        f"{summary['aircraft']}: {_count(len(flights), 'flight')}, {airborne} airborne, "
        f"{_count(len(maneuvers), 'maneuver')}, {seen}.",
    )


def _accuracy(summary: Mapping) -> Finding | None:
    scores = scored(summary)
    if not scores:
        return None
    ordered = sorted(scores.items(), key=lambda item: item[1]["relative_error"])
    parts = [f"{name} {number(score['relative_error'], 2)} %" for name, score in ordered]
    where = "held-out maneuvers" if summary["command"] == "identify" else "this flight"
    return Finding(
        "Accuracy",
        f"Error on {where}, in percent of the measured spread: {_listed(parts)} "
        "(100 % is no better than a constant).",
    )


def _trust(summary: Mapping) -> Finding | None:
    shares = {
        name: 100.0 * score["coverage95"]
        for name, score in scored(summary).items()
        if _known(score.get("coverage95"))
    }
    if not shares:
        return None
    low, high = min(shares.values()), max(shares.values())
    narrow = [name for name, share in shares.items() if share < 90.0]
    wide = [name for name, share in shares.items() if share > 99.5]
    if narrow:
        verdict = f"{_listed(narrow)}: too sure of itself"
    elif wide:
        verdict = f"{_listed(wide)}: wider than this flight needs"
    else:
        verdict = "intervals can be trusted"
    return Finding(
        "Intervals",
        f"95 % bands hold {low:.0f} to {high:.0f} % of the measured samples: {verdict}.",
    )


def _refused(summary: Mapping) -> Finding | None:
    reasons = refused(summary)
    if not reasons:
        return None
    by_reason: dict[str, list[str]] = {}
    for name, reason in reasons.items():
        by_reason.setdefault(reason, []).append(name)
    parts = [f"{_listed(names)}: {reason}" for reason, names in by_reason.items()]
    return Finding("Refused", "; ".join(parts).rstrip(".") + ".")


def _learned(summary: Mapping) -> Finding | None:
    rows = _rows(summary)
    if not rows:
        return None
    sure = sorted((row for row in rows if row.verdict == "yes"), key=_relative)
    text = f"{len(sure)} of {len(rows)} derivatives are determined"
    if sure:
        best = [f"{_name(row)} {plus_minus(row.value, row.half)}" for row in sure[:_SHOWN]]
        text += f", best (± 95 %) {_listed(best)}"
    lost = [_name(row) for row in rows if row.verdict == "no"]
    if lost:
        text += f"; not at all: {_listed(lost[:_SHOWN])}{_more(lost)}"
    return Finding("Learned", f"{text}.")


def _lacking(summary: Mapping) -> Finding | None:
    """Terms that the flight asks for, and what it means that the model does not have them."""
    terms = summary.get("lacking") or []
    if not terms:
        return None
    parts = [
        f"{one['regressor']} in {one['coefficient']} ({100.0 * one['share']:.0f} % of its spread, "
        f"Bayes factor e^{one['log_bayes_factor']:.0f})"
        for one in terms
    ]
    return Finding(
        "Lacks",
        f"The flight asks for terms that the model does not have: {_listed(parts)}. What is "
        "missing bends derivatives and flow angles; --stepwise takes it in, diagnose looks for "
        "causes.",
    )


def _against_file(summary: Mapping) -> Finding | None:
    rows = [row for row in _rows(summary) if row.distance is not None and row.verdict != "no"]
    if not rows:
        return None
    apart = [row for row in rows if abs(row.distance or 0.0) > _DISAGREES]
    apart.sort(key=lambda row: -abs(row.distance or 0.0))
    if not apart:
        return Finding(
            "Aircraft file",
            f"Agrees within {_DISAGREES:.0f} sd where the flight tells a derivative ({len(rows)}).",
        )
    parts = [
        f"{_name(row)} {plus_minus(row.value, row.half)} against {number(row.file)}"
        for row in apart[:3]
    ]
    return Finding(
        "Aircraft file",
        f"Disagrees by more than {_DISAGREES:.0f} sd on {len(apart)} of {len(rows)}: "
        f"{_listed(parts)}{_more(apart, shown=3)}.",
    )


def _sensors(summary: Mapping) -> Finding | None:
    verdict = (summary.get("compatibility") or {}).get("verdict")
    return Finding("Sensors", _sentence(str(verdict))) if verdict else None


def _delays(summary: Mapping) -> Finding | None:
    delays = (summary.get("reconstruction") or {}).get("delays") or {}
    parts = [
        f"{stream} {quantity(entry['value'], _half(entry), entry.get('unit', 's'))}"
        for stream, entry in delays.items()
    ]
    return Finding("Delays", f"{_listed(parts)} (± 95 %).") if parts else None


def _half(entry: Mapping) -> float | None:
    sd = entry.get("sd")
    return None if sd is None else SIGMAS_95 * sd


def _air(summary: Mapping) -> Finding | None:
    reconstruction = summary.get("reconstruction") or {}
    wind = reconstruction.get("wind_ned")
    if not wind or any(value is None for value in wind["value"]):
        return None
    north, east, down = wind["value"]
    speed = math.hypot(north, east)
    origin = math.degrees(math.atan2(-east, -north)) % 360.0
    gust = reconstruction.get("gust_sd") or {}
    rough = (
        f", gusts {number(gust['value'], 2)} m/s (one sd)" if gust.get("value") is not None else ""
    )
    return Finding(
        "Air",
        f"Wind {speed:.1f} m/s from {origin:03.0f}°, {_vertical(down)}{rough}.",
    )


def _vertical(down: float) -> str:
    if abs(down) < 0.05:
        return "no vertical wind"
    return f"{'sinking' if down > 0.0 else 'rising'} {abs(down):.1f} m/s"


def _open_question(summary: Mapping) -> list[Finding]:
    questions = summary.get("cannot_tell") or []
    if not questions:
        return []
    first = questions[0]
    more = f" {len(questions) - 1} more in the report." if len(questions) > 1 else ""
    lines = [Finding("Cannot tell", f"{_plain(first['what'])}: {_sentence(first['why'])}{more}")]
    if first.get("fly"):
        lines.append(Finding("Fly next", _sentence(first["fly"])))
    return lines


def _warnings(summary: Mapping) -> list[Finding]:
    warnings = summary.get("warnings") or []
    if not warnings:
        return []
    more = f" ({len(warnings) - 1} more in the report)" if len(warnings) > 1 else ""
    return [Finding("Warning", f"{_sentence(str(warnings[0]))}{more}")]


def refused(summary: Mapping) -> dict[str, str]:
    """Reasons by coefficient that was refused, in the order CX to Cn."""
    table = summary["coefficients"]
    return {
        name: str(table[name]["refused"])
        for name in COEFFICIENTS
        if name in table and table[name].get("refused")
    }


def scored(summary: Mapping) -> dict[str, Mapping]:
    """Entries of the coefficients that have a held-out error, in the order CX to Cn."""
    table = summary["coefficients"]
    return {
        name: table[name]
        for name in COEFFICIENTS
        if name in table
        and not table[name].get("refused")
        and _known(table[name].get("relative_error"))
    }


def _known(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def _rows(summary: Mapping) -> list[Derivative]:
    """Derivatives that this run found; a prediction finds none, whatever its model holds."""
    if summary["command"] != "identify":
        return []
    table = derivatives(summary.get("derivatives") or {})
    return [row for rows in table.values() for row in rows if row.regressor != "1"]


def _relative(row: Derivative) -> float:
    return row.half / abs(row.value) if row.value else float("inf")


def _name(row: Derivative) -> str:
    return labels.derivative(row.coefficient, row.regressor)


def _more(items: Sequence, *, shown: int = _SHOWN) -> str:
    return f" and {len(items) - shown} more" if len(items) > shown else ""


def _listed(parts: Sequence[str]) -> str:
    return ", ".join(parts)


def _count(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _plain(text: str) -> str:
    return str(text).rstrip(". ")


def _sentence(text: str) -> str:
    text = str(text).strip()
    text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else f"{text}."
