"""Live links to a vehicle: UDP, TCP and serial, opened by pymavlink.

The thread that reads a link does nothing but put what arrived, with its arrival time, into a
bounded mailbox. A slow reader therefore never delays the link; what it could not take is counted.
"""

from __future__ import annotations

import re
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol, runtime_checkable

from pymavlink import mavutil

from gcs_sysid.errors import SourceError
from gcs_sysid.sources import adapters
from gcs_sysid.sources.closing import Closing

SCHEMES = ("udp:", "udpin:", "udpout:", "tcp:")
"""Beginnings of link addresses; a serial device is a path: /dev/ttyUSB0,57600 or COM3,57600."""

_WAITING = ("udp:", "udpin:")
_HOST_AND_PORT = re.compile(r"[^:\s]+:\d{1,5}")
_LARGEST_READ = 65535
_BAUD = 115200
"""Of a serial device whose address names none; pymavlink's default."""
_RECEIVING = 4 << 20
"""Bytes of datagrams that the system keeps for us, as far as it allows: seconds of a busy link."""
_PATIENCE_S = 0.2
_FAREWELL_S = 3.0
_OUTBOX = 64
_AT_ONCE = 256
"""Datagrams read without asking again whether there are any: asking costs as much as reading."""


def is_link(address: str) -> bool:
    """Whether `address` names a live link and not a file."""
    return address.startswith((*SCHEMES, "/dev/")) or _is_com_port(address)


def _is_com_port(address: str) -> bool:
    name = address.partition(",")[0]
    return name[:3] == "COM" and name[3:].isdigit()


@runtime_checkable
class _Port(Protocol):
    """What is used of a pymavlink connection; `port` is its socket or serial device."""

    port: Any

    def select(self, timeout: float) -> bool: ...

    def recv(self, n: int) -> bytes | str: ...

    def write(self, buf: bytes) -> object: ...

    def close(self) -> None: ...


_STARTED_NS = time.time_ns() - time.monotonic_ns()


def now_us() -> int:
    """The ground station's clock [µs since 1970], as it was set when the program began.

    A clock that is set anew while it runs, by hand or from a network, would make arrivals jump.
    """
    return (_STARTED_NS + time.monotonic_ns()) // 1000


class Link(Closing):
    """An open link. Use as a context, or call `close`.

    Args:
        address: `udp:HOST:PORT` and `udpin:` wait for a vehicle to send, `udpout:` sends first,
            `tcp:HOST:PORT` connects; a serial device is its path, with the baud
            rate behind a comma (default 115200).

    Raises:
        SourceError: the address is malformed, or the link cannot be opened.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._port = _open(address)

    @property
    def local_port(self) -> int:
        """Port number of this end of an IP link; with port 0 in the address the system chose it."""
        return int(self._port.port.getsockname()[1])

    def read(self, timeout_s: float) -> bytes:
        """What arrived, waiting for it up to `timeout_s`; empty if nothing did.

        Raises:
            SourceError: the link is broken, or the other end closed it.
        """
        try:
            if not self._port.select(timeout_s):
                return b""
            if isinstance(self._port, mavutil.mavtcp):
                return self._read_tcp()
            # Where there was nothing to read, pymavlink returns an empty text.
            data = self._port.recv(_LARGEST_READ)
            return data if isinstance(data, bytes) else b""
        except OSError as error:
            raise _broken(self.address, error) from error

    def waiting(self) -> Iterator[bytes]:
        """Datagrams that wait already; nothing of links that have none.

        Raises:
            SourceError: the link is broken.
        """
        if not isinstance(self._port, mavutil.mavudp):
            return
        try:
            for _ in range(_AT_ONCE):
                data = self._port.recv(_LARGEST_READ)
                if not isinstance(data, bytes) or not data:
                    return
                yield data
        except OSError as error:
            raise _broken(self.address, error) from error

    def _read_tcp(self) -> bytes:
        # pymavlink prints to the terminal and sleeps when the other end closes the connection.
        data = self._port.port.recv(_LARGEST_READ)
        if not data:
            raise SourceError(
                self.address, "the other end closed the connection", fix="start it, then this again"
            )
        return data

    def write(self, data: bytes) -> None:
        """Sends bytes; a link that listens sends to those it has heard.

        Raises:
            SourceError: the link is broken.
        """
        try:
            if isinstance(self._port, mavutil.mavudp):
                self._port.write(data)
            elif isinstance(self._port, mavutil.mavtcp):
                # pymavlink prints to the terminal where the other end is gone, here and below.
                self._port.port.send(data)
            else:
                self._port.port.write(data)
        except BlockingIOError:
            # The other end does not keep up; what would be late is of no use.
            return
        except OSError as error:
            raise _broken(self.address, error) from error

    def close(self) -> None:
        """Ends the link."""
        self._port.close()


def _open(address: str) -> _Port:
    if not is_link(address):
        raise SourceError(
            address,
            "is neither a link nor a serial device",
            fix=f"begin with one of {', '.join(adapters.names('links'))}, or give a path as "
            "/dev/ttyUSB0,57600",
        )
    if address.startswith(SCHEMES) and not _HOST_AND_PORT.fullmatch(address.partition(":")[2]):
        raise SourceError(
            address, "is no host and port number", fix="write it as udp:127.0.0.1:14550"
        )
    try:
        if address.startswith(_WAITING):
            _alone(address)
        # One attempt: pymavlink prints and sleeps between several.
        opened = mavutil.mavlink_connection(address, retries=1)
        if isinstance(opened, mavutil.mavudp):
            opened.port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVING)
        return opened
    except OSError as error:
        raise _broken(address, error) from error


def _alone(address: str) -> None:
    """Fails where another program holds the port: pymavlink would share it, and one of both starve.

    Raises:
        OSError: the port is taken, or no port of this computer.
    """
    _, host, port = address.split(":")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((host, int(port)))


def _broken(address: str, error: OSError) -> SourceError:
    return SourceError(
        address,
        f"link failed ({error.strerror or error})",
        fix="check the address, and that nothing else uses it",
    )


@dataclass(frozen=True)
class Chunk:
    """Bytes that arrived together, when [µs since 1970], and by which of several links."""

    data: bytes
    link_us: int
    link: int = 0


class Mailbox:
    """Chunks between the link's thread and a reader: bounded, never blocking the one who puts.

    Args:
        size: chunks it holds; more that arrive meanwhile are dropped and counted.
    """

    def __init__(self, size: int = 65536) -> None:
        self._size = size
        self._chunks: deque[Chunk] = deque()
        self._news = threading.Condition()
        self._closed = False
        self.dropped = 0

    def put(self, chunk: Chunk) -> None:
        """Adds a chunk, or counts it as dropped if there is no room."""
        with self._news:
            if len(self._chunks) < self._size:
                self._chunks.append(chunk)
            else:
                self.dropped += 1
            self._news.notify()

    def take(self, timeout_s: float) -> list[Chunk]:
        """All waiting chunks, waiting up to `timeout_s` for the first; empty if none came."""
        with self._news:
            self._news.wait_for(lambda: bool(self._chunks) or self._closed, timeout_s)
            chunks = list(self._chunks)
            self._chunks.clear()
            return chunks

    def close(self) -> None:
        """Wakes up a waiting reader: nothing more will come."""
        with self._news:
            self._closed = True
            self._news.notify_all()

    @property
    def empty(self) -> bool:
        """Whether no chunk waits to be taken."""
        return not self._chunks

    @property
    def closed(self) -> bool:
        """Whether nothing more will come (some may still wait to be taken)."""
        return self._closed


@runtime_checkable
class AnyLink(Protocol):
    """What a link of any kind does."""

    def read(self, timeout_s: float) -> bytes:
        """What arrived, waiting for it up to `timeout_s`; empty if nothing did."""
        ...

    def write(self, data: bytes) -> None:
        """Sends bytes."""
        ...

    def close(self) -> None:
        """Ends the link."""
        ...

    def __enter__(self) -> AnyLink:
        """The link itself."""
        ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Ends the link."""
        ...


@runtime_checkable
class StampedLink(Protocol):
    """A link that knows itself when its bytes arrived, as a file that is being written does."""

    def stamped(self, timeout_s: float) -> list[tuple[bytes, int]]:
        """What arrived, each piece with its arrival time [µs since 1970]."""
        ...


@runtime_checkable
class DatagramLink(AnyLink, Protocol):
    """A link that says what waits already without waiting for more."""

    def waiting(self) -> Iterator[bytes]:
        """Pieces that wait."""
        ...


def bytes_per_second(address: str) -> float | None:
    """What a serial device carries, ten bits a byte; None for links whose width is not known."""
    if address.startswith(SCHEMES):
        return None
    baud = address.partition(",")[2]
    return 0.1 * (float(baud) if baud.isdigit() else _BAUD)


def open_link(address: str) -> AnyLink:
    """Opens a link by the kind that its address begins with.

    Raises:
        SourceError: the address is malformed, the link cannot be opened, or a package that it
            needs is not installed.
    """
    if address.lower().endswith(".tlog"):
        address = address if address.startswith("file:") else f"file:{address}"
    own = (name for name in adapters.names("links") if address.startswith(name))
    name = next(own, None)
    if name is None or name in SCHEMES:
        return Link(address)
    return adapters.load("links", name, asked=address)(address)


class LinkReader(Closing):
    """Reads a link in its own thread into a mailbox. Use as a context.

    Args:
        link: an open link; it stays the caller's to close.
        mailbox: where chunks go; closed when the link fails or this reader stops.
        clock_us: arrival clock [µs since 1970].
        number: of the link, where several share a mailbox.

    One thread reads and writes: links are not made for two.
    """

    def __init__(
        self,
        link: AnyLink,
        mailbox: Mailbox,
        *,
        clock_us: Callable[[], int] = now_us,
        number: int = 0,
    ) -> None:
        self._link = link
        self._mailbox = mailbox
        self._clock_us = clock_us
        self._number = number
        self._stamped = link if isinstance(link, StampedLink) else None
        self._datagrams = link if isinstance(link, DatagramLink) else None
        self._stop = threading.Event()
        self._outbox: deque[bytes] = deque(maxlen=_OUTBOX)
        self._thread = threading.Thread(target=self._run, name="link", daemon=True)
        self.failure: SourceError | None = None

    def __enter__(self) -> LinkReader:
        self._thread.start()
        return self

    def close(self) -> None:
        """Stops reading."""
        self._stop.set()
        # A connection that is being tried again cannot be hurried; it ends with the program.
        self._thread.join(_FAREWELL_S)

    def send(self, frame: bytes) -> None:
        """Sends a frame soon; what cannot be sent in time makes room for what is newer."""
        self._outbox.append(frame)

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                while self._outbox:
                    self._link.write(self._outbox.popleft())
                for data, link_us in self._read():
                    self._mailbox.put(Chunk(data, link_us, self._number))
        except SourceError as error:
            # Raised where the chunks are taken: nobody would see it in this thread.
            self.failure = error
        finally:
            self._mailbox.close()

    def _read(self) -> list[tuple[bytes, int]]:
        if self._stamped is not None:
            return self._stamped.stamped(_PATIENCE_S)
        data = self._link.read(_PATIENCE_S)
        if not data:
            return []
        first = [(data, self._clock_us())]
        if self._datagrams is None:
            return first
        return first + [(more, self._clock_us()) for more in self._datagrams.waiting()]
