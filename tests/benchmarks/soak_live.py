"""Listening for hours: whether memory and the cost of an update grow.

The feed of `live_feed` is recorded, decoded, filtered and fitted in this process as fast as it
goes, hour by hour of flight; every minute of flight the memory, the cost of an update and what was
lost are kept in OUT/soak.jsonl. The filter with the aerodynamics inside runs in a process of its
own, is waited for when it falls behind, and its memory is kept too. A run that was stopped goes on
where it was (the recording and the model too). At the end: slopes over flight time with their
intervals of 95 %, of one straight line a level of memory: each run begins with its own, and has
another once it has learned a kernel anew.

    python tests/benchmarks/soak_live.py --hours 10 --out out/soak
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import TextIO

if "OPENBLAS_NUM_THREADS" not in os.environ:
    # As the program runs: threads only get in the way of small systems.
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "NPROC": "1"}
    os.execv(sys.executable, [sys.executable, *sys.argv])

import numpy as np
import table
from live_feed import AIRCRAFT, HOLE_S, Feed

from gcs_sysid import aircraft_file
from gcs_sysid.cli import numerics
from gcs_sysid.live import document, snapshot, warming
from gcs_sysid.live.inside_beside import Beside
from gcs_sysid.live.station import Compiled, Station
from gcs_sysid.offline import documents
from gcs_sysid.sources.recorder import Recorder
from gcs_sysid.sources.stream import FrameStream

MINUTE_S = 60.0
SETTLED = 5
"""Minutes of a run that are left out: caches fill."""
PART_BYTES = 64 << 20
KEPT_PARTS = 2
"""Older parts of the recording are deleted: ten hours are gigabytes."""


BEHIND = 16
"""Batches of rows that may wait for the filter beside: ten seconds of flight."""


def memory(process: int) -> float:
    """Resident memory now [MB]."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


class Soak:
    """One run of it, in a folder."""

    def __init__(self, out: Path) -> None:
        out.mkdir(parents=True, exist_ok=True)
        self._out, self._log = out, out / "soak.jsonl"
        self.done = [json.loads(line) for line in self._lines()]
        self._run = 1 + max((one["run"] for one in self.done), default=0)
        self._now = [0]
        aircraft = aircraft_file.load(AIRCRAFT)
        compiled = Compiled(aircraft)
        warming.warm(aircraft, compiled)
        self._beside = Beside(numerics.enable, aircraft, None)
        self._station = Station(
            aircraft,
            compiled,
            prior=None,
            vehicle=None,
            clock_us=lambda: self._now[0],
            inside=self._beside,
        )
        if self.done and (out / snapshot.NAME).exists():
            snapshot.restore(
                out / snapshot.NAME,
                self._station.model,
                self._station.processes,
                self._station.inside,
            )

    def _lines(self) -> list[str]:
        """Whole lines; one that a kill cut is left out."""
        if not self._log.exists():
            return []
        return [line for line in self._log.read_text().split("\n")[:-1] if line]

    def fly(self, hours: float) -> None:
        """From where the last run ended until so many hours of flight are done."""
        feed = Feed()
        lap = len(self.done) * MINUTE_S // (feed.lap_s + HOLE_S)
        begun, first = None, len(self.done)
        stream, effort, sent, cpu = FrameStream(), [], 0, time.process_time()
        with (
            Recorder(self._out / "recording.tlog", append=True, part_bytes=PART_BYTES) as recorder,
            self._log.open("a") as log,
        ):
            published = 0.0
            for at, frame in feed.frames(lap=int(lap)):
                begun = at if begun is None else begun
                self._now[0] = 1_790_000_000_000_000 + round(at * 1e6)
                before = time.perf_counter()
                batch = stream.feed(frame, self._now[0])
                recorder.write(batch)
                self._station.receive(batch)
                self._station.work(2**62)
                effort.append(time.perf_counter() - before)
                while self._beside.waiting > BEHIND:
                    time.sleep(0.05)
                sent += 1
                if at - published >= 1.0:
                    published = at
                    self._publish(recorder.frames)
                minutes = first + (at - begun) / MINUTE_S
                if minutes >= len(self.done) + 1:
                    used = time.process_time() - cpu
                    self._note(log, effort, used, sent - recorder.frames)
                    effort, cpu = [], time.process_time()
                    for old in recorder.parts[:-KEPT_PARTS]:
                        old.unlink()
                    if len(self.done) >= 60.0 * hours:
                        return

    def close(self) -> None:
        """Ends the process beside."""
        self._beside.close()

    def _publish(self, frames: int) -> None:
        around = document.Outside(link="", phase="", recorded=frames, now_us=self._now[0])
        told = document.document(self._station, around)
        documents.write_json(self._out / "live.json", told)

    def _note(self, log: TextIO, effort: list[float], used: float, lost: int) -> None:
        half, most = np.percentile(effort, [50.0, 99.0])
        note = {
            "run": self._run,
            "minute": len(self.done) + 1,
            "memory_mb": round(memory(os.getpid()), 2),
            "beside_mb": round(memory(self._beside.process or 0), 2),
            "inside": self._station.inside.known.phase,
            "lost_inside": self._station.inside.known.lost,
            "p50_ms": round(1e3 * float(half), 4),
            "p99_ms": round(1e3 * float(most), 4),
            "of_one_core": round(used / MINUTE_S, 4),
            "lost": lost,
            "updates": self._station.updates,
        }
        self.done.append(note)
        newest = self._station.newest
        if newest is not None:
            kept = snapshot.taken(
                self._station.model, self._station.processes, self._station.inside,
                time_us=newest.row.link_us, updates=self._station.updates,
            )  # fmt: skip
            snapshot.write(self._out / snapshot.NAME, kept)
        log.write(json.dumps(note) + "\n")
        log.flush()
        print(json.dumps(note), flush=True)


def _level(note: dict, done: list[dict]) -> tuple[int, bool]:
    """The run, and whether it has learned a kernel: it then holds what that takes, 70 MB, once.

    That is done whenever there are twice as many samples. A run that goes on from a snapshot holds
    less until then, one that begins for a minute or two.
    """
    begun = min(one["minute"] for one in done if one["run"] == note["run"])
    return note["run"], note["minute"] >= 2 * (begun - 1)


def slope(done: list[dict], name: str) -> tuple[float, float]:
    """Change an hour and its interval of 95 %, with an intercept of its own for every level.

    Minutes are not independent (a lap has four): the interval is widened by what the residuals'
    correlation from one minute to the next says (Bayley & Hammersley 1946).
    """
    levels = [_level(one, done) for one in done]
    begun = {level: done[levels.index(level)]["minute"] for level in levels}
    settled = [
        (one, level)
        for one, level in zip(done, levels, strict=True)
        if one["minute"] - begun[level] >= SETTLED
    ]
    kept, runs = [one for one, _ in settled], sorted({level for _, level in settled})
    if len(kept) < len(runs) + 3:
        return float("nan"), float("nan")
    hours = np.array([one["minute"] / 60.0 for one in kept])
    columns = np.stack(
        [hours, *([float(level == one) for _, level in settled] for one in runs)], axis=1
    )
    values = np.array([one[name] for one in kept])
    found, *_ = np.linalg.lstsq(columns, values, rcond=None)
    left = values - columns @ found
    variance = left @ left / (len(kept) - columns.shape[1])
    along = float(np.corrcoef(left[1:], left[:-1])[0, 1]) if np.ptp(left) > 0.0 else 0.0
    wider = (1.0 + max(along, 0.0)) / (1.0 - min(max(along, 0.0), 0.95))
    deviation = np.sqrt(wider * variance * np.linalg.inv(columns.T @ columns)[0, 0])
    return float(found[0]), 1.96 * float(deviation)


def told(done: list[dict]) -> list[tuple[str, str, str]]:
    """Rows of the table."""
    rows = []
    for name, words, unit in (
        ("memory_mb", "resident memory", "MB"),
        ("beside_mb", "that of the filter with the aerodynamics inside", "MB"),
        ("p50_ms", "a message's cost, p50", "ms"),
        ("p99_ms", "a message's cost, p99", "ms"),
    ):
        change, band = slope(done, name)
        rows.append(
            (words, f"{done[-1][name]:.3g} {unit}", f"{change:+.3g} ± {band:.2g} {unit} an hour")
        )
    share = float(np.mean([one["of_one_core"] for one in done]))
    lost = sum({one["run"]: one["lost_inside"] for one in done}.values())
    rows.append(("times the aerodynamics inside lost the aircraft", str(lost), ""))
    rows.append(("of one core", f"{100 * share:.0f} %", ""))
    rows.append(("messages not recorded", str(sum(one["lost"] for one in done)), ""))
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--hours", type=float, default=10.0)
    parser.add_argument("--out", type=Path, default=Path("out/soak"))
    parser.add_argument("--save", action="store_true", help="keep the table for the README")
    given = parser.parse_args()
    numerics.enable()
    soak = Soak(given.out)
    if len(soak.done) < 60.0 * given.hours:
        soak.fly(given.hours)
    soak.close()
    minutes, runs = len(soak.done), soak.done[-1]["run"]
    table.show(
        "live-soak",
        f"{minutes / 60.0:.2g} hours of flight in {runs} run(s) at 340 messages a second, as fast "
        "as they go; slopes within levels (a run that goes on holds 70 MB more once it has learned "
        f"anew), the first {SETTLED} minutes of each left out",
        ("what", "at the end", "slope, 95 %"),
        told(soak.done),
    )
