"""What is left after a crash, and going on from there."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gcs_sysid.errors import SourceError
from gcs_sysid.sources import tlog
from gcs_sysid.sources.link import Link
from gcs_sysid.sources.recorder import Recorder
from gcs_sysid.sources.stream import FrameStream

PATIENCE_S = 60.0
PROGRAM = """
import sys
from pathlib import Path
from gcs_sysid.live import listen, warming
warming.warm = lambda *_: None  # these frames never leave the ground
listen.run(
    sys.argv[1], listen.load(Path(sys.argv[2])),
    listen.Options(prior="none", quiet_after=1e6, resume=sys.argv[4] == "resume"),
    out=Path(sys.argv[3]), show=lambda _document: None, stopped=lambda: False,
    say=lambda words: print(words, flush=True),
)
"""
AIRCRAFT = Path(__file__).resolve().parents[2] / "data/aircraft/ultra_stick_25e.toml"


def started(link: str, out: Path, how: str) -> subprocess.Popen[str]:
    words = [sys.executable, "-c", PROGRAM, link, str(AIRCRAFT), str(out), how]
    return subprocess.Popen(words, stdout=subprocess.PIPE, text=True)


def test_a_listener_that_is_killed_loses_nothing_and_goes_on(played, tmp_path: Path) -> None:
    """SIGKILL in the middle of a stream of frames, as a frame is written, and once more."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    path, frames = tmp_path / "recording.tlog", [frame for _, frame in played[:300]]
    sent = 0
    for how in ("new", "resume"):
        process = started(f"udpin:127.0.0.1:{port}", tmp_path, how)
        with Link(f"udpout:127.0.0.1:{port}") as vehicle:
            until = time.monotonic() + PATIENCE_S
            want = sent + 150
            while len(recorded(path)) < want:
                assert time.monotonic() < until
                if sent < want and (sent % 150 or listening(port)):
                    vehicle.write(frames[sent])
                    sent += 1
                elif sent < want:
                    time.sleep(0.05)
            process.send_signal(signal.SIGKILL)
            said, _ = process.communicate(timeout=PATIENCE_S)
        if how == "new":
            with path.open("ab") as torn:  # the kernel was handed the half of a frame
                torn.write(path.read_bytes()[:5] + b"\x00\x00\x00\xfd\x1c\x00")
        else:
            assert "recording.tlog goes on, 11 bytes of a cut frame taken off" in said
    assert recorded(path) == frames
    assert tlog.read(path.read_bytes()).lost["garbage_bytes"] == 0


def recorded(path: Path) -> list[bytes]:
    return [frame for _, frame in tlog.frames(path.read_bytes())] if path.exists() else []


def listening(port: int) -> bool:
    """Whether somebody holds the port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return True
    return False


def test_parts_of_a_recording_are_one_flight(
    played: list[tuple[int, bytes]], tmp_path: Path
) -> None:
    records = played[:500]
    stream = FrameStream()
    with Recorder(tmp_path / "recording.tlog", part_bytes=8000) as recorder:
        for link_us, frame in records:
            recorder.write(stream.feed(frame, link_us))
        parts = recorder.parts
    assert len(parts) > 2
    assert parts[0].name == "recording-001.tlog"
    assert parts[-1].name == "recording.tlog"
    assert all(part.stat().st_size < 8400 for part in parts)
    assert [r for part in parts for r in tlog.frames(part.read_bytes())] == records


@pytest.mark.parametrize("left", ["renamed", "opened"])
def test_a_kill_as_a_part_begins_leaves_something_to_resume(
    played: list[tuple[int, bytes]], tmp_path: Path, left: str
) -> None:
    """Between renaming the full part and the first frame of the next it said "nothing to resume",

    and without --resume it began another flight behind the parts of this one.
    """
    path, stream = tmp_path / "recording.tlog", FrameStream()
    with Recorder(path, part_bytes=8000) as recorder:
        for link_us, frame in played[:300]:
            recorder.write(stream.feed(frame, link_us))
        number = len(recorder.parts)
    path.rename(tmp_path / f"recording-{number:03d}.tlog")
    if left == "opened":
        path.touch()
    with pytest.raises(SourceError, match="exists already"):
        Recorder(path)
    with Recorder(path, append=True) as again:
        assert again.interrupted is not None
        assert again.interrupted.cut_bytes == 0
        assert again.interrupted.last_us == played[299][0]
        for link_us, frame in played[300:310]:
            again.write(stream.feed(frame, link_us))
        parts = again.parts
    assert [r for part in parts for r in tlog.frames(part.read_bytes())] == played[:310]


def test_a_part_that_was_taken_away_lets_none_be_overwritten(
    played: list[tuple[int, bytes]], tmp_path: Path
) -> None:
    """The next one was numbered by how many there were, and took the place of the newest."""
    path, stream = tmp_path / "recording.tlog", FrameStream()
    with Recorder(path, part_bytes=3000) as recorder:
        for count, (link_us, frame) in enumerate(played[:500]):
            recorder.write(stream.feed(frame, link_us))
            if count == 250:
                kept = recorder.parts[-2]
                told = kept.read_bytes()
                recorder.parts[0].unlink()
    assert kept.name != "recording-001.tlog"
    assert kept.read_bytes() == told
    assert len(recorder.parts) > 3


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_said_and_how_to_go_on(
    played: list[tuple[int, bytes]], tmp_path: Path
) -> None:
    (tmp_path / "recording.tlog").symlink_to("/dev/full")
    stream = FrameStream()
    link_us, frame = played[0]
    recorder = Recorder(tmp_path / "recording.tlog", append=True)
    with pytest.raises(SourceError, match=r"No space left.*what came before is kept.*--resume"):
        recorder.write(stream.feed(frame, link_us))
    with pytest.raises(SourceError, match="No space left"):
        recorder.close()
