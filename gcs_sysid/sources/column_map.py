"""Column maps: which column of a table is which channel, and in which unit (TOML).

    time = { name = "t", unit = "s" }
    alpha = { name = "aoa", unit = "deg", scale = 1.0 }

An entry's value in its unit is sign · scale · column + offset.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

from gcs_sysid.errors import SourceError
from gcs_sysid.sources.units import Unit, unit_of, units_of

COURSE = "course"
"""Direction of flight over ground: with `groundspeed` it gives `v_north` and `v_east`."""
EXAMPLE = '`alpha = { name = "aoa", unit = "deg" }`'


@dataclass(frozen=True)
class Sensor:
    """Channels that are measured together.

    Attributes:
        stream: MAVLink message type that carries them in telemetry.
        quantity: what they measure; see `units.UNITS`.
        channels: their names in `gcs_sysid.recording.CHANNELS`.
        command: whether repeated values are new commands rather than one measurement held.
    """

    stream: str
    quantity: str
    channels: tuple[str, ...]
    command: bool = False


_POSITION = "GLOBAL_POSITION_INT"
SENSORS: tuple[Sensor, ...] = (
    Sensor("RAW_IMU", "acceleration", ("acc_x", "acc_y", "acc_z")),
    Sensor("RAW_IMU", "angular rate", ("p", "q", "r")),
    Sensor("RAW_IMU", "magnetic flux density", ("mag_x", "mag_y", "mag_z")),
    Sensor("ATTITUDE", "angle", ("roll", "pitch", "yaw")),
    Sensor(_POSITION, "speed", ("v_north", "v_east", "v_down")),
    Sensor(_POSITION, "angle", ("latitude", "longitude")),
    Sensor(_POSITION, "angle", (COURSE,)),
    Sensor(_POSITION, "length", ("altitude",)),
    Sensor("ALTITUDE", "length", ("height",)),
    Sensor("LOCAL_POSITION_NED", "length", ("north", "east")),
    Sensor("VFR_HUD", "speed", ("airspeed",)),
    Sensor("VFR_HUD", "speed", ("groundspeed",)),
    Sensor("VFR_HUD", "speed", ("climb",)),
    Sensor("VFR_HUD", "number", ("throttle",), command=True),
    Sensor("AOA_SSA", "angle", ("alpha",)),
    Sensor("AOA_SSA", "angle", ("beta",)),
    Sensor("SCALED_PRESSURE", "pressure", ("static_pressure",)),
    Sensor("SCALED_PRESSURE", "pressure", ("dynamic_pressure",)),
    Sensor("SCALED_PRESSURE", "temperature", ("temperature",)),
    Sensor("WIND_COV", "speed", ("wind_north", "wind_east", "wind_down")),
    Sensor("SYS_STATUS", "voltage", ("voltage",)),
    Sensor("SYS_STATUS", "current", ("current",)),
    Sensor("HEARTBEAT", "number", ("mode", "armed"), command=True),
    Sensor("SERVO_OUTPUT_RAW", "pulse", tuple(f"pwm_{n}" for n in range(1, 33)), command=True),
    *(Sensor("RPM", "rotation speed", (f"rpm_{n}",)) for n in range(1, 17)),
)
"""What a table can hold, and the telemetry stream that it becomes."""

SENSOR_OF: Mapping[str, Sensor] = {name: sensor for sensor in SENSORS for name in sensor.channels}
"""Channel -> its sensor."""


@dataclass(frozen=True)
class TimeColumn:
    """A column of times and its unit."""

    name: str
    unit: Unit


@dataclass(frozen=True)
class Calibration:
    """Pulses [µs] over deflections [deg], to turn a deflection back to the pulse behind it."""

    pwm: tuple[float, ...]
    deflection: tuple[float, ...]


@dataclass(frozen=True)
class Entry:
    """One channel of the map.

    Attributes:
        channel: name in `gcs_sysid.recording.CHANNELS`, or `course`.
        name: the table's column.
        unit: what the column, scaled, is in.
        scale: value in `unit` of one in the column, sign included.
        offset: value in `unit` of zero in the column.
        time: the column of its times.
        calibration: for a deflection that stands for a servo's pulse.
    """

    channel: str
    name: str
    unit: Unit
    scale: float
    offset: float
    time: TimeColumn
    calibration: Calibration | None


@dataclass(frozen=True)
class ColumnMap:
    """What the columns of a table are.

    Attributes:
        file: name of the map's file.
        entries: one a channel.
        epoch_us: wall time at which the time columns are zero [µs since 1970].
    """

    file: str
    entries: tuple[Entry, ...]
    epoch_us: int


def load(path: Path) -> ColumnMap:
    """Reads a column map.

    Raises:
        SourceError: the file cannot be read, or a line of it is wrong.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SourceError(
            str(path), "cannot be read as text", fix="give a column map in TOML"
        ) from error
    return loads(text, file=str(path))


def loads(text: str, *, file: str) -> ColumnMap:
    """Reads the text of a column map; see `load`."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SourceError(file, f"is no TOML ({error})", fix=f"write lines as {EXAMPLE}") from error
    for key in data:
        if key not in SENSOR_OF and key not in ("time", "epoch"):
            known = ("time", "epoch", *SENSOR_OF)
            raise SourceError(file, f"no channel is called `{key}`", fix=_instead(key, known))
    if "time" not in data:
        raise SourceError(
            file,
            "no line says which column is the time",
            fix='add `time = { name = "t", unit = "s" }`',
        )
    time = _time(data.pop("time"), file=file, key="time")
    epoch_us = _epoch(data.pop("epoch", datetime.fromtimestamp(0, UTC)), file=file)
    entries = tuple(_entry(key, value, time, file=file) for key, value in data.items())
    if not entries:
        raise SourceError(file, "maps no column to a channel", fix=f"add lines as {EXAMPLE}")
    channels = {entry.channel for entry in entries}
    if COURSE in channels and "groundspeed" not in channels:
        raise SourceError(file, "`course` without `groundspeed`", fix="map `groundspeed` too")
    return ColumnMap(file=file, entries=entries, epoch_us=epoch_us)


def _instead(key: str, known: Collection[str]) -> str:
    close = difflib.get_close_matches(key, list(known), n=3)
    if close:
        return f"did you mean {' or '.join(f'`{name}`' for name in close)}?"
    return f"channels are {', '.join(name for name in known if not name[-1].isdigit())}, pwm_1 …"


def _epoch(value: Any, *, file: str) -> int:
    if not isinstance(value, datetime) or value.tzinfo is None:
        raise SourceError(
            file,
            "`epoch` is no date with time zone",
            fix="write the wall time of time zero as `epoch = 2026-05-01T09:30:00Z`",
        )
    since = value - datetime.fromtimestamp(0, UTC)
    return (since.days * 86400 + since.seconds) * 1_000_000 + since.microseconds


def _time(value: Any, *, file: str, key: str) -> TimeColumn:
    table = _table(value, ("name", "unit"), file=file, key=key)
    return TimeColumn(_name(table, file=file, key=key), _unit(table, "time", file=file, key=key))


def _entry(key: str, value: Any, time: TimeColumn, *, file: str) -> Entry:
    pulse = SENSOR_OF[key].quantity == "pulse"
    table = _table(
        value,
        ("name", "unit", "scale", "sign", "offset", "time", *(("pwm", "deflection") * pulse)),
        file=file,
        key=key,
    )
    calibration = _calibration(table, file=file, key=key) if pulse else None
    quantity = SENSOR_OF[key].quantity if calibration is None else "angle"
    own = table.get("time")
    if isinstance(own, str):
        own = TimeColumn(own, time.unit)
    elif own is not None:
        own = _time(own, file=file, key=f"{key}.time")
    sign = _number(table, "sign", 1.0, file=file, key=key)
    if abs(sign) != 1.0:
        raise SourceError(f"{file}: {key}", f"sign is {sign:g}", fix="write 1 or -1")
    return Entry(
        channel=key,
        name=_name(table, file=file, key=key),
        unit=_unit(table, quantity, file=file, key=key),
        scale=sign * _number(table, "scale", 1.0, file=file, key=key),
        offset=_number(table, "offset", 0.0, file=file, key=key),
        time=own or time,
        calibration=calibration,
    )


def _table(value: Any, allowed: tuple[str, ...], *, file: str, key: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise SourceError(f"{file}: {key}", "is no table of name and unit", fix=f"write {EXAMPLE}")
    for name in value:
        if name not in allowed:
            raise SourceError(
                f"{file}: {key}", f"unknown key `{name}`", fix=f"use {', '.join(allowed)}"
            )
    return value


def _name(table: Mapping[str, Any], *, file: str, key: str) -> str:
    name = table.get("name")
    if not isinstance(name, str) or not name:
        raise SourceError(f"{file}: {key}", "names no column", fix='add `name = "COLUMN"`')
    return name


def _unit(table: Mapping[str, Any], quantity: str, *, file: str, key: str) -> Unit:
    allowed = ", ".join(units_of(quantity))
    name = table.get("unit")
    if name is None:
        raise SourceError(f"{file}: {key}", "has no unit", fix=f"add `unit`, one of {allowed}")
    unit = unit_of(str(name), quantity)
    if unit is None:
        also = ""
        if quantity == "pulse":
            also = "; for a deflection add `pwm` and `deflection` as in the aircraft file"
        raise SourceError(
            f"{file}: {key}", f"`{name}` is no unit of {quantity}", fix=f"use {allowed}{also}"
        )
    return unit


def _number(table: Mapping[str, Any], name: str, usual: float, *, file: str, key: str) -> float:
    value = table.get(name, usual)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise SourceError(f"{file}: {key}", f"{name} is no number", fix=f"write `{name} = 1.0`")
    return float(value)


def _calibration(table: Mapping[str, Any], *, file: str, key: str) -> Calibration | None:
    if "pwm" not in table and "deflection" not in table:
        return None
    pwm, deflection = _monotone(table.get("pwm")), _monotone(table.get("deflection"))
    if pwm is None or deflection is None or len(pwm) != len(deflection):
        raise SourceError(
            f"{file}: {key}",
            "`pwm` and `deflection` are no calibration",
            fix="copy both lists from `[[servos]]` of the aircraft file (µs and deg, same length)",
        )
    return Calibration(pwm, deflection)


def _monotone(values: Any) -> tuple[float, ...] | None:
    """Two or more numbers that only rise or only fall; None if they are anything else."""
    if not isinstance(values, list) or len(values) < 2:
        return None
    if not all(isinstance(v, int | float) and not isinstance(v, bool) for v in values):
        return None
    steps = [after - before for before, after in pairwise(values)]
    rising, falling = all(step > 0 for step in steps), all(step < 0 for step in steps)
    return tuple(float(value) for value in values) if rising or falling else None
