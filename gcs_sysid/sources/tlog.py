"""Telemetry logs (.tlog): frames as received, each behind its arrival time.

The stamp is the ground station's clock, 8 bytes, big-endian, microseconds since 1970.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Int

from gcs_sysid.errors import SourceError
from gcs_sysid.recording import Recording
from gcs_sysid.sources import assemble, content
from gcs_sysid.sources.decode import decode
from gcs_sysid.sources.frames import Bytes, search, windows
from gcs_sysid.sources.tables import LogTables

STAMP = 8
"""Bytes of the stamp before each frame."""

PLAUSIBLE_US = 30 * 86400 * 1_000_000
"""No flight lasts a month: a stamp further than this from the others is damaged."""


def open_log(
    path: Path, *, vehicle: int | None, progress: Callable[[float], None] = lambda _fraction: None
) -> Recording:
    """The flight in a .tlog.

    Args:
        path: the file.
        vehicle: system id to use; None takes the only one there is.
        progress: told when the log is read.

    Raises:
        SourceError: the file cannot be read, or holds no MAVLink message.
        RefusedError: it holds several vehicles and none was chosen.
    """
    data = content.read(path)
    log = read(data)
    progress(1.0)
    if not log.tables:
        raise SourceError(
            str(path),
            f"no MAVLink message in {len(data)} bytes",
            fix="give a .tlog as a ground station records it",
        )
    digest = hashlib.sha256(data).hexdigest()
    return assemble.recording(log, source=str(path), sha256=digest, vehicle=vehicle)


def read(data: bytes) -> LogTables:
    """All messages in `data`, the content of a .tlog."""
    raw = np.frombuffer(data, dtype=np.uint8)
    found = search(raw, prefix=STAMP)
    lost = {
        "bad_crc": found.bad_crc,
        "unknown": found.unknown.start.size,
        "garbage_bytes": found.garbage_bytes,
        "truncated": int(found.rest < raw.size),
    }
    return LogTables(decode(raw, found.frames, _stamps(raw, found.frames.start)), lost)


def frames(data: bytes) -> list[tuple[int, bytes]]:
    """(arrival time [µs since 1970], frame) of all messages, unknown ones too, as recorded."""
    raw = np.frombuffer(data, dtype=np.uint8)
    found = search(raw, prefix=STAMP)
    start = np.concatenate([found.frames.start, found.unknown.start])
    end = np.concatenate([found.frames.end, found.unknown.end])
    sort = np.argsort(start)
    stamps = _stamps(raw, start[sort])
    return [
        (link_us, data[first:last])
        for link_us, first, last in zip(
            stamps.tolist(), start[sort].tolist(), end[sort].tolist(), strict=True
        )
    ]


def _stamps(data: Bytes, start: Int[np.ndarray, " frame"]) -> Int[np.ndarray, " frame"]:
    """Arrival times; a damaged one, which no checksum protects, takes that of the next frame.

    Too late is harmless, as the earliest arrivals set the clock.
    """
    raw = windows(data, STAMP)[start - STAMP].view(">u8")[:, 0]
    stamps = np.minimum(raw, 2**62).astype(np.int64)
    if not stamps.size:
        return stamps
    middle = np.sort(stamps)[stamps.size // 2]
    sane = np.abs(stamps - middle) < PLAUSIBLE_US
    places = np.flatnonzero(sane)
    following = np.searchsorted(places, np.arange(stamps.size))
    return stamps[places[np.minimum(following, places.size - 1)]]
