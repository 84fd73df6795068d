"""`inspect`: what is in a log, the maneuvers in it, and what it can and cannot identify."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.offline import envelope
from gcs_sysid.offline.asking import ask
from gcs_sysid.offline.documents import plain, write_json
from gcs_sysid.offline.identifiability import Judgement, judge
from gcs_sysid.offline.inspect_text import text as text
from gcs_sysid.offline.maneuver_choice import chooser
from gcs_sysid.offline.measured_surfaces import in_place_of_commands
from gcs_sysid.offline.requirements import Requirements, check
from gcs_sysid.reconstruct import segment_file
from gcs_sysid.reconstruct.airborne import Interval, airborne
from gcs_sysid.reconstruct.control_history import control_history
from gcs_sysid.reconstruct.segments import split
from gcs_sysid.recording import Recording, Stream, Vehicle, gaps
from gcs_sysid.sources.registry import open_recording

Progress = Callable[[str, float], None]


def run(
    log: Path,
    *,
    aircraft: Path | None = None,
    vehicle: int | None = None,
    segments: Path | None = None,
    columns: Path | None = None,
    can: Path | None = None,
    out: Path | None = None,
    progress: Progress = lambda _stage, _fraction: None,
) -> dict[str, Any]:
    """Inspects a log.

    Args:
        log: the recorded flight.
        aircraft: aircraft file; without it controls are servo outputs and modes are guessed.
        vehicle: which vehicle of the log; needed when there are several.
        segments: maneuvers to list instead of those found.
        columns: what the columns are where the log is a table.
        can: a CAN log of the same flight.
        out: folder for `inspect.json`; None writes nothing.
        progress: told what is being done and which fraction is behind.

    Returns:
        The document of `inspect.json`.

    Raises:
        InputError: the log, the aircraft file or the segments file cannot be used.
    """
    described = aircraft_file.load(aircraft) if aircraft is not None else None
    progress("reading", 0.0)
    recording = open_recording(
        log,
        vehicle=vehicle,
        columns=columns,
        can=can,
        progress=lambda fraction: progress("reading", 0.6 * fraction),
    )
    if described is not None:
        recording, described, _ = in_place_of_commands(recording, described)
    progress("looking for maneuvers", 0.6)
    document = plain(inspected(recording, described, segments))
    if out is not None:
        write_json(out / "inspect.json", document)
    progress("done", 1.0)
    return document


def inspected(
    recording: Recording, aircraft: Aircraft | None, segments: Path | None = None
) -> dict[str, Any]:
    """The document of a recording; see `run`."""
    flights = airborne(recording, aircraft)
    history = control_history(recording, aircraft)
    found = chooser(segments, aircraft)(recording)
    needed = check(recording, aircraft)
    judged = judge(recording, aircraft, history, found, flights, needed)
    wind = envelope.wind(recording, flights)
    return {
        "schema": 1,
        "program": f"gcs-sysid {version('gcs-sysid')}",
        "command": "inspect",
        "source": recording.source,
        "sha256": recording.sha256,
        "aircraft": aircraft.name if aircraft is not None else None,
        "epoch_us": recording.epoch_us,
        "duration_s": _duration(recording),
        "vehicle": _vehicle(recording.vehicle),
        "vehicles": [_vehicle(one) for one in (recording.vehicle, *recording.others)],
        "streams": {
            name: _stream(stream, recording)
            for name, stream in recording.streams.items()
            if stream.count
        },
        "lost": dict(recording.lost),
        "clock": list(recording.clock_notes),
        "parameters": len(recording.parameters),
        "airborne_s": float(sum(end - start for start, end in flights)),
        "airborne": [_interval(flight, recording) for flight in flights],
        "hover_s": _hover(recording, flights),
        "maneuvers": segment_file.entries(found, epoch_us=recording.epoch_us),
        "held_out": list(split(found)[1]),
        "envelope": envelope.visited(recording, flights),
        "controls": envelope.controls(history, flights),
        "wind": asdict(wind) if wind is not None else None,
        "identifiable": {name: asdict(judgement) for name, judgement in judged.items()},
        "warnings": _warnings(recording, aircraft, needed),
        "next_flight": _next_flight(recording, needed, judged),
    }


def _duration(recording: Recording) -> float:
    return max((float(s.time[-1]) for s in recording.streams.values() if s.count), default=0.0)


def _vehicle(vehicle: Vehicle) -> dict[str, Any]:
    return asdict(vehicle)


def _stream(stream: Stream, recording: Recording) -> dict[str, Any]:
    holes = gaps(stream.time)
    first, last = (int(moment) for moment in recording.time_us(stream.time[[0, -1]]))
    return {
        "count": stream.count,
        "rate_hz": stream.rate,
        "first_us": first,
        "last_us": last,
        "gaps": int(holes.size),
        "longest_gap_s": float(holes.max()) if holes.size else 0.0,
        "stamped": stream.stamped,
        "channels": [name for name in stream.channels if stream.has(name)],
    }


def _interval(flight: Interval, recording: Recording) -> dict[str, float | int]:
    start, end = (int(moment) for moment in recording.time_us(np.array(flight)))
    return {
        "start_us": start,
        "end_us": end,
        "start_s": round(flight[0], 3),
        "duration_s": round(flight[1] - flight[0], 3),
    }


def _hover(recording: Recording, flights: tuple[Interval, ...]) -> float:
    """Seconds well above the ground but not on the wing."""
    stream = recording.first(("GLOBAL_POSITION_INT", "ALTITUDE"), "height")
    if stream is None or stream.count < 2:
        return 0.0
    good = stream.valid("height")
    time, height = stream.time[good], stream.channels["height"][good]
    high = height > np.percentile(height, 1.0) + 15.0
    off_wing = high & ~envelope.airborne_mask(time, flights)
    steps = np.minimum(np.diff(time, append=time[-1:]), 1.0)
    return float(np.sum(steps[off_wing]))


def _warnings(recording: Recording, aircraft: Aircraft | None, needed: Requirements) -> list[str]:
    found = list(dict.fromkeys(needed.warnings))
    if aircraft is None and any(name.startswith("servo") for name in _names(recording)):
        found.append(
            "no aircraft file and no output functions in the log: outputs 1, 2, 3, 4 are taken as "
            "aileron, elevator, throttle, rudder; `--aircraft FILE` says for sure"
        )
    return found


def _names(recording: Recording) -> list[str]:
    history = control_history(recording, None)
    return [signal.name for signal in history.surfaces] if history is not None else []


def _next_flight(
    recording: Recording, needed: Requirements, judged: Mapping[str, Judgement]
) -> list[str]:
    """What to change before the next flight: what to record first, then what to fly."""
    advice = list(needed.next_flight)
    reasons = " ".join(judgement.reason for judgement in judged.values())
    if "coarse for" in reasons and not any("RAW_IMU" in line for line in advice):
        advice.append(ask(recording, "RAW_IMU", 50.0))
        advice.append(ask(recording, "SERVO_OUTPUT_RAW", 50.0))
    if "no test input" in reasons or "one test input" in reasons:
        advice.append(
            "fly doublets, 3-2-1-1s and a multisine on each surface, added after the autopilot, at "
            "three airspeeds"
        )
    if "no flow vanes in gusts" in reasons:
        advice.append("fly in calm air (early morning), or fit flow vanes")
    if "go together" in reasons:
        mixed = recording.parameters.get("KFF_RDDRMIX", 0.0)
        said = f" (KFF_RDDRMIX is {mixed:g}: set it to 0)" if mixed else ""
        advice.append(
            f"move each surface on its own: switch mixing and turn coordination off{said}"
        )
    return advice
