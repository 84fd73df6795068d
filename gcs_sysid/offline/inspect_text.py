"""The document of `inspect` in words for a terminal: short lines, degrees, what matters first."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from math import degrees
from typing import Any

from gcs_sysid.recording import NO_AUTOPILOT

WIDTH = 96
"""Columns used at most."""
MANEUVERS_SHOWN = 40
"""A longer list is cut; `inspect.json` holds all of it."""

_IMPORTANT = (
    "HIGHRES_IMU RAW_IMU SCALED_IMU SCALED_IMU2 ATTITUDE ATTITUDE_QUATERNION SERVO_OUTPUT_RAW "
    "AIRSPEED VFR_HUD GLOBAL_POSITION_INT LOCAL_POSITION_NED GPS_RAW_INT SCALED_PRESSURE AOA_SSA "
    "RPM ESC_TELEMETRY_1_TO_4 HEARTBEAT"
).split()


def text(document: Mapping[str, Any]) -> str:
    """The whole document for a person."""
    parts = [
        _head(document),
        _streams(document),
        _flight(document),
        _maneuvers(document),
        _identifiable(document),
        _list("Beware", _not_said_elsewhere(document)),
        _list("Before the next flight", document["next_flight"]),
    ]
    return "\n\n".join("\n".join(part) for part in parts if part)


def _head(document: Mapping[str, Any]) -> list[str]:
    vehicle = document["vehicle"]
    kind = vehicle["kind"].removeprefix("MAV_TYPE_").replace("_", " ").lower()
    autopilot = vehicle["autopilot"].removeprefix("MAV_AUTOPILOT_").lower()
    if vehicle["autopilot"] == NO_AUTOPILOT:
        autopilot = "a table"
    who = document["aircraft"] or "no aircraft file"
    lines = [
        f"{document['source']}: {document['duration_s']:.0f} s, of it "
        f"{document['airborne_s']:.0f} s airborne",
        f"vehicle {vehicle['system']} ({kind}, {autopilot}), {who}",
    ]
    if document["hover_s"] > 20.0:
        lines.append(f"{document['hover_s']:.0f} s off the ground but too slow for wings: left out")
    others = [str(one["system"]) for one in document["vehicles"][1:]]
    if others:
        lines.append(f"also in this log: vehicle {', '.join(others)}")
    return lines


def _streams(document: Mapping[str, Any]) -> list[str]:
    streams = document["streams"]
    shown = [name for name in _IMPORTANT if name in streams]
    rows = [("Streams", "count", "Hz", "gaps", "longest", "clock")]
    for name in shown:
        entry = streams[name]
        longest = f"{entry['longest_gap_s']:.1f} s" if entry["gaps"] else ""
        clock = "vehicle" if entry["stamped"] else "inferred"
        rows.append(
            (
                f"  {name}",
                str(entry["count"]),
                f"{entry['rate_hz']:.1f}",
                str(entry["gaps"]),
                longest,
                clock,
            )
        )
    lines = _table(rows)
    rest = len(streams) - len(shown)
    if rest:
        lines.append(f"  and {rest} types more, not used here")
    lost = {reason: count for reason, count in document["lost"].items() if count}
    if lost:
        said = ", ".join(f"{count} {reason.replace('_', ' ')}" for reason, count in lost.items())
        lines.append(f"  lost: {said}")
    # That a type carries no stamp the column `clock` tells already.
    for note in (note for note in document["clock"] if "carries no stamp" not in note):
        lines += _wrapped(f"clock: {note}", "  ")
    return lines


def _flight(document: Mapping[str, Any]) -> list[str]:
    visited, controls = document["envelope"], document["controls"]
    if not visited and not controls:
        return []
    flown = [
        _range(f"  {name.replace('_', ' ')}", entry, entry["sd"]) for name, entry in visited.items()
    ]
    lines = _table([("Flown", "from", "to", "sd"), *flown])
    if controls:
        moved = [_range(f"  {name}", entry, entry["activity"]) for name, entry in controls.items()]
        lines += ["", *_table([("Controls", "from", "to", "activity"), *moved])]
    wind = document["wind"]
    if wind is not None:
        lines += [
            f"  wind about {(wind['north'] ** 2 + wind['east'] ** 2) ** 0.5:.1f} m/s, gusts "
            f"{wind['gust']:.1f} m/s along the path"
        ]
    return lines


def _range(name: str, entry: Mapping[str, Any], spread: float) -> tuple[str, str, str, str]:
    unit = entry["unit"]
    scale, shown, digits = {
        "rad": (degrees(1.0), "°", 1),
        "rad/s": (degrees(1.0), "°/s", 0),
        "1": (1.0, "", 2),
        "us": (1.0, " us", 0),
    }.get(unit, (1.0, f" {unit}", 1))
    return (
        name,
        f"{scale * entry['min']:.{digits}f}",
        f"{scale * entry['max']:.{digits}f}{shown}",
        f"{scale * spread:.{max(digits, 1)}f}{shown}",
    )


def _maneuvers(document: Mapping[str, Any]) -> list[str]:
    found = document["maneuvers"]
    if not found:
        return ["Maneuvers: none"]
    held = set(document["held_out"])
    rows = [(f"Maneuvers ({len(found)})", "start", "length", "airspeed", "controls", "")]
    for entry in found[:MANEUVERS_SHOWN]:
        speed = entry["airspeed_mean"]
        rows.append(
            (
                f"  {entry['id']:>3} {entry['kind']}",
                f"{entry['start_s']:.1f} s",
                f"{entry['duration_s']:.1f} s",
                "" if speed is None else f"{speed:.1f} m/s",
                textwrap.shorten(" ".join(entry["controls"]), 32, placeholder=" ..."),
                "held out" if entry["id"] in held else "",
            )
        )
    lines = _table(rows, left=(0, 4, 5))
    if len(found) > MANEUVERS_SHOWN:
        lines.append(f"  and {len(found) - MANEUVERS_SHOWN} more: see inspect.json")
    return lines


def _identifiable(document: Mapping[str, Any]) -> list[str]:
    lines = ["Can be identified"]
    answers = sorted(
        document["identifiable"].items(),
        key=lambda item: (
            ("yes", "weak", "no").index(item[1]["verdict"]),
            item[1]["reason"],
        ),
    )
    for (verdict, reason), group in groupby(
        answers, key=lambda item: (item[1]["verdict"], item[1]["reason"])
    ):
        names = " ".join(name for name, _ in group)
        lines += _wrapped(_without_fix(reason, document), f"  {verdict:<5} {names:<18} ")
    return lines


def _without_fix(reason: str, document: Mapping[str, Any]) -> str:
    """A reason without the remedy that the list for the next flight repeats."""
    for fix in document["next_flight"]:
        reason = reason.removesuffix(f"; {fix}")
    return reason


def _not_said_elsewhere(document: Mapping[str, Any]) -> list[str]:
    reasons = " ".join(entry["reason"] for entry in document["identifiable"].values())
    fixes = tuple(document["next_flight"])
    return [
        warning
        for warning in document["warnings"]
        if warning not in reasons and not warning.endswith(fixes)
    ]


def _list(title: str, items: Iterable[str]) -> list[str]:
    lines = [line for item in items for line in _wrapped(item, "  - ")]
    return [title, *lines] if lines else []


def _wrapped(content: str, lead: str) -> list[str]:
    return textwrap.wrap(
        content,
        WIDTH,
        initial_indent=lead,
        subsequent_indent=" " * len(lead),
        break_long_words=False,
    ) or [lead.rstrip()]


def _table(rows: Sequence[tuple[str, ...]], *, left: tuple[int, ...] = (0,)) -> list[str]:
    """Rows in columns: the first and those in `left` flush left, the others right."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        "  ".join(
            cell.ljust(width) if column in left else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
