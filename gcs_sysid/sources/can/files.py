"""CAN frames out of log files, through python-can."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import can
from can.io.blf import BLFParseError

from gcs_sysid.errors import SourceError
from gcs_sysid.sources.can.transfers import CanFrame

_READERS: Mapping[str, Callable[..., Any]] = {
    ".asc": can.ASCReader,
    ".blf": can.BLFReader,
    ".log": can.CanutilsLogReader,
    ".mf4": can.MF4Reader,
}
SUFFIXES = tuple(_READERS)
_TEXT = {"mode": "r", "encoding": "utf-8", "errors": "replace"}
_OPEN: Mapping[str, dict[str, Any]] = {
    ".asc": _TEXT,
    ".blf": {"mode": "rb"},
    ".log": _TEXT,
    ".mf4": {"mode": "rb"},
}
_DAMAGED = (
    can.CanError,
    BLFParseError,
    struct.error,
    zlib.error,
    ValueError,
    LookupError,
    OSError,
    ArithmeticError,
    TypeError,
    AttributeError,
    MemoryError,
)
"""What python-can's readers raise on bytes that are not of their format."""


def frames(path: Path) -> list[CanFrame]:
    """Frames with identifiers of 29 bits in a CAN log.

    Raises:
        SourceError: the file cannot be read, or a package for its format is missing.
    """
    suffix = path.suffix.lower()
    if suffix not in _READERS:
        raise SourceError(
            str(path),
            f"unknown kind of CAN log `{path.suffix or path.name}`",
            fix=f"give one of {', '.join(SUFFIXES)}",
        )
    try:
        # The file is opened here: python-can leaves it open where it is none of its format.
        with path.open(**_OPEN[suffix]) as file, _READERS[suffix](file) as reader:
            found = [
                CanFrame(round(1e6 * one.timestamp), one.arbitration_id, bytes(one.data))
                for one in reader
                if one.is_extended_id and not one.is_error_frame and not one.is_remote_frame
            ]
    except NotImplementedError as error:
        raise SourceError(
            str(path),
            f"a CAN log of kind {path.suffix} needs the package asammdf",
            fix="pip install 'python-can[mf4]'",
        ) from error
    except _DAMAGED as error:
        reason = " ".join(str(error).split())[:120]
        raise SourceError(
            str(path), f"cannot be read as CAN log ({reason})", fix="export it again"
        ) from error
    if not found:
        raise SourceError(
            str(path),
            "holds no CAN frame with an identifier of 29 bits",
            fix="record the bus on which the DroneCAN nodes are",
        )
    return found
