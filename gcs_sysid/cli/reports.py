"""The report of a run, written beside its documents, and its findings for the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

REPORT = "report.html"


def write(run: Literal["identify", "predict"], summary: Mapping[str, Any], table: Path) -> str:
    """Writes `report.html` beside the table of samples.

    Args:
        run: which command made the summary.
        summary: its document.
        table: its samples or predictions, Parquet.

    Returns:
        The findings in at most ten lines, the last one naming the report.
    """
    import pyarrow.parquet as parquet

    from gcs_sysid.report import identify, predict, ten_lines

    columns = parquet.read_table(table)
    samples = {name: columns[name].to_numpy() for name in columns.column_names}
    render = identify.render if run == "identify" else predict.render
    path = table.with_name(REPORT)
    _replace(path, render(summary, samples))
    return ten_lines(summary, path)


def _replace(path: Path, text: str) -> None:
    """Writes the file whole or not at all: somebody may be reading the last one."""
    partial = path.with_name(f".{path.name}.partial")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
