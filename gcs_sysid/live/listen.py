"""`listen`: a link recorded, reconstructed while it goes on, and identified when it falls quiet.

The recording comes before everything else: a chunk is on its way to the disk before anybody looks
into it, the filter works in short turns in between, and whoever shows its results may fail.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import SourceError
from gcs_sysid.live import document, warming
from gcs_sysid.live.station import Compiled, Station
from gcs_sysid.offline import documents, identify
from gcs_sysid.offline.identify import file_prior
from gcs_sysid.sources.link import LinkReader, Mailbox, now_us, open_link
from gcs_sysid.sources.recorder import Recorder
from gcs_sysid.sources.signing import Signatures, load_key
from gcs_sysid.sources.stream import FrameStream

RECORDING, LIVE = "recording.tlog", "live.json"
QUIET_S = 10.0
PATIENCE_S = 0.1
"""Longest wait for news [s], and so for a wish to stop to be noticed."""
TURN_US = 50_000
"""The filter lets the recording go on at least so often [µs]."""
PUBLISH_S = 1.0

Show = Callable[[Mapping[str, Any]], None]
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Clock:
    """Time as a run sees it: seconds that never fall, and the ground station's own [µs]."""

    seconds: Callable[[], float] = time.monotonic
    us: Callable[[], int] = now_us


@dataclass(frozen=True)
class Ending:
    """How listening ended.

    Attributes:
        why: `quiet`, `stopped` by the user, or `closed` by the other end.
        live: the last live document.
        recording: the recording.
        note: what the link said when it closed; empty otherwise.
    """

    why: Literal["quiet", "stopped", "closed"]
    live: Mapping[str, Any]
    recording: Path
    note: str = ""


class Session:
    """One link being listened to, step by step.

    Args:
        link: its address, for people.
        mailbox: what the link brings.
        recorder: where it goes first.
        station: what is made of it.
        publish: gets the live document once a second.
        clock: time.
        signatures: lets frames with a good signature through only; None lets all through.
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
    ) -> None:
        self._link = link
        self._mailbox = mailbox
        self._recorder = recorder
        self._station = station
        self._publish = publish
        self._clock = clock
        self._frames = FrameStream(signatures=signatures)
        self._opened = self._published = clock.seconds()
        self._heard: float | None = None
        self.ready = threading.Event()

    @property
    def heard(self) -> bool:
        """Whether anything arrived."""
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
            batch = self._frames.feed(chunk.data, chunk.link_us)
            self._recorder.write(batch)
            self._station.receive(batch)
            self._heard = self._clock.seconds()
        if self.ready.is_set():
            self._station.work(self._clock.us() + TURN_US)
        if self._clock.seconds() - self._published >= PUBLISH_S:
            self._published = self._clock.seconds()
            self._publish(self.document(self._phase()))

    def _phase(self) -> str:
        if not self.heard:
            return f"waiting for data on {self._link} ({self.silence:.0f} s)"
        if not self.ready.is_set():
            return "recording; the filter is being compiled"
        quiet = f", quiet for {self.silence:.0f} s" if self.silence >= 2.0 else ""
        return self._station.phase() + quiet

    def document(self, phase: str) -> dict[str, Any]:
        """The live document now."""
        return document.document(
            self._station,
            link=self._link,
            phase=phase,
            recorded=self._recorder.frames,
            lost={**self._frames.lost, "mailbox_full": self._mailbox.dropped},
        )


def run(
    link: str,
    aircraft: Aircraft,
    *,
    prior: Literal["file", "none"],
    vehicle: int | None,
    quiet_after: float,
    resume: bool,
    out: Path,
    show: Show,
    stopped: Callable[[], bool],
    sign_key: Path | None = None,
    clock: Clock = Clock(),
) -> Ending:
    """Listens until the link falls quiet, is closed, or the user has enough.

    Args:
        link: address.
        aircraft: its file.
        prior: start the first model from the file's aerodynamics, or ignore their values.
        vehicle: MAVLink system id to follow; None takes the first autopilot heard.
        quiet_after: silence after data that ends the run [s].
        resume: continue the recording that `out` holds.
        out: existing folder for `recording.tlog` and `live.json`.
        show: gets the live document once a second; when it fails, listening goes on without.
        stopped: whether the user wants to end.
        sign_key: file with the secret key; frames without a good signature are then left out.
        clock: time.

    Raises:
        SourceError: the link cannot be opened, nothing at all arrived, or the recording failed.
    """
    believed = file_prior(aircraft) if prior == "file" else None
    compiled = Compiled(aircraft)
    station = Station(aircraft, compiled, prior=believed, vehicle=vehicle, clock_us=clock.us)
    mailbox = Mailbox()
    publish = _publisher(out / LIVE, show)
    signatures = Signatures(load_key(sign_key)) if sign_key is not None else None
    with open_link(link) as opened, Recorder(out / RECORDING, append=resume) as recorder:
        session = Session(
            link,
            mailbox=mailbox,
            recorder=recorder,
            station=station,
            publish=publish,
            clock=clock,
            signatures=signatures,
        )
        with (
            LinkReader(opened, mailbox, clock_us=clock.us) as reader,
            warming.started(aircraft, compiled, session.ready),
        ):
            why = _listen(session, stopped, quiet_after)
        note = "" if reader.failure is None or why != "closed" else reader.failure.what
    if not session.heard:
        if not resume:
            (out / RECORDING).unlink()
            (out / LIVE).unlink(missing_ok=True)
        raise reader.failure or SourceError(
            link,
            f"nothing was received in {session.silence:.0f} s",
            fix="check that the vehicle sends to this address and port",
        )
    last = session.document(f"ended: {note or why}")
    publish(last)
    return Ending(why, last, out / RECORDING, note)


def _listen(
    session: Session, stopped: Callable[[], bool], quiet_after: float
) -> Literal["quiet", "stopped", "closed"]:
    while True:
        session.turn()
        if stopped():
            return "stopped"
        if session.exhausted:
            return "closed"
        if session.heard and session.silence >= quiet_after:
            return "quiet"


def _publisher(path: Path, show: Show) -> Show:
    """Writes the document and shows it; neither may stop the recording."""
    failed: set[str] = set()

    def attempt(name: str, action: Callable[[], None]) -> None:
        if name in failed:
            return
        try:
            action()
        except Exception as error:  # noqa: BLE001 - a display may fail in any way
            failed.add(name)
            _LOG.warning("%s failed, listening goes on without: %s", name, error)

    def publish(document: Mapping[str, Any]) -> None:
        attempt(LIVE, lambda: documents.write_json(path, document))
        attempt("display", lambda: show(document))

    return publish


def identified(
    ending: Ending,
    aircraft: Path,
    *,
    prior: Literal["file", "none"],
    vehicle: int | None,
    out: Path,
    progress: Callable[[str, float], None],
) -> dict[str, Any]:
    """What `identify` makes of the recording, in the same folder.

    Raises:
        InputError: the recording cannot be used; it stays.
    """
    return identify.run(
        [ending.recording],
        aircraft,
        prior=prior,
        segments=None,
        vehicle=vehicle if vehicle is not None else ending.live["vehicle"],
        stepwise=False,
        out=out,
        progress=progress,
    )


def load(aircraft: Path) -> Aircraft:
    """The aircraft file."""
    return aircraft_file.load(aircraft)
