"""Turns proved frames into tables of field values, each message type at once."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from gcs_sysid.sources.frames import Bytes, Frames, windows
from gcs_sysid.sources.layouts import Layout, layout
from gcs_sysid.sources.tables import MessageTable, TableKey


def decode(
    data: Bytes, frames: Frames, link_us: Int[np.ndarray, " frame"]
) -> dict[TableKey, MessageTable]:
    """Tables of all messages, by sender and type, in the order of the frames.

    Args:
        data: the bytes that `frames` refers to.
        frames: frames of known messages.
        link_us: arrival time of each frame [µs since 1970].
    """
    if not frames.start.size:
        return {}
    # Both headers end in system, component and id; the id has one byte, or three.
    sender = frames.start + np.where(frames.header == 6, 3, 5)
    code = (frames.id << 16) | (data[sender].astype(np.int64) << 8) | data[sender + 1]
    codes, group = np.unique(code, return_inverse=True)
    order = np.argsort(group.astype(np.uint16), kind="stable")
    bounds = np.searchsorted(group[order], np.arange(1, codes.size))
    tables: dict[TableKey, MessageTable] = {}
    for key, index in zip(codes.tolist(), np.split(order, bounds), strict=True):
        kind = layout(key >> 16)
        table = _table(data, frames[index], kind, index, link_us[index])
        tables[TableKey((key >> 8) & 0xFF, key & 0xFF, kind.name)] = table
    return tables


def _table(
    data: Bytes,
    frames: Frames,
    kind: Layout,
    order: Int[np.ndarray, " message"],
    link_us: Int[np.ndarray, " message"],
) -> MessageTable:
    whole = kind.dtype.itemsize
    rows = np.zeros((frames.start.size, whole), dtype=np.uint8)
    payload = frames.start + frames.header
    # Version 2 drops trailing zeros, and old senders do not know the extension fields: both are
    # zeros. Bytes behind the fields known here come from newer definitions and are left out.
    used = np.minimum(frames.length, whole)
    for length in np.unique(used).tolist():
        if length:
            these = np.flatnonzero(used == length)
            rows[these, :length] = windows(data, length)[payload[these]]
    values = rows.view(kind.dtype)[:, 0]
    return MessageTable(order, link_us, {name: values[name] for name in kind.fields})
