"""Writes what a link brings as a standard .tlog, in parts of bounded size."""

from __future__ import annotations

import os
import struct
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from gcs_sysid.errors import SourceError
from gcs_sysid.sources.closing import Closing
from gcs_sysid.sources.frames import search
from gcs_sysid.sources.stream import Batch
from gcs_sysid.sources.tlog import STAMP

_SYNC_S = 1.0
_DIGITS = 3
_TAIL = 1 << 16
"""Bytes at the end of an interrupted recording that are looked at; a frame has at most 288."""
PART_BYTES = 256 << 20
"""A part of this size holds several hours of a busy link."""


@dataclass(frozen=True)
class Interrupted:
    """What was found at the end of a recording that is continued.

    Attributes:
        cut_bytes: of a frame that was being written, taken off.
        last_us: arrival of the last whole frame [µs since 1970]; None where there is none.
    """

    cut_bytes: int
    last_us: int | None


class Recorder(Closing):
    """A .tlog being written: each frame as received, behind its arrival time. Use as a context.

    Each batch is handed to the operating system at once, and to the disk every second by a thread
    of its own, so that a slow disk is not waited for: a program that is killed loses nothing, a
    computer that loses power what came in the last second, or since a slow disk began with more.

    Args:
        path: file to write; when it grows beyond `part_bytes` it is renamed to `NAME-001.tlog` and
            so on, and begun anew.
        append: continue an existing file, without what a torn write left at its end; otherwise an
            existing one is refused.
        part_bytes: size of a part.
        clock: seconds, from any origin, never falling.

    Attributes:
        frames: written so far.
        interrupted: what was found at the end of the file that is continued; None for a new one.

    Raises:
        SourceError: the file exists, or cannot be written; from `write` too, so that a recording
            never ends unnoticed.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        append: bool = False,
        part_bytes: int = PART_BYTES,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.path = Path(path)
        self.frames = 0
        self.interrupted: Interrupted | None = None
        self._part_bytes = part_bytes
        self._clock = clock
        try:
            if append:
                self.interrupted = self._mended()
            elif _older(self.path):
                # A kill after the last part was renamed left no file of the name itself.
                raise FileExistsError
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
        self._dirty = False
        self._disk = ThreadPoolExecutor(max_workers=1, thread_name_prefix="disk")
        self._syncing: Future[None] | None = None

    @property
    def parts(self) -> list[Path]:
        """All parts in order, the one being written last."""
        return parts(self.path)

    def _mended(self) -> Interrupted | None:
        """What a recording that is continued ended with, the newest part that holds a frame."""
        found = None
        for path in reversed(self.parts):
            if not path.exists():
                continue
            ended = _mended(path)
            if ended.last_us is not None:
                cut = 0 if found is None else found.cut_bytes
                return Interrupted(cut + ended.cut_bytes, ended.last_us)
            found = found or ended
        return found

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
            self._dirty = True
            if self._file.tell() >= self._part_bytes:
                self._begin_part()
        except OSError as error:
            raise self._failed(error) from error
        self.frames += len(frames)
        self.sync()

    def sync(self) -> None:
        """Hands what was written to the disk, if a second has gone by since the last time.

        Raises:
            SourceError: the file could not be written, now or the last time.
        """
        if self._syncing is not None and not self._syncing.done():
            return
        try:
            self._wait()
        except OSError as error:
            raise self._failed(error) from error
        if self._dirty and self._clock() - self._synced >= _SYNC_S:
            self._synced, self._dirty = self._clock(), False
            self._syncing = self._disk.submit(_to_disk, self._file)

    def _wait(self) -> None:
        """Waits for what the disk was handed last; raises what went wrong there."""
        syncing, self._syncing = self._syncing, None
        if syncing is not None:
            syncing.result()

    def close(self) -> None:
        """Ends the recording.

        Raises:
            SourceError: the file cannot be written.
        """
        if self._file.closed:
            return
        try:
            with self._disk, self._file:
                self._wait()
                if self._dirty:
                    _to_disk(self._file)
        except OSError as error:
            raise self._failed(error) from error

    def _begin_part(self) -> None:
        self._wait()
        _to_disk(self._file)
        self._file.close()
        number = 1 + max(_older(self.path), default=0)
        self.path.rename(self.path.with_stem(f"{self.path.stem}-{number:0{_DIGITS}d}"))
        self._file = self.path.open("xb")

    def _failed(self, error: OSError) -> SourceError:
        return SourceError(
            str(self.path),
            f"recording failed ({error.strerror or error}); what came before is kept",
            fix="free or choose another disk, check its permissions, and go on with --resume",
        )


def parts(path: Path) -> list[Path]:
    """All parts of the recording `path`, in order, the newest last: it has the name itself."""
    return [*_older(path).values(), path]


def _older(path: Path) -> dict[int, Path]:
    """Parts that are finished, by number, in order."""
    found = {}
    for part in path.parent.glob(f"{path.stem}-*{path.suffix}"):
        number = part.stem.removeprefix(f"{path.stem}-")
        if len(number) >= _DIGITS and number.isdecimal():
            found[int(number)] = part
    return dict(sorted(found.items()))


def _to_disk(file: BinaryIO) -> None:
    file.flush()
    os.fsync(file.fileno())


def _mended(path: Path) -> Interrupted:
    """Takes off the beginning of a frame that was being written when a recording ended."""
    size = path.stat().st_size
    if not path.is_file() or not size:
        return Interrupted(0, None)
    with path.open("r+b") as file:
        file.seek(max(size - _TAIL, 0))
        tail = file.read()
        found = search(np.frombuffer(tail, dtype=np.uint8), prefix=STAMP)
        ends = np.concatenate([found.frames.end, found.unknown.end])
        starts = np.concatenate([found.frames.start, found.unknown.start])
        if not ends.size:
            return Interrupted(0, None)
        cut = len(tail) - int(ends.max())
        last = int(starts[np.argmax(ends)])
        if cut:
            file.truncate(size - cut)
            _to_disk(file)
    stamp = tail[max(last - STAMP, 0) : last]
    return Interrupted(cut, int.from_bytes(stamp, "big") if len(stamp) == STAMP else None)
