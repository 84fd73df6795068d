"""`simulate`, `diagnose` and `suggest` hand their options to their runs."""

from __future__ import annotations

import types
from pathlib import Path

import pytest

import gcs_sysid.offline
from gcs_sysid.cli import entry, numerics, reports
from gcs_sysid.offline.suggestion_target import Question

DOCUMENT = {"program": "gcs-sysid 0.1.0"}


@pytest.fixture
def calls(monkeypatch, tmp_path):
    """Stands for the runs; each call is kept as (run, positional, named)."""
    kept: list[tuple[str, tuple, dict]] = []

    def stand_in(name):
        def run(*args, progress, **named):
            kept.append((name, args, named))
            progress("half way", 0.5)
            return DOCUMENT

        return types.SimpleNamespace(run=run)

    for name in ("simulate", "diagnose", "suggest"):
        monkeypatch.setattr(gcs_sysid.offline, name, stand_in(name), raising=False)
    monkeypatch.setattr(numerics, "enable", lambda: None)
    monkeypatch.setattr(reports, "sheet", lambda run, _summary, table: f"{run}: {table}")
    monkeypatch.chdir(tmp_path)
    for file in ("flight.tlog", "other.tlog", "aircraft.toml", "map.toml"):
        (tmp_path / file).touch()
    (tmp_path / "model").mkdir()
    return kept


def test_simulate(calls, capsys):
    assert entry.main(["simulate", "flight.tlog", "--model", "model", "--vehicle", "2"]) == 0
    [(_, args, named)] = calls
    assert args == (Path("flight.tlog"),)
    assert named == {
        "aircraft": None, "model": Path("model"), "vehicle": 2, "segments": None, "columns": None,
        "can": None, "tolerances": None, "out": Path("flight-simulate"),
    }  # fmt: skip
    assert capsys.readouterr().out == "simulate: flight-simulate/simulated.parquet\n"


def test_diagnose(calls, capsys):
    arguments = ["flight.tlog", "--aircraft", "aircraft.toml", "--holdout", "other.tlog"]
    assert entry.main(["diagnose", *arguments, "--columns", "map.toml"]) == 0
    [(_, args, named)] = calls
    assert args == ((Path("flight.tlog"),),)
    assert named == {
        "aircraft": Path("aircraft.toml"), "model": None, "holdout": Path("other.tlog"),
        "vehicle": None, "segments": None, "columns": Path("map.toml"), "can": None,
        "method": "filter", "out": Path("flight-diagnose"),
    }  # fmt: skip
    assert capsys.readouterr().out == "diagnose: flight-diagnose/residuals.parquet\n"


def test_suggest_takes_one_question(calls, capsys):
    pair = ["--separate", "mass,cg_shift"]
    assert entry.main(["suggest", "--model", "model", *pair]) == 0
    [(_, args, _)] = calls
    assert args[1].separate == "mass,cg_shift"
    assert entry.main(["suggest", "--model", "model", *pair, "--target", "Cm"]) == 2
    assert "--separate goes without --target" in capsys.readouterr().err


def test_suggest(calls, capsys):
    arguments = ["--target", "Cn", "--region", "beta=2:8", "--gust", "0.8", "--minutes", "4"]
    arguments += ["--flown", "before", "--seed", "4"]
    assert entry.main(["suggest", "--model", "model", *arguments]) == 0
    [(_, args, named)] = calls
    question = Question(
        target="Cn", region="beta=2:8", gust=0.8, minutes=4.0, flown=Path("before"), seed=4
    )
    assert args == (Path("model"), question)
    assert named == {"out": Path("model-suggest")}
    assert capsys.readouterr().out == "suggest: model-suggest/maneuvers.parquet\n"


def test_results_of_somebody_else_are_not_overwritten(calls, capsys, tmp_path):
    (tmp_path / "flight-diagnose").mkdir()
    (tmp_path / "flight-diagnose" / "aircraft-extended.toml").write_text("mine")
    assert entry.main(["diagnose", "flight.tlog", "--aircraft", "aircraft.toml"]) == 1
    assert calls == []
    assert "nothing in its folder says that gcs-sysid wrote it" in capsys.readouterr().err
