"""Telemetry logs (.tlog): frames as received, each behind its arrival time.

The stamp is the ground station's clock, 8 bytes, big-endian, microseconds since 1970.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from gcs_sysid.sources.decode import decode
from gcs_sysid.sources.frames import Bytes, search, windows
from gcs_sysid.sources.tables import LogTables

STAMP = 8
"""Bytes of the stamp before each frame."""

PLAUSIBLE_US = 30 * 86400 * 1_000_000
"""No flight lasts a month: a stamp further than this from the others is damaged."""


def read(data: bytes) -> LogTables:
    """All messages in `data`, the content of a .tlog."""
    content = np.frombuffer(data, dtype=np.uint8)
    found = search(content, prefix=STAMP)
    lost = {
        "bad_crc": found.bad_crc,
        "unknown": found.unknown.start.size,
        "garbage_bytes": found.garbage_bytes,
        "truncated": int(found.rest < content.size),
    }
    return LogTables(decode(content, found.frames, _stamps(content, found.frames.start)), lost)


def frames(data: bytes) -> list[tuple[int, bytes]]:
    """(arrival time [µs since 1970], frame) of all messages, unknown ones too, as recorded."""
    content = np.frombuffer(data, dtype=np.uint8)
    found = search(content, prefix=STAMP)
    start = np.concatenate([found.frames.start, found.unknown.start])
    end = np.concatenate([found.frames.end, found.unknown.end])
    sort = np.argsort(start)
    stamps = _stamps(content, start[sort])
    return [
        (link_us, data[first:last])
        for link_us, first, last in zip(
            stamps.tolist(), start[sort].tolist(), end[sort].tolist(), strict=True
        )
    ]


def _stamps(content: Bytes, start: Int[np.ndarray, " frame"]) -> Int[np.ndarray, " frame"]:
    """Arrival times; a damaged one, which no checksum protects, takes that of the next frame.

    Too late is harmless, as the earliest arrivals set the clock.
    """
    raw = windows(content, STAMP)[start - STAMP].view(">u8")[:, 0]
    stamps = np.minimum(raw, 2**62).astype(np.int64)
    if not stamps.size:
        return stamps
    middle = np.sort(stamps)[stamps.size // 2]
    sane = np.abs(stamps - middle) < PLAUSIBLE_US
    places = np.flatnonzero(sane)
    following = np.searchsorted(places, np.arange(stamps.size))
    return stamps[places[np.minimum(following, places.size - 1)]]
