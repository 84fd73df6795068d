"""`sitl`: a simulated aircraft whose truth is known."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gcs_sysid.cli import needs, options, output
from gcs_sysid.errors import UsageError

if TYPE_CHECKING:
    from gcs_sysid.sitl.scenario import PlannedFlight

_WHAT_TO_FLY = "give --aircraft FILE and --record FILE.tlog or --link, or --scenario FILE"

_FILES = ("record", "truth", "hidden")

seed = click.option(
    "--seed", metavar="N", type=click.IntRange(0, 2**31 - 1), default=0, show_default=True,
    help="Seed of turbulence, sensor noise and radio: the same seed, the same file.",
)  # fmt: skip
wind = click.option(
    "--wind", metavar="DEG SPEED", type=float, nargs=2, default=(0.0, 0.0),
    help="Steady wind: where it blows from [deg], how fast [m/s].",
)  # fmt: skip
gust = click.option(
    "--gust", metavar="SIGMA", type=click.FloatRange(min=0.0), default=0.0, show_default=True,
    help="Standard deviation of vertical gusts [m/s]; horizontal ones follow (MIL-F-8785C).",
)  # fmt: skip


@click.command("sitl")
@options.aircraft(required=False)
@click.option(
    "--record",
    metavar="FILE.tlog",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Fly the standard flight and record it here; with --link, what arrives there.",
)
@click.option(
    "--truth",
    metavar="FILE.npz",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write what really happened here: rows, cols, t0_us; what is hidden goes to FILE.json.",
)
@click.option(
    "--effect",
    "effects",
    metavar="FILE",
    type=options.Existing("effect file"),
    multiple=True,
    help="Hide in the flight what this file names; may be given several times.",
)
@click.option(
    "--link",
    metavar="LINK",
    help="Fly in real time and speak MAVLink here instead: udpout:127.0.0.1:14550, tcpin:HOST:PORT "
    "(waits for a client), tcp:HOST:PORT, or a serial device.",
)
@click.option(
    "--duration",
    metavar="SECONDS",
    type=click.FloatRange(min=0.0, min_open=True),
    help="With --link: stop after that time instead of when interrupted.",
)
@seed
@wind
@gust
@click.option(
    "--scenario",
    metavar="FILE",
    type=options.Existing("scenario"),
    help="Fly the flights of a scenario instead, and record them where it says.",
)
@click.option(
    "--out",
    metavar="DIR",
    type=click.Path(path_type=Path, file_okay=False),
    help="With --scenario: folder for flights that do not say where they are recorded, and truths.",
)
@options.as_json
def command(
    aircraft: Path | None,
    record: Path | None,
    truth: Path | None,
    effects: tuple[Path, ...],
    link: str | None,
    duration: float | None,
    seed: int,
    wind: tuple[float, float],
    gust: float,
    scenario: Path | None,
    out: Path | None,
    as_json: bool,
) -> None:  # fmt: skip
    """Fly an aircraft file in JSBSim, recorded or live.

    The recording is what a ground station would have kept; the truth is known. With --link it is a
    vehicle that ground stations connect to.
    """
    needs.jsbsim()
    if link is None and duration is not None:
        raise UsageError("--duration belongs to --link; a recording has its flight's length")
    if scenario is None and out is not None:
        raise UsageError("--out belongs to --scenario; one flight goes to --record FILE.tlog")
    if link is not None:
        if scenario is not None:
            raise UsageError("--link flies live, --scenario to files; leave one of them out")
        planned = _hiding(_standard(aircraft, record, truth, seed, wind, gust), effects)
        live = _fly_live(planned, link, duration)
        output.show(live, _live_text(live), as_json=as_json)
        return
    from gcs_sysid.sitl import scenario as scenarios

    if scenario is not None:
        if aircraft is not None or record is not None or truth is not None or effects:
            raise UsageError("--scenario says what to fly and where to record it; leave out others")
        flights = [_placed(planned, out) for planned in scenarios.load(scenario).flights]
    else:
        if record is None:
            raise UsageError(_WHAT_TO_FLY)
        flights = [_hiding(_standard(aircraft, record, truth, seed, wind, gust), effects)]
    flown = [_fly(planned) for planned in flights]
    output.show({"flights": flown}, _text(flown), as_json=as_json)


def _standard(
    aircraft: Path | None,
    record: Path | None,
    truth: Path | None,
    seed: int,
    wind: tuple[float, float],
    gust: float,
) -> PlannedFlight:
    from gcs_sysid import aircraft_file
    from gcs_sysid.sitl import plan, scenario
    from gcs_sysid.sitl.flight import Flight
    from gcs_sysid.sitl.scenario import PlannedFlight

    if aircraft is None:
        raise UsageError(_WHAT_TO_FLY)
    loaded = aircraft_file.load(aircraft)
    legs = plan.standard(loaded)
    direction, speed = wind
    return PlannedFlight(
        "live" if record is None else record.stem,
        Flight(
            believed=loaded,
            flown=loaded,
            legs=legs,
            start=scenario.start(legs[0]),
            wind=scenario.wind(math.radians(direction), speed, gust),
            seed=seed,
        ),
        record=record,
        truth=truth,
    )


def _hiding(planned: PlannedFlight, files: Sequence[Path]) -> PlannedFlight:
    from gcs_sysid.sitl import scenario
    from gcs_sysid.sitl.effects import catalogue

    if planned.truth is not None and planned.truth.suffix == ".json":
        raise UsageError("--truth names a .npz; what is hidden goes to a .json beside it")
    loaded = [catalogue.load(file) for file in files]
    entries = [entry for file in loaded for entry in file.effects]
    more = {key: value for file in loaded for key, value in file.truth.items()}
    return scenario.hiding(planned, entries, more)


def _placed(planned: PlannedFlight, out: Path | None) -> PlannedFlight:
    """The flight with a place for its recording and truth."""
    if planned.record is not None:
        return planned
    if out is None:
        raise UsageError(
            f"flight `{planned.name}` does not say where to `record` it; give --out DIR"
        )
    out.mkdir(parents=True, exist_ok=True)
    truth = planned.truth or out / f"{planned.name}_truth.npz"
    return replace(planned, record=out / f"{planned.name}.tlog", truth=truth)


def _fly_live(planned: PlannedFlight, link: str, duration: float | None) -> Mapping[str, Any]:
    from gcs_sysid.sitl import live
    from gcs_sysid.sitl import truth as truths

    flight = replace(planned.flight, epoch_us=time.time_ns() // 1000)
    witness = None if planned.truth is None else truths.Witness(flight)
    with contextlib.ExitStack() as opened:
        wire = opened.enter_context(live.Link(link))
        record = opened.enter_context(planned.record.open("wb")) if planned.record else None
        vehicle = live.LiveVehicle(flight, wire, record=record, witness=witness)
        click.echo(f"Flying; speaks MAVLink to {link}. Ctrl-C ends it.", err=True)
        # Interrupting is how a live flight ends.
        with contextlib.suppress(KeyboardInterrupt):
            live.fly(vehicle, duration=duration)
    if planned.truth is not None and witness is not None:
        told = {**planned.told, "epoch_us": flight.epoch_us, "duration_s": vehicle.time}
        truths.save(witness.truth(), planned.truth, rate=planned.truth_rate, told=told)
    return {
        "link": link,
        "duration_s": vehicle.time,
        "sent": vehicle.sent,
        **_files(planned),
    }


def _live_text(live: Mapping[str, Any]) -> str:
    words = f"{live['duration_s']:.0f} s flown, {live['sent']} messages sent to {live['link']}"
    return "\n".join([words, *(live[key] for key in _FILES if live[key])])


def _files(planned: PlannedFlight) -> Mapping[str, str | None]:
    """Where the recording, the truth and what is hidden have been written."""
    from gcs_sysid.sitl import truth

    hidden = None if planned.truth is None else truth.beside(planned.truth)
    paths = (planned.record, planned.truth, hidden)
    return {
        key: None if path is None else str(path) for key, path in zip(_FILES, paths, strict=True)
    }


def _fly(planned: PlannedFlight) -> Mapping[str, Any]:
    from gcs_sysid.sitl import record

    begun = time.perf_counter()
    duration = planned.flight.duration
    with output.progress(f"sitl {planned.name}") as progress:
        flown = record.run(
            planned.flight,
            record=planned.record,
            truth=planned.truth,
            truth_rate=planned.truth_rate,
            told=planned.told,
            progress=lambda seconds: progress("flying", seconds / duration),
        )
    return {
        "name": planned.name,
        **_files(planned),
        "duration_s": duration,
        "sent": flown.sent,
        "received": len(flown.frames),
        "times_real_time": round(duration / (time.perf_counter() - begun), 1),
    }


def _text(flown: Sequence[Mapping[str, Any]]) -> str:
    return "\n".join(
        f"{flight['name']}: {flight['duration_s']:.0f} s flown at {flight['times_real_time']:.0f} "
        f"times real time, {flight['received']} of {flight['sent']} messages received\n"
        + "\n".join(flight[key] for key in _FILES if flight[key])
        for flight in flown
    )
