"""A link that is opened again when it breaks: the other end restarted, a cable was pulled."""

from __future__ import annotations

import time
from collections.abc import Callable

from gcs_sysid.errors import SourceError
from gcs_sysid.sources.can.tunnel import SCHEME as BUS_SCHEME
from gcs_sysid.sources.closing import Closing
from gcs_sysid.sources.link import AnyLink, DatagramLink, is_link, open_link

AGAIN_S = 1.0
"""A broken link is tried so often."""


class ReconnectingLink(Closing):
    """A link like any other that is silent while it is broken. Use as a context.

    Args:
        open_one: opens the link; the first time a failure is the caller's.
        clock: seconds, from any origin, never falling.
        sleep: waits for some seconds.

    Attributes:
        losses: how often it broke.
        broken: why it is down; empty while it is up.

    Raises:
        SourceError: the link cannot be opened.
    """

    def __init__(
        self,
        open_one: Callable[[], AnyLink],
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._open_one = open_one
        self._clock, self._sleep = clock, sleep
        self._link: AnyLink | None = open_one()
        self._tried = clock()
        self.losses = 0
        self.broken = ""

    def read(self, timeout_s: float) -> bytes:
        """What arrived, waiting for it up to `timeout_s`; empty if nothing did or it is broken."""
        link = self._link or self._again()
        if link is None:
            self._sleep(timeout_s)
            return b""
        try:
            return link.read(timeout_s)
        except SourceError as error:
            self._lost(link, error)
            return b""

    def waiting(self) -> list[bytes]:
        """Pieces that wait already; none of links that do not say, or while it is broken."""
        link = self._link
        found: list[bytes] = []
        if isinstance(link, DatagramLink):
            try:
                found.extend(link.waiting())
            except SourceError as error:
                self._lost(link, error)
        return found

    def write(self, data: bytes) -> None:
        """Sends bytes; while the link is broken they are lost, as on a radio."""
        link = self._link
        if link is None:
            return
        try:
            link.write(data)
        except SourceError as error:
            self._lost(link, error)

    def close(self) -> None:
        """Ends the link."""
        if self._link is not None:
            self._link.close()

    def _lost(self, link: AnyLink, error: SourceError) -> None:
        link.close()
        self._link = None
        self._tried = self._clock()
        self.losses += 1
        self.broken = error.what

    def _again(self) -> AnyLink | None:
        if self._clock() - self._tried < AGAIN_S:
            return None
        self._tried = self._clock()
        try:
            self._link = self._open_one()
        except SourceError as error:
            self.broken = error.what
            return None
        self.broken = ""
        return self._link


def open_lasting(address: str) -> AnyLink:
    """Opens a link by its address; one that can break and come back is opened again by itself.

    Raises:
        SourceError: the address is malformed, or the link cannot be opened.
    """
    if is_link(address) or address.startswith(BUS_SCHEME):
        return ReconnectingLink(lambda: open_link(address))
    return open_link(address)
