"""A .tlog that grows under the reader's eyes."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_sysid.errors import SourceError
from gcs_sysid.sources import tlog
from gcs_sysid.sources.followed import FollowedLog
from gcs_sysid.sources.link import LinkReader, Mailbox, open_link
from gcs_sysid.sources.recorder import Recorder
from gcs_sysid.sources.stream import FrameStream
from tests.sources.conftest import Writer


def flight() -> bytes:
    log = Writer().heartbeat(0)
    for i in range(20):
        log.add(20_000 * i, "ATTITUDE", time_boot_ms=5000 + 20 * i, roll=0.01 * i)
        log.add(20_000 * i + 7, "VFR_HUD", airspeed=20.0)
    return log.data


DATA = flight()


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(0, len(DATA)), max_size=6), st.integers(0, 40), st.integers(0, 1000))
def test_however_it_is_written_frames_and_times_are_those_of_the_file(
    tmp_path_factory: pytest.TempPathFactory, cuts: list[int], garbage: int, at: int
) -> None:
    place = at % (len(tlog.frames(DATA)) + 1)
    begin = sum(8 + len(frame) for _, frame in tlog.frames(DATA)[:place])
    data = DATA[:begin] + b"\x07" * garbage + DATA[begin:]
    path = tmp_path_factory.mktemp("followed") / "growing.tlog"
    path.write_bytes(b"")
    found: list[tuple[bytes, int]] = []
    stream = FrameStream()
    with FollowedLog(f"file:{path}", sleep=lambda _s: None) as link, path.open("ab") as writer:
        edges = [0, *sorted(cuts), len(data)]
        for first, last in pairwise(edges):
            writer.write(data[first:last])
            writer.flush()
            found += link.stamped(0.0)
    batches = [stream.feed(piece, link_us) for piece, link_us in found]
    assert [(b.link_us, frame) for b in batches for frame in b.raw()] == tlog.frames(DATA)
    assert stream.lost["garbage_bytes"] == (garbage if place < len(tlog.frames(DATA)) else 0)


def test_what_is_recorded_of_it_is_the_same_file(tmp_path: Path) -> None:
    path, mailbox, stream = tmp_path / "flight.tlog", Mailbox(), FrameStream()
    path.write_bytes(DATA)
    with (
        open_link(str(path)) as link,
        LinkReader(link, mailbox),
        Recorder(tmp_path / "recording.tlog") as recorder,
    ):
        while recorder.frames < 41:
            chunks = mailbox.take(10.0)
            assert chunks
            for chunk in chunks:
                recorder.write(stream.feed(chunk.data, chunk.link_us))
    assert (tmp_path / "recording.tlog").read_bytes() == DATA


def test_a_file_that_is_begun_anew_is_followed_from_its_beginning(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    path.write_bytes(DATA)
    with FollowedLog(str(path), sleep=lambda _s: None) as link:
        assert len(link.stamped(0.0)) == 41
        path.write_bytes(DATA[: len(DATA) // 2])
        link.stamped(0.0)
        assert link.stamped(0.0)[0] == (tlog.frames(DATA)[0][1], tlog.frames(DATA)[0][0])
        with pytest.raises(SourceError, match="cannot be sent to a log"):
            link.write(b"x")


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="cannot be read"):
        open_link(str(tmp_path / "none.tlog"))
