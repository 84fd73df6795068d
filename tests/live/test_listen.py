"""Listening from the first frame to the last line, whatever goes wrong around it."""

from __future__ import annotations

import inspect
import json
import queue
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.cli import entry, live_view
from gcs_sysid.errors import RefusedError, SourceError
from gcs_sysid.live import document, handing, listen, showing, snapshot, warming
from gcs_sysid.live.failures import Failures
from gcs_sysid.live.listen import Ending, Options
from gcs_sysid.live.session import Clock
from gcs_sysid.live.station import Compiled, Station
from gcs_sysid.offline import documents, identify
from gcs_sysid.reconstruct import inertial_filter
from gcs_sysid.sources import tlog
from gcs_sysid.sources.link import Link
from gcs_sysid.sources.recorder import Recorder
from gcs_sysid.sources.stream import FrameStream

MICRO = 1e-6
PATIENCE_S = 60.0
AIRCRAFT = Path(__file__).resolve().parents[2] / "data/aircraft/ultra_stick_25e.toml"


class Ticking:
    """Time that goes on by a good tenth of a second at every look."""

    def __init__(self, start_us: int) -> None:
        self.us = start_us

    @property
    def clock(self) -> Clock:
        return Clock(seconds=self.seconds, us=lambda: self.us)

    def seconds(self) -> float:
        self.us += 150_000
        return self.us * MICRO


@pytest.fixture(autouse=True)
def cold(monkeypatch: pytest.MonkeyPatch) -> None:
    """These flights never leave the ground: there is nothing to compile."""
    monkeypatch.setattr(warming, "warm", lambda *_: None)


@pytest.fixture
def port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind(("127.0.0.1", 0))
        return int(opened.getsockname()[1])


@pytest.fixture
def hear(
    aircraft: Aircraft, played: list[tuple[int, bytes]], port: int, tmp_path: Path
) -> Callable[..., Ending]:
    """Listens while some frames are sent; if asked to, stops when all came and so many looks."""

    def run(
        *,
        frames: int = 50,
        looks: int | None = None,
        show: Callable[..., None] = lambda _document: None,
        resume: bool = False,
    ) -> Ending:
        time = Ticking(played[0][0])
        looked = [0]

        def stopped() -> bool:
            looked[0] += 1
            if looked[0] == 1 and frames:
                with Link(f"udpout:127.0.0.1:{port}") as vehicle:
                    for _, frame in played[:frames]:
                        vehicle.write(frame)
            if looks is None:
                return False
            kept = recorded(tmp_path / "recording.tlog") if frames else []
            return looked[0] >= looks and len(kept) == frames

        return listen.run(
            f"udpin:127.0.0.1:{port}",
            aircraft,
            Options(prior="none", quiet_after=5.0 if looks is None else 1e6, resume=resume),
            out=tmp_path,
            show=show,
            stopped=stopped,
            clock=time.clock,
        )

    return run


def recorded(path: Path) -> list[bytes]:
    return [frame for _, frame in tlog.frames(path.read_bytes())]


def test_a_link_that_falls_quiet_ends_the_flight(hear, played, tmp_path) -> None:
    shown: list[dict] = []
    ending = hear(show=shown.append)
    assert ending.why == "quiet"
    assert recorded(ending.recording) == [frame for _, frame in played[:50]]
    live = json.loads((tmp_path / "live.json").read_text())
    assert live["phase"] == "ended: quiet"
    assert live["program"].startswith("gcs-sysid ")
    assert live["counts"]["recorded"] == 50
    assert live["vehicle"] == 1
    assert shown[-1]["phase"] == "ended: quiet"


def test_the_user_ends_it(hear, played) -> None:
    ending = hear(looks=2)
    assert ending.why == "stopped"
    assert recorded(ending.recording) == [frame for _, frame in played[:50]]


def test_nothing_heard_leaves_nothing_behind(hear, tmp_path) -> None:
    with pytest.raises(SourceError, match=r"nothing was received in .* s; check") as error:
        hear(frames=0, looks=8)
    assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_a_display_that_fails_does_not_stop_the_recording(hear, played, caplog) -> None:
    calls = [0]

    def broken(_document: object) -> None:
        calls[0] += 1
        raise BrokenPipeError("nobody looks")

    ending = hear(show=broken)
    assert len(recorded(ending.recording)) == 50
    assert calls[0] == 1
    assert "display failed" in caplog.text


def test_a_terminal_that_is_held_up_holds_up_nothing(hear, tmp_path, monkeypatch) -> None:
    """With Ctrl-S in the terminal filter and recording stood still."""
    monkeypatch.setattr(handing, "LAST_S", 0.05)
    held = threading.Event()
    calls: list[object] = []

    def show(document: object) -> None:
        calls.append(document)
        held.wait(60.0)

    ending = hear(show=show)
    assert len(calls) == 1
    held.set()
    assert ending.why == "quiet"
    assert len(recorded(ending.recording)) == 50
    assert json.loads((tmp_path / "live.json").read_text())["phase"] == "ended: quiet"


def test_of_documents_that_wait_the_newest_is_shown() -> None:
    first, seen, done = threading.Event(), [], threading.Event()

    def show(document: dict) -> None:
        seen.append(document["number"])
        first.set()
        assert done.wait(60.0)

    with showing.shown(show) as put:
        put({"number": 0})
        assert first.wait(60.0)
        for number in (1, 2, 3):
            put({"number": number})
        done.set()
    assert seen == [0, 3]


def test_a_filter_that_fails_begins_anew_and_is_told(hear, monkeypatch) -> None:
    """One matrix that could not be solved ended the recording."""
    left = [3]

    def work(_station: Station, _until: int) -> None:
        if left[0]:
            left[0] -= 1
            raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(Station, "work", work)
    monkeypatch.setattr(Station, "idle", True)
    ending = hear()
    assert len(recorded(ending.recording)) == 50
    assert ending.live["counts"]["failures"] == ending.live["counts"]["restarts"] == 3
    (told,) = ending.live["alarms"]
    assert told["kind"] == "failed"
    assert told["words"] == (
        "the filter, which begins anew: failed 3 times (LinAlgError: Singular matrix)"
    )


def test_a_document_that_cannot_be_made_ends_nothing(hear, tmp_path, monkeypatch) -> None:
    def broken(*_given: object, **_named: object) -> dict:
        raise ValueError("cannot convert NaN")

    monkeypatch.setattr(document, "document", broken)
    shown: list[dict] = []
    ending = hear(show=shown.append)
    assert len(recorded(ending.recording)) == 50
    live = json.loads((tmp_path / "live.json").read_text())
    assert live["vehicle"] == ending.live["vehicle"] == 1
    assert live["counts"]["recorded"] == 50
    assert live["alarms"][0]["words"].startswith("the live document: failed")
    assert live_view.line(shown[-1])
    assert live_view.table(shown[-1])


def test_frames_that_cannot_be_decoded_are_recorded(hear, monkeypatch) -> None:
    def broken(_station: Station, _batch: object) -> None:
        raise KeyError("altitude")

    monkeypatch.setattr(Station, "receive", broken)
    ending = hear()
    assert len(recorded(ending.recording)) == 50
    assert "decoding" in ending.live["alarms"][0]["what"]


class Flying:
    """A station in flight whose seconds a test counts, and what is published of it."""

    def __init__(self, aircraft: Aircraft, compiled: Compiled) -> None:
        self.now = 0.0
        self.clock = Clock(seconds=lambda: self.now, us=lambda: round(self.now * 1e6))
        self.station = Station(aircraft, compiled, prior=None, vehicle=None, clock_us=self.clock.us)
        newest: Any = SimpleNamespace(row=SimpleNamespace(link_us=7))
        self.station.newest = newest

    def publishing(self, out: Path) -> AbstractContextManager[showing.Show]:
        return listen._publishing(out, lambda _document: None, self.station, self.clock)

    def told(self) -> list[str]:
        return [one.words for one in self.station.failures.told()]


def test_a_snapshot_that_failed_is_tried_again(aircraft, compiled, tmp_path, monkeypatch) -> None:
    """A disk that was full for a moment cost every later snapshot."""
    saved: queue.SimpleQueue[str] = queue.SimpleQueue()
    flying, told = Flying(aircraft, compiled), []

    def write(path: Path, _arrays: object) -> None:
        first = not told
        if first:
            told.append(path.name)
        saved.put(path.name)
        if first:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(snapshot, "write", write)
    with flying.publishing(tmp_path) as publish:
        for second in range(1, 60):
            flying.now = float(second)
            publish({})
            if second % int(snapshot.EVERY_S) == 0:
                saved.get(timeout=PATIENCE_S)
            if second == int(snapshot.EVERY_S):
                until = time.monotonic() + PATIENCE_S
                while not flying.told():
                    assert time.monotonic() < until
                words = "live-model.npz, which is tried again: failed once (OSError: [Errno 28] No"
                assert flying.told()[0].startswith(words)
    assert saved.empty()
    assert flying.station.failures.count == 1
    assert flying.told() == []


def test_a_slow_disk_holds_up_nothing(aircraft, compiled, tmp_path, monkeypatch) -> None:
    """The filter waited for every snapshot until it was on the disk.

    While one is being written the newest waits; both are as they were taken, whatever is learned.
    """
    begun, slow = threading.Event(), threading.Event()
    write, kept = snapshot.write, []

    def late(path: Path, arrays: dict[str, np.ndarray]) -> None:
        begun.set()
        assert slow.wait(PATIENCE_S)
        write(path, arrays)
        with np.load(path) as found:
            kept.append({name: found[name] for name in ("lasting", "time_us")})

    monkeypatch.setattr(snapshot, "write", late)
    monkeypatch.setattr(documents, "write_json", lambda _path, _document: slow.wait(PATIENCE_S))
    flying = Flying(aircraft, compiled)
    with flying.publishing(tmp_path) as publish:
        for second in range(1, 60):
            flying.now = float(second)
            flying.station.newest = SimpleNamespace(row=SimpleNamespace(link_us=second))
            flying.station.model._lasting[:] = second  # learned in place, as sums are
            publish({})
            assert second < snapshot.EVERY_S or begun.wait(PATIENCE_S)
        flying.station.model._lasting[:] = 99.0
        slow.set()
    assert [int(one["time_us"]) for one in kept] == [5, 55]
    assert [float(one["lasting"].max()) for one in kept] == [5.0, 55.0]
    assert flying.station.failures.count == 0
    assert [path.name for path in tmp_path.iterdir()] == [snapshot.NAME]


def test_failures_of_several_threads_are_all_counted() -> None:
    failures = Failures(lambda: 0)

    def fail(number: int) -> None:
        for _ in range(500):
            failures.note(f"part {number % 4}", ValueError("broken"))
            failures.told()

    threads = [threading.Thread(target=fail, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures.count == sum(one.count for one in failures.told()) == 4000


def test_a_disk_that_is_full_stops_loudly(hear, tmp_path) -> None:
    (tmp_path / "recording.tlog").symlink_to("/dev/full")
    with pytest.raises(SourceError, match=r"recording failed .*space.*; free or choose"):
        hear(resume=True)


def test_a_recording_is_never_overwritten_but_continued_when_asked(hear) -> None:
    hear()
    with pytest.raises(SourceError, match="exists already"):
        hear()
    assert len(recorded(hear(resume=True).recording)) == 100


def test_samples_are_read_as_before_the_kill(hear, aircraft, compiled, tmp_path) -> None:
    """The autopilot told its filter once: after `--resume` samples lay 11 ms later than before."""
    recording = hear().recording
    told = {inertial_filter.GYRO: 20.0}

    def station() -> Station:
        return Station(aircraft, compiled, prior=None, vehicle=None, clock_us=lambda: 0)

    before, after = station(), station()
    arrays = snapshot.taken(
        before.model,
        before.processes,
        before.inside,
        time_us=1,
        updates=1,
        parameters=told | {"OTHER": 1.0},
    )
    snapshot.write(tmp_path / snapshot.NAME, arrays)
    with Recorder(recording, append=True) as recorder:
        listen._resumed(recorder, after, tmp_path)
    assert after.decoder.parameters == told
    after.receive(FrameStream().feed(b"", 0))
    assert after.rows.inertial_delay == inertial_filter.delay(20.0)


def test_a_link_that_the_other_end_closes_is_opened_again(aircraft, played, tmp_path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        time = Ticking(played[0][0])
        sent: list[int] = []

        def stopped() -> bool:
            """The vehicle hangs up, and takes the next call."""
            if len(sent) < 2:
                vehicle, _ = server.accept()
                with vehicle:
                    half = played[25 * len(sent) : 25 * len(sent) + 25]
                    vehicle.sendall(b"".join(frame for _, frame in half))
                sent.append(25)
            return False

        ending = listen.run(
            f"tcp:127.0.0.1:{server.getsockname()[1]}",
            aircraft,
            Options(prior="none", quiet_after=20.0),
            out=tmp_path,
            show=lambda _document: None,
            stopped=stopped,
            clock=time.clock,
        )
    assert ending.why == "quiet"
    assert ending.live["health"]["losses"] == 2
    assert recorded(ending.recording) == [frame for _, frame in played[:50]]


def test_a_link_that_cannot_be_opened(aircraft, tmp_path) -> None:
    with pytest.raises(SourceError, match="neither a link nor a serial device"):
        listen.run(
            "carrier-pigeon",
            aircraft,
            Options(prior="none", quiet_after=1.0),
            out=tmp_path,
            show=lambda _document: None,
            stopped=lambda: True,
        )
    assert list(tmp_path.iterdir()) == []


def test_what_only_the_end_needs_is_not_in_memory_before() -> None:
    code = "import sys; import gcs_sysid.live.listen; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert "gcs_sysid.live.station" in loaded
    assert not loaded & {"pyarrow", "gcs_sysid.offline.identify", "gcs_sysid.report"}


def test_it_is_identified_as_identify_would_do_it(tmp_path, monkeypatch) -> None:
    """Only by least squares, once, in gusts too: `identify` chooses by itself."""
    asked: list[inspect.BoundArguments] = []
    signature = inspect.signature(identify.run)

    def run(*given: object, **named: object) -> dict:
        asked.append(signature.bind(*given, **named))
        raise RefusedError("recording.tlog", "it never flew", fix="fly")

    monkeypatch.setattr(identify, "run", run)
    log = tmp_path / "recording.tlog"
    log.write_bytes(b"frames")
    with pytest.raises(RefusedError):
        listen.identified(
            Ending("quiet", {"vehicle": 1}, log),
            AIRCRAFT,
            prior="file",
            vehicle=None,
            out=tmp_path,
            progress=lambda _stage, _share: None,
        )
    words = ["identify", str(log), "--aircraft", str(AIRCRAFT), "--out", str(tmp_path)]
    assert entry.main(words) == 1
    one, other = asked
    for each in asked:
        each.apply_defaults()
    for name in ("method", "body", "stepwise", "segments", "columns", "can", "prior"):
        assert one.arguments[name] == other.arguments[name], name


def test_a_recording_that_cannot_be_identified_stays(hear, tmp_path) -> None:
    ending = hear()
    with pytest.raises((RefusedError, SourceError)):
        listen.identified(
            ending,
            AIRCRAFT,
            prior="file",
            vehicle=None,
            out=tmp_path,
            progress=lambda _stage, _share: None,
        )
    assert ending.recording.is_file()
    assert (tmp_path / "live.json").is_file()
