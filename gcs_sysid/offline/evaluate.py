"""`evaluate`: coefficients, their uncertainty and derivatives at given conditions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.parquet as pq

from gcs_sysid.errors import InputError
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.gp import aerodynamics
from gcs_sysid.offline import documents, model_store


def run(model_dir: Path, at: Path, out: Path) -> dict[str, Any]:
    """Adds `CX`, `CX_sd`, … and `CX_alpha`, `CX_alpha_sd`, … to the table `at`, into `out`.

    Args:
        model_dir: an identified model.
        at: CSV or Parquet with one column a regressor variable (`alpha` rad, `qhat`, `elevator`
            rad…).
        out: CSV or Parquet to write, by its ending.

    Returns:
        Number of rows, columns added, and rows outside the range the model was fitted on.

    Raises:
        InputError: a file cannot be read, or a column that the model needs is missing.
    """
    stored = model_store.load(model_dir)
    table = _read(at)
    values = _values(table, stored.model, at)
    added: dict[str, np.ndarray] = {}
    for name, prediction in stored.model.predict(values, measured=False).items():
        added[name] = prediction.mean
        added[f"{name}_sd"] = prediction.deviation
        for variable in stored.model.depends_on(name):
            slope = stored.model.derivative(name, variable, values)
            added[f"{name}_{variable}"] = slope.mean
            added[f"{name}_{variable}_sd"] = slope.deviation
    for name, column in added.items():
        if name in table.column_names:
            table = table.drop_columns([name])
        table = table.append_column(name, pa.array(column))
    _write(table, out)
    return {
        "rows": table.num_rows,
        "added": list(added),
        "extrapolated": int(np.sum(_outside(stored.model, values))),
        "file": str(out),
    }


def _read(path: Path) -> pa.Table:
    try:
        if path.suffix.lower() == ".parquet":
            return pq.read_table(path)
        return pacsv.read_csv(path)
    except (OSError, pa.ArrowException) as error:
        raise InputError(
            str(path),
            f"cannot be read as a table ({error})",
            fix="give CSV with a header line, or Parquet",
        ) from error


def _values(table: pa.Table, model: AeroModel, path: Path) -> dict[str, np.ndarray]:
    needed = model.variables
    missing = [name for name in needed if name not in table.column_names]
    if missing:
        raise InputError(
            str(path),
            f"has no column {', '.join(missing)}",
            fix=f"give every column the model is a function of: {', '.join(needed)}",
        )
    try:
        values = {name: table[name].to_numpy().astype(np.float64) for name in needed}
    except (TypeError, ValueError) as error:
        raise InputError(
            str(path), f"holds values that are no numbers ({error})", fix="give plain numbers"
        ) from error
    broken = [name for name, column in values.items() if not np.all(np.isfinite(column))]
    if broken:
        raise InputError(
            str(path),
            f"has empty or infinite values in {', '.join(broken)}",
            fix="fill them in or leave the rows out",
        )
    return values


def _outside(model: AeroModel, values: dict[str, np.ndarray]) -> np.ndarray:
    """Rows at which a regressor lies outside the range of the data, or a process has none."""
    count = len(next(iter(values.values())))
    outside = np.zeros(count, dtype=bool)
    for fit in model.fits.values():
        for key, low, high in zip(fit.keys, fit.lowest, fit.highest, strict=True):
            if key in values:
                outside |= (values[key] < low) | (values[key] > high)
    for unknown in aerodynamics.untold(model, values).values():
        outside |= unknown
    return outside


def _write(table: pa.Table, path: Path) -> None:
    def write(temporary: Path) -> None:
        if path.suffix.lower() == ".parquet":
            pq.write_table(table, temporary)
        else:
            pacsv.write_csv(table, temporary)

    documents.write_atomic(path, write)
