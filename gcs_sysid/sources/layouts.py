"""Memory layout of every MAVLink message, taken from pymavlink's generated definitions.

The dialect `all` holds ardupilotmega, common, development and every other published dialect; their
message ids do not collide.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Bool, Int, UInt8
from pymavlink.dialects.v20 import all as dialect


@dataclass(frozen=True)
class Layout:
    """How one message type lies in a frame.

    Attributes:
        id: message id.
        name: message type.
        fields: field names in wire order, extensions included.
        dtype: the fields, without padding.
    """

    id: int
    name: str
    fields: tuple[str, ...]
    dtype: np.dtype


@cache
def layout(message_id: int) -> Layout:
    """Layout of a known message id."""
    definition = dialect.mavlink_map[message_id]
    tokens = re.findall(r"(\d*)([a-zA-Z])", definition.unpacker.format)
    fields = [
        _field(name, kind, int(count or 1), array=bool(count))
        for name, (count, kind) in zip(definition.ordered_fieldnames, tokens, strict=True)
    ]
    names = tuple(definition.ordered_fieldnames)
    return Layout(message_id, definition.msgname, names, np.dtype(fields))


def _field(name: str, kind: str, count: int, *, array: bool) -> tuple:
    if kind in "sc":
        return (name, f"S{count}")
    code = np.dtype(f"<{kind}")
    return (name, code, (count,)) if array else (name, code)


@cache
def known_ids() -> Bool[np.ndarray, " id"]:
    """Which message ids are defined, by id."""
    known = np.zeros(max(dialect.mavlink_map) + 1, dtype=bool)
    known[list(dialect.mavlink_map)] = True
    return known


@cache
def sizes() -> Int[np.ndarray, " id"]:
    """Bytes of all fields by message id; zero for unknown ids."""
    result = np.zeros(max(dialect.mavlink_map) + 1, dtype=np.int64)
    for message_id, definition in dialect.mavlink_map.items():
        result[message_id] = definition.unpacker.size
    return result


@cache
def crc_extras() -> UInt8[np.ndarray, " id"]:
    """Checksum seeds by message id; zero for unknown ids."""
    extras = np.zeros(max(dialect.mavlink_map) + 1, dtype=np.uint8)
    for message_id, definition in dialect.mavlink_map.items():
        extras[message_id] = definition.crc_extra
    return extras
