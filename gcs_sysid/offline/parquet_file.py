"""Columns of numbers on disk, as Parquet.

Apart from other documents: what it takes is 30 MB, and a listener writes no columns.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from gcs_sysid.offline import documents


def write(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Writes columns of one length, whole or not at all."""
    table = pa.table({name: pa.array(np.asarray(values)) for name, values in columns.items()})
    documents.write_atomic(
        path, lambda temporary: pq.write_table(table, temporary, compression="zstd")
    )


def read(path: Path) -> dict[str, np.ndarray]:
    """All columns of a file, by name."""
    table = pq.read_table(path)
    return {name: table[name].to_numpy() for name in table.column_names}
