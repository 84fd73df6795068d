"""Links that break and come back."""

from __future__ import annotations

import os
import pty
import tempfile
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_sysid.errors import SourceError
from gcs_sysid.sources.reconnecting import AGAIN_S, ReconnectingLink, open_lasting

PATIENCE_S = 20.0


class Scripted:
    """A link whose reads and writes are written down beforehand; an error breaks it."""

    def __init__(self, *reads: bytes | str) -> None:
        self._reads = list(reads)
        self.closed = False
        self.sent: list[bytes] = []

    def read(self, timeout_s: float) -> bytes:
        found = self._reads.pop(0)
        if isinstance(found, str):
            raise SourceError("link", found, fix="wait")
        return found

    def write(self, data: bytes) -> None:
        if not self._reads:
            raise SourceError("link", "nobody there", fix="wait")
        self.sent.append(data)

    def close(self) -> None:
        self.closed = True

    def __enter__(self) -> Scripted:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def test_it_is_tried_once_a_second_until_it_is_back() -> None:
    first, second, clock = Scripted(b"a", "gone"), Scripted(b"b", b"c"), Clock()
    opened: list[float] = []

    def open_one() -> Scripted:
        opened.append(clock.now)
        if len(opened) in (2, 3):
            raise SourceError("link", "refused", fix="wait")
        return first if len(opened) == 1 else second

    link = ReconnectingLink(open_one, clock=clock, sleep=clock.sleep)
    assert link.read(0.2) == b"a"
    assert link.read(0.2) == b""
    assert first.closed
    assert (link.losses, link.broken) == (1, "gone")
    link.write(b"lost, as on a radio")
    found = b""
    while len(found) < 2:
        found += link.read(0.2)
        assert clock.now < 10.0
    assert found == b"bc"
    assert opened == pytest.approx([0.0, AGAIN_S, 2 * AGAIN_S, 3 * AGAIN_S], abs=0.21)
    assert link.broken == ""
    assert first.sent == []


def test_one_that_cannot_be_opened_at_first_is_the_callers_trouble() -> None:
    def refuse() -> Scripted:
        raise SourceError("link", "refused", fix="wait")

    with pytest.raises(SourceError, match="refused"):
        ReconnectingLink(refuse)


@pytest.fixture
def device() -> Iterator[Path]:
    """A name in /dev under which serial devices come and go."""
    shared = Path("/dev/shm")
    if not shared.is_dir():
        pytest.skip("no /dev/shm, where a serial device can be given a name")
    with tempfile.TemporaryDirectory(dir=shared) as folder:
        yield Path(folder) / "ttyTest"


def plugged(device: Path) -> int:
    """The other end of a serial device that appears."""
    near, far = pty.openpty()
    tty.setraw(far)
    device.unlink(missing_ok=True)
    device.symlink_to(os.ttyname(far))
    os.close(far)
    return near


def test_a_serial_device_that_is_unplugged_and_comes_back(device: Path) -> None:
    near = plugged(device)
    with open_lasting(f"{device},57600") as link:
        assert isinstance(link, ReconnectingLink)
        os.write(near, b"before")
        assert link.read(PATIENCE_S) == b"before"
        link.write(b"request")
        assert os.read(near, 100) == b"request"
        os.close(near)
        until = time.monotonic() + PATIENCE_S
        while not link.broken:
            assert link.read(0.1) == b""
            assert time.monotonic() < until
        near = plugged(device)
        while b"after" not in link.read(0.1):
            os.write(near, b"after")  # what came before it was opened is flushed
            assert time.monotonic() < until
        assert (link.losses, link.broken) == (1, "")
        os.close(near)
