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
        begun = time.perf_counter()
        flown = record.fly(planned.flight)
        factor = planned.flight.duration / (time.perf_counter() - begun)
        messages = f"{len(flown.frames)} messages"
        rows.append((planned.name, f"{planned.flight.duration:.0f} s", messages, f"{factor:.0f}"))
    columns = ("flight", "length", "received", "times real time (wanted: 20)")
    table.show("sitl", "Flying in JSBSim, straight to a file", columns, rows)


if __name__ == "__main__":
    main()
