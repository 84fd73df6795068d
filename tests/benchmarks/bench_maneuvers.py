"""How many of the inputs flown the finder finds, and how many of those it claims were flown."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid import aircraft_file  # noqa: E402 - the tests' helpers are found from ROOT
from gcs_sysid.reconstruct.segments import find  # noqa: E402
from gcs_sysid.sources.registry import open_recording  # noqa: E402
from tests.benchmarks import table  # noqa: E402
from tests.reconstruct.flown_events import events, recall_and_precision  # noqa: E402

FOLDER = ROOT.parent / "shared" / "data" / "arduplane_sitl"


def main() -> None:
    """Measures both flights whose inputs were written down."""
    rows = []
    for flight, air in (("A", "calm air"), ("B", "turbulence")):
        if not FOLDER.is_dir():
            continue
        flown = events(FOLDER / f"{flight}_events.json")
        found = find(
            open_recording(FOLDER / f"{flight}.tlog"),
            aircraft_file.load(FOLDER / "aircraft.toml"),
        )
        recall, precision = recall_and_precision(flown, found)
        rows.append(
            (f"ArduPlane in {air}", len(flown), f"{100 * recall:.0f} %", f"{100 * precision:.0f} %")
        )
    table.show(
        "maneuvers",
        "Doublets, 3-2-1-1s, multisines and throttle inputs found in flights where each was noted",
        ("flight", "flown", "found", "of those claimed, flown"),
        rows,
    )


if __name__ == "__main__":
    main()
