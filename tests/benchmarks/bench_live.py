"""Listening to a busy link in real time: latency, processor time, memory, what is recorded.

`gcs-sysid listen` runs as its users run it, in a process of its own, and is fed over UDP by this
one: 100 Hz of inertial unit, attitude and servos, 10 Hz of the rest (`live_feed`). Then the same
at ten times the rate for twenty seconds. `--seconds N` is the length of the first: in five minutes
the processes learn, and learn anew, and the filter with the aerodynamics inside, in a process of
its own, knows its derivatives. Percentiles are those of the newest 4096 updates (40 s) at its end;
those since the start hold what was late while everything began, too.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

import table
from live_feed import AIRCRAFT, Feed

from gcs_sysid.sources import tlog

SECONDS = 300.0
TIMES = 10
_TICKS = os.sysconf("SC_CLK_TCK")
PATIENCE_S = 120.0


class Listener:
    """A process that listens, looked at from outside."""

    def __init__(self, folder: Path, port: int) -> None:
        self.folder = folder
        self.begun = time.monotonic()
        words = ["listen", f"udpin:127.0.0.1:{port}", "--aircraft", str(AIRCRAFT)]
        words += ["--out", str(folder), "--no-dashboard", "--listen-only", "--quiet-after", "1000"]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "gcs_sysid", *words],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    def beside(self) -> int:
        """The process of the filter with the aerodynamics inside."""
        for path in Path("/proc").glob("[0-9]*/cmdline"):
            with contextlib.suppress(OSError):
                parent = path.with_name("stat").read_text().rpartition(")")[2].split()[1]
                if int(parent) == self.process.pid and b"spawn_main" in path.read_bytes():
                    return int(path.parent.name)
        raise AssertionError("no process beside")

    def stop(self) -> None:
        self.process.kill()  # what it would identify now is not measured here
        self.process.wait()

    def live(self) -> dict:
        try:
            return json.loads((self.folder / "live.json").read_text())
        except (OSError, ValueError):
            return {}


def cpu(process: int) -> float:
    """Processor time that a process has used so far [s]."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def memory(process: int, which: str) -> float:
    """Resident memory [MB]: `VmRSS` now, `VmHWM` the largest so far."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith(f"{which}:"):
            return int(line.split()[1]) / 1024
    raise AssertionError(f"no {which}")


@contextlib.contextmanager
def listening() -> Generator[tuple[Listener, Callable[[bytes], object]], None, None]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        folder = Path(tempfile.mkdtemp(prefix="bench-live-"))
        listener = Listener(folder, port)
        try:
            yield listener, lambda frame: sender.sendto(frame, ("127.0.0.1", port))
        finally:
            listener.stop()
            shutil.rmtree(folder)


def fed(
    frames: Iterator[tuple[float, bytes]], send: Callable[[bytes], object]
) -> Iterator[tuple[float, bytes]]:
    """Sends frames at their times; yields each once it is sent."""
    begun = time.monotonic()
    for at, frame in frames:
        left = begun + at - time.monotonic()
        if left > 0.0:
            time.sleep(left)
        send(frame)
        yield at, frame


def in_real_time(feed: Feed, seconds: float) -> list[tuple[str, str, str]]:
    """Latency, first estimate, processor time, memory."""
    first: float | None = None
    looked, settled, known = 0.0, None, None
    with listening() as (listener, send):
        process = listener.process.pid
        for at, _ in fed(feed.frames(), send):
            if at - looked < 0.25:
                continue
            looked = at
            if first is None and listener.live().get("state"):
                first = time.monotonic() - listener.begun
                settled = (time.monotonic(), cpu(process))
            if known is None and listener.live().get("derivatives_by") == "inside the filter":
                beside, now = listener.beside(), time.monotonic()
                known = (now - listener.begun, now, beside, cpu(beside))
            if first is not None and time.monotonic() - listener.begun - first >= seconds:
                break
            assert first is not None or at < PATIENCE_S, "no estimate"
        assert first is not None
        assert settled is not None
        assert known is not None, "the filter with the aerodynamics inside never knew"
        after, since, beside, before = known
        used = (cpu(process) - settled[1]) / (time.monotonic() - settled[0])
        filtering = (cpu(beside) - before) / (time.monotonic() - since)
        last, largest = listener.live(), memory(process, "VmHWM")
        sizes = [f"{memory(beside, which):.0f}" for which in ("VmHWM", "VmRSS")]
    packet, counts, inside = last["latency"]["packet_to_update"], last["counts"], last["inside"]
    return [
        ("packet to update, p50", "5 ms", f"{packet['p50_ms']:.1f} ms"),
        ("packet to update, p99", "25 ms", f"{packet['p99_ms']:.1f} ms"),
        (
            "the same since the start: p50, p99",
            "said",
            f"{packet['all_p50_ms']:.1f}, {packet['all_p99_ms']:.1f} ms",
        ),
        ("start to first estimate, code compiled before", "10 s", f"{first:.1f} s"),
        ("of one core", "40 %", f"{100 * used:.0f} %"),
        ("resident memory, largest", "600 MB", f"{largest:.0f} MB"),
        # Feeder and listener are one and a half of it; more is others' work, which slows both.
        ("load of the machine meanwhile", "1.5", f"{os.getloadavg()[0]:.1f} on {os.cpu_count()}"),
        ("inertial samples left out, at the start too", "said", str(counts["decimated"])),
        ("aerodynamics inside the filter", "known", inside["phase"]),
        ("start to their first derivatives", "said", f"{after:.0f} s"),
        ("how old their newest row", "3 s", f"{inside['age_s'] or math.nan:.1f} s"),
        ("their process, of one core after that", "said", f"{100 * filtering:.0f} %"),
        ("its resident memory: largest, at the end", "said", f"{', '.join(sizes)} MB"),
    ]


def at_ten_times(feed: Feed, seconds: float) -> list[tuple[str, str, str]]:
    """Whether the recording holds every frame."""
    sent: list[bytes] = []
    with listening() as (listener, send):
        for count, _ in enumerate(itertools.repeat(None)):
            # Until it listens, nothing counts.
            if listener.live():
                break
            assert count < 10 * PATIENCE_S
            time.sleep(0.1)
        for at, frame in fed(feed.frames(), send):
            sent.append(frame)
            if at >= seconds:
                break
        time.sleep(2.0)
        last = listener.live()
        kept = [f for _, f in tlog.frames((listener.folder / "recording.tlog").read_bytes())]
    lost = len(sent) - len(kept)
    packet = last["latency"]["packet_to_update"]
    return [
        (f"frames missing of {len(sent)} at {TIMES} times the rate", "0", str(lost)),
        ("the rest as it was sent", "yes", "yes" if kept == sent else "no"),
        ("inertial samples left out there", "said", str(last["counts"]["decimated"])),
        ("packet to update there, p50", "said", f"{packet['p50_ms'] or float('inf'):.0f} ms"),
    ]


if __name__ == "__main__":
    words = sys.argv
    seconds = float(words[words.index("--seconds") + 1]) if "--seconds" in words else SECONDS
    made = Feed()
    with listening() as (warm, _):  # compiles, and keeps what it compiled
        until = time.monotonic() + PATIENCE_S
        while not warm.live() and time.monotonic() < until:
            time.sleep(0.2)
        while "compiled" in warm.live().get("phase", "") and time.monotonic() < until:
            time.sleep(0.2)
        time.sleep(20.0)
        warm.process.send_signal(signal.SIGTERM)
    table.show(
        "live",
        f"Listening to 340 messages a second, {seconds:.0f} s in real time",
        ("what", "wanted", "found"),
        [*in_real_time(made, seconds), *at_ten_times(Feed(TIMES), min(seconds, 20.0))],
    )
