"""Tables that are measured in parts."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from tests.benchmarks import table


def test_rows_that_are_not_measured_now_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table, "KEPT", tmp_path)
    rows, order = [("b", "0", "new")], ("a", "b", "c")
    monkeypatch.setattr(sys, "argv", ["bench", "--save"])
    assert table.beside("made", rows, order) == rows
    before = [
        ["c", "0", "old"],
        ["b", "0", "old"],
        ["a north", "0", "old"],
        ["a north", "1", "old"],
    ]
    (tmp_path / "made.json").write_text(json.dumps({"rows": before}))
    found = [tuple(row) for row in table.beside("made", rows, order)]
    assert found == [
        ("a north", "0", "old"),
        ("a north", "1", "old"),
        ("b", "0", "new"),
        ("c", "0", "old"),
    ]
    monkeypatch.setattr(sys, "argv", ["bench"])
    assert table.beside("made", rows, order) == rows
