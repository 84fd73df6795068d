"""What `diagnose` says of the simulation inside ArduPlane 4.6, held against its own equations.

A recorded flight of the real autopilot flying its built-in aircraft, and the aircraft file that an
engineer would write down from its published coefficients. By its source and its log the simulation
departs from such a file in these ways:

- The pitot tube's pressure passes a filter of 0.7 old and 0.3 new at 10 Hz, which is late by
  0.1·0.7/0.3 s on average, as a lag of that is.
- In calm air the airspeed told is 0.9325 of the speed over ground, on average, where equivalent
  airspeed at 734 m would be 1/1.0363 of it.
- Forces and moments are made of equivalent airspeed and the density of the air: all are 1/1.0363²
  of what the file says, as of an aircraft with 7.4 % more mass and inertia about every axis.
- Its pitching moment holds that of all forces about a point 0.15 m behind and 0.05 m above, the
  file's that of the lift only: at every airspeed it is 0.0265 more, as of an elevator 1.5° off.

Some minutes a flight; what was diagnosed before is kept in `--out`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.benchmarks import table  # noqa: E402 - found from ROOT

FOLDER = ROOT.parent / "shared" / "data" / "arduplane_sitl"
EAS2TAS = 1.0363
KNOWN = {
    "pitot_lag": 0.1 * 0.7 / 0.3,
    "airspeed_scale": 0.9325 * EAS2TAS - 1.0,
    **dict.fromkeys(("mass_ratio", "Ixx_ratio", "Iyy_ratio", "Izz_ratio"), EAS2TAS**2),
}
"""By source and log."""


def diagnosed(log: Path, out: Path) -> dict[str, Any]:
    kept = out / "diagnosis.json"
    if not kept.exists():
        words = ["diagnose", log, "--aircraft", FOLDER / "aircraft.toml", "--out", out]
        subprocess.run([sys.executable, "-m", "gcs_sysid", *map(str, words)], check=True)
    return json.loads(kept.read_text(encoding="utf-8"))


def rows(flight: str, found: dict[str, Any]) -> list[tuple[str, ...]]:
    """A row for each parameter of the causes that are named, then those that perhaps are."""
    best = found["ranking"][0]
    listed = [
        (
            flight,
            name,
            f"{item['value']:.4g} ± {item['sd']:.2g}",
            f"{KNOWN[name]:.4g}" if name in KNOWN else "none",
        )
        for name, item in best["parameters"].items()
        if found["verdict"] == "effect"
    ]
    listed = listed or [(flight, found["verdict"], "", "")]
    return listed + [
        (flight, f"perhaps {name}", f"{100.0 * share:.0f} %", "")
        for name, share in found.get("perhaps", {}).items()
    ]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--flights", nargs="*", default=["A", "B"])
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "arduplane")
    parser.add_argument("--save", action="store_true")
    asked = parser.parse_args()
    found = {name: diagnosed(FOLDER / f"{name}.tlog", asked.out / name) for name in asked.flights}
    table.show(
        "arduplane",
        "What the simulation inside ArduPlane has wrong against its aircraft file",
        ("flight", "named", "found, one sd", "by its source and log"),
        [row for name, one in found.items() for row in rows(name, one)],
    )


if __name__ == "__main__":
    main()
