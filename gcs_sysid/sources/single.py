"""One frame alone in a piece of input, as every UDP datagram is: found without searching.

`frames.search` and `decode.decode` are made for megabytes; setting them up costs ten times what one
frame needs. Both ways give the same, and a test holds them together.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from gcs_sysid.sources.checksum import byte_table
from gcs_sysid.sources.frames import (
    CHECKSUM,
    HEADER_V1,
    HEADER_V2,
    MAGIC_V1,
    MAGIC_V2,
    SIGNATURE,
    SIGNED,
    Found,
    Frames,
)
from gcs_sysid.sources.layouts import crc_extras, known_ids, layout, sizes
from gcs_sysid.sources.tables import MessageTable, TableKey

_NONE = Frames(*(np.zeros(0, dtype=np.int64) for _ in range(5)))


@cache
def _steps() -> list[int]:
    return byte_table().tolist()


@cache
def _definition(message_id: int) -> tuple[int, int] | None:
    """Checksum seed and bytes of all fields of a message; None for an unknown one."""
    if message_id >= known_ids().size or not known_ids()[message_id]:
        return None
    return int(crc_extras()[message_id]), int(sizes()[message_id])


def found(data: bytes) -> Found | None:
    """What a search finds in `data` if that is exactly one proved frame; else None."""
    if len(data) < HEADER_V1 + CHECKSUM:
        return None
    if data[0] == MAGIC_V1:
        header, message_id, signed = HEADER_V1, data[5], False
    elif data[0] == MAGIC_V2 and len(data) >= HEADER_V2 + CHECKSUM and not data[2] & ~SIGNED:
        header, message_id = HEADER_V2, data[7] | data[8] << 8 | data[9] << 16
        signed = bool(data[2] & SIGNED)
    else:
        return None
    known = _definition(message_id)
    end = header + data[1] + CHECKSUM
    if known is None or len(data) != end + (SIGNATURE if signed else 0):
        return None
    extra, whole = known
    if header == HEADER_V1 and data[1] > whole:
        return None
    if _checksum(data[1 : end - CHECKSUM], extra) != data[end - 2] | data[end - 1] << 8:
        return None
    values = (0, len(data), header, data[1], message_id)
    frames = Frames(*(np.array([value], dtype=np.int64) for value in values))
    return Found(frames, 0, _NONE, 0, len(data))


def _checksum(body: bytes, extra: int) -> int:
    """CRC-16/MCRF4XX of a frame's body and the seed of its message, see `checksum`."""
    steps, crc = _steps(), 0xFFFF
    for byte in body:
        crc = (crc >> 8) ^ steps[(crc ^ byte) & 0xFF]
    return (crc >> 8) ^ steps[(crc ^ extra) & 0xFF]


def decoded(data: bytes, frame: Found, link_us: int) -> dict[TableKey, MessageTable]:
    """What `decode` makes of that frame.

    Args:
        data: the frame.
        frame: as `found` gave it.
        link_us: when it arrived [µs since 1970].
    """
    header, length = int(frame.frames.header[0]), int(frame.frames.length[0])
    kind = layout(int(frame.frames.id[0]))
    whole = kind.dtype.itemsize
    payload = data[header : header + min(length, whole)].ljust(whole, b"\0")
    # A copy, since what comes from bytes cannot be written to.
    values = np.frombuffer(payload, dtype=kind.dtype).copy()
    sender = 3 if header == HEADER_V1 else 5
    key = TableKey(data[sender], data[sender + 1], kind.name)
    fields = {name: values[name] for name in kind.fields}
    return {key: MessageTable(np.zeros(1, dtype=np.int64), np.array([link_us]), fields)}
