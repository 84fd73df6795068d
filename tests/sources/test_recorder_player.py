from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from gcs_sysid.errors import SourceError
from gcs_sysid.sources import tlog
from gcs_sysid.sources.player import play
from gcs_sysid.sources.recorder import Recorder
from gcs_sysid.sources.stream import FrameStream

PATIENCE_S = 60.0


class Clock:
    """Time that passes only by sleeping."""

    def __init__(self) -> None:
        self.now = 100.0
        self.naps: list[float] = []

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.naps.append(seconds)
        self.now += seconds


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_the_log_sets_the_time(writer: type, speed: float) -> None:
    log = writer().heartbeat(0).heartbeat(20_000).heartbeat(20_000).heartbeat(3_500_000)
    clock, sent = Clock(), []
    count = play(
        tlog.frames(log.data),
        lambda frame: sent.append((clock.now - 100.0, frame)),
        speed=speed,
        clock=clock,
        sleep=clock.sleep,
    )
    assert count == 4
    assert [t * speed for t, _ in sent] == pytest.approx([0.0, 0.02, 0.02, 3.5])
    assert [frame for _, frame in sent] == [frame for _, frame in log.records]


def test_as_fast_as_it_goes(writer: type) -> None:
    log = writer().heartbeat(0).heartbeat(10**9)
    clock = Clock()
    assert play(tlog.frames(log.data), len, speed=float("inf"), clock=clock, sleep=clock.sleep) == 2
    assert clock.naps == []


def test_progress_goes_on_in_pauses(writer: type) -> None:
    log = writer().heartbeat(0).heartbeat(3_000_000)
    clock, told = Clock(), []
    play(
        tlog.frames(log.data),
        len,
        clock=clock,
        sleep=clock.sleep,
        progress=lambda played, whole: told.append((played, whole)),
    )
    assert [played for played, _ in told] == pytest.approx([0.5, 1, 1.5, 2, 2.5, 3, 3])
    assert {whole for _, whole in told} == {3.0}


def test_arrivals_that_fall_back_are_sent_at_once(writer: type) -> None:
    log = writer().heartbeat(0).heartbeat(1_000_000)
    records = log.data
    later, earlier = records[: len(records) // 2], records[len(records) // 2 :]
    clock = Clock()
    assert play(tlog.frames(earlier + later), len, clock=clock, sleep=clock.sleep) == 2
    assert clock.naps == []


def test_a_recording_is_a_tlog(writer: type, tmp_path: Path) -> None:
    path, stream = tmp_path / "r.tlog", FrameStream()
    log = writer().heartbeat(0).add(5, "ATTITUDE", time_boot_ms=3).add(9, "MEMINFO", freemem=2)
    with Recorder(path) as recorder:
        for link_us, frame in log.records:
            recorder.write(stream.feed(frame, link_us))
    assert path.read_bytes() == log.data
    assert recorder.frames == 3


def test_every_batch_is_there_at_once(writer: type, tmp_path: Path) -> None:
    """A program that is killed must not lose what it received."""
    path, stream = tmp_path / "r.tlog", FrameStream()
    log = writer().heartbeat(1).heartbeat(2)
    with Recorder(path) as recorder:
        for i, (link_us, frame) in enumerate(log.records):
            recorder.write(stream.feed(frame, link_us))
            assert len(tlog.frames(path.read_bytes())) == i + 1


def disk(monkeypatch: pytest.MonkeyPatch, put: Callable[[], None]) -> None:
    monkeypatch.setattr("os.fsync", lambda _descriptor: put())


def turned(recorder: Recorder, until: Callable[[], bool]) -> None:
    """Goes on as `listen` does, without time going on, until the disk's thread has come to it."""
    end = time.monotonic() + PATIENCE_S
    while not until():
        assert time.monotonic() < end
        recorder.sync()
        time.sleep(0.001)


def test_it_reaches_the_disk_every_second(
    writer: type, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, synced = Clock(), []
    disk(monkeypatch, lambda: synced.append(clock.now))
    stream = FrameStream()
    frame = writer().frame("HEARTBEAT")
    with Recorder(tmp_path / "r.tlog", clock=clock) as recorder:
        for count in range(1, 27):
            clock.now += 0.125
            recorder.write(stream.feed(frame, 0))
            turned(recorder, lambda count=count: len(synced) == count // 8)
        assert synced == [101.0, 102.0, 103.0]
    assert synced[3:] == [103.25]


def test_a_slow_disk_is_not_waited_for(
    writer: type, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every second filter and reception stood still until the disk had it."""
    clock, stream, begun, slow, done = Clock(), FrameStream(), [], threading.Event(), []

    def put() -> None:
        begun.append(clock.now)
        assert slow.wait(PATIENCE_S)
        done.append(clock.now)

    disk(monkeypatch, put)
    frame, path = writer().frame("HEARTBEAT"), tmp_path / "r.tlog"
    with Recorder(path, clock=clock) as recorder:
        for _ in range(40):
            clock.now += 0.125
            recorder.write(stream.feed(frame, 0))
        turned(recorder, lambda: bool(begun))
        assert done == [], "it goes on while the disk has not come back"
        assert len(begun) == 1, "and does not pile up"
        assert len(tlog.frames(path.read_bytes())) == 40
        slow.set()
        turned(recorder, lambda: len(begun) == 2)
    assert len(done) == 2, "what came meanwhile was put there, and at the end nothing was left"


def test_a_disk_that_fails_behind_the_scenes_is_told_with_the_next_turn(
    writer: type, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, stream, failed = Clock(), FrameStream(), threading.Event()

    def put() -> None:
        failed.set()
        raise OSError(5, "Input/output error")

    disk(monkeypatch, put)
    recorder = Recorder(tmp_path / "r.tlog", clock=clock)
    clock.now += 1.0
    recorder.write(stream.feed(writer().frame("HEARTBEAT"), 0))
    assert failed.wait(PATIENCE_S)
    with pytest.raises(SourceError, match=r"recording failed \(Input/output error\).*--resume"):
        turned(recorder, lambda: False)
    recorder.close()


def test_a_disk_that_fails_at_the_last_moment_is_told_and_the_file_closed(
    writer: type, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, stream = Clock(), FrameStream()

    def put() -> None:
        raise OSError(5, "Input/output error")

    disk(monkeypatch, put)
    recorder = Recorder(tmp_path / "r.tlog", clock=clock)
    clock.now += 1.0
    recorder.write(stream.feed(writer().frame("HEARTBEAT"), 0))
    with pytest.raises(SourceError, match="Input/output error"):
        recorder.close()
    recorder.close()


def test_a_recording_is_never_overwritten_but_continued(writer: type, tmp_path: Path) -> None:
    path, stream = tmp_path / "r.tlog", FrameStream()
    frame = writer().frame("HEARTBEAT")
    for append in (False, True):
        with Recorder(path, append=append) as recorder:
            recorder.write(stream.feed(frame, 7))
    assert tlog.frames(path.read_bytes()) == [(7, frame), (7, frame)]
    with pytest.raises(SourceError, match=r"exists already.*--resume"):
        Recorder(path)


def test_a_disk_that_is_full_is_told_at_once(writer: type) -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("the system has no /dev/full")
    recorder = Recorder(full, append=True)
    with pytest.raises(SourceError, match="recording failed"):
        recorder.write(FrameStream().feed(writer().frame("HEARTBEAT"), 0))
    with pytest.raises(SourceError, match="recording failed"):
        recorder.close()


def test_a_folder_that_does_not_exist(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="recording failed"):
        Recorder(tmp_path / "missing" / "r.tlog")
