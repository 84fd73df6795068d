"""Opens a log by the format its name promises."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path

from gcs_sysid.errors import SourceError
from gcs_sysid.recording import Recording
from gcs_sysid.sources import assemble, table, tlog
from gcs_sysid.sources.tables import LogTables

READERS: Mapping[str, Callable[[bytes], LogTables]] = {".tlog": tlog.read}
"""File name ending -> reader of the file's content."""


def open_recording(
    path: str | Path, *, vehicle: int | None = None, columns: Path | None = None
) -> Recording:
    """The flight recorded in a log file.

    Args:
        path: a .tlog, or a table (.csv, .parquet, .mat).
        vehicle: MAVLink system id to use; without it the log must hold one vehicle only.
        columns: what the columns of a table are; see `column_map`. Logs of other formats know
            their own, and it says nothing about them.

    Raises:
        SourceError: the file is missing, empty, or not a log of a known format; or the column map
            is missing or wrong.
        RefusedError: it holds several vehicles and none was chosen.
    """
    path = Path(path)
    if path.suffix.lower() in table.SUFFIXES:
        return table.recording(path, _content(path), columns=columns, vehicle=vehicle)
    reader = _reader(path)
    data = _content(path)
    log = reader(data)
    if not log.tables:
        raise SourceError(
            str(path),
            f"no MAVLink message in {len(data)} bytes",
            fix="give a .tlog as a ground station records it",
        )
    digest = hashlib.sha256(data).hexdigest()
    return assemble.recording(log, source=str(path), sha256=digest, vehicle=vehicle)


def _reader(path: Path) -> Callable[[bytes], LogTables]:
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise SourceError(
            str(path),
            f"unknown kind of log `{path.suffix or path.name}`",
            fix=f"give one of {', '.join((*READERS, *table.SUFFIXES))}",
        )
    return reader


def _content(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise SourceError(str(path), "no such file", fix="check the path") from error
    except IsADirectoryError as error:
        raise SourceError(str(path), "is a directory", fix="give the log file in it") from error
    except OSError as error:
        raise SourceError(
            str(path), f"cannot be read ({error.strerror})", fix="check its permissions"
        ) from error
    if not data:
        raise SourceError(str(path), "is empty", fix="record the flight again, or find the log")
    return data
