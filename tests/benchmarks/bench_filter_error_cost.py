"""What filter error costs: one flight of four minutes at 50 Hz, all its parameters free.

Fitted twice in a process that keeps no compiled code from before, then once more in another that
finds the first one's. What the first fit takes longer than the second is compiling, and with kept
code reading it. One pass over the whole, half and a quarter of it shows how cost grows.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time as clock
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid import aircraft_file, regressors  # noqa: E402 - found from ROOT
from gcs_sysid.aircraft import Aircraft  # noqa: E402
from gcs_sysid.cli import numerics  # noqa: E402
from gcs_sysid.estimate import flight_rows, settling  # noqa: E402
from gcs_sysid.estimate.filter_error import Fit  # noqa: E402
from gcs_sysid.model.flight_model import FlightModel  # noqa: E402
from gcs_sysid.offline import aided_fit, aided_flight, flight, maneuver_choice  # noqa: E402
from gcs_sysid.offline.flight import Flight  # noqa: E402
from gcs_sysid.reconstruct import causal  # noqa: E402
from tests.benchmarks import bench_filter_error, table  # noqa: E402

SEED = 7000
FOLDER = ROOT / "out" / "filter_error" / str(SEED)


def fitted(times: int) -> dict[str, list[float]]:
    """Seconds of so many fits, one after the other, and how many parameters were free."""
    numerics.enable()
    numerics.keep_freed_memory()
    aircraft = aircraft_file.load(bench_filter_error.OWN)
    one = flight.read(
        FOLDER / "flight.tlog",
        aircraft,
        vehicle=None,
        segments=maneuver_choice.chooser(None, aircraft),
        delay=None,
        progress=lambda *_: None,
        measured=True,
    )
    structure, seconds, free = regressors.default_structure(aircraft), [], 0
    for _ in range(times):
        begun = clock.perf_counter()
        fit = aided_fit.identify([one], aircraft, structure, None, (), lambda *_: None).fits[0]
        seconds.append(clock.perf_counter() - begun)
        free = int(np.count_nonzero(np.isfinite(np.diagonal(fit.bound))))
    passes = [passed(one, aircraft, fit, share) for share in (1, 2, 4)]
    return {"seconds": seconds, "free": [free], "passes": passes}


def passed(one: Flight, aircraft: Aircraft, fit: Fit, share: int) -> float:
    """Seconds of a pass of the filter with all sensitivities, over so small a share of a flight."""
    model = FlightModel(aided_flight.with_structure(aircraft, fit.unknowns.means.aerodynamics))
    whole = aided_flight.prepare(one.recording, aircraft, one.reconstruction)
    every = np.ones(whole.rows.step.size, dtype=bool)
    part, counts = next(flight_rows.busy(whole, every, every.size // share))
    path = settling.along(model, part, fit.unknowns)
    taken = []
    for _ in range(4):
        begun = clock.perf_counter()
        causal.passed(model, *fit.unknowns, path, counts)
        taken.append(clock.perf_counter() - begun)
    return min(taken)


def child(times: int, cache: str) -> dict[str, list[float]]:
    """The same in a process of its own."""
    out = subprocess.run(
        [sys.executable, __file__, "--fits", str(times)],
        env={**os.environ, numerics.CACHE: cache},
        check=True,
        capture_output=True,
        text=True,
    )
    return json.loads(out.stdout.splitlines()[-1])


def main() -> None:
    if "--fits" in sys.argv:
        print(json.dumps(fitted(int(sys.argv[sys.argv.index("--fits") + 1]))))
        return
    bench_filter_error.flown(FOLDER, SEED, bench_filter_error.OWN)
    with tempfile.TemporaryDirectory() as cache:
        cold = child(2, cache)
        warm = child(1, cache)
    first, second = cold["seconds"]
    table.show(
        "filter_error_cost",
        f"Filter error on 4 minutes at 50 Hz, {cold['free'][0]} derivatives beside sensors and "
        f"intensities, {len(os.sched_getaffinity(0))} cores",
        ("what", "wanted", "found"),
        [
            ("the fit", "60 s", f"{second:.0f} s"),
            ("more of a first one, nothing compiled before", "20 s", f"{first - second:.0f} s"),
            ("more of a first one, compiled code kept", "", f"{warm['seconds'][0] - second:.0f} s"),
            (
                "a pass with all sensitivities over the flight / half / a quarter of it",
                "linear",
                " / ".join(f"{each:.2f}" for each in cold["passes"]) + " s",
            ),
        ],
    )


if __name__ == "__main__":
    main()
