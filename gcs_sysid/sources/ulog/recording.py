"""From a PX4 log to a Recording with the streams that telemetry of the flight would have."""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from pyulog import ULog
from pyulog.exceptions import ULogException

from gcs_sysid.errors import RefusedError, SourceError
from gcs_sysid.recording import Recording, Vehicle
from gcs_sysid.sources import assemble, content, joined
from gcs_sysid.sources.joined import Piece
from gcs_sysid.sources.messages import stream_name
from gcs_sysid.sources.ulog.topics import BY_INSTANCE, DEMANDS, READINGS, WANTED, Topic

MAGIC = b"ULog\x01\x12\x35"
_DAMAGED = (
    ULogException,
    struct.error,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    ArithmeticError,
    MemoryError,
)
"""What pyulog raises on bytes that are no such log."""
_OFTEN = 1 << 20
_READ_TIMES = 4
"""How often a file may be read over while the next whole message is searched for in damage."""
_UNIX_US = 1e15
"""A GPS time before this [µs since 1970] was made up by a receiver without a fix."""
_LONGEST_US = 30 * 86400e6
"""No flight lasts a month: stamps further from the others are damaged."""
_KINDS: Mapping[int, str] = {
    1: "MAV_TYPE_FIXED_WING",
    2: "MAV_TYPE_QUADROTOR",
    **dict.fromkeys((19, 20, 21, 22, 23, 24, 25), "MAV_TYPE_VTOL_FIXEDROTOR"),
}
"""Parameter `MAV_TYPE` (MAVLink's MAV_TYPE); all kinds of VTOL count alike."""

Topics = Mapping[tuple[str, int], Topic]


class _Careful(io.BufferedReader):
    """A file that tells how far it was read, and ends where damage would trap pyulog.

    Behind a header that announces more bytes than the file has left, pyulog 1.3 goes back by what
    was announced instead of by what was read, and finds itself where it was before, without end.
    """

    def __init__(self, path: Path, size: int, progress: Callable[[float], None]) -> None:
        super().__init__(io.FileIO(path))
        self._size = size
        self._progress = progress
        self._told = 0
        self._missing = 0
        self._left = _READ_TIMES * size + _OFTEN

    def read(self, size: int | None = -1, /) -> bytes:
        place = self.tell()
        if place - self._told > _OFTEN:
            self._told = place
            self._progress(place / self._size)
        data = super().read(size) if self._left > 0 else b""
        self._left -= len(data)
        self._missing = max((size or 0) - len(data), 0)
        return data

    def seek(self, offset: int, whence: int = 0, /) -> int:
        if whence == 1 and offset < 0:
            offset = min(offset + self._missing, 0)
        self._missing = 0
        return super().seek(offset, whence)


def open_log(path: Path, *, vehicle: int | None, progress: Callable[[float], None]) -> Recording:
    """The flight in a .ulg.

    Args:
        path: the file.
        vehicle: system id asked for; such a log holds one vehicle only.
        progress: told which fraction is read.

    Raises:
        SourceError: the file cannot be read, or is no such log.
        RefusedError: another vehicle was asked for.
    """
    data = content.mapped(path)
    if data[: len(MAGIC)].tobytes() != MAGIC:
        raise SourceError(str(path), "is no ULog", fix="give the .ulg that PX4 wrote")
    said = io.StringIO()
    try:
        # pyulog prints what it finds damaged; it is told in `lost` instead.
        with contextlib.redirect_stdout(said), _Careful(path, data.size, progress) as file:
            log = ULog(file, sorted(WANTED))
    except _DAMAGED as error:
        reason = " ".join(str(error).split())[:120]
        raise SourceError(
            str(path), f"cannot be read as ULog ({reason})", fix="copy it from the vehicle again"
        ) from error
    progress(1.0)
    return recording(log, source=str(path), sha256=content.digest(path), vehicle=vehicle)


def recording(log: ULog, *, source: str, sha256: str, vehicle: int | None = None) -> Recording:
    """The Recording of a log; see `open_log`."""
    parameters = _parameters(log)
    topics: Topics = {
        (one.name, one.multi_id): one.data for one in log.data_list if "timestamp" in one.data
    }
    own = Vehicle(
        system=_id(parameters),
        component=1,
        autopilot="MAV_AUTOPILOT_PX4",
        kind=_KINDS.get(int(parameters.get("MAV_TYPE", 1.0)), "MAV_TYPE_FIXED_WING"),
        messages=sum(int(topic["timestamp"].size) for topic in topics.values()),
    )
    if vehicle not in (None, own.system):
        raise RefusedError(
            source,
            f"an onboard log holds one vehicle, and this one's system id is {own.system}",
            fix=f"leave --vehicle out, or use --vehicle {own.system}",
        )
    middle = _middle(topics)
    pieces = [*_pieces(topics, middle), *_demanded(topics, parameters, middle)]
    if not pieces:
        raise SourceError(
            source,
            "holds none of the topics that tell of the flight",
            fix="log sensor_combined, vehicle_attitude, airspeed (PX4: SDLOG_PROFILE = 1)",
        )
    origin_us = min(float(piece.time_us.min()) for piece in pieces)
    streams, absent = assemble.without_absent(
        joined.streams(pieces, origin_us, beside_us=joined.BESIDE_US)
    )
    boot_us, notes = _wall_time(topics)
    lost, dropped = _lost(log)
    return Recording(
        source=source,
        sha256=sha256,
        vehicle=own,
        epoch_us=round(boot_us + origin_us),
        streams=streams,
        parameters=parameters,
        texts=tuple(
            (1e-6 * (line.timestamp - origin_us), str(line.message))
            for line in sorted(log.logged_messages, key=lambda line: line.timestamp)
        ),
        lost=lost,
        clock_notes=(*notes, *dropped, *absent),
    )


def _parameters(log: ULog) -> dict[str, float]:
    """Last value of each parameter that is a number."""
    last = dict(log.initial_parameters)
    last.update({name: value for _, name, value in log.changed_parameters})
    return {name: float(value) for name, value in last.items() if isinstance(value, int | float)}


def _id(parameters: Mapping[str, float]) -> int:
    system = parameters.get("MAV_SYS_ID", 1.0)
    return int(system) if 0.0 < system < 256.0 else 1


def _middle(topics: Topics) -> float:
    stamps = [np.median(topic["timestamp"]) for topic in topics.values()]
    return float(np.median(stamps)) if stamps else 0.0


def _times(topic: Topic) -> Float[np.ndarray, " sample"]:
    """When the values were sampled [µs since boot]; when they were published where nothing says."""
    published = topic["timestamp"].astype(np.float64)
    if "timestamp_sample" not in topic:
        return published
    sampled = topic["timestamp_sample"].astype(np.float64)
    late = published - sampled
    return np.where((sampled > 0.0) & (late >= 0.0) & (late < 1e6), sampled, published)


def _piece(
    stream: str, topic: Topic, channels: Mapping[str, np.ndarray], middle: float
) -> Piece | None:
    time = _times(topic)
    sort = np.argsort(time, kind="stable")
    sort = sort[np.abs(time[sort] - middle) < _LONGEST_US]
    if not sort.size:
        return None
    return Piece(stream, time[sort], {name: values[sort] for name, values in channels.items()})


def _pieces(topics: Topics, middle: float) -> Iterator[Piece]:
    """Measurements of all streams, the most important of each first."""
    for reading in READINGS:
        instances = sorted(number for name, number in topics if name == reading.topic)
        if not (reading.each or reading.topic in BY_INSTANCE):
            instances = instances[:1]
        for number in instances:
            topic = topics[reading.topic, number]
            stream = stream_name(reading.stream, number) if reading.each else reading.stream
            piece = _piece(stream, topic, reading.read(topic, number), middle)
            if piece is not None:
                yield piece


def _demanded(topics: Topics, parameters: Mapping[str, float], middle: float) -> Iterator[Piece]:
    """Pulses that follow from demands, for outputs whose pulses were not logged.

    PX4 puts a demand of -1 to 1 linearly between PWM_MAIN_MINn and PWM_MAIN_MAXn (a motor's 0 to
    1), turned around where the bit of PWM_MAIN_REV is set.
    """
    if any(name == "actuator_outputs" for name, _ in topics):
        return
    for name, first in DEMANDS.items():
        topic = topics.get((name, 0))
        if topic is None:
            continue
        channels = {}
        for output in range(1, 17):
            number = int(parameters.get(f"PWM_MAIN_FUNC{output}", 0.0)) - first
            column = topic.get(f"control[{number}]")
            if column is None:
                continue
            demand = column.astype(np.float64)
            share = demand if name == "actuator_motors" else 0.5 * (demand + 1.0)
            if int(parameters.get("PWM_MAIN_REV", 0.0)) >> (output - 1) & 1:
                share = 1.0 - share
            low = parameters.get(f"PWM_MAIN_MIN{output}", 1000.0)
            high = parameters.get(f"PWM_MAIN_MAX{output}", 2000.0)
            channels[f"pwm_{output}"] = low + (high - low) * np.clip(share, 0.0, 1.0)
        if channels:
            piece = _piece("SERVO_OUTPUT_RAW", topic, channels, middle)
            if piece is not None:
                yield piece


def _wall_time(topics: Topics) -> tuple[float, list[str]]:
    """Wall time of boot [µs since 1970] and how it is known; 0 where the log does not tell."""
    for name in ("vehicle_gps_position", "sensor_gps"):
        topic = topics.get((name, 0))
        if topic is None or "time_utc_usec" not in topic:
            continue
        wall = topic["time_utc_usec"].astype(np.float64)
        known = wall > _UNIX_US
        if known.any():
            boot = (wall - topic["timestamp"].astype(np.float64))[known]
            spread = 1e-6 * float(np.ptp(boot))
            return float(np.median(boot)), [
                f"wall time from {boot.size} {name} messages, boot at "
                f"{1e-6 * float(np.median(boot)):.6f} s since 1970, spread {spread:.6f} s"
            ]
    return 0.0, ["no wall time in this log: its clock counts from boot, shown as 1970"]


def _lost(log: Any) -> tuple[dict[str, int], list[str]]:
    """Counts by reason, and a sentence about pauses in the log."""
    pauses: Sequence[int] = [int(one.duration) for one in log.dropouts]
    lost = {"dropouts": len(pauses), "damaged": int(log.file_corruption)}
    if not pauses:
        return lost, []
    return lost, [
        f"the autopilot could not write for {1e-3 * sum(pauses):.3f} s in {len(pauses)} pauses, "
        f"the longest {1e-3 * max(pauses):.3f} s"
    ]
