"""A stall that the model does not have, in gusts, without vanes: asked for, taken in, and then?

Flights of the Ultra Stick by the legs of `replay/stall`, each with another break of the lift curve,
gusts of 0.8 m/s, no prior. Fitted inside the filter with the usual terms, and with those that it
asks for. Judged on another flight of the same aircraft, against the coefficients that flew, at the
air that the aircraft felt. The flights with nothing hidden are those of
`bench_filter_error.py --flights`. Takes half an hour; results are kept in out/lacking.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid import aircraft_file, regressors  # noqa: E402 - found from ROOT
from gcs_sysid.aircraft import FORCES, MOMENTS, Aircraft  # noqa: E402
from gcs_sysid.cli import numerics  # noqa: E402
from gcs_sysid.offline import identify  # noqa: E402
from tests.benchmarks import table  # noqa: E402
from tests.benchmarks.bench_filter_error import true_flow  # noqa: E402

SCENARIO = ROOT / "replay" / "stall" / "scenario.toml"
BELIEVED = ROOT / "replay" / "ultra_stick_25e.toml"
HIDDEN = ((0.12, 0.6), (0.10, 0.5), (0.14, 0.7), (0.09, 0.3))
"""Where the lift curve breaks [rad], and the share of its slope that is lost."""
GUST = 0.8


def flown(folder: Path, number: int, *, vanes: bool = False) -> Path:
    """Flies both flights of the scenario, unless they were flown before; returns the aircraft."""
    aircraft = folder / "aircraft.toml"
    if (folder / "flights" / "second.tlog").exists():
        return aircraft
    (folder / "flights").mkdir(parents=True, exist_ok=True)
    described = BELIEVED.read_text()
    if not vanes:
        head, rest = described.split("[vanes]", 1)
        described = head + rest[rest.index("[[servos]]") :]
    aircraft.write_text(described)
    text = SCENARIO.read_text()
    knot, lost = HIDDEN[number]
    for old, new in (
        ('"../ultra_stick_25e.toml"', f'"{aircraft}"'),
        ("alpha_break = 0.12", f"alpha_break = {knot}"),
        ("slope_loss = 0.6", f"slope_loss = {lost}"),
        ("gust = 0.10", f"gust = {GUST}"),
        ("seed = 186", f"seed = {8100 + 2 * number}"),
        ("seed = 187", f"seed = {8101 + 2 * number}"),
    ):
        assert old in text
        text = text.replace(old, new)
    (folder / "scenario.toml").write_text(text)
    command = [sys.executable, "-m", "gcs_sysid", "sitl", "--scenario"]
    command += [str(folder / "scenario.toml"), "--out", str(folder / "flights")]
    subprocess.run(command, check=True, capture_output=True)
    return aircraft


def truth(folder: Path, name: str) -> dict[str, np.ndarray]:
    """Truth of one of a scenario's flights by column, and `time_us`."""
    with np.load(folder / "flights" / f"{name}_truth.npz") as file:
        columns = {str(key): file["rows"][:, i] for i, key in enumerate(file["cols"])}
        return {**columns, "time_us": int(file["t0_us"]) + 1e6 * columns["t"]}


def model_errors(
    aircraft: Aircraft, derivatives: dict[str, Any], true: dict[str, np.ndarray]
) -> dict[str, float]:
    """100·std(model − true)/std(true) on another flight."""
    flow, controls = true_flow(aircraft, true), aircraft.control_names
    out = {}
    for name, terms in derivatives.items():
        modelled = sum(
            entry["value"] * regressors.evaluate(regressors.parse(key, controls=controls), flow)
            for key, entry in terms.items()
        )
        out[name] = 100.0 * float(np.std(modelled - true[name]) / np.std(true[name]))
    return out


def flow_errors(samples: Path, true: dict[str, np.ndarray]) -> list[float]:
    """Of angle of attack and sideslip inside maneuvers, rms [deg]."""
    table_of = pq.read_table(samples, columns=["time_us", "maneuver", "alpha", "beta"])
    rows = {name: table_of[name].to_numpy() for name in table_of.column_names}
    used = rows["maneuver"] >= 0
    return [
        float(np.rad2deg(np.sqrt(np.mean((rows[name] - at)[used] ** 2))))
        for name in ("alpha", "beta")
        for at in [np.interp(rows["time_us"], true["time_us"], true[name])]
    ]


def scored(folder: Path, number: int) -> dict[str, Any]:
    """Identifies one flight with the usual terms, then with those that it asks for."""
    path = flown(folder, number)
    described = aircraft_file.load(path)
    usual = regressors.default_structure(described)
    result: dict[str, Any] = {"number": number}
    for label, by_data in (("usual", False), ("asked", True)):
        summary = identify.run(
            [folder / "flights" / "first.tlog"],
            path,
            prior="none",
            segments=None,
            vehicle=None,
            stepwise=by_data,
            out=folder / label,
            progress=lambda *_: None,
            method="filter-error",
        )
        derivatives = summary["derivatives"]
        result[label] = {
            "seconds": summary["timing"]["fit_s"],
            "method": summary["method"],
            "flow": flow_errors(folder / label / "samples.parquet", truth(folder, "first")),
            "errors": model_errors(described, derivatives, truth(folder, "second")),
            "terms": [
                f"{name}_{key}"
                for name, terms in derivatives.items()
                for key in terms
                if key not in usual[name]
            ],
            "lacking": summary["lacking"],
            "off": _off(described, derivatives),
        }
    return result


def _off(aircraft: Aircraft, derivatives: dict[str, Any]) -> list[float]:
    """(found − true)/sd of the derivatives of coefficients in which nothing was hidden."""
    off = []
    for name, terms in derivatives.items():
        flew = aircraft.aerodynamics[name].terms
        for key, entry in terms.items():
            if name != "CZ":
                true = flew[key].value if key in flew else 0.0
                off.append((entry["value"] - true) / entry["sd"])
    return off


LEAST_SQUARES = ": no end inside the filter, least squares"
FITTED = {"usual": "usual terms", "asked": "with terms asked for"}


def shown(results: Sequence[dict[str, Any]]) -> None:
    """Prints both fits of every flight, and their mean."""
    rows = [
        (
            words + LEAST_SQUARES * (result[label]["method"]["name"] != "filter_error"),
            f"{knot:g} rad, {100.0 * lost:.0f} %",
            *_numbers([result[label]]),
            ", ".join(
                f"{one['coefficient']}_{one['regressor']} ({one['log_bayes_factor']:.0f})"
                for one in result[label]["lacking"]
            )
            or "nothing",
        )
        for result in results
        for knot, lost in [HIDDEN[result["number"]]]
        for label, words in FITTED.items()
    ]
    means = [
        (words, f"mean of {len(results)}", *_numbers([result[label] for result in results]), "")
        for label, words in FITTED.items()
    ]
    table.show(
        "lacking",
        "A lift slope that breaks, in gusts of 0.8 m/s without vanes, no prior, 1.5 min: % error "
        "on another flight against what flew",
        (
            "fitted",
            "hidden: break, loss",
            "CZ",
            "forces",
            "moments",
            "alpha [°]",
            "beta [°]",
            "95 % intervals that hold, CZ apart",
            "then asked for [nat]",
        ),
        [*means, *rows],
    )


def _numbers(parts: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    """Mean errors of some fits, and the share of their intervals that hold."""
    errors = [
        np.mean([part["errors"][name] for part in parts for name in names])
        for names in (("CZ",), FORCES, MOMENTS)
    ]
    flow = np.mean([part["flow"] for part in parts], axis=0)
    off = np.concatenate([part["off"] for part in parts])
    return (
        *(f"{error:.1f}" for error in errors),
        *(f"{angle:.2f}" for angle in flow),
        f"{100.0 * np.mean(np.abs(off) < 1.96):.0f} %",
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--flights", type=int, default=0, help="of the four; none unless asked for")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=ROOT / "out" / "lacking")
    parser.add_argument("--save", action="store_true")
    asked = parser.parse_args()
    if not asked.flights:
        print("lacking: takes half an hour; ask for it with --flights 4")
        return
    numerics.enable()
    numerics.keep_freed_memory()
    results = []
    for number in range(asked.first, asked.first + asked.flights):
        kept = asked.folder / f"{number}.json"
        if not kept.exists():
            result = scored(asked.folder / str(number), number)
            kept.write_text(json.dumps(result))
        results.append(json.loads(kept.read_text()))
        print(f"flight {number} fitted", flush=True)
    shown(results)


if __name__ == "__main__":
    main()
