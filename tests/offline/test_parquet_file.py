from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from gcs_sysid.offline import parquet_file


def test_tables_keep_types_and_values(tmp_path: Path) -> None:
    columns = {
        "time_us": np.array([1_700_000_000_000_000, 2], dtype=np.int64),
        "CX": np.array([0.1, np.nan]),
        "held_out": np.array([True, False]),
    }
    parquet_file.write(tmp_path / "t.parquet", columns)
    table = pq.read_table(tmp_path / "t.parquet")
    assert [str(field.type) for field in table.schema] == ["int64", "double", "bool"]
    for name, column in columns.items():
        assert np.array_equal(table[name].to_numpy(), column, equal_nan=name == "CX")
    found = parquet_file.read(tmp_path / "t.parquet")
    assert {name: column.dtype for name, column in found.items()} == {
        name: column.dtype for name, column in columns.items()
    }
    for name, column in columns.items():
        assert np.array_equal(found[name], column, equal_nan=name == "CX")
