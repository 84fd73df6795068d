"""Reads a DataFlash log that a ground station converted to text (.log).

One message a line: `ATT, 24269455, 0.0, 0.02, …`, the formats in `FMT` lines. Values whose letter
implies a scale are written with the scale applied.
"""

from __future__ import annotations

import io
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from jaxtyping import Int

from gcs_sysid.sources.dataflash.formats import TEXT, Format, described
from gcs_sysid.sources.dataflash.log import DataflashLog, Messages, Stamps

_START = b"FMT"
_FIRST_LINES = 50
_OFTEN = 50_000
_STAMPS = {"TimeUS": 1, "TimeMS": 1000}
"""Field of the time since boot -> µs of one in it."""


def looks_like(data: bytes) -> bool:
    """Whether the beginning of a file is that of such a log."""
    return any(line.strip().startswith(_START) for line in data.split(b"\n")[:_FIRST_LINES])


@dataclass
class _Lines:
    """Lines of one type without its name, and which line of the log each is."""

    texts: list[bytes] = field(default_factory=list)
    order: list[int] = field(default_factory=list)


def read(
    data: bytes | memoryview,
    *,
    wanted: Collection[str] | None = None,
    progress: Callable[[float], None] = lambda _fraction: None,
) -> DataflashLog:
    """All messages of a log; see `binary.read`."""
    lines, lost = _by_type(data, wanted, progress)
    formats = _formats(lines.pop("FMT", _Lines()).texts)
    for name in set(lines) - set(formats):
        lost["unknown"] += len(lines.pop(name).texts)
    tables: dict[str, tuple[Mapping[str, np.ndarray], np.ndarray]] = {}
    for name, own in lines.items():
        format_ = formats[name]
        fields = format_.fields if wanted is None or name in wanted else format_.fields[:1]
        columns, whole = _columns(own.texts, format_, fields)
        lost["truncated"] += len(own.texts) - whole.size
        tables[name] = columns, np.array(own.order, dtype=np.int64)[whole]
    messages, stamps = _judged(tables, formats, wanted)
    return DataflashLog(messages, {**lost, "bad_stamp": stamps.bad}, stamps.restarts)


def _by_type(
    data: bytes | memoryview, wanted: Collection[str] | None, progress: Callable[[float], None]
) -> tuple[dict[str, _Lines], dict[str, int]]:
    """Lines by message type; of types that nobody asked for the first field only."""
    lines: dict[str, _Lines] = defaultdict(_Lines)
    lost = {"unknown": 0, "garbage_bytes": 0, "truncated": 0}
    done = 0
    for number, line in enumerate(io.BytesIO(data)):
        done += len(line)
        if number % _OFTEN == 0:
            progress(done / len(data))
        name, comma, rest = line.partition(b",")
        name = name.strip()
        if not comma or not name.isalnum() or len(name) > 4:
            lost["garbage_bytes"] += len(line) if line.strip() else 0
            continue
        kind = name.decode("ascii")
        if wanted is not None and kind not in wanted and kind != "FMT":
            rest = rest.partition(b",")[0]
        lines[kind].texts.append(rest.strip())
        lines[kind].order.append(number)
    return lines, lost


def _formats(lines: list[bytes]) -> dict[str, Format]:
    formats = {}
    for line in lines:
        parts = [part.strip().decode("utf-8", "replace") for part in line.split(b",", 4)]
        if len(parts) < 5 or not (parts[0].isdigit() and parts[1].isdigit()):
            continue
        columns = ",".join(name.strip() for name in parts[4].split(","))
        one = described(int(parts[0]), int(parts[1]), parts[2], parts[3], columns)
        if one is not None:
            formats.setdefault(one.name, one)
    return formats


def _columns(
    lines: list[bytes], format_: Format, fields: tuple[str, ...]
) -> tuple[dict[str, np.ndarray], Int[np.ndarray, " whole"]]:
    """Columns of the lines that have as many fields as they should, and which lines these are."""
    # Only the last field may hold commas: the text of a message.
    split = [line.split(b",", len(fields) - 1) for line in lines]
    whole = [i for i, parts in enumerate(split) if len(parts) == len(fields)]
    columns = {}
    for at, name in enumerate(fields):
        texts = [split[i][at].strip() for i in whole]
        if format_.letters[at] in TEXT:
            columns[name] = np.array(texts, dtype=np.bytes_)
        else:
            columns[name] = _numbers(texts, name)
    return columns, np.array(whole, dtype=np.int64)


def _numbers(texts: list[bytes], name: str) -> np.ndarray:
    """Numbers, NaN for what is none; times as integers."""
    try:
        strings = pa.array(texts, pa.string())
        if name in _STAMPS:
            return pc.cast(strings, pa.int64()).to_numpy(zero_copy_only=False)
        return pc.cast(strings, pa.float64()).to_numpy(zero_copy_only=False)
    except pa.ArrowInvalid:
        values = np.array([_number(text) for text in texts])
        if name not in _STAMPS:
            return values
        return np.clip(np.where(np.isfinite(values), values, 0.0), 0.0, 2.0**62).astype(np.int64)


def _number(text: bytes) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def _judged(
    tables: Mapping[str, tuple[Mapping[str, np.ndarray], Int[np.ndarray, " line"]]],
    formats: Mapping[str, Format],
    wanted: Collection[str] | None,
) -> tuple[dict[str, Messages], Stamps]:
    """Messages with times since boot that can be believed, all types judged together."""
    stamped = {
        name: (columns[formats[name].fields[0]] * _STAMPS[formats[name].fields[0]], order)
        for name, (columns, order) in tables.items()
        if formats[name].fields[0] in _STAMPS
    }
    order = np.concatenate([o for _, o in stamped.values()] or [np.zeros(0, np.int64)])
    stamp = np.concatenate([s for s, _ in stamped.values()] or [np.zeros(0, np.int64)])
    sort = np.argsort(order)
    stamps = Stamps()
    time, good = np.zeros_like(stamp), np.ones(stamp.size, dtype=bool)
    time[sort], good[sort] = stamps.judge(stamp[sort])
    messages, at = {}, 0
    for name, (columns, own_order) in tables.items():
        size = own_order.size
        own_time, keep = np.zeros(size, np.int64), np.ones(size, dtype=bool)
        if name in stamped:
            own_time, keep = time[at : at + size], good[at : at + size]
            at += size
        rows = {n: v[keep] for n, v in columns.items()} if wanted is None or name in wanted else {}
        messages[name] = Messages(formats[name], own_time[keep], rows, scaled=True)
    return messages, stamps
