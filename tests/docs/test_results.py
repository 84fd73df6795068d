"""The README shows the results that were kept, and no others."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def results():
    spec = importlib.util.spec_from_file_location("results", ROOT / "docs" / "results.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_readme_shows_the_kept_results(results):
    readme = results.README.read_text(encoding="utf-8")
    assert results.renewed(readme, results.block()) == readme, "run `make results`"
    assert results.PAGE.read_text(encoding="utf-8") == results.page(), "run `make results`"


def test_a_line_shows_what_was_kept_and_only_that(results, tmp_path):
    document = {"title": "t", "columns": ["what", "ours"], "rows": [["a", "1"], ["b", "2|"]]}
    (tmp_path / "one.json").write_text(json.dumps(document), encoding="utf-8")
    both = (results.Cell("one", "b", "ours"), results.Cell("one", "", "ours"))
    line = results.Line("speed", "3 s", both, " s")
    missing = results.Line("never run", "4 s", (results.Cell("two", "b", "ours"),))
    shown = results.block(tmp_path, (line, missing))
    assert "| speed | 3 s | 2\\| / 1 s |" in shown
    assert "never run" not in shown
    gone = results.Line("speed", "3 s", (results.Cell("one", "c", "ours"),))
    with pytest.raises(KeyError, match="one: no c"):
        results.block(tmp_path, (gone,))


def test_a_line_counts_rows_among_some(results, tmp_path):
    rows = [["a", "agrees with both"], ["b", "not told"], ["c", "departs"], ["d", "agrees"]]
    document = {"title": "t", "columns": ["what", "said"], "rows": rows}
    (tmp_path / "one.json").write_text(json.dumps(document), encoding="utf-8")
    told = ("agrees", "departs")
    counts = (
        results.Count("one", "said", told),
        results.Count("one", "said", ("agrees",), told),
    )
    shown = results.block(tmp_path, (results.Line("told", "–", counts),))
    assert "| told | – | 3 of 4 / 2 of 3 |" in shown


def test_tables_become_markdown_in_the_order_of_their_names(results, tmp_path):
    for name, cell in (("b", "second"), ("a", "first|one")):
        document = {"title": name, "columns": ["what"], "rows": [[cell]]}
        (tmp_path / f"{name}.json").write_text(json.dumps(document), encoding="utf-8")
    shown = results.page(tmp_path)
    assert shown.index("first\\|one") < shown.index("second")
    assert "**a**\n\n| what |\n| --- |\n| first\\|one |" in shown


def test_renewing_touches_nothing_else(results):
    readme = f"before\n{results.BEGIN}\nold\n{results.END}\nafter\n"
    new = f"{results.BEGIN}\nnew\n{results.END}"
    assert results.renewed(readme, new) == f"before\n{new}\nafter\n"


def test_a_benchmark_prints_its_table_and_keeps_it_only_when_asked(tmp_path, monkeypatch, capsys):
    path = ROOT / "tests" / "benchmarks" / "table.py"
    spec = importlib.util.spec_from_file_location("table", path)
    assert spec is not None
    assert spec.loader is not None
    table = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(table)
    monkeypatch.setattr(table, "KEPT", tmp_path)
    monkeypatch.setattr(sys, "argv", ["bench_x.py"])
    table.show("x", "Errors", ("what", "found"), [("alpha", 0.25)])
    assert "alpha  0.25" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr(sys, "argv", ["bench_x.py", "--save"])
    table.show("x", "Errors", ("what", "found"), [("alpha", 0.25)])
    kept = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert kept == {"title": "Errors", "columns": ["what", "found"], "rows": [["alpha", "0.25"]]}


def test_make_knows_the_targets_that_were_promised():
    targets = ("setup", "demo", "test", "lint", "bench", "docs")
    done = subprocess.run(
        ["make", "--dry-run", "--no-print-directory", *targets],
        cwd=ROOT, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
