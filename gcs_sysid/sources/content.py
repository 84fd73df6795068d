"""The bytes of a log file, and what to say when they cannot be had."""

from __future__ import annotations

import hashlib
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from gcs_sysid.errors import SourceError


def read(path: Path) -> bytes:
    """The whole content.

    Raises:
        SourceError: the file is missing, empty, or cannot be read.
    """
    with _readable(path):
        data = path.read_bytes()
    if not data:
        raise _empty(path)
    return data


def mapped(path: Path) -> UInt8[np.ndarray, " byte"]:
    """The content mapped into memory: pages are read when they are looked at.

    Raises:
        SourceError: as `read`.
    """
    with _readable(path):
        if path.is_dir():
            raise IsADirectoryError
        if path.stat().st_size == 0:
            raise _empty(path)
        return np.memmap(path, dtype=np.uint8, mode="r")


def digest(path: Path) -> str:
    """SHA-256 of the content, in hexadecimal."""
    with _readable(path), path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _empty(path: Path) -> SourceError:
    return SourceError(str(path), "is empty", fix="record the flight again, or find the log")


@contextmanager
def _readable(path: Path) -> Generator[None, None, None]:
    try:
        yield
    except FileNotFoundError as error:
        raise SourceError(str(path), "no such file", fix="check the path") from error
    except IsADirectoryError as error:
        raise SourceError(str(path), "is a directory", fix="give the log file in it") from error
    except OSError as error:
        raise SourceError(
            str(path), f"cannot be read ({error.strerror})", fix="check its permissions"
        ) from error
