"""Finds MAVLink frames in bytes: version 1 and 2, signed ones too, each proved by its checksum.

Every place that could start a frame of a known message is a candidate; those whose checksum agrees
are frames. Nothing is assumed about what lies between them, so garbage, cut and damaged frames cost
only themselves, and each is counted.

Wire format (mavlink.io, "Packet serialization"): 0xFE, payload length, sequence, system, component,
id; or 0xFD, payload length, incompatibility flags, compatibility flags, sequence, system,
component, id (3 bytes); then the payload, the checksum (2 bytes) and, if flag 0x01 is set, a
signature (13 bytes).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int, UInt8

from gcs_sysid.sources.checksum import checksum
from gcs_sysid.sources.layouts import crc_extras, known_ids, sizes

MAGIC_V1 = 0xFE
MAGIC_V2 = 0xFD
HEADER_V1 = 6
HEADER_V2 = 10
CHECKSUM = 2
SIGNATURE = 13
SIGNED = 0x01
_SMALLEST = HEADER_V1 + CHECKSUM
_LARGEST = HEADER_V2 + 255 + CHECKSUM + SIGNATURE
_BLOCK = 1 << 20  # bytes searched at a time, which bounds the memory that hostile input can claim
_ROWS = 4096  # frames proved at a time: the look-ups then stay within a cache of a megabyte

Bytes = UInt8[np.ndarray, " byte"]
Places = Int[np.ndarray, " frame"]


@dataclass(frozen=True)
class Frames:
    """Frames by place, all arrays of one length.

    Attributes:
        start: position of the frame's first byte.
        size: bytes from there to its end, checksum and signature included.
        header: bytes before the payload.
        length: bytes of payload.
        id: message id.
    """

    start: Places
    size: Places
    header: Places
    length: Places
    id: Places

    @property
    def end(self) -> Places:
        """Position behind each frame."""
        return self.start + self.size

    def __getitem__(self, index: np.ndarray) -> Frames:
        return Frames(
            self.start[index],
            self.size[index],
            self.header[index],
            self.length[index],
            self.id[index],
        )


@dataclass(frozen=True)
class Found:
    """What a search found.

    Attributes:
        frames: proved frames in order.
        bad_crc: frames of known messages whose checksum is wrong.
        unknown: what look like frames of messages that no dialect defines; without a definition
            their checksum cannot prove them.
        garbage_bytes: bytes that belong to nothing.
        rest: position of a frame that the end of the data cut, or the end of the data.
    """

    frames: Frames
    bad_crc: int
    unknown: Frames
    garbage_bytes: int
    rest: int


def search(data: Bytes, *, prefix: int = 0) -> Found:
    """All frames in `data`.

    Args:
        data: the bytes.
        prefix: bytes before each frame that belong to it (8 for the stamps of a .tlog).
    """
    blocks = [
        _proved(data, _candidates(data, first)) for first in range(0, max(data.size, 1), _BLOCK)
    ]
    frames = _apart(_joined(blocks), prefix)
    return _account(data, frames, prefix)


def windows(data: Bytes, length: int) -> UInt8[np.ndarray, "place width"]:
    """View of the `length` bytes from every place on.

    NumPy's `sliding_window_view` takes twenty times as long to set up.
    """
    places = max(data.size - length + 1, 0)
    return np.ndarray((places, length), np.uint8, buffer=data, strides=(1, 1))


def _joined(blocks: list[Frames]) -> Frames:
    names = ("start", "size", "header", "length", "id")
    return Frames(*(np.concatenate([getattr(block, name) for block in blocks]) for name in names))


def _candidates(data: Bytes, first: int, last: int | None = None) -> Frames:
    """Everything that starts like a frame between `first` and `last` and fits into the data."""
    last = min(first + _BLOCK if last is None else last, data.size - _SMALLEST + 1)
    block = data[first : max(first, last)]
    start = first + np.flatnonzero((block == MAGIC_V1) | (block == MAGIC_V2))
    second = data[start] == MAGIC_V2
    # Within the smallest frame of version 1 all header bytes of version 1 exist; those of version 2
    # may lie behind the end of the data and are then read as its last byte, and rejected by size.
    byte = [data[np.minimum(start + i, data.size - 1)].astype(np.int64) for i in (2, 5, 7, 8, 9)]
    flags, id_v1, low, middle, high = byte
    length = data[start + 1].astype(np.int64)
    header = np.where(second, HEADER_V2, HEADER_V1)
    signature = np.where(second & ((flags & SIGNED) != 0), SIGNATURE, 0)
    size = header + length + CHECKSUM + signature
    message_id = np.where(second, low | (middle << 8) | (high << 16), id_v1)
    # Flags that are not known forbid reading the frame, by definition.
    readable = ~second | ((flags & ~SIGNED) == 0)
    fits = start + size <= data.size
    return Frames(start, size, header, length, message_id)[readable & fits]


def _is_known(frames: Frames) -> Bool[np.ndarray, " frame"]:
    known = known_ids()
    return (frames.id < known.size) & known[np.minimum(frames.id, known.size - 1)]


def _proved(data: Bytes, frames: Frames) -> Frames:
    """The frames of known messages whose checksum agrees."""
    frames = frames[_is_known(frames)]
    # Only version 2 may carry fields of a newer definition behind those known here.
    frames = frames[(frames.header == HEADER_V2) | (frames.length <= sizes()[frames.id])]
    if not frames.start.size:
        return frames
    extras = crc_extras()[frames.id]
    body = frames.header + frames.length - 1
    good = np.zeros(frames.start.size, dtype=bool)
    order = np.argsort(body.astype(np.uint16), kind="stable")
    lengths, first = np.unique(body[order], return_index=True)
    for length, index in zip(lengths.tolist(), np.split(order, first[1:]), strict=True):
        places = windows(data, length + CHECKSUM)
        for first_row in range(0, index.size, _ROWS):
            rows = index[first_row : first_row + _ROWS]
            window = places[frames.start[rows] + 1]
            sent = window[:, -2].astype(np.uint16) | (window[:, -1].astype(np.uint16) << 8)
            good[rows] = checksum(window[:, :-CHECKSUM], extras[rows]) == sent
    return frames[good]


def _apart(frames: Frames, prefix: int) -> Frames:
    """Frames without those that begin inside the one before (one place in 65536 does by chance)."""
    if np.all(frames.start[1:] >= frames.end[:-1] + prefix) and np.all(frames.start >= prefix):
        return frames
    keep: list[int] = []
    free = prefix
    for i, (start, end) in enumerate(zip(frames.start.tolist(), frames.end.tolist(), strict=True)):
        if start >= free:
            keep.append(i)
            free = end + prefix
    return frames[np.array(keep, dtype=np.int64)]


def _account(data: Bytes, frames: Frames, prefix: int) -> Found:
    """What lies between the frames, and where the data end in the middle of one."""
    left = np.concatenate([[0], frames.end])
    right = np.concatenate([frames.start - prefix, [data.size]])
    gaps = np.flatnonzero(right > left)
    garbage = bad = 0
    unknown = [frames[np.zeros(0, dtype=np.int64)]]
    rest = data.size
    for gap in gaps.tolist():
        begin, end = int(left[gap]), int(right[gap])
        if gap == frames.start.size:
            rest = _cut(data, max(begin, data.size - _LARGEST - prefix), prefix)
            end = rest
        for whole, damaged in _between(data, begin, end, prefix):
            unknown.append(whole)
            bad += damaged.start.size
            garbage -= int(np.sum(whole.size + prefix) + np.sum(damaged.size + prefix))
        garbage += end - begin
    return Found(frames, bad, _joined(unknown), garbage, rest)


def _between(data: Bytes, begin: int, end: int, prefix: int) -> Iterator[tuple[Frames, Frames]]:
    """Frames of unknown messages, and damaged ones, between two places, block by block."""
    free = begin + prefix
    for first in range(begin, end, _BLOCK):
        inside = _candidates(data, first, min(first + _BLOCK, end))
        keep: list[int] = []
        for i, (start, past) in enumerate(
            zip(inside.start.tolist(), inside.end.tolist(), strict=True)
        ):
            if start >= free and past <= end:
                keep.append(i)
                free = past + prefix
        inside = inside[np.array(keep, dtype=np.int64)]
        known = _is_known(inside)
        yield inside[~known], inside[known]


def _cut(data: Bytes, begin: int, prefix: int) -> int:
    """Where the frame starts, prefix included, that the end of the data cuts off."""
    place = begin
    while place + prefix < data.size:
        size = _size_at(data, place + prefix)
        if size is None:
            place += 1
        elif place + prefix + size > data.size:
            return place
        else:
            place += prefix + size
    return min(place, data.size)


def _size_at(data: Bytes, at: int) -> int | None:
    """Bytes of the frame that starts at `at`, as far as its header is there; None if none does."""
    header = [*data[at : at + 3].tolist(), 0, 0]
    if header[0] == MAGIC_V1:
        return _SMALLEST + header[1]
    if header[0] == MAGIC_V2 and header[2] & ~SIGNED == 0:
        signature = SIGNATURE if header[2] & SIGNED else 0
        return HEADER_V2 + header[1] + CHECKSUM + signature
    return None
