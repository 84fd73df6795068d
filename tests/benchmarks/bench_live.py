"""How long the live filter takes, and whether one core keeps up with 50 and 100 Hz.

The bundled flight is fed frame by frame on a clock of its own: a frame arrives at its time, or, if
the computer was still busy, waits; what the work costs is this process's own CPU time. So the
latencies are those of a link in real time on one core, without waiting for it.
"""

from __future__ import annotations

import gc
import os
import sys
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import jax
import table

from gcs_sysid import aircraft_file
from gcs_sysid.live import document, warming
from gcs_sysid.live.station import Compiled, Station
from gcs_sysid.sources import tlog
from gcs_sysid.sources.stream import FrameStream

ROOT = Path(__file__).resolve().parents[2]
AIRCRAFT = ROOT / "data/aircraft/ultra_stick_25e.toml"
FLIGHT = ROOT / "data/flights/demo.tlog"
LENGTH_S = 60.0


class BusyClock:
    """The time of a computer that does one thing after another, in µs."""

    def __init__(self) -> None:
        self._base = 0
        self._cpu = time.process_time_ns()

    def us(self) -> int:
        return self._base + (time.process_time_ns() - self._cpu) // 1000

    def arrive(self, at_us: int) -> None:
        """Goes on to the arrival of a frame, unless it is later already."""
        self._base, self._cpu = max(self.us(), at_us), time.process_time_ns()


def ready() -> tuple[Station, BusyClock]:
    """A station with everything compiled, and its clock."""
    clock = BusyClock()
    aircraft = aircraft_file.load(AIRCRAFT)
    compiled = Compiled(aircraft)
    warming.warm(aircraft, compiled)
    station = Station(aircraft, compiled, prior=None, vehicle=None, clock_us=clock.us)
    return station, clock


def feed(station: Station, clock: BusyClock, speed: float) -> Iterator[float]:
    """Feeds the flight and makes the document once a second; yields the time of each [s]."""
    stream = FrameStream()
    published = 0.0
    played = tlog.frames(FLIGHT.read_bytes())
    first = played[0][0]
    for link_us, frame in played:
        at = (link_us - first) * 1e-6
        if at > LENGTH_S:
            return
        arrival = first + int(1e6 * at / speed)
        clock.arrive(arrival)
        station.receive(stream.feed(frame, arrival))
        station.work(2**62)
        if at / speed - published >= 1.0:
            published = at / speed
            document.document(station, link="", phase="", recorded=0, lost=stream.lost)
            yield published


def timed(speed: float) -> tuple[str, ...]:
    station, clock = ready()
    begin = time.process_time()
    for _ in feed(station, clock, speed):
        pass
    busy = (time.process_time() - begin) / (LENGTH_S / speed)
    update, packet = station.effort.percentiles(), station.latency.percentiles()
    return (
        f"{50 * speed:.0f}",
        f"{update['p50_ms']:.1f} / {update['p99_ms']:.1f}",
        f"{packet['p50_ms']:.0f} / {packet['p99_ms']:.0f}",
        str(station.rows.decimated + station.skipped),
        f"{100 * busy:.0f} %",
    )


def grown() -> float:
    """Memory that the last third of the flight adds [KiB]."""
    station, clock = ready()
    tracemalloc.start()
    sizes = []
    for _ in feed(station, clock, 1.0):
        gc.collect()
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    return (sizes[-1] - sizes[2 * len(sizes) // 3]) / 1024


if __name__ == "__main__":
    if "OPENBLAS_NUM_THREADS" not in os.environ:
        # As the program runs: threads only get in the way of small systems.
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
        os.execv(sys.executable, [sys.executable, *sys.argv])
    jax.config.update("jax_enable_x64", True)
    table.show(
        "live",
        "Live filter and first model on one core: time per inertial sample (wanted: 50 to 100 Hz, "
        f"nothing decimated, memory that does not grow: {grown():.0f} KiB in the last third)",
        (
            "IMU [Hz]",
            "update p50 / p99 [ms]",
            "packet to update p50 / p99 [ms]",
            "decimated",
            "of one core",
        ),
        [timed(speed) for speed in (1.0, 2.0)],
    )
