"""The MAVLink checksum of many frames at once.

CRC-16/MCRF4XX (X.25 polynomial 0x1021 reflected, start 0xFFFF, no final inversion), over the frame
from its length byte to the end of the payload, then one seed byte of the message definition.

The checksum is linear over GF(2): that of a frame is the exclusive or of one table entry a byte,
where the entry depends on the byte and on how many bytes follow it, and of the start value carried
through all bytes. So all frames of one length are summed by look-ups, without a loop over bytes.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import UInt8, UInt16

_START = 0xFFFF
_POLYNOMIAL = 0x8408  # 0x1021, reflected
_LONGEST = 9 + 255  # header of version 2 without its first byte, and the largest payload


@cache
def byte_table() -> UInt16[np.ndarray, " byte"]:
    """Checksum of each single byte from a start of zero."""
    table = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        table = np.where(table & 1, (table >> 1) ^ _POLYNOMIAL, table >> 1).astype(np.uint16)
    return table


def _advance(
    crc: UInt16[np.ndarray, "*shape"], byte: UInt8[np.ndarray, "*#shape"]
) -> UInt16[np.ndarray, "*shape"]:
    return (crc >> 8) ^ byte_table()[(crc ^ byte) & 0xFF]


@cache
def _entries() -> tuple[UInt16[np.ndarray, " entry"], UInt16[np.ndarray, " length"]]:
    """Entries by (bytes that follow, byte), flat, and the start value carried through n bytes."""
    table = np.empty((_LONGEST, 256), dtype=np.uint16)
    start = np.empty(_LONGEST + 1, dtype=np.uint16)
    table[0] = byte_table()
    start[0] = _START
    zero = np.zeros(1, dtype=np.uint8)
    for n in range(1, _LONGEST):
        table[n] = _advance(table[n - 1], zero)
    for n in range(1, _LONGEST + 1):
        start[n] = _advance(start[n - 1 : n], zero)[0]
    return table.ravel(), start


def checksum(
    bodies: UInt8[np.ndarray, "frame byte"], extra: UInt8[np.ndarray, " frame"]
) -> UInt16[np.ndarray, " frame"]:
    """Checksums of frames of one length.

    Args:
        bodies: from the length byte to the end of the payload.
        extra: seed byte of each frame's message definition.
    """
    length = bodies.shape[1]
    entries, start = _entries()
    offset = 256 * np.arange(length - 1, -1, -1, dtype=np.intp)
    crc = np.bitwise_xor.reduce(entries.take(bodies + offset), axis=1)
    return _advance(crc ^ start[length], extra)
