from __future__ import annotations

import gc
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_sysid.errors import SourceError
from gcs_sysid.sources import tlog
from gcs_sysid.sources.link import Chunk, Link, LinkReader, Mailbox, is_link
from gcs_sysid.sources.player import play
from gcs_sysid.sources.recorder import Recorder
from gcs_sysid.sources.registry import open_recording
from gcs_sysid.sources.stream import FrameStream

PATIENCE_S = 10.0
"""How long a test waits for loopback before it fails; it takes milliseconds."""


def arriving_at(times_us: Iterator[int]) -> object:
    return lambda: next(times_us)


def flight(writer: type, count: int = 100) -> object:
    log = writer().heartbeat(0)
    for i in range(count):
        log.add(20_000 * i, "ATTITUDE", time_boot_ms=5000 + 20 * i, roll=0.01 * i, pitch=0.1)
        log.add(20_000 * i + 10, "VFR_HUD", airspeed=20.0)
    return log


def take(mailbox: Mailbox, frames: int) -> list[Chunk]:
    """Chunks until they hold so many frames; each datagram is one here."""
    chunks: list[Chunk] = []
    while len(chunks) < frames:
        news = mailbox.take(PATIENCE_S)
        assert news, f"only {len(chunks)} of {frames} arrived"
        chunks += news
    return chunks


def test_a_played_log_is_recorded_as_it_was(writer: type, tmp_path: Path) -> None:
    """Log, player, loopback, reader thread, recorder, and back: frame by frame the same."""
    log = flight(writer)
    path = tmp_path / "recording.tlog"
    arrivals = arriving_at(iter(range(1_790_000_000_000_000, 2**62, 20_000)))
    mailbox, stream = Mailbox(), FrameStream()
    with Link("udpin:127.0.0.1:0") as ground:
        address = f"udpout:127.0.0.1:{ground.local_port}"
        with (
            Link(address) as vehicle,
            LinkReader(ground, mailbox, clock_us=arrivals),
            Recorder(path) as recorder,
        ):
            sent = play(tlog.frames(log.data), vehicle.write, speed=float("inf"))
            for chunk in take(mailbox, sent):
                recorder.write(stream.feed(chunk.data, chunk.link_us))
    assert sent == recorder.frames == len(log.records)
    assert [frame for _, frame in tlog.frames(path.read_bytes())] == [
        frame for _, frame in tlog.frames(log.data)
    ]
    assert open_recording(path).streams["ATTITUDE"].count == 100
    assert mailbox.dropped == 0


def test_a_listening_link_answers_whom_it_heard() -> None:
    with (
        Link("udp:127.0.0.1:0") as ground,
        Link(f"udpout:127.0.0.1:{ground.local_port}") as vehicle,
    ):
        vehicle.write(b"hello")
        assert ground.read(PATIENCE_S) == b"hello"
        ground.write(b"answer")
        assert vehicle.read(PATIENCE_S) == b"answer"
        assert vehicle.read(0.0) == b""


def test_a_port_that_somebody_listens_to_is_not_shared() -> None:
    """Datagrams go to one of two listeners; the other would wait for ever, or both miss some."""
    with (
        Link("udp:127.0.0.1:0") as first,
        pytest.raises(SourceError, match=r"already in use.*nothing else uses it"),
    ):
        Link(f"udp:127.0.0.1:{first.local_port}")


def test_tcp_and_its_end() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        with Link(f"tcp:127.0.0.1:{server.getsockname()[1]}") as link:
            connection, _ = server.accept()
            connection.sendall(b"abc")
            assert link.read(PATIENCE_S) == b"abc"
            link.write(b"back")
            assert connection.recv(10) == b"back"
            connection.close()
            with pytest.raises(SourceError, match="closed the connection"):
                link.read(PATIENCE_S)


def test_a_broken_link_ends_the_mailbox_and_says_why() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        with Link(f"tcp:127.0.0.1:{server.getsockname()[1]}") as link:
            connection, _ = server.accept()
            mailbox = Mailbox()
            with LinkReader(link, mailbox) as reader:
                connection.close()
                assert mailbox.take(PATIENCE_S) == []
                assert mailbox.closed
            assert reader.failure is not None
            assert "closed the connection" in str(reader.failure)


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("udp:nowhere", "no host and port"),
        ("udp:127.0.0.1:port", "no host and port"),
        ("carrier-pigeon:1", "neither a link nor a serial device"),
        ("/dev/does-not-exist,57600", "link failed"),
        ("tcp:127.0.0.1:1", "link failed"),
    ],
)
def test_links_that_cannot_be_opened(address: str, words: str) -> None:
    with pytest.raises(SourceError, match=words) as error:
        Link(address)
    assert str(error.value).startswith(address)
    assert "\n" not in str(error.value)


# pymavlink does not close the socket that it could not bind.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_an_address_that_is_taken() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        with pytest.raises(SourceError, match="nothing else uses it"):
            Link(f"udpin:127.0.0.1:{other.getsockname()[1]}")
    gc.collect()


def test_what_is_a_link() -> None:
    links = ["udp:127.0.0.1:14550", "tcp:h:5760", "/dev/ttyACM0", "COM3,57600", "udpin:0.0.0.0:1"]
    assert all(is_link(address) for address in links)
    assert not any(is_link(path) for path in ["flight.tlog", "COMPARE.tlog", "./dev/a.tlog", "udp"])


def test_a_full_mailbox_counts_what_it_drops() -> None:
    mailbox = Mailbox(size=3)
    for i in range(5):
        mailbox.put(Chunk(bytes([i]), i))
    assert [chunk.link_us for chunk in mailbox.take(0.0)] == [0, 1, 2]
    assert mailbox.dropped == 2
    mailbox.put(Chunk(b"", 9))
    assert [chunk.link_us for chunk in mailbox.take(0.0)] == [9]


def test_a_waiting_reader_is_woken_up() -> None:
    mailbox = Mailbox()
    threading.Thread(target=mailbox.put, args=[Chunk(b"x", 1)]).start()
    assert mailbox.take(PATIENCE_S) == [Chunk(b"x", 1)]
    threading.Thread(target=mailbox.close).start()
    assert mailbox.take(PATIENCE_S) == []
