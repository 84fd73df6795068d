"""Where a search inside the filter begins: from an ordinary aircraft, or from least squares.

On flights of `bench_filter_error.py`, in gusts and without vanes, nothing told: how far the values
are off at the beginning, how many passes the stretch takes on which a search begins, and how likely
it is where that comes to rest. `identify` begins from an ordinary aircraft.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid import aircraft_file, regressors  # noqa: E402 - found from ROOT
from gcs_sysid.aircraft import Aircraft  # noqa: E402
from gcs_sysid.cli import numerics  # noqa: E402
from gcs_sysid.estimate import (  # noqa: E402
    equation_error,
    first_guess,
    flight_rows,
    inside_filter,
    settling,
    verdict,
)
from gcs_sysid.model.flight_model import FlightModel  # noqa: E402
from gcs_sysid.offline import aided_fit, aided_flight  # noqa: E402
from gcs_sysid.offline.flight import Flight  # noqa: E402
from tests.benchmarks import (  # noqa: E402
    bench_filter_error,
    bench_filter_error_cost,
    table,
)

SEEDS = (7001, 7013)
"""One that settles on its first stretch, and one that does not."""
Values = Mapping[str, Mapping[str, float]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="*", default=SEEDS)
    parser.add_argument("--folder", type=Path, default=ROOT / "out" / "filter_error")
    parser.add_argument("--save", action="store_true", help="see tests/benchmarks/table.py")
    asked = parser.parse_args()
    numerics.enable()
    numerics.keep_freed_memory()
    aircraft = aircraft_file.load(bench_filter_error.OWN)
    structure = regressors.default_structure(aircraft)
    rows: list[tuple[str, ...]] = []
    for seed in asked.seeds:
        folder = asked.folder / str(seed)
        bench_filter_error.flown(folder, seed, bench_filter_error.OWN)
        one = bench_filter_error_cost.read(folder / "flight.tlog", aircraft)
        fitted = equation_error.fit([one.samples], aircraft, structure, [one.pieces()], prior=None)
        told = sum(
            verdict.judge(fit, index, None).answer != "no"
            for fit in fitted.fits.values()
            for index in range(len(fit.keys))
        )
        squares = {
            name: dict(zip(fit.keys, fit.value.tolist(), strict=True))
            for name, fit in fitted.fits.items()
        }
        starts = {
            "an ordinary aircraft": first_guess.derivatives(aircraft, structure),
            f"least squares, {told} of {sum(map(len, structure.values()))} told": squares,
        }
        rows += [(str(seed), name, *_rest(one, aircraft, start)) for name, start in starts.items()]
    table.show(
        "filter_error_starts",
        "Where a search inside the filter begins, in gusts without vanes, nothing told",
        ("flight", "from", "slopes off, rms of their size", "passes", "log-likelihood at rest"),
        rows,
    )


def _rest(one: Flight, aircraft: Aircraft, start: Values) -> tuple[str, str, str]:
    """How far off it begins, passes over a stretch, and the likelihood where it comes to rest."""
    structure = {name: tuple(terms) for name, terms in start.items()}
    model = FlightModel(aided_flight.with_structure(aircraft, start))
    item = aided_fit._prepared(one, start, (), body=False)
    mean, sigma = inside_filter.beliefs(structure, None, aircraft)
    before = aided_fit._believed(mean, sigma, aircraft, body=False)
    beliefs = aided_fit._beliefs(item, aided_fit._with(item.first, before), before.covariance)
    rows, counts = flight_rows.busiest(item.rows, np.ones_like(item.held))
    passes: list[str] = []
    done, _ = settling.begun(model, rows, item.first, beliefs, counts, passes.append, rough=True)
    taken = sum(text.startswith(("approach", "turn")) for text in passes)
    return f"{_off(aircraft, start):.2f}", str(taken), f"{max(done.log_likelihood):.0f}"


def _off(aircraft: Aircraft, start: Values) -> float:
    """Error of all slopes over their true size, rms."""
    shares = [
        (start[name][key] - term.value) / term.value
        for name, model in aircraft.aerodynamics.items()
        for key, term in model.terms.items()
        if key != regressors.CONSTANT and key in start[name]
    ]
    return float(np.sqrt(np.mean(np.square(shares))))


if __name__ == "__main__":
    main()
