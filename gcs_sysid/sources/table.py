"""Tables (.csv, .parquet, .mat) as recordings, through a column map.

Published flight-test records come as tables. Their channels get the stream names that telemetry
has, so that everything above treats them alike.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from gcs_sysid.errors import RefusedError, SourceError
from gcs_sysid.recording import NO_AUTOPILOT, Recording, Vehicle
from gcs_sysid.sources import assemble, column_map, content, held, joined, table_file
from gcs_sysid.sources.clock import UNIX_US
from gcs_sysid.sources.column_map import (
    COURSE,
    SENSOR_OF,
    Calibration,
    ColumnMap,
    Entry,
    Sensor,
    TimeColumn,
)
from gcs_sysid.sources.joined import Piece
from gcs_sysid.sources.units import to_si

SUFFIXES = tuple(table_file.READERS)
SYSTEM = 1
"""A table holds one vehicle; this is the system id it goes by."""
LONGEST_US = 1e12
"""Time columns further apart than this [µs] (eleven days) are not of one flight."""

Column = Float[np.ndarray, " row"]


@dataclass(frozen=True)
class Part:
    """Measurements of one sensor: times [µs since time zero], values in SI by channel."""

    sensor: Sensor
    time_us: Column
    channels: Mapping[str, Column]


@dataclass(frozen=True)
class Table:
    """A table's columns and what is said about them."""

    source: str
    columns: Mapping[str, Column | None]
    map: ColumnMap


def recording(path: Path, *, columns: Path | None, vehicle: int | None) -> Recording:
    """The flight in a table.

    Args:
        path: the table's file, whose ending names its format.
        columns: the column map's file.
        vehicle: system id asked for; a table holds vehicle 1 only.

    Raises:
        SourceError: no column map, one that does not fit the table, or an unreadable table.
        RefusedError: another vehicle was asked for.
    """
    data = content.read(path)
    if columns is None:
        raise _no_map(path, data)
    if vehicle not in (None, SYSTEM):
        raise RefusedError(
            str(path), "a table holds one vehicle, number 1", fix="leave --vehicle out"
        )
    table = Table(str(path), table_file.columns(path, data), column_map.load(columns))
    lost: dict[str, int] = {}
    notes: list[str] = []
    parts = [_thinned(part, notes) for part in _parts(table, lost)]
    origin_us = min(float(part.time_us[0]) for part in parts)
    _of_one_flight(table, parts)
    epoch_us = table.map.epoch_us + round(origin_us)
    pieces = [Piece(p.sensor.stream, p.time_us, p.channels) for p in _over_ground(parts)]
    streams, absent = assemble.without_absent(joined.streams(pieces, origin_us))
    return Recording(
        source=str(path),
        sha256=hashlib.sha256(data).hexdigest(),
        vehicle=Vehicle(
            SYSTEM, 1, NO_AUTOPILOT, "MAV_TYPE_FIXED_WING", sum(s.count for s in streams.values())
        ),
        epoch_us=epoch_us,
        streams=streams,
        lost=lost,
        clock_notes=(*notes, *absent),
    )


def _no_map(path: Path, data: bytes) -> SourceError:
    names = [name for name, values in table_file.columns(path, data).items() if values is not None]
    shown = ", ".join(f"`{name}`" for name in names[:8]) + (" …" if len(names) > 8 else "")
    return SourceError(
        str(path),
        f"is a table, and nothing says what its columns {shown} are",
        fix=(
            'write a file with lines such as `time = { name = "t", unit = "s" }` and '
            f"{column_map.EXAMPLE} and give it with --columns MAP.toml"
        ),
    )


def _parts(table: Table, lost: dict[str, int]) -> list[Part]:
    """Measurements of each sensor on each of its time columns."""
    groups: dict[tuple[Sensor, TimeColumn], list[Entry]] = {}
    for entry in table.map.entries:
        groups.setdefault((SENSOR_OF[entry.channel], entry.time), []).append(entry)
    times = {time: _time(table, time, lost) for time in {time: None for _, time in groups}}
    parts = [
        _part(table, sensor, entries, *times[time]) for (sensor, time), entries in groups.items()
    ]
    found = [part for part in parts if part.time_us.size]
    if not found:
        raise SourceError(
            table.source, "no mapped column holds a number", fix=f"correct {table.map.file}"
        )
    return found


def _time(table: Table, time: TimeColumn, lost: dict[str, int]) -> tuple[Column, np.ndarray]:
    """A time column [µs] and the rows of it to use: those with a time, each time once."""
    raw = _column(table, time.name, "time")
    rows = np.flatnonzero(np.isfinite(raw))
    steps = np.diff(raw[rows])
    where = f"{table.source}: column `{time.name}`"
    if not rows.size:
        raise SourceError(where, "holds no times", fix=f"name another in {table.map.file}")
    if np.any(steps < 0.0):
        first = int(np.argmax(steps < 0.0))
        raise SourceError(
            where,
            f"time falls back in row {rows[first + 1] + 1}, from {raw[rows[first]]:.10g} to "
            f"{raw[rows[first + 1]]:.10g}",
            fix="cut the table there: it holds two runs, or padding",
        )
    if steps.size and np.median(steps) == 0.0:
        raise SourceError(
            where,
            "time stands still from row to row",
            fix="name a time column that counts every row",
        )
    again = np.concatenate([[False], steps == 0.0])
    for reason, count in (
        ("rows_without_time", raw.size - rows.size),
        ("rows_at_same_time", int(again.sum())),
    ):
        if count:
            lost[reason] = lost.get(reason, 0) + count
    return raw * (time.unit.factor * 1e6), rows[~again]


def _column(table: Table, name: str, channel: str) -> Column:
    if name not in table.columns:
        raise SourceError(
            table.source,
            f"has no column `{name}`, which {table.map.file} gives for {channel}",
            fix=table_file.nearest(name, table.columns),
        )
    values = table.columns[name]
    if values is None:
        raise SourceError(
            table.source,
            f"column `{name}`, given for {channel}, does not hold numbers",
            fix=f"name another in {table.map.file}, or write numbers",
        )
    return values


def _part(
    table: Table, sensor: Sensor, entries: Sequence[Entry], time_us: Column, rows: np.ndarray
) -> Part:
    channels = {}
    for entry in entries:
        raw = _column(table, entry.name, entry.channel)
        if raw.size != time_us.size:
            raise SourceError(
                table.source,
                f"column `{entry.name}` has {raw.size} rows and its time `{entry.time.name}` "
                f"{time_us.size}",
                fix=f'add `time = "COLUMN"` to {entry.channel} in {table.map.file}',
            )
        channels[entry.channel] = _values(entry, raw[rows])
    _hide_unmeasured(channels)
    known = np.any([np.isfinite(values) for values in channels.values()], axis=0)
    return Part(
        sensor, time_us[rows][known], {name: values[known] for name, values in channels.items()}
    )


def _values(entry: Entry, raw: Column) -> Column:
    """One channel in SI, angles of attitude within half a turn, NaN where not measured."""
    stated = entry.scale * raw + entry.offset
    stated = np.where(np.isfinite(stated), stated, np.nan)
    values = to_si(stated, entry.unit)
    if entry.calibration is not None:
        return _pulse(np.degrees(values), entry.calibration)
    if entry.channel in ("roll", "yaw", "longitude"):
        return (values + np.pi) % (2.0 * np.pi) - np.pi
    return values


def _pulse(deflection: Column, calibration: Calibration) -> Column:
    """Pulse [µs] behind a deflection [deg]: linear between points, the ends' slopes beyond."""
    pairs = sorted(zip(calibration.deflection, calibration.pwm, strict=True))
    known, pwm = (np.array(values) for values in zip(*pairs, strict=True))
    piece = np.clip(np.searchsorted(known, deflection) - 1, 0, known.size - 2)
    slope = np.diff(pwm) / np.diff(known)
    return pwm[piece] + slope[piece] * (deflection - known[piece])


DEAD_WHEN_ALL_ZERO = (
    ("acc_x", "acc_y", "acc_z"),
    ("mag_x", "mag_y", "mag_z"),
    ("roll", "pitch", "yaw"),
    ("latitude", "longitude"),
)
"""Sensors whose channels are never all exactly zero at once: such rows were filled before the
sensor or the estimator started."""


def _hide_unmeasured(channels: dict[str, Column]) -> None:
    for names in DEAD_WHEN_ALL_ZERO:
        if set(names) <= set(channels):
            dead = np.all([channels[name] == 0.0 for name in names], axis=0)
            for name in names:
                channels[name] = np.where(dead, np.nan, channels[name])


def _thinned(part: Part, notes: list[str]) -> Part:
    """The part without repetitions of a measurement."""
    if part.sensor.command:
        return part
    values = np.stack(list(part.channels.values()), axis=1)
    rows = held.measured_rows(values)
    if rows.size == part.time_us.size:
        return part
    notes.append(
        f"{', '.join(part.channels)}: held for {held.hold(values):.3g} rows each, so "
        f"{rows.size} measurements in {part.time_us.size} rows"
    )
    return replace(
        part,
        time_us=part.time_us[rows],
        channels={name: column[rows] for name, column in part.channels.items()},
    )


def _of_one_flight(table: Table, parts: Sequence[Part]) -> None:
    first = min(float(part.time_us[0]) for part in parts)
    last = max(float(part.time_us[-1]) for part in parts)
    if last - first > LONGEST_US:
        raise SourceError(
            table.source,
            f"its time columns lie {(last - first) / 86_400e6:.0f} days apart",
            fix=f"correct the units of time in {table.map.file}, or name columns of one clock",
        )
    if first > UNIX_US and table.map.epoch_us:
        raise SourceError(
            table.source,
            "time counts from 1970 already",
            fix=f"take `epoch` out of {table.map.file}",
        )


def _over_ground(parts: Sequence[Part]) -> list[Part]:
    """The parts with speed and course over ground, as GPS receivers report them, made velocity."""
    course = next((part for part in parts if COURSE in part.channels), None)
    if course is None:
        return list(parts)
    speed = next(part for part in parts if "groundspeed" in part.channels)
    at = np.interp(course.time_us, speed.time_us, speed.channels["groundspeed"])
    angle = course.channels[COURSE]
    velocity = replace(
        course, channels={"v_north": at * np.cos(angle), "v_east": at * np.sin(angle)}
    )
    return [velocity, *(part for part in parts if part is not course and part is not speed)]
