"""Writes what a link brings as a standard .tlog."""

from __future__ import annotations

import os
import struct
import time
from collections.abc import Callable
from pathlib import Path

from gcs_sysid.errors import SourceError
from gcs_sysid.sources.closing import Closing
from gcs_sysid.sources.stream import Batch

_SYNC_S = 1.0


class Recorder(Closing):
    """A .tlog being written: each frame as received, behind its arrival time. Use as a context.

    Each batch is handed to the operating system at once, and to the disk every second: a program
    that is killed loses nothing, a computer that loses power a second.

    Args:
        path: file to write.
        append: continue an existing file; otherwise an existing one is refused.
        clock: seconds, from any origin, never falling.

    Raises:
        SourceError: the file exists, or cannot be written; from `write` too, so that a recording
            never ends unnoticed.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        append: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.path = Path(path)
        self.frames = 0
        self._clock = clock
        try:
            self._file = self.path.open("ab" if append else "xb")
        except FileExistsError as error:
            raise SourceError(
                str(path),
                "exists already, and a recording never overwrites one",
                fix="give another --out, or --resume to continue it",
            ) from error
        except OSError as error:
            raise self._failed(error) from error
        self._synced = clock()

    def write(self, batch: Batch) -> None:
        """Adds the frames of a batch.

        Raises:
            SourceError: the file cannot be written.
        """
        stamp = struct.pack(">Q", batch.link_us)
        frames = batch.raw()
        try:
            self._file.write(b"".join(stamp + frame for frame in frames))
            self._file.flush()
            if self._clock() - self._synced >= _SYNC_S:
                os.fsync(self._file.fileno())
                self._synced = self._clock()
        except OSError as error:
            raise self._failed(error) from error
        self.frames += len(frames)

    def close(self) -> None:
        """Ends the recording.

        Raises:
            SourceError: the file cannot be written.
        """
        try:
            self._file.close()
        except OSError as error:
            raise self._failed(error) from error

    def _failed(self, error: OSError) -> SourceError:
        return SourceError(
            str(self.path),
            f"recording failed ({error.strerror or error})",
            fix="free or choose another disk, and check its permissions",
        )
