"""Whether a MATLAB 5 file is whole, before a library that trusts its tags reads it.

SciPy's reader takes an unknown data type for an index and brings the whole program down
(scipy 1.x, `_mio5_utils.read_numeric`). Layout: MathWorks, MAT-File Format, 2019, chapter 1.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator

HEADER = 128
MAJOR_VERSION = 1
"""Of MATLAB 5 to 7.2 files; 7.3 is HDF5 and says 2."""
MATRIX = 14
COMPRESSED = 15
NUMERIC = {1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18}
"""miINT8 … miUINT32, miSINGLE, miDOUBLE, miINT64, miUINT64, miUTF8 … miUTF32."""
DEEPEST = 50
"""Structs within structs; more is damage."""
COMPLEX = 0x0800
CONTENT = {1: "nnm*", 2: "nnnnm*", 3: "nnnnnm*", 5: "nnnnn", 16: "nnm", 17: "nnnm"}
"""What follows the flags of an array, by its class (cell, struct, object, sparse, function,
opaque): n numbers or text, m an array. All other classes, numbers and text, have `nnn`."""
LAST_CLASS = 17


def check(data: bytes) -> None:
    """Nothing, for a file whose elements have known types and end where they say.

    Raises:
        ValueError: an element is damaged or cut.
        zlib.error: a compressed one is.
    """
    if len(data) < HEADER or 0 in data[:4]:  # version 4 has no such header, and no such tags
        return
    # Version and byte order as SciPy takes them, or it would read what was not checked.
    if data[125 if data[126:127] == b"I" else 124] != MAJOR_VERSION:
        return
    order = "<" if data[126:HEADER] == b"IM" else ">"
    for kind, content in _elements(data[HEADER:], order):
        if kind == COMPRESSED:
            for inner, inflated in _elements(zlib.decompress(content), order):
                _array(inner, inflated, order, 0)
        else:
            _array(kind, content, order, 0)


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Types and contents of the elements that follow each other."""
    place = 0
    while place < len(data):
        if len(data) - place < 8:
            raise ValueError("cut within a tag")
        kind, size = struct.unpack_from(f"{order}II", data, place)
        if kind >> 16:  # a small element: size, type and up to four bytes in one tag
            kind, size, start, end = kind & 0xFFFF, kind >> 16, place + 4, place + 8
        else:
            start = place + 8
            # Compressed elements alone are not padded to eight bytes.
            end = start + (size if kind == COMPRESSED else -(-size // 8) * 8)
        if start + size > min(end, len(data)):
            raise ValueError("cut within an element")
        yield kind, data[start : start + size]
        place = end


def _array(kind: int, content: bytes, order: str, depth: int) -> None:
    """Checks one array and those within it."""
    if kind != MATRIX:
        raise ValueError(f"an element of type {kind} instead of an array")
    if depth > DEEPEST:
        raise ValueError("arrays nested without end")
    if not content:  # an empty field
        return
    parts = list(_elements(content, order))
    if parts[0][0] != 6 or len(parts[0][1]) != 8:
        raise ValueError("an array without flags")
    [flags] = struct.unpack_from(f"{order}I", parts[0][1])
    shape = "".join(_letter(inner) for inner, _ in parts[1:])
    wanted = CONTENT.get(flags & 0xFF, "nnn") + "n" * bool(flags & COMPLEX)
    if not 1 <= flags & 0xFF <= LAST_CLASS or not re.fullmatch(wanted, shape):
        raise ValueError("an array of unknown content")
    for inner, inside in parts[1:]:
        if inner == MATRIX:
            _array(inner, inside, order, depth + 1)


def _letter(kind: int) -> str:
    return "m" if kind == MATRIX else "n" if kind in NUMERIC else "?"
