"""Telemetry logs (.tlog): frames as received, each behind its arrival time (8 bytes, big-endian µs)."""

from __future__ import annotations

import struct
from collections import Counter, defaultdict

import numpy as np
from pymavlink.dialects.v20 import all as dialect

from gcs_sysid.sources.tables import LogTables, MessageTable, TableKey


def read(data: bytes) -> LogTables:
    """All messages in `data`, the content of a .tlog."""
    parser = dialect.MAVLink(None)
    parser.robust_parsing = True
    rows: dict[TableKey, list] = defaultdict(list)
    lost: Counter[str] = Counter(bad_crc=0, unknown=0, garbage_bytes=0, truncated=0)
    position = 0
    order = 0
    while position + 16 <= len(data):
        (link_us,) = struct.unpack_from(">Q", data, position)
        start = position + 8
        if data[start] == 0xFD:
            size = 12 + data[start + 1] + 13 * (data[start + 2] & 1)
        elif data[start] == 0xFE:
            size = 8 + data[start + 1]
        else:
            lost["garbage_bytes"] += 1
            position += 1
            continue
        message = parser.parse_char(data[start : start + size])
        if message is None:
            break
        position = start + size
        name = message.get_type()
        if name == "BAD_DATA":
            lost["bad_crc"] += 1
        elif name.startswith("UNKNOWN"):
            lost["unknown"] += 1
        else:
            key = TableKey(message.get_srcSystem(), message.get_srcComponent(), name)
            values = [getattr(message, field) for field in message.fieldnames]
            rows[key].append((order, link_us, values))
            order += 1
    lost["truncated"] = int(position < len(data))
    return LogTables({key: _table(key.name, row) for key, row in rows.items()}, dict(lost))


def _table(name: str, rows: list) -> MessageTable:
    by_name = {message.msgname: message for message in dialect.mavlink_map.values()}
    columns = zip(*(row[2] for row in rows), strict=True)
    return MessageTable(
        order=np.array([row[0] for row in rows], dtype=np.int64),
        link_us=np.array([row[1] for row in rows], dtype=np.int64),
        fields={
            field: np.array([v.encode() if isinstance(v, str) else v for v in column])
            for field, column in zip(by_name[name].fieldnames, columns, strict=True)
        },
    )
