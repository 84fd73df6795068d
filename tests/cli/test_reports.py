"""The report is written beside the documents, whole or not at all."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet
import pytest

import gcs_sysid.report
from gcs_sysid.cli import reports


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "samples.parquet"
    parquet.write_table(pa.table({"t": np.arange(3.0), "held_out": [True, False, True]}), path)
    return path


def stand_in(monkeypatch, render):
    for run in ("identify", "predict"):
        monkeypatch.setattr(f"gcs_sysid.report.{run}.render", render)
    monkeypatch.setattr(gcs_sysid.report, "ten_lines", lambda _summary, path: f"Report {path}")


@pytest.mark.parametrize("run", ["identify", "predict"])
def test_the_page_is_made_from_summary_and_table(run, table, monkeypatch):
    def render(summary, samples):
        assert summary == {"schema": 1}
        assert samples["held_out"].dtype == bool
        return f"{run} {samples['t'].sum()} α"

    stand_in(monkeypatch, render)
    report = table.with_name("report.html")
    assert reports.write(run, {"schema": 1}, table) == f"Report {report}"
    assert report.read_text(encoding="utf-8") == f"{run} 3.0 α"
    assert report.stat().st_mode & 0o044, "others cannot read it"


def test_a_failed_report_leaves_the_last_one_and_no_rest(table, monkeypatch):
    report = table.with_name("report.html")
    report.write_text("last", encoding="utf-8")
    stand_in(monkeypatch, lambda _summary, _samples: "\ud800")  # cannot be encoded
    with pytest.raises(UnicodeEncodeError):
        reports.write("identify", {}, table)
    assert report.read_text(encoding="utf-8") == "last"
    assert sorted(path.name for path in table.parent.iterdir()) == ["report.html", table.name]
