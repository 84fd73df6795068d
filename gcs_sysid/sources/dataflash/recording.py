"""From a DataFlash log to a Recording with the streams that telemetry of the flight would have."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid.errors import RefusedError, SourceError
from gcs_sysid.recording import Recording, Stream, Vehicle
from gcs_sysid.sources import assemble, content, joined
from gcs_sysid.sources.dataflash import binary, channels, text
from gcs_sysid.sources.dataflash.channels import Reading
from gcs_sysid.sources.dataflash.formats import plain_text
from gcs_sysid.sources.dataflash.log import DataflashLog, Messages
from gcs_sysid.sources.joined import Piece
from gcs_sysid.sources.messages import stream_name

SUFFIXES = (".bin", ".log")
_GPS_EPOCH_S = 315_964_800
"""6 January 1980, where GPS time begins [s since 1970]."""
_WEEK_S = 604_800
_LEAP_S = ((1_167_264_017, 18), (1_119_744_016, 17), (0, 16))
"""From which GPS second on it is ahead of UTC by how much (IERS Bulletin C 52 and 49)."""
_MOST = 256
"""Instances are numbered in a byte."""
_FIX = 3
"""Status of a receiver from which on it has a position in three dimensions."""
_KINDS: Mapping[str, str] = {
    "ArduPlane": "MAV_TYPE_FIXED_WING",
    "ArduCopter": "MAV_TYPE_QUADROTOR",
    "ArduRover": "MAV_TYPE_GROUND_ROVER",
    "ArduSub": "MAV_TYPE_SUBMARINE",
}
_SYSTEM = ("SYSID_THISMAV", "MAV_SYSID")


def open_log(path: Path, *, vehicle: int | None, progress: Callable[[float], None]) -> Recording:
    """The flight in a .bin or .log.

    Args:
        path: the file.
        vehicle: system id asked for; such a log holds one vehicle only.
        progress: told which fraction is read.

    Raises:
        SourceError: the file cannot be read, or is no such log.
        RefusedError: another vehicle was asked for.
    """
    data = content.mapped(path)
    if bytes(data[:2]) == binary.MAGIC:
        log = binary.read(data, wanted=channels.WANTED, progress=progress)
    elif text.looks_like(bytes(data[:65536])):
        log = text.read(bytes(data), wanted=channels.WANTED, progress=progress)
    else:
        log = binary.read(data, wanted=channels.WANTED, progress=progress)
    if not any(one.time_us.size for name, one in log.messages.items() if name != "FMT"):
        raise SourceError(
            str(path),
            f"no DataFlash message in {data.size} bytes",
            fix="give the .bin that the autopilot wrote, or its .log in text",
        )
    return recording(log, source=str(path), sha256=content.digest(path), vehicle=vehicle)


def recording(
    log: DataflashLog, *, source: str, sha256: str, vehicle: int | None = None
) -> Recording:
    """The Recording of a log; see `open_log`."""
    parameters = _parameters(log.messages.get("PARM"))
    texts = _texts(log.messages.get("MSG"))
    own = _vehicle(log, parameters, [line for _, line in texts])
    if vehicle not in (None, own.system):
        raise RefusedError(
            source,
            f"an onboard log holds one vehicle, and this one's system id is {own.system}",
            fix=f"leave --vehicle out, or use --vehicle {own.system}",
        )
    pieces = list(_pieces(log))
    if not pieces:
        raise SourceError(
            source, "no message carries a time", fix="log IMU, ATT, GPS, ARSP and RCOU"
        )
    boot_us, notes = _wall_time(log.messages)
    origin_us = min(float(piece.time_us.min()) for piece in pieces)
    streams, absent = assemble.without_absent(
        joined.streams(pieces, origin_us, beside_us=joined.BESIDE_US)
    )
    if log.restarts:
        notes.append(f"the autopilot restarted {log.restarts} time(s) in this log")
    return Recording(
        source=source,
        sha256=sha256,
        vehicle=own,
        epoch_us=round(boot_us + origin_us),
        streams=_wrapped(streams),
        parameters=parameters,
        texts=tuple((1e-6 * (time - origin_us), line) for time, line in texts),
        lost={
            **log.lost,
            "bad_instance": _impossible(log),
            "dropped": _dropped(log.messages.get("DSF")),
        },
        clock_notes=(*notes, *absent),
    )


def _parameters(messages: Messages | None) -> dict[str, float]:
    """Last value of each parameter."""
    if messages is None or not (messages.has("Name") and messages.has("Value")):
        return {}
    names = [plain_text(name) for name in messages.raw("Name").tolist()]
    return dict(zip(names, messages.value("Value").tolist(), strict=True))


def _texts(messages: Messages | None) -> list[tuple[float, str]]:
    if messages is None or not messages.has("Message"):
        return []
    lines = [plain_text(line) for line in messages.raw("Message").tolist()]
    return list(zip(messages.time_us.astype(np.float64).tolist(), lines, strict=True))


def _vehicle(log: DataflashLog, parameters: Mapping[str, float], texts: list[str]) -> Vehicle:
    system = next((parameters[name] for name in _SYSTEM if name in parameters), 1.0)
    system = int(system) if 0.0 < system < 256.0 else 1
    said = " ".join(texts)
    kind = next((kind for name, kind in _KINDS.items() if name in said), "MAV_TYPE_FIXED_WING")
    return Vehicle(system, 1, "MAV_AUTOPILOT_ARDUPILOTMEGA", kind, log.count)


def _dropped(messages: Messages | None) -> int:
    """Messages that the autopilot could not write, by its own count."""
    if messages is None or not messages.has("Dp") or not messages.time_us.size:
        return 0
    counted = messages.value("Dp")
    return int(np.max(counted, where=np.isfinite(counted), initial=0.0))


def _pieces(log: DataflashLog) -> Iterator[Piece]:
    """Measurements of all streams, the most important of each first."""
    for reading in channels.READINGS:
        messages = log.messages.get(reading.message)
        if messages is None or not messages.time_us.size:
            continue
        if reading.message.startswith("N") and "XKF1" in log.messages:
            continue
        if reading.message in channels.CORES:
            messages = _primary(messages, log.messages)
        yield from _read(reading, messages, log.messages)
    for name, stream in channels.MOTORS.items():
        messages = log.messages.get(name)
        if messages is not None and messages.has("RPM"):
            yield from _motors(messages, stream)
    known = channels.WANTED | set(channels.DEFINITIONS)
    for name, messages in log.messages.items():
        if name not in known and np.any(messages.time_us):
            yield Piece(name, _times(messages), {})


def _times(messages: Messages) -> Float[np.ndarray, " message"]:
    return messages.time_us.astype(np.float64)


def _subset(messages: Messages, mask: Bool[np.ndarray, " message"]) -> Messages:
    rows = messages.rows
    taken = rows[mask] if isinstance(rows, np.ndarray) else {n: v[mask] for n, v in rows.items()}
    return replace(messages, time_us=messages.time_us[mask], rows=taken)


def _instances(messages: Messages) -> Iterator[tuple[int, Messages]]:
    """Messages of each sensor of a type."""
    field = messages.format.instance
    if field is None:
        yield 0, messages
        return
    numbers = messages.value(field)
    for number in np.unique(numbers[_possible(numbers)]).tolist():
        yield int(number), _subset(messages, numbers == number)


def _possible(numbers: Float[np.ndarray, " message"]) -> Bool[np.ndarray, " message"]:
    """Which numbers of sensors can be: of a damaged line in text they may be anything."""
    return (numbers >= 0.0) & (numbers < _MOST) & (numbers == np.floor(numbers))


def _impossible(log: DataflashLog) -> int:
    """Messages left out because the number of their sensor cannot be."""
    read = (log.messages.get(name) for name in {one.message for one in channels.READINGS})
    fields = [(one, one.format.instance) for one in read if one is not None and one.time_us.size]
    return sum(int(np.sum(~_possible(one.value(name)))) for one, name in fields if name)


def _primary(messages: Messages, others: Mapping[str, Messages]) -> Messages:
    """Messages of the core that the autopilot flew by."""
    cores = dict(_instances(messages))
    choice = others.get(channels.PRIMARY[messages.format.name[0]])
    if len(cores) == 1:
        return next(iter(cores.values()))
    if choice is None or not choice.has("PI") or not choice.time_us.size:
        return cores[min(cores)]
    numbers, counts = np.unique(choice.value("PI"), return_counts=True)
    return cores.get(int(numbers[np.argmax(counts)]), cores[min(cores)])


def _read(reading: Reading, messages: Messages, others: Mapping[str, Messages]) -> Iterator[Piece]:
    split = _instances(messages) if reading.message not in channels.CORES else [(0, messages)]
    for number, own in split:
        at = reading.first + number
        stream = (
            reading.streams[at]
            if at < len(reading.streams)
            else stream_name(reading.streams[0], at)
        )
        values = {f.channel: f.read(own) for f in reading.fields if own.has(f.field)}
        if reading.healthy is not None and own.has(reading.healthy):
            _hide(values, own.value(reading.healthy) == 0.0)
        time = _times(own)
        if reading.message.startswith("GPS"):
            time = _fixes(own, values, others.get("GPA"), number)
        sort = np.argsort(time, kind="stable")
        yield Piece(stream, time[sort], {name: column[sort] for name, column in values.items()})


def _hide(values: dict[str, np.ndarray], where: Bool[np.ndarray, " message"]) -> None:
    for name, column in values.items():
        values[name] = np.where(where, np.nan, column)


def _fixes(
    messages: Messages, values: dict[str, np.ndarray], accuracy: Messages | None, number: int
) -> Float[np.ndarray, " message"]:
    """Adds velocity over ground and hides what is no fix; times [µs] at which fixes were taken."""
    if messages.has("Spd") and messages.has("GCrs"):
        speed, course = messages.value("Spd"), np.radians(messages.value("GCrs"))
        values["v_north"], values["v_east"] = speed * np.cos(course), speed * np.sin(course)
    if messages.has("Status"):
        _hide(values, messages.value("Status") < _FIX)
    time = _times(messages)
    if accuracy is None or not accuracy.has("SMS"):
        return time
    # GPA is written right behind GPS and knows when the receiver took the fix.
    own = dict(_instances(accuracy)).get(number)
    if own is None or not own.time_us.size:
        return time
    at = np.clip(np.searchsorted(own.time_us, messages.time_us), 0, own.time_us.size - 1)
    near = np.abs(own.time_us[at] - messages.time_us) <= joined.BESIDE_US
    taken = 1e6 * own.value("SMS") * (1.0 if own.format.unit("SMS") else 1e-3)
    late = time - taken[at]
    return np.where(near & (late >= 0.0) & (late < 1e6), taken[at], time)


def _motors(messages: Messages, stream: Callable[[int], str]) -> Iterator[Piece]:
    for number, own in _instances(messages):
        rpm = own.value("RPM")
        yield Piece(stream(number), _times(own), {f"rpm_{number + 1}": rpm})


def _wall_time(messages: Mapping[str, Messages]) -> tuple[float, list[str]]:
    """Wall time of boot [µs since 1970] and how it is known; 0 where the log does not tell."""
    performance, receiver = messages.get("PM"), messages.get("GPS")
    if performance is not None and performance.has("R"):
        wall = performance.raw("R").astype(np.float64)
        known = (wall > 0.0) & np.isfinite(wall)
        if known.any():
            return _boot(wall[known] - _times(performance)[known], "PM")
    if receiver is not None and all(receiver.has(name) for name in ("GWk", "GMS", "Status")):
        milliseconds = receiver.raw("GMS").astype(np.float64)
        seconds = receiver.value("GWk") * _WEEK_S + 1e-3 * milliseconds
        fixed = (receiver.value("Status") >= _FIX) & (receiver.value("GWk") > 0.0)
        known = fixed & np.isfinite(milliseconds)
        if known.any():
            leap = next(leap for since, leap in _LEAP_S if float(seconds[known][0]) >= since)
            wall = 1e6 * (seconds + _GPS_EPOCH_S - leap)
            fixes = _fixes(receiver, {}, messages.get("GPA"), 0)
            return _boot((wall - fixes)[known], "GPS")
    return 0.0, ["no wall time in this log: its clock counts from boot, shown as 1970"]


def _boot(differences: Float[np.ndarray, " message"], name: str) -> tuple[float, list[str]]:
    boot = float(np.median(differences))
    return boot, [
        f"wall time from {differences.size} {name} messages, boot at {1e-6 * boot:.6f} s since "
        f"1970, spread {1e-6 * float(np.ptp(differences)):.6f} s"
    ]


def _wrapped(streams: Mapping[str, Stream]) -> dict[str, Stream]:
    """Streams with headings within half a turn and rows of a dead estimator or unit hidden."""
    return {name: replace(s, channels=_clean(s.channels)) for name, s in streams.items()}


_DEAD_AT_ZERO = (
    (("acc_x", "acc_y", "acc_z"), ("acc_x", "acc_y", "acc_z", "p", "q", "r")),
    (("mag_x", "mag_y", "mag_z"), ("mag_x", "mag_y", "mag_z")),
    (("latitude", "longitude"), ("latitude", "longitude")),
)
"""Channels that are never all exactly zero while their sensor works, and what to hide then."""


def _clean(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    result = dict(values)
    if "yaw" in result:
        result["yaw"] = (result["yaw"] + np.pi) % (2.0 * np.pi) - np.pi
    for tell, hide in _DEAD_AT_ZERO:
        if set(tell) <= set(result):
            dead = np.all([result[name] == 0.0 for name in tell], axis=0)
            if dead.any():
                _hide_some(result, hide, dead)
    return result


def _hide_some(values: dict[str, np.ndarray], names: tuple[str, ...], where: np.ndarray) -> None:
    for name in names:
        if name in values:
            values[name] = np.where(where, np.nan, values[name])
