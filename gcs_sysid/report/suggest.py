"""The page that `suggest` leaves: what to fly next, what it teaches, how far it goes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from gcs_sysid.figures.maneuver import maneuver
from gcs_sysid.report import labels, sheet
from gcs_sysid.report.findings import Finding
from gcs_sysid.report.numbers import number
from gcs_sysid.report.sheet import Section, Sheet, Table


def render(summary: Mapping, table: Mapping[str, np.ndarray]) -> str:
    """The report of a suggestion as one self-contained HTML file.

    Args:
        summary: the document of `suggest`.
        table: `maneuvers.parquet`, one array a column.
    """
    listed = summary["maneuvers"]
    return sheet.render(
        Sheet(
            kind="Maneuver suggestions",
            question="What to fly next",
            summary=summary,
            findings=findings(summary),
            sections=(
                Section(
                    "maneuvers",
                    "Maneuvers",
                    "In order of worth. Deviations are of the coefficient along the maneuver, root "
                    "mean square, before it is flown and after it was flown once and fitted.",
                    tables=(_maneuvers(summary),),
                ),
                Section(
                    "derivatives",
                    "Derivatives",
                    "One standard deviation of each term, now and after the maneuver. What errors "
                    "of mass and inertia leave open no maneuver closes.",
                    tables=tuple(_derivatives(item) for item in _best(listed)),
                ),
                Section(
                    "motion",
                    "Inputs and motion",
                    "Flown from level flight by the identified aircraft with a gentle attitude "
                    "hold, as an autopilot keeps one.",
                    figures=tuple(
                        maneuver(table, place, item, summary["limits"])
                        for place, item in enumerate(listed)
                    ),
                ),
            ),
            files="maneuvers.json, suggest.json and a CSV for each maneuver",
        )
    )


def findings(summary: Mapping) -> tuple[Finding, ...]:
    """The headline findings, most important first."""
    listed = summary["maneuvers"]
    if not listed:
        return (
            Finding(
                "Nothing to fly",
                f"every moment coefficient is known to {100.0 * summary['confidence']:.0f} % of "
                "its variation; ask for more with a smaller --confidence.",
            ),
        )
    found = [Finding("Least sure", f"{_unsure(summary)}.")]
    for item in listed[:5]:
        found.append(Finding("Fly", f"{_described(item)}: {_teaches(item)}."))
    at = summary["condition"]
    found.append(
        Finding(
            "From",
            f"level flight at {at['airspeed']:.0f} m/s, {at['height']:.0f} m above ground or more.",
        )
    )
    return tuple(found)


def _unsure(summary: Mapping) -> str:
    """Coefficients and, of each, the term that is known worst against the size of all."""
    words = []
    for name, item in summary["unsure"].items():
        share = 100.0 * item["sd"] / item["spread"] if item["spread"] else math.inf
        words.append(f"{name} to {number(share, 2)} % of its variation")
    return "; ".join(words)


def _described(item: Mapping) -> str:
    amplitude = ", ".join(
        f"{name} ±{math.degrees(value):.1f}°" for name, value in item["amplitude"].items()
    )
    return f"{item['kind']} of {item['duration_s']:.1f} s on {amplitude}"


def _teaches(item: Mapping) -> str:
    parts = []
    for name in item["target"]["coefficients"]:
        one = item["expected"][name]
        parts.append(f"{name} {number(one['sd_before'], 2)} to {number(one['sd_after'], 2)} (sd)")
    risk = item["envelope"]["violation_probability"]
    return f"{', '.join(parts)}; leaves the envelope with probability {number(risk, 2)}"


def _maneuvers(summary: Mapping) -> Table:
    return Table(
        ("maneuver", "amplitude", "length, s", "sd before, after", "beyond the envelope", "file"),
        tuple(
            (
                str(item["name"]).replace("_", " "),
                ", ".join(f"{math.degrees(value):.1f}°" for value in item["amplitude"].values()),
                f"{item['duration_s']:.1f}",
                "; ".join(
                    f"{name} {number(item['expected'][name]['sd_before'], 2)}, "
                    f"{number(item['expected'][name]['sd_after'], 2)}"
                    for name in item["target"]["coefficients"]
                ),
                number(item["envelope"]["violation_probability"], 2),
                item["csv"],
            )
            for item in summary["maneuvers"]
        ),
    )


def _best(listed: Sequence[Mapping]) -> list[Mapping]:
    """The worthiest maneuver of each set of controls."""
    first: dict[tuple[str, ...], Mapping] = {}
    for item in listed:
        first.setdefault(tuple(item["controls"]), item)
    return list(first.values())


def _derivatives(item: Mapping) -> Table:
    rows = []
    for name in item["target"]["coefficients"]:
        for key, one in item["expected"][name]["derivatives"].items():
            rows.append(
                (
                    labels.derivative(name, key),
                    number(one["sd_before"], 3),
                    number(one["sd_after"], 3),
                )
            )
    return Table((str(item["name"]).replace("_", " "), "sd before", "sd after"), tuple(rows))
