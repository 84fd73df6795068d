"""Whether a flight that was listened to gives the model of its file.

A recorded flight is replayed to `gcs-sysid listen` over UDP at its own timing; what it identifies
at the end is held against `gcs-sysid identify` on the file itself, derivative by derivative.

    python tests/benchmarks/same_model.py FLIGHT.tlog AIRCRAFT.toml --out out/same-model
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import table

from gcs_sysid.sources import tlog

WITHIN = 0.5
"""Largest difference of a derivative, in standard deviations that the file gives it: what arrivals
over another link do to the times of messages without a stamp."""
PATIENCE_S = 120.0


def program(*words: str) -> list[str]:
    return [sys.executable, "-m", "gcs_sysid", *words]


def heard(flight: Path, aircraft: Path, out: Path) -> None:
    """Listens to the flight at its own timing, and identifies it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        link = f"udp:127.0.0.1:{free.getsockname()[1]}"
    words = ["--aircraft", str(aircraft), "--no-dashboard", "--listen-only", "--out", str(out)]
    listener = subprocess.Popen(program("listen", link, *words), stdout=subprocess.DEVNULL)
    until = time.monotonic() + PATIENCE_S
    while not (out / "live.json").exists():
        assert time.monotonic() < until, "it never listened"
        time.sleep(0.1)
    subprocess.run(
        program("replay", str(flight), "--to", link), check=True, stdout=subprocess.DEVNULL
    )
    assert listener.wait() == 0


def differences(live: dict, file: dict) -> list[tuple[float, str, str]]:
    """By derivative, the largest first: standard deviations apart, name, both values."""
    rows = []
    for name, terms in file["derivatives"].items():
        for key, term in terms.items():
            other = live["derivatives"][name][key]
            apart = abs(other["value"] - term["value"]) / term["sd"]
            words = f"{term['value']:.4f} / {other['value']:.4f}"
            rows.append((apart, f"{name}_{key}", words))
    return sorted(rows, reverse=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("flight", type=Path)
    parser.add_argument("aircraft", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--again", action="store_true", help="compare what --out holds, only")
    parser.add_argument("--save", action="store_true", help="keep the table for the README")
    given = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    live, file = given.out / "live", given.out / "file"
    if not given.again:
        shutil.rmtree(given.out, ignore_errors=True)
        live.mkdir(parents=True)
        heard(given.flight, given.aircraft, live)
        words = ["--aircraft", str(given.aircraft), "--out", str(file)]
        subprocess.run(
            program("identify", str(given.flight), *words), check=True, stdout=subprocess.DEVNULL
        )
    kept, whole = (
        [frame for _, frame in tlog.frames(path.read_bytes())]
        for path in (live / "recording.tlog", given.flight)
    )
    found = differences(
        *(json.loads((folder / "summary.json").read_text()) for folder in (live, file))
    )
    table.show(
        "live-same-model",
        f"{given.flight.name} replayed to the link at its own timing, against the file identified: "
        f"{len(kept)} of {len(whole)} frames recorded, {'the same' if kept == whole else 'others'}",
        ("derivative", "file / live", f"apart, in sd of the file (wanted: {WITHIN})"),
        [(name, both, f"{apart:.2f}") for apart, name, both in found[:5]],
    )
    sys.exit(0 if found[0][0] <= WITHIN and kept == whole else 1)
