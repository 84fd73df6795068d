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
    from gcs_sysid.offline import documents, parquet_file
    from gcs_sysid.report import identify, predict, ten_lines

    samples = parquet_file.read(table)
    render = identify.render if run == "identify" else predict.render
    path = table.with_name(REPORT)
    documents.write_text(path, render(summary, samples))
    return ten_lines(summary, path)


def sheet(
    run: Literal["simulate", "diagnose", "suggest"], summary: Mapping[str, Any], table: Path
) -> str:
    """As `write`, for the runs whose report is findings with sections of tables and figures.

    Args:
        run: which command made the summary.
        summary: its document.
        table: its table, Parquet.
    """
    from gcs_sysid.offline import documents, parquet_file
    from gcs_sysid.report import diagnose, simulate, suggest
    from gcs_sysid.report import sheet as sheets

    samples = parquet_file.read(table)
    made = {"simulate": simulate, "diagnose": diagnose, "suggest": suggest}[run]
    path = table.with_name(REPORT)
    documents.write_text(path, made.render(summary, samples))
    return sheets.lines(made.findings(summary), summary["warnings"], path)
