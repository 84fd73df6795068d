"""Columns of numbers out of .csv, .parquet and .mat files."""

from __future__ import annotations

import difflib
import io
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import scipy.io
from jaxtyping import Float
from pyarrow import csv, parquet

from gcs_sysid.errors import SourceError
from gcs_sysid.sources import mat_elements

Column = Float[np.ndarray, " row"]
LABELS = "_label"
"""Mission Planner writes beside each matrix `IMU` the names of its columns, `IMU_label`."""


DAMAGED = (
    pa.ArrowException,
    scipy.io.matlab.MatReadError,
    zlib.error,
    struct.error,
    ValueError,
    LookupError,
    OSError,
    ArithmeticError,
    MemoryError,
)
"""What the libraries raise on bytes that are not of the format."""


def columns(path: Path, data: bytes) -> dict[str, Column | None]:
    """All columns of a table by name; None for one that does not hold numbers.

    Dates become µs since 1970. A .mat gives its vectors, in structs as `struct.field`, and the
    columns of its matrices as `IMU(:,3)` and, where `IMU_label` names them, as `IMU.GyrX`.

    Raises:
        SourceError: the content is not what the file's name promises.
    """
    try:
        return READERS[path.suffix.lower()](data)
    except NotImplementedError as error:
        raise SourceError(
            str(path), "is a MATLAB 7.3 file", fix="save it with `save -v7` in MATLAB"
        ) from error
    except DAMAGED as error:
        reason = " ".join(str(error).split())[:120]
        raise SourceError(
            str(path),
            f"cannot be read as {path.suffix.lower()} ({reason})",
            fix="export the table again",
        ) from error


def nearest(name: str, known: Mapping[str, object]) -> str:
    """What to say about a column that is not there."""
    same_end = [one for one in known if one.rpartition(".")[2].lower() == name.lower()]
    close = same_end[:3] or difflib.get_close_matches(name, known, n=3)
    if close:
        return f"did you mean {' or '.join(f'`{one}`' for one in close)}?"
    some = ", ".join(list(known)[:12])
    return f"the columns are {some}{' …' if len(known) > 12 else ''}"


def _csv(data: bytes) -> dict[str, Column | None]:
    first = data.split(b"\n", 1)[0].decode("utf-8", "replace")
    delimiter = max(",;\t", key=first.count)
    return _arrow(
        csv.read_csv(io.BytesIO(data), parse_options=csv.ParseOptions(delimiter=delimiter))
    )


def _parquet(data: bytes) -> dict[str, Column | None]:
    return _arrow(parquet.read_table(pa.BufferReader(data)))


def _arrow(table: pa.Table) -> dict[str, Column | None]:
    if len(set(table.column_names)) < table.num_columns:
        twice = next(n for n in table.column_names if table.column_names.count(n) > 1)
        raise ValueError(f"two columns are called {twice!r}")
    return {name.strip(): _numbers(table.column(name)) for name in table.column_names}


def _numbers(column: pa.ChunkedArray) -> Column | None:
    kind = column.type
    if pa.types.is_timestamp(kind):
        column = pc.cast(pc.cast(column, pa.timestamp("us", tz=kind.tz), safe=False), pa.int64())
    elif not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)):
        return None
    return pc.cast(column, pa.float64(), safe=False).to_numpy()


def _mat(data: bytes) -> dict[str, Column | None]:
    mat_elements.check(data)
    try:
        content = scipy.io.loadmat(io.BytesIO(data), simplify_cells=True)
    except TypeError as error:  # what SciPy raises where it expected another element
        raise ValueError(str(error)) from error
    return dict(_flat({k: v for k, v in content.items() if not k.startswith("__")}, ""))


def _flat(content: Mapping[str, Any], path: str) -> Iterator[tuple[str, Column | None]]:
    for key, value in content.items():
        name = f"{path}{key}"
        if isinstance(value, dict):
            yield from _flat(value, f"{name}.")
            continue
        array = np.asarray(value)
        if array.dtype.kind not in "fiub" or array.ndim > 2:
            yield name, None
        elif array.ndim < 2:
            yield name, np.atleast_1d(array).astype(np.float64)
        else:
            yield from _matrix(name, array.astype(np.float64), content.get(f"{key}{LABELS}"))


def _matrix(
    name: str, matrix: Float[np.ndarray, "row column"], labels: Any
) -> Iterator[tuple[str, Column]]:
    lying = matrix.shape[0] < matrix.shape[1]
    for number, values in enumerate(matrix if lying else matrix.T, start=1):
        yield f"{name}({number},:)" if lying else f"{name}(:,{number})", values
    if labels is not None and not lying:
        for label, values in zip(np.atleast_1d(labels), matrix.T, strict=False):
            yield f"{name}.{str(label).strip()}", values


READERS: Mapping[str, Callable[[bytes], dict[str, Column | None]]] = {
    ".csv": _csv,
    ".parquet": _parquet,
    ".mat": _mat,
}
"""File name ending -> reader of the file's content."""
