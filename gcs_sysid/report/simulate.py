"""The page that `simulate` leaves: how the simulation flies, and where it departs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gcs_sysid.figures.simulation import history
from gcs_sysid.report import sheet
from gcs_sysid.report.findings import Finding
from gcs_sysid.report.numbers import for_people, number
from gcs_sysid.report.sheet import Section, Sheet, Table

_BINS = 700
_LISTED = 20


def render(summary: Mapping, table: Mapping[str, np.ndarray]) -> str:
    """The report of a simulation as one self-contained HTML file.

    Args:
        summary: the document of `simulate`.
        table: `simulated.parquet`, one array a column.
    """
    return sheet.render(
        Sheet(
            kind="Simulation report",
            question="How the simulation flies this flight",
            summary=summary,
            findings=findings(summary),
            sections=(
                Section(
                    "channels",
                    "Channels",
                    "Simulated less measured, over all windows. A channel passes where its rms "
                    "error is within the tolerance, or where Theil's inequality coefficient, 0 "
                    "for equal motions and 1 for opposite ones, is "
                    f"{number(summary['theil_limit'])} or less.",
                    tables=(_channels(summary),),
                ),
                Section(
                    "free-run",
                    "Whole maneuvers",
                    _free_run_words(summary["free_run"]),
                    tables=(_free_run(summary),) if summary["free_run"]["channels"] else (),
                ),
                Section(
                    "coefficients",
                    "Coefficients",
                    "What the simulation gives at the measured motion less what was measured, over "
                    "all maneuvers: where it is wrong at the source, before errors gather into "
                    "motion. Without vanes in gusts the flow angles' errors are in it as well.",
                    tables=(_coefficients(summary),),
                ),
                Section(
                    "frequency",
                    "In frequency",
                    "The band about the frequency of most motion in which what is simulated goes "
                    "along with what was measured, coherence 0.6 or more, and its answer there: "
                    "gain 1 and no phase for a simulation that moves as measured; a lag is "
                    "negative.",
                    tables=(_frequency(summary),),
                ),
                Section(
                    "departures",
                    "Departures",
                    "Windows in which a channel left its tolerance, the largest first."
                    if summary["departures"]
                    else "None: no channel left its tolerance in any window.",
                    tables=(_departures(summary),) if summary["departures"] else (),
                ),
                Section(
                    "motion",
                    "Motion",
                    "Zooming in time carries over between the panels.",
                    figures=(history(table, bins=_BINS),),
                ),
            ),
            files="simulate.json and simulated.parquet",
        )
    )


def findings(summary: Mapping) -> tuple[Finding, ...]:
    """The headline findings, most important first."""
    channels = summary["channels"]
    failed = [name for name, item in channels.items() if not item["pass"]]
    found = [
        Finding(
            "Simulation",
            f"{summary['simulation']}: {summary['windows']['count']} windows of "
            f"{summary['windows']['length_s']:.0f} s.",
        ),
        Finding(
            "Verdict",
            f"departs from the flight in {', '.join(failed)}."
            if failed
            else f"flies as measured in all {len(channels)} channels.",
        ),
    ]
    worst = sorted(channels.items(), key=lambda item: -item[1]["theil"])[:3]
    found.append(
        Finding(
            "Least alike",
            "; ".join(
                f"{name}: rms {_shown(item['rms'], item['unit'])}, Theil {number(item['theil'], 2)}"
                for name, item in worst
            )
            + ".",
        )
    )
    if summary["departures"]:
        first = summary["departures"][0]
        found.append(
            Finding(
                "Departs most",
                f"{first['channel']} by {_shown(first['size'], first['unit'])} at "
                f"{first['t_s']:.1f} s: {first['region']}.",
            )
        )
    return tuple(found)


def _channels(summary: Mapping) -> Table:
    return Table(
        ("channel", "bias", "rms", "tolerance", "expected sd", "Theil", "verdict"),
        tuple(
            (
                name,
                *(
                    _shown(item[key], item["unit"])
                    for key in ("bias", "rms", "tolerance", "expected_sd")
                ),
                number(item["theil"], 2),
                "pass" if item["pass"] else "departs",
            )
            for name, item in summary["channels"].items()
        ),
    )


def _free_run_words(free_run: Mapping) -> str:
    lost = free_run["lost"]
    words = (
        f"Each of {free_run['count']} maneuvers left alone from its beginning, the longest for "
        f"{free_run['longest_s']:.0f} s. Of Theil's coefficient a good simulation has most in "
        "another course, little in another mean or size."
    )
    if lost:
        words += f" Not flown to the end: maneuvers {', '.join(map(str, lost))}."
    return words


def _free_run(summary: Mapping) -> Table:
    return _agreements("channel", summary["free_run"]["channels"])


def _coefficients(summary: Mapping) -> Table:
    return _agreements("coefficient", summary["coefficients"])


def _agreements(what: str, items: Mapping[str, Mapping]) -> Table:
    """How what was simulated agrees with what was measured; a coefficient has no unit."""
    return Table(
        (what, "bias", "rms", "Theil", "of it mean", "size", "course"),
        tuple(
            (
                name,
                *(
                    _shown(item[key], item["unit"]) if "unit" in item else number(item[key])
                    for key in ("bias", "rms")
                ),
                number(item["theil"], 2),
                *_parts(item["theil_parts"]),
            )
            for name, item in items.items()
        ),
    )


def _parts(parts: Mapping) -> tuple[str, ...]:
    """Of Theil's coefficient another mean, size, course."""
    return tuple(f"{100.0 * parts[name]:.0f} %" for name in ("bias", "variance", "covariance"))


def _frequency(summary: Mapping) -> Table:
    return Table(
        ("channel", "band, Hz", "gain", "phase, deg"),
        tuple(
            (name, "–", "–", "–")
            if item is None
            else (
                name,
                " to ".join(number(one, 2) for one in item["band_hz"]),
                number(item["gain"], 2),
                f"{np.degrees(item['phase']):.0f}",
            )
            for name, item in summary["frequency"].items()
        ),
    )


def _departures(summary: Mapping) -> Table:
    return Table(
        ("where", "channel", "from, s", "by", "tolerance"),
        tuple(
            (
                item["region"],
                item["channel"],
                f"{item['t_s']:.1f}",
                _shown(item["size"], item["unit"]),
                _shown(item["tolerance"], item["unit"]),
            )
            for item in summary["departures"][:_LISTED]
        ),
    )


def _shown(value: float | None, unit: str) -> str:
    if value is None:
        return number(value)
    shown, _, name = for_people(value, 0.0, unit)
    return f"{number(shown)} {name}"
