"""How much faster than real time flights are made."""

from __future__ import annotations

import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid.sitl import record, scenario  # noqa: E402 - needs the path above
from tests.benchmarks import table  # noqa: E402 - needs the path above


def main() -> None:
    rows = []
    for planned in scenario.load(ROOT / "replay" / "demo" / "scenario.toml").flights:
        begun, used = time.perf_counter(), time.process_time()
        flown = record.fly(planned.flight)
        duration = planned.flight.duration
        factors = (
            duration / (time.perf_counter() - begun),
            duration / (time.process_time() - used),
        )
        messages = f"{len(flown.frames)} messages"
        rows.append((planned.name, f"{duration:.0f} s", messages, *(f"{x:.0f}" for x in factors)))
    # A machine that is busy otherwise shows in the first factor, not in the second.
    columns = (
        *("flight", "length", "received"),
        *("times real time (wanted: 20)", "of processor time"),
    )
    table.show("sitl", "Flying in JSBSim, straight to a file", columns, rows)


if __name__ == "__main__":
    main()
