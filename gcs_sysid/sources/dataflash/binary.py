"""Finds and decodes the messages of a binary DataFlash log, block by block.

A message is 0xA3 0x95, its type, its fields; there is no checksum. Every place that looks like a
header is a candidate. A candidate counts as a message when the one behind it begins where its
format says that it ends, or the file ends there; the rest is counted as lost. Memory is bounded:
blocks of the file are looked at one after the other, and of types that nobody asked for only times
are kept.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int

from gcs_sysid.sources.dataflash.formats import (
    FMT,
    FMT_LENGTH,
    FMT_TYPE,
    HEADER,
    Format,
    described,
    plain_text,
    with_units,
)
from gcs_sysid.sources.dataflash.log import DataflashLog, Messages, Stamps
from gcs_sysid.sources.frames import Bytes, windows

MAGIC = b"\xa3\x95"
_BLOCK = 1 << 24
_LONGEST = 255 + HEADER
DEFINITIONS = ("FMT", "FMTU", "UNIT", "MULT")
"""Types that describe the others; they are always read."""

Places = Int[np.ndarray, " message"]
Progress = Callable[[float], None]


def read(
    data: Bytes,
    *,
    wanted: Collection[str] | None = None,
    progress: Progress = lambda _fraction: None,
) -> DataflashLog:
    """All messages of a log.

    Args:
        data: the file's bytes, for instance mapped into memory.
        wanted: types whose fields are needed; None for all.
        progress: told which fraction is behind.
    """
    formats = _formats(data)
    lengths = np.zeros(256, dtype=np.int64)
    lengths[list(formats)] = [one.length for one in formats.values()]
    found: dict[int, list[tuple[np.ndarray, np.ndarray]]] = defaultdict(list)
    walk, stamps = _Walk(data, lengths), Stamps()
    for first in range(0, max(data.size, 1), _BLOCK):
        places = walk.block(first)
        _decode(data, places, formats, wanted, stamps, found)
        progress(min(1.0, (first + _BLOCK) / max(data.size, 1)))
    messages = {
        formats[number].name: Messages(
            formats[number],
            np.concatenate([time for time, _ in parts]),
            np.concatenate([rows for _, rows in parts]),
        )
        for number, parts in found.items()
    }
    lost = {**walk.lost, "bad_stamp": stamps.bad}
    return DataflashLog(_with_units(messages), lost, stamps.restarts)


def _formats(data: Bytes) -> dict[int, Format]:
    """Formats by type number: those of all FMT messages that agree with themselves."""
    formats = {FMT_TYPE: FMT}
    head = re.compile(re.escape(MAGIC + bytes([FMT_TYPE])))
    for match in head.finditer(data.data):
        record = data[match.start() : match.start() + FMT_LENGTH]
        if record.size < FMT_LENGTH:
            break
        number, length, *texts = record[HEADER:].view(FMT.dtype)[0]
        one = described(int(number), int(length), *(plain_text(bytes(text)) for text in texts))
        if one is not None:
            formats.setdefault(one.type, one)
    return formats


class _Walk:
    """Goes through the candidates of a log from message to message."""

    def __init__(self, data: Bytes, lengths: Int[np.ndarray, " type"]) -> None:
        self._data = data
        self._lengths = lengths
        self._free = 0
        self.lost = {"unknown": 0, "garbage_bytes": 0, "truncated": 0}

    def block(self, first: int) -> Places:
        """Places of the messages that begin in a block; counts what lies between them."""
        last = min(first + _BLOCK, self._data.size)
        candidates = self._candidates(first, last + _LONGEST)
        start, end, following = candidates.start, candidates.end, candidates.following
        good = following >= 0
        # Nearly every candidate is followed by the next one, and in damaged parts none is by any:
        # both runs are taken at once.
        stops = np.flatnonzero(~good | (following != np.arange(start.size) + 1))
        starts = np.flatnonzero(good)
        taken: list[np.ndarray] = []
        at = int(np.searchsorted(start, max(first, self._free)))
        limit = int(np.searchsorted(start, last))
        while at < limit:
            if not good[at]:
                restart = min(_next(starts, at), limit)
                cut = int(np.sum(end[at:restart] > start[at:restart]))
                self.lost["truncated"] += cut
                self.lost["unknown"] += restart - at - cut
                at = restart
                continue
            stop = min(_next(stops, at), limit - 1)
            taken.append(np.arange(at, stop + 1 if good[stop] else stop))
            at = int(following[stop]) if good[stop] else stop
        chosen = np.concatenate([*taken, np.zeros(0, dtype=np.int64)]).astype(np.int64)
        places = start[chosen]
        used = int(np.sum(end[chosen] - places))
        begin = max(first, min(self._free, last))
        self._free = int(end[chosen[-1]]) if chosen.size else self._free
        cut = self._cut(start, end) if last == self._data.size else 0
        self.lost["garbage_bytes"] += max(last, self._free) - begin - used - cut
        return places

    def _cut(self, start: Places, end: Places) -> int:
        """Bytes of the message that the end of the file cuts off."""
        cut = start[(end > self._data.size) & (start >= self._free)]
        return self._data.size - int(cut[0]) if cut.size else 0

    def _candidates(self, first: int, last: int) -> _Candidates:
        part = self._data[first:last]
        start = np.flatnonzero((part[:-2] == MAGIC[0]) & (part[1:-1] == MAGIC[1]))
        end = start + self._lengths[part[start + 2]]
        following = np.searchsorted(start, end)
        begins = np.append(start, -1)[np.minimum(following, start.size)] == end
        at_end = first + end == self._data.size
        known = end > start
        following = np.where(known & begins, following, np.where(known & at_end, start.size, -1))
        return _Candidates(first + start, first + end, following)


def _next(places: Places, at: int) -> int:
    """The first of some sorted places that is not before `at`; a very large one if none is."""
    found = int(np.searchsorted(places, at))
    return int(places[found]) if found < places.size else 2**62


@dataclass(frozen=True)
class _Candidates:
    """Places that look like headers, where their messages end, which candidate begins there.

    `following` is -1 where none does; a message of unknown length ends where it starts.
    """

    start: Places
    end: Places
    following: Places


def _decode(
    data: Bytes,
    places: Places,
    formats: Mapping[int, Format],
    wanted: Collection[str] | None,
    stamps: Stamps,
    found: dict[int, list[tuple[np.ndarray, np.ndarray]]],
) -> None:
    """Adds the messages of a block, each type decoded at once."""
    if not places.size:
        return
    types = data[places + 2]
    order = np.argsort(types, kind="stable")
    numbers, first = np.unique(types[order], return_index=True)
    groups = dict(zip(numbers.tolist(), np.split(order, first[1:]), strict=True))
    stamp = np.zeros(places.size, dtype=np.int64)
    stamped = np.zeros(places.size, dtype=bool)
    rows: dict[int, np.ndarray] = {}
    for number, index in groups.items():
        kind = formats[number]
        raw = windows(data, kind.length)[places[index]]
        values = raw[:, HEADER:].copy().view(kind.dtype)[:, 0]
        own = _stamp(kind, values)
        if own is not None:
            stamp[index], stamped[index] = own, True
        if wanted is None or kind.name in wanted or kind.name in DEFINITIONS:
            rows[number] = values
    good = np.ones(places.size, dtype=bool)
    stamp[stamped], good[stamped] = stamps.judge(stamp[stamped])
    for number, index in groups.items():
        keep = good[index]
        values = rows[number][keep] if number in rows else np.zeros(0, formats[number].dtype)
        found[number].append((stamp[index][keep], values))


def _stamp(kind: Format, rows: np.ndarray) -> np.ndarray | None:
    """Times since boot [µs]; None for types without."""
    if "TimeUS" in kind.fields:
        return np.minimum(rows["TimeUS"].astype(np.uint64), 2**62).astype(np.int64)
    if "TimeMS" in kind.fields:
        return rows["TimeMS"].astype(np.int64) * 1000
    return None


_TOLD = {"UNIT": ("Id", "Label"), "MULT": ("Id", "Mult"), "FMTU": ("FmtType", "UnitIds", "MultIds")}


def _with_units(messages: dict[str, Messages]) -> dict[str, Messages]:
    """The messages, their formats completed by what FMTU says of them."""
    rows: dict[str, list[tuple]] = {}
    for name, fields in _TOLD.items():
        one = messages.get(name)
        if one is None or not all(one.has(field) for field in fields):
            return messages
        rows[name] = list(zip(*(one.raw(field).tolist() for field in fields), strict=True))
    units = {chr(letter): plain_text(label) for letter, label in rows["UNIT"]}
    multipliers = {chr(letter): float(value) for letter, value in rows["MULT"]}
    told = {number: (plain_text(u), plain_text(m)) for number, u, m in rows["FMTU"]}
    return {
        name: replace(
            one, format=with_units(one.format, *told[one.format.type], units, multipliers)
        )
        if one.format.type in told
        else one
        for name, one in messages.items()
    }
