"""What a suggestion costs: `suggest` as it is started, first without and then with compiled code.

On each of three aircraft of data/aircraft a weak first flight is flown and identified, and what to
fly next is asked by a process that finds no compiled code. Of the first aircraft it is asked once
more, with the code of that process: what compiling takes is the same for all.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time as clock
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid import aircraft_file  # noqa: E402 - found from ROOT
from gcs_sysid.cli import numerics  # noqa: E402
from gcs_sysid.sitl import record  # noqa: E402
from tests.benchmarks import closed_loop, table  # noqa: E402

AIRCRAFT = ("ultra_stick_25e", "brumby_mk3", "aerosonde")
WANTED = "60 s"


def identified(name: str, folder: Path) -> Path:
    """The model of a weak flight of an aircraft that is as its file says."""
    believed = aircraft_file.load(closed_loop.DATA / f"{name}.toml")
    log = folder / "flight.tlog"
    record.run(closed_loop.flight(believed, believed, closed_loop.weak(believed), 0), record=log)
    out = folder / "identify"
    started("identify", log, "--aircraft", closed_loop.DATA / f"{name}.toml", "--out", out)
    return out


def started(*words: object) -> float:
    """Seconds of a command, process start to end."""
    program = Path(sys.executable).with_name("gcs-sysid")
    begun = clock.perf_counter()
    subprocess.run([str(word) for word in (program, *words)], check=True, capture_output=True)
    return clock.perf_counter() - begun


def asked(model: Path, out: Path) -> tuple[float, int]:
    """Seconds of `suggest`, and how many runs its sortie has."""
    seconds = started("suggest", "--model", model, "--confidence", "0.001", "--out", out)
    document = json.loads((out / "suggest.json").read_text(encoding="utf-8"))
    return seconds, len(document["sortie"]["steps"])


def main() -> None:
    """One aircraft after the other."""
    rows: list[tuple[object, ...]] = []
    for name in AIRCRAFT:
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            model = identified(name, folder)
            os.environ[numerics.CACHE] = f"{folder}/compiled"
            cold, steps = asked(model, folder / "first")
            warm = "" if rows else f"{asked(model, folder / 'second')[0]:.0f} s"
            del os.environ[numerics.CACHE]
        rows.append((name, steps, WANTED, f"{cold:.0f} s", warm))
    table.show(
        "suggest_cost",
        f"`suggest` after a weak first flight, {len(os.sched_getaffinity(0))} cores",
        (
            "aircraft",
            "runs in the sortie",
            "wanted",
            "nothing compiled before",
            "compiled code kept",
        ),
        rows,
    )


if __name__ == "__main__":
    main()
