"""One minute of the bundled flight, listened to once over loopback, and identified from a file."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.live import document
from gcs_sysid.live.filter import Estimate
from gcs_sysid.live.inside_rows import Batch, InsideRows
from gcs_sysid.live.session import Clock, Session
from gcs_sysid.live.station import Compiled, Station
from gcs_sysid.sources import tlog
from gcs_sysid.sources.link import Link, LinkReader, Mailbox
from gcs_sysid.sources.recorder import Recorder

ROOT = Path(__file__).resolve().parents[2]
LENGTH_S = 42.0
"""Until the rudder doublet: every control was moved."""
PATIENCE = 100
"""Turns that a frame may take over loopback, a tenth of a second each."""


@dataclass(frozen=True)
class Listened:
    """What came of listening.

    Attributes:
        log: the part of the flight that was played.
        recording: what was recorded of it.
        station: what was made of it, at its end.
        estimates: every state.
        windows: every window of coefficients.
        batches: every batch of rows of the aided filter.
        documents: the live documents, one a second of flight.
    """

    log: Path
    recording: Path
    station: Station
    estimates: list[Estimate]
    windows: list[Samples]
    batches: list[Batch]
    documents: list[dict]


@pytest.fixture(scope="session")
def aircraft() -> Aircraft:
    return aircraft_file.load(ROOT / "data/aircraft/ultra_stick_25e.toml")


@pytest.fixture(scope="session")
def compiled(aircraft: Aircraft) -> Compiled:
    return Compiled(aircraft)


@pytest.fixture(scope="session")
def played() -> list[tuple[int, bytes]]:
    """Arrival times [µs] and frames of the part of the flight that is used."""
    frames = tlog.frames((ROOT / "data/flights/demo.tlog").read_bytes())
    end = frames[0][0] + LENGTH_S * 1e6
    return [item for item in frames if item[0] < end]


@pytest.fixture(scope="session")
def listened(
    played: list[tuple[int, bytes]],
    aircraft: Aircraft,
    compiled: Compiled,
    tmp_path_factory: pytest.TempPathFactory,
) -> Listened:
    """Frame after frame over UDP; the clock of the station stands at the frame's own arrival."""
    folder = tmp_path_factory.mktemp("listened")
    log = folder / "part.tlog"
    log.write_bytes(b"".join(struct.pack(">Q", t) + frame for t, frame in played))
    now = [played[0][0]]
    clock = Clock(seconds=lambda: now[0] * 1e-6, us=lambda: now[0])
    estimates: list[Estimate] = []
    windows: list[Samples] = []
    batches: list[Batch] = []
    documents: list[dict] = []

    def observe(item: Estimate | Samples) -> None:
        if not isinstance(item, Estimate):
            windows.append(item)
            return
        estimates.append(item)
        batch = maker.take(item, station.filter.lever)
        if batch is not None:
            batches.append(batch)

    station = Station(
        aircraft, compiled, prior=None, vehicle=None, clock_us=clock.us, observer=observe
    )
    maker = InsideRows(aircraft, station.commands)
    mailbox = Mailbox()
    with (
        Link("udpin:127.0.0.1:0") as ground,
        Link(f"udpout:127.0.0.1:{ground.local_port}") as vehicle,
        Recorder(folder / "recording.tlog") as recorder,
        LinkReader(ground, mailbox, clock_us=clock.us),
    ):
        session = Session(
            "udpin:127.0.0.1:0",
            mailbox=mailbox,
            recorder=recorder,
            station=station,
            publish=documents.append,
            clock=clock,
        )
        session.ready.set()
        for count, (link_us, frame) in enumerate(played, start=1):
            now[0] = link_us
            vehicle.write(frame)
            turns = 0
            while recorder.frames < count:
                session.turn()
                turns += 1
                assert turns < PATIENCE, f"frame {count} never arrived"
    documents.append(
        document.document(station, document.Outside("test", "ended", recorded=len(played)))
    )
    return Listened(log, recorder.path, station, estimates, windows, batches, documents)
