"""What is learned kept on disk meanwhile, so that a killed program can go on with it."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from gcs_sysid.errors import InputError
from gcs_sysid.live.inside_feed import InsideFeed
from gcs_sysid.live.processes import Processes
from gcs_sysid.live.regression import RunningModel
from gcs_sysid.offline import documents

NAME = "live-model.npz"
SCHEMA = 3
EVERY_S = 5.0
"""A snapshot is taken so often [s]: this much of the model a killed program loses."""
_SCHEMA, _TIME, _UPDATES, _STRUCTURE = "schema", "time_us", "updates", "structure"
_PARAMETER = "parameter."
_NONE: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class Restored:
    """What a snapshot held.

    Attributes:
        time_us: when it was taken [µs since 1970].
        updates: after how many.
        processes: whether the processes go on too.
        inside: whether the filter with the aerodynamics inside does.
        parameters: of the autopilot: it tells them seldom, and a program that begins anew would
            read its samples otherwise.
    """

    time_us: int
    updates: int
    processes: bool
    inside: bool
    parameters: Mapping[str, float]


def taken(
    model: RunningModel,
    processes: Processes,
    inside: InsideFeed,
    *,
    time_us: int,
    updates: int,
    parameters: Mapping[str, float] = _NONE,
) -> dict[str, np.ndarray]:
    """What all three know now; what they learn later changes nothing in it.

    Args:
        model: the first model.
        processes: beside it.
        inside: the filter with the aerodynamics inside.
        time_us: of the newest state [µs since 1970].
        updates: so far.
        parameters: of the autopilot, by which samples were read.
    """
    known = {**model.state(), **processes.state(), **inside.state()}
    return {
        **{name: value.copy() for name, value in known.items()},
        _SCHEMA: np.array(SCHEMA),
        _TIME: np.array(time_us),
        _UPDATES: np.array(updates),
        _STRUCTURE: np.array(model.structure),
        **{f"{_PARAMETER}{name}": np.array(value) for name, value in parameters.items()},
    }


def write(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Writes what was `taken`, whole or not at all, and onto the disk."""

    def fill(temporary: Path) -> None:
        with temporary.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
            file.flush()
            os.fsync(file.fileno())

    documents.write_atomic(path, fill)


def restore(path: Path, model: RunningModel, processes: Processes, inside: InsideFeed) -> Restored:
    """Lets all three go on from a snapshot of those of the same structure.

    Raises:
        InputError: it cannot be read, or belongs to another aircraft or program.
    """
    arrays = _read(path)
    try:
        known = int(arrays[_SCHEMA]) == SCHEMA and str(arrays[_STRUCTURE]) == model.structure
    except (KeyError, TypeError, ValueError) as error:
        raise _damaged(path, error) from error
    if not known:
        raise InputError(
            str(path),
            "is the model of another aircraft file, or of another version of the program",
            fix="move it away; the recording can still be continued and identified",
        )
    try:
        model.restore(arrays)
        gone_on = processes.restore(arrays)
        known = inside.restore(arrays)
        return Restored(
            int(arrays[_TIME]), int(arrays[_UPDATES]), gone_on, known, dict(_parameters(arrays))
        )
    except (KeyError, TypeError, ValueError) as error:
        raise _damaged(path, error) from error


def _parameters(arrays: Mapping[str, np.ndarray]) -> Iterator[tuple[str, float]]:
    for name, value in arrays.items():
        if name.startswith(_PARAMETER):
            yield name.removeprefix(_PARAMETER), float(value)


def _read(path: Path) -> Mapping[str, np.ndarray]:
    try:
        # Opened here: NumPy leaves open what is no archive.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (OSError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise _damaged(path, error) from error


def _damaged(path: Path, error: Exception) -> InputError:
    return InputError(
        str(path),
        f"cannot be read as a snapshot of the model ({' '.join(str(error).split())[:100]})",
        fix="move it away; the recording can still be continued and identified",
    )
