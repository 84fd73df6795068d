"""One link being listened to, step by step."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from gcs_sysid.live import document
from gcs_sysid.live.document import Outside
from gcs_sysid.live.showing import Show
from gcs_sysid.live.station import Station
from gcs_sysid.sources.link import Mailbox, now_us
from gcs_sysid.sources.rates import Rates
from gcs_sysid.sources.recorder import Recorder
from gcs_sysid.sources.requests import Requests
from gcs_sysid.sources.signing import Signatures
from gcs_sysid.sources.stream import Batch, FrameStream

PATIENCE_S = 0.1
"""Longest wait for news [s], and so for a wish to stop to be noticed."""
TURN_US = 50_000
"""The filter lets the recording go on at least so often [µs]."""
PUBLISH_S = 1.0
MAIN, BUS = 0, 1
"""Numbers of the links that share a mailbox: the vehicle's, and a CAN bus beside it."""


@dataclass(frozen=True)
class Clock:
    """Time as a run sees it: seconds that never fall, and the ground station's own [µs]."""

    seconds: Callable[[], float] = time.monotonic
    us: Callable[[], int] = now_us


@dataclass(frozen=True)
class Line:
    """How a link is doing.

    Attributes:
        losses: how often it broke.
        broken: why it is down; empty while it is up.
    """

    losses: int = 0
    broken: str = ""


@dataclass(frozen=True)
class Asking:
    """What is asked of the vehicle, and the way to it."""

    requests: Requests
    send: Callable[[bytes], None]


class Session:
    """One link being listened to.

    Args:
        link: its address, for people.
        mailbox: what the links bring.
        recorder: where it goes first.
        station: what is made of it.
        publish: gets the live document once a second.
        clock: time.
        signatures: lets frames with a good signature through only; None lets all through.
        asking: what is asked of the vehicle; None sends nothing.
        line: how the link is doing.
    """

    def __init__(
        self,
        link: str,
        *,
        mailbox: Mailbox,
        recorder: Recorder,
        station: Station,
        publish: Show,
        clock: Clock,
        signatures: Signatures | None = None,
        asking: Asking | None = None,
        line: Callable[[], Line] = Line,
    ) -> None:
        self._link = link
        self._mailbox = mailbox
        self._recorder = recorder
        self._station = station
        self._publish = publish
        self._clock = clock
        # Frames of two links would cut each other's; a bus at this computer is not signed.
        self._frames = {MAIN: FrameStream(signatures=signatures), BUS: FrameStream()}
        self._asking = asking
        self._line = line
        self._rates = Rates()
        self._opened = self._published = clock.seconds()
        self._heard: float | None = None
        self.ready = threading.Event()

    @property
    def heard(self) -> bool:
        """Whether the vehicle's link brought anything."""
        return self._heard is not None

    @property
    def silence(self) -> float:
        """Time since something arrived, or since the start [s]."""
        since = self._opened if self._heard is None else self._heard
        return self._clock.seconds() - since

    @property
    def exhausted(self) -> bool:
        """Whether the link is closed and everything it brought was worked on."""
        return self._mailbox.closed and self._mailbox.empty and self._station.idle

    def turn(self) -> None:
        """Records what has arrived, then filters for a while, then publishes if it is time.

        Raises:
            SourceError: the recording cannot go on.
        """
        working = self.ready.is_set() and not self._station.idle
        for chunk in self._mailbox.take(0.0 if working else PATIENCE_S):
            batch = self._frames[chunk.link].feed(chunk.data, chunk.link_us)
            self._recorder.write(batch)
            now = self._clock.seconds()
            if chunk.link == MAIN:
                self._heard = now
            try:
                self._look(batch, now)
            except Exception as error:  # noqa: BLE001 - it is recorded already
                self._station.failures.note("decoding, which leaves out messages", error)
        self._recorder.sync()
        self._ask()
        if self.ready.is_set():
            try:
                self._station.work(self._clock.us() + TURN_US)
            except Exception as error:  # noqa: BLE001 - the recording goes on
                self._station.restart(error)
        if self._clock.seconds() - self._published >= PUBLISH_S:
            self._published = self._clock.seconds()
            self._publish(self.document())

    def _look(self, batch: Batch, now: float) -> None:
        """What is made of frames that are recorded."""
        self._station.receive(batch)
        tables = batch.tables()
        self._rates.add({key.name: table.count for key, table in tables.items()}, now)
        if self._asking is not None:
            self._asking.requests.heard(self._station.decoder.vehicle, tables, now)

    def _ask(self) -> None:
        if self._asking is not None:
            for frame in self._asking.requests.due(self._clock.seconds()):
                self._asking.send(frame)

    def _phase(self) -> str:
        line = self._line()
        if line.broken:
            return f"link lost ({line.broken}), trying again"
        compiling = "" if self.ready.is_set() else "; the filter is being compiled"
        if not self.heard:
            return f"waiting for data on {self._link} ({self.silence:.0f} s){compiling}"
        if compiling:
            return f"recording{compiling}"
        quiet = f", quiet for {self.silence:.0f} s" if self.silence >= 2.0 else ""
        return self._station.phase() + quiet

    def document(self, phase: str | None = None) -> dict[str, Any]:
        """The live document now; without what is known where that cannot be told.

        Args:
            phase: what is going on; None says what it is.
        """
        around = self._outside(phase or self._phase())
        try:
            return document.document(self._station, around)
        except Exception as error:  # noqa: BLE001 - the recording goes on, and says what is wrong
            self._station.failures.note("the live document", error)
            return document.bare(self._station, around)

    def _outside(self, phase: str) -> Outside:
        """What the document says of link and recording."""
        now = self._clock.seconds()
        line = self._line()
        lost = {"mailbox_full": self._mailbox.dropped}
        for stream in self._frames.values():
            lost = {**lost, **{k: lost.get(k, 0) + n for k, n in stream.lost.items()}}
        return Outside(
            link=self._link,
            phase=phase,
            now_us=self._clock.us(),
            recorded=self._recorder.frames,
            lost={**lost, **{k: n for k, n in self._station.decoder.can.lost.items() if n}},
            health={
                "up": not line.broken,
                "why": line.broken,
                "losses": line.losses,
                "silence_s": round(self.silence, 2),
                "streams": {
                    name: {
                        "rate_hz": round(self._rates.rate(name, now), 1),
                        "age_s": round(now - last, 2),
                    }
                    for name, last in sorted(self._rates.last.items())
                },
                "requests": {} if self._asking is None else self._asking.requests.told(now),
            },
        )
