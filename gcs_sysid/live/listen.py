"""`listen`: a link recorded, reconstructed while it goes on, and identified when it falls quiet.

The recording comes before everything else: a chunk is on its way to the disk before anybody looks
into it, the filter works in short turns in between, and whoever shows its results may fail.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Generator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import SourceError
from gcs_sysid.estimate.file_prior import file_prior
from gcs_sysid.live import showing, snapshot, warming
from gcs_sysid.live.handing import Thing, handed_on
from gcs_sysid.live.inside_beside import Beside
from gcs_sysid.live.session import BUS, Asking, Clock, Line, Session
from gcs_sysid.live.showing import Show
from gcs_sysid.live.station import Compiled, Station
from gcs_sysid.offline import documents
from gcs_sysid.sources.can.tunnel import SCHEME as BUS_SCHEME
from gcs_sysid.sources.link import LinkReader, Mailbox, bytes_per_second, is_link
from gcs_sysid.sources.reconnecting import ReconnectingLink, open_lasting
from gcs_sysid.sources.recorder import PART_BYTES, Recorder
from gcs_sysid.sources.requests import Needs, Requests
from gcs_sysid.sources.sender import Sender
from gcs_sysid.sources.signing import Signatures, load_key

RECORDING, LIVE = "recording.tlog", "live.json"
FLOWN = "aircraft-flown.toml"
"""The aircraft file as it was when listening began: whoever edits it meanwhile changes nothing."""
QUIET_S = 10.0
SWITCH_S = 0.0001
"""The thread that reads the link waits no longer for its turn; with Python's own fifty times that
the system's buffer overflows at thousands of datagrams a second."""

_LOG = logging.getLogger(__name__)
_CLOCK = Clock()


@dataclass(frozen=True)
class Options:
    """How to listen.

    Attributes:
        prior: start the first model from the file's aerodynamics, or ignore their values.
        vehicle: MAVLink system id to follow; None takes the first autopilot heard.
        quiet_after: silence after data that ends the run [s].
        resume: continue the recording and the model that the folder holds.
        sign_key: file with the secret key: frames without a good signature are left out, and what
            is sent is signed.
        silent: send nothing, not even a heartbeat.
        can: bus beside the link, `can:INTERFACE:CHANNEL`.
        part_bytes: size at which another part of the recording begins.
    """

    prior: Literal["file", "none"] = "file"
    vehicle: int | None = None
    quiet_after: float = QUIET_S
    resume: bool = False
    sign_key: Path | None = None
    silent: bool = False
    can: str | None = None
    part_bytes: int = PART_BYTES


@dataclass(frozen=True)
class Ending:
    """How listening ended.

    Attributes:
        why: `quiet`, `stopped` by the user, or `closed` by the other end.
        live: the last live document.
        recording: the newest part of the recording.
        parts: all parts, the newest last.
        note: what the link said when it closed; empty otherwise.
    """

    why: Literal["quiet", "stopped", "closed"]
    live: Mapping[str, Any]
    recording: Path
    note: str = ""
    parts: tuple[Path, ...] = ()


def run(
    link: str,
    aircraft: Aircraft,
    options: Options,
    *,
    out: Path,
    show: Show,
    stopped: Callable[[], bool],
    say: Callable[[str], None] = _LOG.info,
    clock: Clock = _CLOCK,
    prepare: Callable[[], None] | None = None,
) -> Ending:
    """Listens until the link falls quiet, is closed, or the user has enough.

    Args:
        link: address.
        aircraft: its file.
        options: how to listen.
        out: existing folder for `recording.tlog`, `live.json` and the model's snapshots.
        show: gets the live document once a second, in a thread of its own; while it is busy it
            misses some, and when it fails, listening goes on without.
        stopped: whether the user wants to end.
        say: takes a sentence for the user, now and then.
        clock: time.
        prepare: called in the process of the filter with the aerodynamics inside, before it
            computes; None leaves that filter out.

    Raises:
        SourceError: a link cannot be opened, nothing at all arrived, or the recording failed.
        InputError: the model's snapshot cannot be continued.
    """
    sys.setswitchinterval(SWITCH_S)
    believed = file_prior(aircraft) if options.prior == "file" else None
    compiled = Compiled(aircraft)
    inside = None if prepare is None else Beside(prepare, aircraft, believed)
    station = Station(
        aircraft,
        compiled,
        prior=believed,
        vehicle=options.vehicle,
        clock_us=clock.us,
        inside=inside,
    )
    if options.can is not None and not options.can.startswith(BUS_SCHEME):
        raise SourceError(options.can, "is no CAN bus", fix="write it as can:socketcan:can0")
    key = load_key(options.sign_key) if options.sign_key is not None else None
    mailbox = Mailbox()
    with ExitStack() as opened:
        publish = opened.enter_context(_publishing(out, show, station, clock))
        main = opened.enter_context(open_lasting(link))
        bus = None if options.can is None else opened.enter_context(open_lasting(options.can))
        recorder = opened.enter_context(
            Recorder(out / RECORDING, append=options.resume, part_bytes=options.part_bytes)
        )
        if options.resume:
            say(_resumed(recorder, station, out))
        reader = LinkReader(main, mailbox, clock_us=clock.us)
        asks = is_link(link) and not options.silent
        session = Session(
            link,
            mailbox=mailbox,
            recorder=recorder,
            station=station,
            publish=publish,
            clock=clock,
            signatures=None if key is None else Signatures(key),
            asking=Asking(Requests(Sender(key), _needs(aircraft, link)), reader.send)
            if asks
            else None,
            line=lambda: _line(main),
        )
        with ExitStack() as running:
            running.enter_context(reader)
            if bus is not None:
                beside = LinkReader(bus, mailbox, clock_us=clock.us, number=BUS)
                running.enter_context(beside)
            running.enter_context(warming.started(aircraft, compiled, believed, session.ready))
            running.callback(station.processes.close)
            if inside is not None:
                running.callback(inside.close)
            why = _listen(session, stopped, options.quiet_after)
        note = _line(main).broken or ("" if reader.failure is None else reader.failure.what)
        if session.heard:
            last = session.document(f"ended: {note or why}")
            publish(last)
            return Ending(why, last, out / RECORDING, note, tuple(recorder.parts))
    if not options.resume:
        for name in (RECORDING, LIVE, snapshot.NAME):
            (out / name).unlink(missing_ok=True)
    raise reader.failure or SourceError(
        link,
        f"nothing was received in {session.silence:.0f} s",
        fix="check that the vehicle sends to this address and port",
    )


def _line(link: object) -> Line:
    if isinstance(link, ReconnectingLink):
        return Line(link.losses, link.broken)
    return Line()


def _needs(aircraft: Aircraft, link: str) -> Needs:
    return Needs(
        vanes=aircraft.vanes is not None,
        motor_speeds=any(engine.rpm is not None for engine in aircraft.propulsion),
        bytes_per_second=bytes_per_second(link),
    )


def _resumed(recorder: Recorder, station: Station, out: Path) -> str:
    """Lets the model go on from its snapshot; returns what was found, in a sentence."""
    found = recorder.interrupted
    if found is None:
        return f"nothing to resume in {out}: a new recording begins"
    cut = f", {found.cut_bytes} bytes of a cut frame taken off" if found.cut_bytes else ""
    words = f"{recorder.path.name} goes on{cut}"
    path = out / snapshot.NAME
    if not path.exists():
        return f"{words}; there is no snapshot of the model, it begins anew"
    restored = snapshot.restore(path, station.model, station.processes, station.inside)
    station.decoder.remember(restored.parameters)
    if not restored.processes:
        words += "; the Gaussian processes begin anew"
    if found.last_us is None:
        return f"{words}; the model goes on from its snapshot"
    behind = max(found.last_us - restored.time_us, 0) * 1e-6
    return f"{words}; the model goes on from {behind:.1f} s before the end of the recording"


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


@contextmanager
def _publishing(
    out: Path, show: Show, station: Station, clock: Clock
) -> Generator[Show, None, None]:
    """Yields what writes the document, hands it on to be shown, and keeps the model.

    None of these may stop the recording, or hold up the filter where a disk is slow: each writes in
    a thread of its own, the newest of what waits; what could not be written is tried again with the
    next.
    """

    def attempt(name: str, action: Callable[[Thing], None]) -> Callable[[Thing], None]:
        def tried(thing: Thing) -> None:
            try:
                action(thing)
            except Exception as error:  # noqa: BLE001 - a disk may fail in any way
                station.failures.note(f"{name}, which is tried again", error)

        return tried

    kept = clock.seconds()
    with (
        showing.shown(show) as tell,
        handed_on(attempt(LIVE, lambda it: documents.write_json(out / LIVE, it)), LIVE) as write,
        handed_on(
            attempt(snapshot.NAME, lambda it: snapshot.write(out / snapshot.NAME, it)),
            snapshot.NAME,
        ) as keep,
    ):

        def take(link_us: int) -> None:
            keep(
                snapshot.taken(
                    station.model,
                    station.processes,
                    station.inside,
                    time_us=link_us,
                    updates=station.updates,
                    parameters=station.decoder.parameters,
                )
            )

        def publish(document: Mapping[str, Any]) -> None:
            nonlocal kept
            tell(document)
            write(document)
            if station.newest is not None and clock.seconds() - kept >= snapshot.EVERY_S:
                kept = clock.seconds()
                attempt(snapshot.NAME, take)(station.newest.row.link_us)

        yield publish


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
    # Only now: what identification takes would stand in memory throughout the flight.
    from gcs_sysid.offline import identify

    return identify.run(
        list(ending.parts or (ending.recording,)),
        aircraft,
        prior=prior,
        segments=None,
        vehicle=vehicle if vehicle is not None else ending.live["vehicle"],
        method="auto",
        stepwise=False,
        out=out,
        progress=progress,
    )


def recorded(folder: Path) -> bool:
    """Whether a folder holds a recording, or parts of one."""
    path = folder / RECORDING
    return path.exists() or any(folder.glob(f"{path.stem}-[0-9]*{path.suffix}"))


def load(aircraft: Path) -> Aircraft:
    """The aircraft file."""
    return aircraft_file.load(aircraft)
