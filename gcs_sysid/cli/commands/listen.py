"""`listen`: a live link recorded, reconstructed while it goes on, and identified at its end."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import click

from gcs_sysid.cli import live_view, numerics, options, output, reports
from gcs_sysid.errors import InputError

WRITES = (
    *("model", "summary.json", "samples.parquet", "report.html", "live.json"),
    *("live-model.npz", "aircraft-flown.toml"),
)


@click.command("listen")
@click.argument("link")
@options.aircraft()
@click.option(
    "--prior",
    type=click.Choice(["file", "none"]),
    default="file",
    show_default=True,
    help="Start from the aircraft file's aerodynamics, or ignore them.",
)
@click.option(
    "--quiet-after", metavar="S", type=click.FloatRange(min=0.0, min_open=True), default=10.0,
    show_default=True, help="The flight is over when the link was silent for so many seconds.",
)  # fmt: skip
@click.option(
    "--resume", is_flag=True,
    help="Continue the recording and the first model that the folder holds.",
)  # fmt: skip
@click.option(
    "--listen-only", is_flag=True,
    help="Send nothing, neither heartbeats nor requests for the streams that are needed.",
)  # fmt: skip
@click.option(
    "--can", metavar="BUS",
    help="CAN bus with DroneCAN sensors at this computer: can:socketcan:can0, "
    "can:udp_multicast:239.74.163.2, can:slcan:/dev/ttyACM0,1000000 (interfaces of python-can).",
)  # fmt: skip
@click.option(
    "--part-size", metavar="MB", type=click.IntRange(min=1), default=256, show_default=True,
    help="Begin another part of the recording whenever it reaches this size.",
)  # fmt: skip
@click.option(
    "--sign-key", metavar="FILE", type=options.Existing("file"),
    help="Take signed MAVLink only, and sign what is sent; FILE holds the key: 32 bytes, 64 hex "
    "digits or a passphrase.",
)  # fmt: skip
@click.option(
    "--dashboard/--no-dashboard", default=True, show_default=True,
    help="Serve a web page of it on this computer, in a process of its own.",
)  # fmt: skip
@options.vehicle
@click.option(
    "--out", metavar="DIR", type=click.Path(path_type=Path, file_okay=False),
    help="Folder for the results; ./listen-DATE-TIME unless given.",
)  # fmt: skip
@options.as_json
def command(
    link: str,
    aircraft: Path,
    prior: Literal["file", "none"],
    quiet_after: float,
    resume: bool,
    listen_only: bool,
    can: str | None,
    part_size: int,
    sign_key: Path | None,
    dashboard: bool,
    vehicle: int | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Listen to a live LINK: record it, and learn while it flies.

    LINK is udp:HOST:PORT, tcp:HOST:PORT, a serial device as /dev/ttyUSB0,57600,
    mavsdk:udpin://HOST:PORT, or a .tlog that another program is writing. Every frame goes to
    recording.tlog at once; states, coefficients and a first model are shown once a second and
    written to live.json. The vehicle is asked for streams that come too slowly. A link that breaks
    is opened again. When it falls quiet, or at Ctrl-C, the recording is identified.
    """
    numerics.compute_in_one_thread()
    from gcs_sysid.live import listen

    numerics.enable()
    begun = datetime.now(UTC)
    chosen = out if out is not None else Path(f"listen-{begun:%Y%m%d-%H%M%S}")
    listen.load(aircraft)
    with output.folder(chosen, Path(link), "listen", WRITES) as destination:
        with (
            _kept(aircraft, destination, resume=resume, to_stderr=as_json) as flown,
            _dashboard(destination, wanted=dashboard),
            _stopping() as stopped,
            live_view.opened(to_stderr=as_json) as show,
        ):
            ending = listen.run(
                link,
                listen.load(flown),
                listen.Options(
                    prior=prior,
                    vehicle=vehicle,
                    quiet_after=quiet_after,
                    resume=resume,
                    sign_key=sign_key,
                    silent=listen_only,
                    can=can,
                    part_bytes=part_size << 20,
                ),
                out=destination,
                show=show,
                stopped=stopped,
                say=lambda words: live_view.say(words, to_stderr=as_json),
                prepare=numerics.enable,
            )
        live_view.say(f"{_why(ending)}; recorded to {ending.recording}", to_stderr=as_json)
        with output.progress(f"identify {ending.recording.name}") as progress:
            summary = _identified(ending, flown, prior, vehicle, destination, progress)
        text = reports.write("identify", summary, destination / "samples.parquet")
    output.show(summary, text, as_json=as_json)


def _why(ending: Any) -> str:
    words = {
        "quiet": f"The link fell quiet ({ending.note})" if ending.note else "The link fell quiet",
        "stopped": "Stopped",
        "closed": f"The link ended ({ending.note})" if ending.note else "The link ended",
    }
    return words[ending.why]


def _identified(
    ending: Any,
    aircraft: Path,
    prior: Literal["file", "none"],
    vehicle: int | None,
    out: Path,
    progress: output.Progress,
) -> dict[str, Any]:
    """The summary; where the flight cannot be identified, what was kept is said with the reason."""
    from gcs_sysid.live import listen

    try:
        return listen.identified(
            ending, aircraft, prior=prior, vehicle=vehicle, out=out, progress=progress
        )
    except InputError as error:
        raise InputError(
            error.where,
            f"recorded, but not identified: {error.what}",
            fix=error.fix,
        ) from error


@contextmanager
def _kept(
    aircraft: Path, folder: Path, *, resume: bool, to_stderr: bool
) -> Generator[Path, None, None]:
    """The aircraft file as it was when the recording began, beside it; gone where there is none."""
    from gcs_sysid.live import listen

    flown = folder / listen.FLOWN
    if not (flown.exists() and listen.recorded(folder)):
        shutil.copyfile(aircraft, flown)
    elif resume and flown.read_bytes() != aircraft.read_bytes():
        live_view.say(
            f"{aircraft} is not what this flight began with: it goes on with {flown}; move that "
            "away to go on with the other",
            to_stderr=to_stderr,
        )
    try:
        yield flown
    finally:
        if not listen.recorded(folder):
            flown.unlink(missing_ok=True)


@contextmanager
def _dashboard(folder: Path, *, wanted: bool) -> Generator[None, None, None]:
    """A page of what is written into `folder`; its process can neither slow nor stop this one."""
    if not wanted:
        yield
        return
    words = ["dashboard", str(folder), "--of", str(os.getpid())]
    # Ctrl-C in the terminal is for this process; the page ends with it.
    process = subprocess.Popen(  # noqa: S603 - this program itself, with arguments of its own
        [sys.executable, "-m", "gcs_sysid", *words],
        stdin=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        yield
    finally:
        process.terminate()
        process.wait()


@contextmanager
def _stopping() -> Generator[Callable[[], bool], None, None]:
    """Lets Ctrl-C and SIGTERM end the listening, not the program; afterwards they end that too."""
    asked = threading.Event()

    def ask(_signal: int, _frame: object) -> None:
        asked.set()

    signals = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, ask) for number in signals}
    try:
        yield asked.is_set
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
