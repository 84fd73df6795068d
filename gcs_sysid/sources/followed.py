"""A .tlog that another program is writing, followed as if it were a link.

Frames keep the arrival times that stand in the file, so that what is recorded again is the same
file; damage between them is passed on and counted where frames are found.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import numpy as np

from gcs_sysid.errors import SourceError
from gcs_sysid.sources.closing import Closing
from gcs_sysid.sources.frames import search
from gcs_sysid.sources.tlog import STAMP

SCHEME = "file:"
SUFFIX = ".tlog"
_PIECE = 1 << 20
"""Bytes read at a time."""
_LONGEST_REST = 1 << 16
"""More than this without a frame in it is garbage, not a frame that is still being written."""
_LOOK_S = 0.05


class FollowedLog(Closing):
    """A growing log. Use as a context, or call `close`.

    Args:
        address: path of the .tlog, behind `file:` or as it is.
        sleep: waits for some seconds.

    Raises:
        SourceError: it cannot be opened.
    """

    def __init__(self, address: str, *, sleep: Callable[[float], None] = time.sleep) -> None:
        self.path = Path(address.removeprefix(SCHEME))
        self._sleep = sleep
        self._rest = b""
        self._last_us = 0
        self._file = self._opened()

    def stamped(self, timeout_s: float) -> list[tuple[bytes, int]]:
        """Frames that were written since, with their arrival times, waiting for some.

        Raises:
            SourceError: the file cannot be read any more.
        """
        until = time.monotonic() + timeout_s
        while True:
            piece = self._next()
            if piece or time.monotonic() >= until:
                return self._cut(piece) if piece else []
            self._sleep(_LOOK_S)

    def read(self, timeout_s: float) -> bytes:
        """The same without the times."""
        return b"".join(data for data, _ in self.stamped(timeout_s))

    def write(self, data: bytes) -> None:
        """Refused: nobody listens at the other end of a file.

        Raises:
            SourceError: always.
        """
        raise SourceError(
            str(self.path), f"{len(data)} bytes cannot be sent to a log", fix="give a link"
        )

    def close(self) -> None:
        """Ends it."""
        self._file.close()

    def _opened(self) -> BinaryIO:
        try:
            return self.path.open("rb")
        except OSError as error:
            raise self._failed(error) from error

    def _next(self) -> bytes:
        try:
            piece = self._file.read(_PIECE)
            if not piece and os.fstat(self._file.fileno()).st_size < self._file.tell():
                # Written anew from its beginning.
                self._file.seek(0)
                self._rest = b""
            return piece
        except OSError as error:
            raise self._failed(error) from error

    def _cut(self, piece: bytes) -> list[tuple[bytes, int]]:
        data = self._rest + piece
        frames = search(np.frombuffer(data, dtype=np.uint8), prefix=STAMP)
        starts = np.concatenate([frames.frames.start, frames.unknown.start])
        ends = np.concatenate([frames.frames.end, frames.unknown.end])
        sort = np.argsort(starts)
        found, done = [], 0
        for start, end in zip(starts[sort].tolist(), ends[sort].tolist(), strict=True):
            stamp = max(start - STAMP, done)
            if start - stamp == STAMP:
                self._last_us = int.from_bytes(data[stamp:start], "big")
            found.append((data[done:stamp] + data[start:end], self._last_us))
            done = end
        self._rest = data[done:]
        if len(self._rest) > _LONGEST_REST:
            found.append((self._rest, self._last_us))
            self._rest = b""
        return found

    def _failed(self, error: OSError) -> SourceError:
        return SourceError(
            str(self.path), f"cannot be read ({error.strerror or error})", fix="check the path"
        )
