"""A recording as MAVLink frames: what a vehicle would have sent of it.

The inverse of `messages`: each channel goes back into the field that it would come from, in that
field's resolution. Streams are named by their message type, so the name says the message. What no
message carries is left out and told.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, Shaped
from pymavlink.dialects.v20 import all as dialect

from gcs_sysid import frames as rotations
from gcs_sysid.recording import NO_AUTOPILOT, Recording, Stream
from gcs_sysid.sources import messages
from gcs_sysid.sources.checksum import checksum
from gcs_sysid.sources.frames import MAGIC_V2
from gcs_sysid.sources.layouts import crc_extras, layout

BOOT_US = 10_000_000
"""The vehicle is switched on this long before its first sample."""
_RENAMED: Mapping[str, str] = {"ESC_STATUS": "ESC_TELEMETRY_1_TO_4"}
"""Streams of other sources whose channels a message of another name carries."""
_EVERY_US = 1_000_000
"""A heartbeat and the wall time, where a recording has none, come so often."""
_IDS: Mapping[str, int] = {
    kind.msgname: number for number, kind in sorted(dialect.mavlink_map.items(), reverse=True)
}
_TEXT = 50

Fields = dict[str, np.ndarray]
Rows = Int[np.ndarray, " message"]


@dataclass(frozen=True)
class Encoded:
    """A recording as frames.

    Attributes:
        frames: (when the vehicle sent it [µs since 1970], frame), in order.
        left_out: what no message carries: streams, channels (`STREAM.channel`), and rows of which a
            value is missing that the message cannot leave out, with how many values or rows.
    """

    frames: list[tuple[int, bytes]]
    left_out: Mapping[str, int]


@dataclass(frozen=True)
class _Table:
    """Messages of one type: when each was sent, and their payloads."""

    id: int
    time_us: Rows
    payload: Shaped[np.ndarray, " message"]


def frames(recording: Recording) -> Encoded:
    """All streams, parameters and texts of a recording as one vehicle's MAVLink 2 frames."""
    left_out: dict[str, int] = {}
    begin_us = recording.epoch_us - BOOT_US
    tables = [
        table
        for stream in recording.streams.values()
        if (table := _encoded(stream, recording, begin_us, left_out)) is not None
    ]
    tables += _alive(recording, begin_us, {table.id for table in tables})
    tables += _described(recording)
    return Encoded(_packed(tables, recording), left_out)


def _encoded(
    stream: Stream, recording: Recording, begin_us: int, left_out: dict[str, int]
) -> _Table | None:
    """The messages of a stream, or None where no message carries it."""
    base, _, instance = stream.name.removesuffix("]").partition("[")
    name = _RENAMED.get(base, base)
    own = {c: v for c, v in stream.channels.items() if np.isfinite(v).any()}
    taken = base != name and name in recording.streams
    if taken or not messages.has_channels(name) or (instance and not instance.isdigit()):
        if own:
            left_out[stream.name] = stream.count
        return None
    fields: Fields = {}
    keep = np.ones(stream.count, dtype=bool)
    for quantity in messages.QUANTITIES.get(name, ()):
        values = own.pop(quantity.channel, None)
        whole = np.issubdtype(layout(_IDS[name]).dtype[quantity.field].base, np.integer)
        fields[quantity.field], sayable = _field(quantity, values, stream.count, whole=whole)
        keep &= sayable
    special = _SPECIAL.get(name)
    if special is not None:
        fields |= special(stream, own)
    left_out |= {f"{stream.name}.{channel}": int(v.size) for channel, v in own.items()}
    if not keep.all():
        left_out[f"{stream.name} (rows)"] = int((~keep).sum())
    if instance and name in messages.INSTANCE_FIELD:
        fields[messages.INSTANCE_FIELD[name]] = np.full(stream.count, int(instance))
    time_us = recording.time_us(stream.time)
    return _table(name, time_us[keep], begin_us, {f: v[keep] for f, v in fields.items()})


def _field(
    quantity: messages.Quantity,
    values: Float[np.ndarray, " sample"] | None,
    count: int,
    *,
    whole: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Raw values of a field, and which of them the field can say."""
    if values is None:
        unknown = quantity.unknown[0] if quantity.unknown else 0.0 if whole else np.nan
        return np.full(count, unknown), np.ones(count, dtype=bool)
    raw = (values - quantity.offset) / quantity.scale
    raw = np.round(raw) if whole else raw
    missing = ~np.isfinite(raw)
    if whole and quantity.unknown:
        return np.where(missing, quantity.unknown[0], raw), np.ones(count, dtype=bool)
    return np.where(missing & whole, 0.0, raw), ~(missing & whole)


def _table(name: str, time_us: Rows, begin_us: int, fields: Mapping[str, np.ndarray]) -> _Table:
    """Payloads with the vehicle's own stamps, where the message has one."""
    found = layout(_IDS[name])
    payload = np.zeros(time_us.size, dtype=found.dtype)
    stamped = dict(fields)
    if "time_boot_ms" in found.fields:
        stamped["time_boot_ms"] = np.round(1e-3 * (time_us - begin_us)) % 2**32
    elif "time_usec" in found.fields:
        counter = 8 * found.dtype["time_usec"].itemsize
        stamped["time_usec"] = (time_us - begin_us) % 2 ** min(counter, 62)
    for field, values in stamped.items():
        kind = found.dtype[field].base
        if np.issubdtype(kind, np.integer):
            limits = np.iinfo(kind)
            values = np.clip(values, limits.min, limits.max)
        payload[field] = values.astype(kind)
    return _Table(found.id, time_us, payload)


def _attitude_quaternion(stream: Stream, own: Fields) -> Fields:
    angles = np.stack([own.pop(name) for name in ("roll", "pitch", "yaw")], axis=1)
    quaternion = np.nan_to_num(rotations.quaternion_from_euler(angles))
    return {f"q{i + 1}": quaternion[:, i] for i in range(4)}


def _gps(stream: Stream, own: Fields) -> Fields:
    fixed = stream.valid("latitude") & stream.valid("longitude")
    fields: Fields = {"fix_type": np.where(fixed, dialect.GPS_FIX_TYPE_3D_FIX, 0)}
    north, east = own.pop("v_north", None), own.pop("v_east", None)
    unknown = np.full(stream.count, float(messages.UINT16_MAX))
    fields["vel"], fields["cog"] = unknown, unknown
    if north is not None and east is not None:
        known = np.isfinite(north) & np.isfinite(east)
        course = np.degrees(np.arctan2(east, north)) % 360.0
        fields["vel"] = np.where(known, np.round(100.0 * np.hypot(north, east)), unknown)
        fields["cog"] = np.where(known, np.round(100.0 * course) % 36000, unknown)
    return fields


def _local_position(stream: Stream, own: Fields) -> Fields:
    height = own.pop("height", None)
    return {} if height is None else {"z": -height}


def _airspeed(stream: Stream, own: Fields) -> Fields:
    return {"flags": np.where(stream.valid("airspeed"), 0, 1)}


def _wind(stream: Stream, own: Fields) -> Fields:
    north, east = own.pop("wind_north"), own.pop("wind_east")
    return {
        "speed": np.hypot(north, east),
        "direction": np.degrees(np.arctan2(-east, -north)),
    }


def _battery(stream: Stream, own: Fields) -> Fields:
    """All cells in as few fields as hold the voltage."""
    volts = own.pop("voltage", np.full(stream.count, np.nan))
    cells = np.full((stream.count, 10), float(messages.UINT16_MAX))
    left = np.round(1e3 * volts)
    for cell in range(10):
        part = np.minimum(left, messages.UINT16_MAX - 1.0)
        cells[:, cell] = np.where(part > 0.0, part, messages.UINT16_MAX)
        left = left - part
    return {"voltages": cells}


def _esc(first: int) -> Callable[[Stream, Fields], Fields]:
    def write(stream: Stream, own: Fields) -> Fields:
        rpm, count = np.zeros((stream.count, 4)), np.zeros((stream.count, 4))
        for element in range(4):
            values = own.pop(f"rpm_{first + element}", None)
            if values is not None:
                known = np.isfinite(values)
                rpm[known, element] = np.round(values[known])
                count[:, element] = np.cumsum(known) % 2**16 * known
        return {"rpm": rpm, "count": count}

    return write


def _heartbeat(stream: Stream, own: Fields) -> Fields:
    armed = own.pop("armed", None)
    return {} if armed is None else {"base_mode": np.where(armed > 0.5, 128, 0)}


def _highres_imu(stream: Stream, own: Fields) -> Fields:
    bits = np.zeros(stream.count, dtype=np.int64)
    for bit, name in enumerate(messages.HIGHRES_BITS):
        bits |= stream.valid(name).astype(np.int64) << bit
    return {"fields_updated": bits}


_SPECIAL: Mapping[str, Callable[[Stream, Fields], Fields]] = {
    "AIRSPEED": _airspeed,
    "ATTITUDE_QUATERNION": _attitude_quaternion,
    "BATTERY_STATUS": _battery,
    "ESC_TELEMETRY_1_TO_4": _esc(1),
    "ESC_TELEMETRY_5_TO_8": _esc(5),
    "ESC_TELEMETRY_9_TO_12": _esc(9),
    "ESC_TELEMETRY_13_TO_16": _esc(13),
    "GPS2_RAW": _gps,
    "GPS_RAW_INT": _gps,
    "HEARTBEAT": _heartbeat,
    "HIGHRES_IMU": _highres_imu,
    "LOCAL_POSITION_NED": _local_position,
    "WIND": _wind,
}
"""Message type -> fields that a plain scale and offset cannot say; takes the channels it uses."""


def _alive(recording: Recording, begin_us: int, there: set[int]) -> Iterator[_Table]:
    """A heartbeat and the wall time each second, where the recording has none."""
    last = max((float(s.time[-1]) for s in recording.streams.values() if s.count), default=0.0)
    time_us = recording.epoch_us + np.arange(0, round(1e6 * last) + 1, _EVERY_US)
    if _IDS["HEARTBEAT"] not in there:
        # Nothing says whether it was armed; what flies is.
        armed = np.full(time_us.size, 128)
        yield _table("HEARTBEAT", time_us, begin_us, {"base_mode": armed})
    if _IDS["SYSTEM_TIME"] not in there:
        yield _table("SYSTEM_TIME", time_us, begin_us, {"time_unix_usec": time_us})


def _described(recording: Recording) -> Iterator[_Table]:
    """Parameters at the beginning, and texts."""
    begin_us = recording.epoch_us - BOOT_US
    if recording.parameters:
        count = len(recording.parameters)
        fields = {
            "param_id": np.array([name.encode()[:16] for name in recording.parameters]),
            "param_value": np.array(list(recording.parameters.values()), dtype=np.float64),
            "param_type": np.full(count, dialect.MAV_PARAM_TYPE_REAL32),
            "param_count": np.full(count, count),
            "param_index": np.arange(count),
        }
        time_us = np.full(count, recording.epoch_us)
        yield _table("PARAM_VALUE", time_us, begin_us, fields)
    if recording.texts:
        times = recording.time_us(np.array([time for time, _ in recording.texts]))
        lines = np.array([line.encode("utf-8", "replace")[:_TEXT] for _, line in recording.texts])
        severity = np.full(lines.size, dialect.MAV_SEVERITY_INFO)
        yield _table("STATUSTEXT", times, begin_us, {"text": lines, "severity": severity})


def _packed(tables: list[_Table], recording: Recording) -> list[tuple[int, bytes]]:
    """Frames in the order of their times, with sequence numbers in that order."""
    times = np.concatenate([table.time_us for table in tables])
    order = np.argsort(times, kind="stable")
    number = np.empty(order.size, dtype=np.int64)
    number[order] = np.arange(order.size)
    found: list[bytes] = []
    done = 0
    for table in tables:
        _identify(table, recording)
        found += _wrapped(table, number[done : done + table.time_us.size], recording)
        done += table.time_us.size
    return [(int(times[i]), found[i]) for i in order.tolist()]


def _identify(table: _Table, recording: Recording) -> None:
    """Heartbeats say what kind of vehicle it is; a table's flight is flown by nobody known."""
    if table.id != _IDS["HEARTBEAT"]:
        return
    vehicle = recording.vehicle
    unknown = vehicle.autopilot == NO_AUTOPILOT
    table.payload["autopilot"] = (
        dialect.MAV_AUTOPILOT_GENERIC if unknown else _value("MAV_AUTOPILOT", vehicle.autopilot)
    )
    table.payload["type"] = (
        dialect.MAV_TYPE_FIXED_WING if unknown else _value("MAV_TYPE", vehicle.kind)
    )
    table.payload["system_status"] = dialect.MAV_STATE_ACTIVE
    table.payload["mavlink_version"] = 3


def _value(group: str, name: str) -> int:
    """Number of an enum's entry, `GROUP_7` for one that has no name."""
    entries = dialect.enums[group]
    known = next((number for number, entry in entries.items() if entry.name == name), None)
    return int(name.rpartition("_")[2]) if known is None else known


def _wrapped(table: _Table, number: Rows, recording: Recording) -> list[bytes]:
    size = table.payload.dtype.itemsize
    count = table.time_us.size
    body = np.zeros((count, 9 + size), dtype=np.uint8)
    body[:, 0] = size
    body[:, 3] = number % 256
    body[:, 4] = recording.vehicle.system or 1
    body[:, 5] = recording.vehicle.component or 1
    body[:, 6:9] = [table.id & 0xFF, table.id >> 8 & 0xFF, table.id >> 16]
    body[:, 9:] = table.payload.view(np.uint8).reshape(count, size)
    extra = np.full(count, crc_extras()[table.id], dtype=np.uint8)
    crc = checksum(body, extra)
    start = bytes([MAGIC_V2])
    return [
        start + one.tobytes() + int(c).to_bytes(2, "little")
        for one, c in zip(body, crc.tolist(), strict=True)
    ]
