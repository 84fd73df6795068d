"""Opens a log by the format its name promises.

Formats are registered by name in `adapters` and imported when a log of theirs is opened.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path

from gcs_sysid.errors import SourceError
from gcs_sysid.recording import Recording
from gcs_sysid.sources import adapters

Progress = Callable[[float], None]

_TABLES = (".csv", ".parquet", ".mat")


def open_recording(
    path: str | Path,
    *,
    vehicle: int | None = None,
    columns: Path | None = None,
    can: Path | None = None,
    progress: Progress = lambda _fraction: None,
) -> Recording:
    """The flight recorded in a log file.

    Args:
        path: a telemetry log (.tlog), an onboard log (.bin, .log, .ulg), or a table
            (.csv, .parquet, .mat).
        vehicle: MAVLink system id to use; without it the log must hold one vehicle only.
        columns: what the columns of a table are; see `column_map`. Logs of other formats know
            their own, and it says nothing about them.
        can: a CAN log of the same flight (.asc, .blf, .log, .mf4), put on its clock.
        progress: told which fraction of a large log is read.

    Raises:
        SourceError: the file is missing, empty, or not a log of a known format; or the column map
            is missing or wrong.
        RefusedError: it holds several vehicles and none was chosen.
    """
    found = _opened(Path(path), vehicle, columns, progress)
    if can is None:
        return found
    merge = importlib.import_module("gcs_sysid.sources.can.merge")
    return merge.beside(found, can)


def _opened(path: Path, vehicle: int | None, columns: Path | None, progress: Progress) -> Recording:
    suffix = path.suffix.lower()
    if suffix in _TABLES:
        table = importlib.import_module("gcs_sysid.sources.table")
        return table.recording(path, columns=columns, vehicle=vehicle)
    if suffix not in adapters.names("logs"):
        raise SourceError(
            str(path),
            f"unknown kind of log `{path.suffix or path.name}`",
            fix=f"give one of {', '.join((*adapters.names('logs'), *_TABLES))}",
        )
    module = adapters.load("logs", suffix, asked=str(path))
    return module.open_log(path, vehicle=vehicle, progress=progress)
