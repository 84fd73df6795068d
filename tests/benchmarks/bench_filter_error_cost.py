"""What filter error costs: one flight of four minutes at 50 Hz, all its parameters free.

Fitted twice in a process that keeps no compiled code from before, then once more in another that
finds the first one's. What the first fit takes longer than the second is compiling, and with kept
code reading it. How cost grows is shown by whole fits of the flight, its first half and its first
quarter, each begun anew with compiled code, and by one pass over so much of it.
"""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
import tempfile
import time as clock
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jax.flatten_util import ravel_pytree

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid import aircraft_file, regressors  # noqa: E402 - found from ROOT
from gcs_sysid.aircraft import Aircraft  # noqa: E402
from gcs_sysid.cli import numerics  # noqa: E402
from gcs_sysid.estimate import flight_rows, settling  # noqa: E402
from gcs_sysid.estimate.filter_error import Fit  # noqa: E402
from gcs_sysid.model.flight_model import FlightModel  # noqa: E402
from gcs_sysid.offline import aided_fit, aided_flight  # noqa: E402
from gcs_sysid.offline.flight import Flight  # noqa: E402
from gcs_sysid.reconstruct import causal  # noqa: E402
from gcs_sysid.sources import tlog  # noqa: E402
from tests.benchmarks import bench_filter_error, table  # noqa: E402

SEED = 7000
SHARES = (2, 4)
"""Half of the flight and a quarter."""
FOLDER = ROOT / "out" / "filter_error" / str(SEED)


def fitted(times: int, shares: Sequence[int] = ()) -> dict[str, list[float]]:
    """Seconds of so many fits, one after the other, and how many parameters were free.

    Args:
        times: that the whole flight is fitted.
        shares: halves, quarters, … fitted as well, each twice, of which the second counts.
    """
    numerics.enable()
    numerics.keep_freed_memory()
    aircraft = aircraft_file.load(bench_filter_error.OWN)
    one = bench_filter_error.read(FOLDER / "flight.tlog", aircraft)
    seconds = []
    for _ in range(times):
        fit, taken = timed(one, aircraft)
        seconds.append(taken)
    parts = []
    with tempfile.TemporaryDirectory() as folder:
        for share in shares:
            log = shortened(FOLDER / "flight.tlog", Path(folder), share)
            part = bench_filter_error.read(log, aircraft)
            timed(part, aircraft)
            parts.append(timed(part, aircraft)[1])
    passes = [passed(one, aircraft, fit, share) for share in (1, *shares)]
    return {"seconds": seconds, "parts": parts, "free": free(fit), "passes": passes}


def timed(one: Flight, aircraft: Aircraft) -> tuple[Fit, float]:
    """A fit, and its seconds."""
    structure = regressors.default_structure(aircraft)
    begun = clock.perf_counter()
    fit = aided_fit.identify([one], aircraft, structure, None, (), lambda *_: None).fits[0]
    return fit, clock.perf_counter() - begun


def shortened(log: Path, folder: Path, share: int) -> Path:
    """The beginning of a recording, so small a share of it."""
    frames = tlog.frames(log.read_bytes())
    first, last = frames[0][0], frames[-1][0]
    path = folder / f"{share}.tlog"
    path.write_bytes(
        b"".join(
            struct.pack(">Q", stamp) + frame
            for stamp, frame in frames
            if (stamp - first) * share <= last - first
        )
    )
    return path


def free(fit: Fit) -> list[float]:
    """How many derivatives, parameters of the sensors and intensities are sought."""
    means, noises = (np.asarray(ravel_pytree(part)[0]) for part in fit.deviation)
    derivatives = fit.bound.shape[0]
    return [
        float(np.count_nonzero(part)) for part in (means[:derivatives], means[derivatives:], noises)
    ]


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


def child(times: int, cache: str, shares: Sequence[int] = ()) -> dict[str, list[float]]:
    """The same in a process of its own."""
    out = subprocess.run(
        [sys.executable, __file__, "--fits", str(times), *map(str, shares)],
        env={**os.environ, numerics.CACHE: cache},
        check=True,
        capture_output=True,
        text=True,
    )
    return json.loads(out.stdout.splitlines()[-1])


def main() -> None:
    if "--fits" in sys.argv:
        times, *shares = map(int, sys.argv[sys.argv.index("--fits") + 1 :])
        print(json.dumps(fitted(times, shares)))
        return
    bench_filter_error.flown(FOLDER, SEED, bench_filter_error.OWN)
    with tempfile.TemporaryDirectory() as cache:
        cold = child(2, cache, SHARES)
        warm = child(1, cache)
    first, second = cold["seconds"]
    derivatives, sensors, intensities = cold["free"]
    table.show(
        "filter_error_cost",
        f"Filter error on 4 minutes at 50 Hz; free: {derivatives:.0f} derivatives, {sensors:.0f} "
        f"of the sensors, {intensities:.0f} intensities; {len(os.sched_getaffinity(0))} cores",
        ("what", "wanted", "found"),
        [
            ("the fit", "60 s", f"{second:.0f} s"),
            ("more of a first one, nothing compiled before", "20 s", f"{first - second:.0f} s"),
            ("more of a first one, compiled code kept", "", f"{warm['seconds'][0] - second:.0f} s"),
            (
                "the fit over the flight / half / a quarter",
                "linear",
                " / ".join(f"{each:.0f}" for each in (second, *cold["parts"])) + " s",
            ),
            (
                "a pass with all sensitivities over the flight / half / a quarter of it",
                "linear",
                " / ".join(f"{each:.2f}" for each in cold["passes"]) + " s",
            ),
        ],
    )


if __name__ == "__main__":
    main()
