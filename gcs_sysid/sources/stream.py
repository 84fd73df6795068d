"""Frames from a link, as its bytes come in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gcs_sysid.sources import single
from gcs_sysid.sources.decode import decode
from gcs_sysid.sources.frames import Bytes, Found, Frames, search
from gcs_sysid.sources.signing import Signatures
from gcs_sysid.sources.tables import MessageTable, TableKey


@dataclass(frozen=True)
class Batch:
    """Frames that became complete with one piece of input.

    Attributes:
        data: the bytes.
        found: where the frames lie in them.
        link_us: when the piece arrived [µs since 1970].
        alone: whether the bytes are one frame, known and whole.
    """

    data: Bytes
    found: Found
    link_us: int
    alone: bool = False

    def raw(self) -> list[bytes]:
        """The frames as they came, those of unknown messages included, in order."""
        places = [*_places(self.found.frames), *_places(self.found.unknown)]
        return [self.data[start:end].tobytes() for start, end in sorted(places)]

    def tables(self) -> Mapping[TableKey, MessageTable]:
        """The decoded messages; `order` counts within the batch."""
        return self._decoded

    @cached_property
    def _decoded(self) -> Mapping[TableKey, MessageTable]:
        frames = self.found.frames
        if self.alone:
            return single.decoded(self.data.tobytes(), self.found, self.link_us)
        return decode(self.data, frames, np.full(frames.start.size, self.link_us, dtype=np.int64))


def _places(frames: Frames) -> list[tuple[int, int]]:
    return list(zip(frames.start.tolist(), frames.end.tolist(), strict=True))


class FrameStream:
    """Cuts a stream of bytes into frames, however it is cut into pieces.

    Not for log files: a frame that the end of the input cut is awaited, not counted.

    Args:
        signatures: lets frames with a good signature through only; None lets all through.
    """

    def __init__(self, *, signatures: Signatures | None = None) -> None:
        self._rest = b""
        self._signatures = signatures
        self._lost = {"bad_crc": 0, "unknown": 0, "garbage_bytes": 0}

    @property
    def lost(self) -> Mapping[str, int]:
        """What could not be used so far, counted by reason."""
        return self._lost | (self._signatures.lost if self._signatures is not None else {})

    def feed(self, data: bytes, link_us: int) -> Batch:
        """The frames that `data` completes.

        Args:
            data: bytes as received, any number.
            link_us: when they were received [µs since 1970].
        """
        alone = single.found(data) if not self._rest and self._signatures is None else None
        if alone is not None:
            return Batch(np.frombuffer(data, dtype=np.uint8), alone, link_us, alone=True)
        content = np.frombuffer(self._rest + data, dtype=np.uint8)
        found = search(content)
        self._rest = content[found.rest :].tobytes()
        self._lost["bad_crc"] += found.bad_crc
        self._lost["unknown"] += found.unknown.start.size
        self._lost["garbage_bytes"] += found.garbage_bytes
        if self._signatures is not None:
            found = replace(
                found,
                frames=found.frames[self._signatures.good(content, found.frames)],
                unknown=found.unknown[self._signatures.good(content, found.unknown)],
            )
        return Batch(content, found, link_us)
