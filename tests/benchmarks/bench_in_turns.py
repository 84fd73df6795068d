"""States and Gaussian processes in turns, until the likelihood stops rising.

Flights of the Ultra Stick by the legs of `replay/stall`, its lift curve broken, in gusts of
0.8 m/s, with flow vanes and without. The polynomial, fitted inside the filter with the usual terms,
has no bend. Each round learns processes of what it leaves at the states of the round before, gate
open, and smooths the flight anew by a filter that holds both. Judged on another flight of the
aircraft, against the coefficients that flew, at the air that it felt. Takes ten minutes.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid import aircraft_file  # noqa: E402 - found from ROOT
from gcs_sysid.aircraft import FORCES, MOMENTS, Aircraft  # noqa: E402
from gcs_sysid.cli import numerics  # noqa: E402
from gcs_sysid.estimate.result import AeroModel  # noqa: E402
from gcs_sysid.gp import fitting  # noqa: E402
from gcs_sysid.gp.aerodynamics import LearnedModel  # noqa: E402
from gcs_sysid.offline import aided_fit, identify, learned, model_store  # noqa: E402
from gcs_sysid.offline.flight import Flight  # noqa: E402
from tests.benchmarks import (  # noqa: E402
    bench_filter_error_cost,
    bench_lacking,
    table,
)
from tests.benchmarks.bench_filter_error import true_flow  # noqa: E402

EFFORT = replace(learned.EFFORT, always=True, local=False)
ROUNDS = 6
STOPPED = 2.0
"""A round that brings the likelihood no further than this is the last [nat]."""
STALLED = 0.12
"""Where the lift curve breaks [rad]."""


def quiet(text: str, fraction: float) -> None:
    """No progress."""


def rounds(folder: Path, words: str, *, vanes: bool) -> list[tuple[str, ...]]:
    """Rows of one flight: the polynomial alone, then every round."""
    path = bench_lacking.flown(folder, 0, vanes=vanes)
    described = aircraft_file.load(path)
    identify.run(
        [folder / "flights" / "first.tlog"],
        path,
        prior="none",
        segments=None,
        vehicle=None,
        stepwise=False,
        out=folder / "usual",
        progress=quiet,
        method="filter-error",
    )
    stored = model_store.load(folder / "usual")
    one = bench_filter_error_cost.read(folder / "flights" / "first.tlog", described)
    fits, controls = stored.model.fits, stored.model.controls
    polynomial = AeroModel(fits, controls)
    kept = ", ".join(sorted(getattr(stored.model, "outputs", ()))) or "none"
    model, rows, best = polynomial, [], -np.inf
    for number in range(ROUNDS + 1):
        seen = aided_fit.seen_by(one, model, quiet)
        gained = seen.log_likelihood - best
        leaves = learned.samples(polynomial, [seen.flight], None)
        rows.append(
            (
                words,
                "polynomial" if number == 0 else f"round {number}",
                "" if number == 0 else f"{gained:+.1f}",
                *errors(described, model, folder),
                left(seen.flight, leaves.values[:, learned.outputs(polynomial).index("CZ")]),
                kept if number == 0 else "all",
            )
        )
        print(*rows[-1], flush=True)
        if number and gained < STOPPED:
            break
        best = max(best, seen.log_likelihood)
        found = fitting.fit(leaves, EFFORT)
        model = LearnedModel(
            fits, controls, found, learned.inputs(polynomial), learned.outputs(polynomial)
        )
    return rows


def left(one: Flight, values: np.ndarray) -> str:
    """What the polynomial leaves of CZ at the filter's states, in % of CZ's spread."""
    measured = one.samples.measured["CZ"][one.pieces() >= 0]
    return f"{100.0 * np.std(values) / np.std(measured):.1f}"


def errors(described: Aircraft, model: AeroModel, folder: Path) -> list[str]:
    """100·std(model − true)/std(true) on the other flight: CZ, CZ past the break, means."""
    true = bench_lacking.truth(folder, "second")
    flow = true_flow(described, true)
    predicted = model.predict(flow, measured=False)
    wrong = {name: found.mean - true[name] for name, found in predicted.items()}
    each = {name: 100.0 * np.std(off) / np.std(true[name]) for name, off in wrong.items()}
    past = true["alpha"] > STALLED
    beyond = 100.0 * np.sqrt(np.mean(wrong["CZ"][past] ** 2)) / np.std(true["CZ"])
    means = [np.mean([each[name] for name in names]) for names in (FORCES, MOMENTS)]
    return [f"{value:.1f}" for value in (each["CZ"], beyond, *means)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", action="store_true", help="fly; nothing unless asked for")
    parser.add_argument("--folder", type=Path, default=ROOT / "out" / "in_turns")
    parser.add_argument("--save", action="store_true", help="see tests/benchmarks/table.py")
    asked = parser.parse_args()
    if not asked.rounds:
        print("in turns: takes ten minutes; ask for it with --rounds")
        return
    numerics.enable()
    rows = []
    for vanes, words in ((False, "no vanes"), (True, "vanes")):
        rows += rounds(asked.folder / words.replace(" ", "_"), words, vanes=vanes)
    table.show(
        "in_turns",
        "A lift slope that breaks: states and processes in turns, % error on another flight "
        "against what flew",
        ("flow", "model", "likelihood [nat]", "CZ", "CZ past the break", "forces", "moments",
         "polynomial leaves of CZ, its own flight", "earned their place"),
        rows,
    )  # fmt: skip


if __name__ == "__main__":
    main()
