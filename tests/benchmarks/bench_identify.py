"""What `identify` finds where the truth is known, and what a run of it costs."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid.sitl import record, scenario  # noqa: E402 - needs the path above
from tests.benchmarks import table  # noqa: E402 - needs the path above

AIRCRAFT = ROOT / "data" / "aircraft" / "ultra_stick_25e.toml"
DEMO = ROOT / "data" / "flights" / "demo.tlog"
SCENARIO = ROOT / "replay" / "demo" / "scenario.toml"
SHARED = ROOT.parent / "shared"
MINUTES = 10.0


def identified(
    log: Path, aircraft: Path, out: Path, *, method: str = "auto"
) -> tuple[dict[str, Any], float]:
    """Summary of a run without prior, and its wall time [s], process start to end."""
    program = Path(sys.executable).with_name("gcs-sysid")
    command = [program, "identify", log, "--aircraft", aircraft, "--prior", "none", "--out", out]
    command += ["--method", method]
    begun = time.perf_counter()
    subprocess.run([str(part) for part in command], check=True, capture_output=True)
    wall = time.perf_counter() - begun
    return json.loads((out / "summary.json").read_text(encoding="utf-8")), wall


def believed(aircraft: Path) -> dict[str, dict[str, float]]:
    with aircraft.open("rb") as file:
        coefficients = tomllib.load(file)["aerodynamics"]
    return {name: terms for name, terms in coefficients.items() if isinstance(terms, dict)}


def flown() -> dict[str, dict[str, float]]:
    """The derivatives that flew the demo."""
    with SCENARIO.open("rb") as file:
        changed = tomllib.load(file)["flown"]["aerodynamics"]
    return {name: {**terms, **changed.get(name, {})} for name, terms in believed(AIRCRAFT).items()}


def accuracy(
    flight: str, summary: dict[str, Any], truth: dict[str, dict[str, float]]
) -> list[tuple[object, ...]]:
    """One row a derivative: found, one standard deviation, truth, error in deviations."""
    rows = []
    for name, terms in summary["derivatives"].items():
        for key, entry in terms.items():
            if key in truth.get(name, {}):
                error = (entry["value"] - truth[name][key]) / entry["sd"]
                rows.append(
                    (flight, f"{name}_{key}", f"{entry['value']:.4g}", f"{entry['sd']:.2g}",
                     f"{truth[name][key]:.4g}", f"{error:+.1f}")
                )  # fmt: skip
    return rows


def outcome(
    flight: str, summary: dict[str, Any], truth: dict[str, dict[str, float]]
) -> tuple[object, ...]:
    """Held-out errors, coverage, and how many intervals hold the truth."""
    errors = [
        "refused" if score["refused"] else f"{score['relative_error']:.0f}"
        for score in summary["coefficients"].values()
    ]
    entries = [
        (entry, truth[name][key])
        for name, terms in summary["derivatives"].items()
        for key, entry in terms.items()
        if key in truth.get(name, {})
    ]
    held = sum(abs(entry["value"] - true) < 1.96 * entry["sd"] for entry, true in entries)
    known = sum(entry["sd"] < 0.25 * abs(true) for entry, true in entries)
    return (flight, *errors, f"{held} of {len(entries)}", f"{known} of {len(entries)}")


def without_aerodynamics(aircraft: Path, folder: Path) -> Path:
    text = aircraft.read_text(encoding="utf-8")
    bare = folder / "aircraft.toml"
    bare.write_text(text[: text.index("[aerodynamics")], encoding="utf-8")
    return bare


def long_flight(path: Path) -> None:
    """The demo's plan flown over and over for ten minutes."""
    planned = scenario.load(SCENARIO).flights[-1].flight
    rounds = int(MINUTES * 60.0 / planned.duration) + 1
    legs, left = [], MINUTES * 60.0
    for leg in planned.legs * rounds:
        if left < leg.duration:
            break
        legs.append(leg)
        left -= leg.duration
    legs.append(replace(legs[0], duration=left, inputs=()))
    record.run(replace(planned, legs=tuple(legs)), record=path, truth=None)


def cost(folder: Path) -> None:
    """Time and memory of a long flight, before all others: memory is the most of any process.

    By least squares first, and as `identify` does it by itself: where they tell too little, inside
    the filter.
    """
    long_flight(folder / "long.tlog")
    rows = []
    for method, words in (("equation-error", "least squares"), ("auto", "as it chooses")):
        asked = (folder / "long.tlog", AIRCRAFT, folder / method)
        summary, wall = identified(*asked, method=method)
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
        used = summary["method"]["name"].replace("_", " ")
        rows += [
            (f"{words}: wall time", used, "30 s", f"{wall:.0f} s"),
            (f"{words}: peak memory", used, "1000 MB", f"{peak / 1e3:.0f} MB"),
        ]
    minutes = summary["flights"][0]["duration_s"] / 60.0
    table.show(
        "identify_cost",
        f"`identify` on {minutes:.0f} minutes at 50 Hz in calm air, whole process, code compiled",
        ("what", "fitted by", "wanted", "found"),
        rows,
    )


def main() -> None:
    """Measures a long flight, the demo, and a case in gusts and a real flight where they are."""
    rows: list[tuple[object, ...]] = []
    outcomes = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cost(folder)
        jobs = [("demo", DEMO, AIRCRAFT, flown())]
        if SHARED.is_dir():
            clean, thor = SHARED / "cases" / "clean", SHARED / "data" / "umn_thor"
            bare = without_aerodynamics(clean / "aircraft.toml", folder)
            jobs += [
                ("clean, gusts of 3 m/s, no vanes", clean / "flight.tlog", bare,
                 believed(clean / "aircraft.toml")),
                ("UMN Thor, against the wind tunnel", thor / "thor_flight75.tlog",
                 thor / "aircraft.toml", believed(thor / "aircraft.toml")),
            ]  # fmt: skip
        for index, (flight, log, aircraft, truth) in enumerate(jobs):
            summary, _ = identified(log, aircraft, folder / str(index))
            rows += accuracy(flight, summary, truth)
            outcomes.append(outcome(flight, summary, truth))
    table.show(
        "identify_derivatives",
        "Derivatives found without a prior, against those that flew (or the wind tunnel's)",
        ("flight", "derivative", "found", "one sd", "truth", "error / sd"),
        rows,
    )
    table.show(
        "identify",
        "Error on held-out maneuvers in % of the measured spread; intervals of 95 %",
        ("flight", "CX", "CY", "CZ", "Cl", "Cm", "Cn", "hold the truth", "known to 25 %"),
        outcomes,
    )


if __name__ == "__main__":
    main()
