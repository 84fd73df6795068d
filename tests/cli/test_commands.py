"""Each command hands its options to its run and shows what comes back."""

from __future__ import annotations

import json
import types
from pathlib import Path

import pytest

import gcs_sysid.offline
from gcs_sysid.cli import entry, numerics, reports
from gcs_sysid.errors import RefusedError

SUMMARY = {
    "program": "gcs-sysid 0.1.0",
    "flights": [{"source": "flight.tlog", "airborne_s": 60.0}],
    "maneuvers": [],
    "coefficients": {},
    "rows": 3,
    "extrapolated": 1,
    "file": "flown.csv",
}


@pytest.fixture
def calls(monkeypatch, tmp_path):
    """Stands for the runs; each call is kept as (run, positional, named)."""
    kept: list[tuple[str, tuple, dict]] = []

    def stand_in(name):
        def run(*args, progress=None, **named):
            kept.append((name, args, named))
            if progress is not None:
                progress("half way", 0.5)
            return SUMMARY

        return types.SimpleNamespace(
            run=run, text=lambda _document: "streams", FILE="aircraft.toml"
        )

    for name in ("init", "inspect", "identify", "predict", "evaluate"):
        monkeypatch.setattr(gcs_sysid.offline, name, stand_in(name), raising=False)
    monkeypatch.setattr(numerics, "enable", lambda: None)
    monkeypatch.setattr(reports, "write", lambda run, _summary, table: f"{run}: {table}")
    monkeypatch.chdir(tmp_path)
    for file in (
        "flight.tlog",
        "other.tlog",
        "aircraft.toml",
        "segments.json",
        "points.csv",
        "map.toml",
        "bus.blf",
    ):
        (tmp_path / file).touch()
    (tmp_path / "model").mkdir()
    return kept


def test_init(calls, capsys):
    assert entry.main(["init", "flight.tlog", "--vehicle", "3", "--out", "first"]) == 0
    [(_, args, named)] = calls
    assert args == (Path("flight.tlog"),)
    assert named == {"vehicle": 3, "columns": None, "out": Path("first")}
    assert capsys.readouterr().out == "streams\n"


def test_init_never_overwrites_a_file_that_may_have_been_filled_in(calls, capsys):
    Path("first").mkdir()
    Path("first/aircraft.toml").touch()
    assert entry.main(["init", "flight.tlog", "--out", "first"]) == 1
    assert "exists" in capsys.readouterr().err
    assert not calls


def test_inspect(calls, capsys):
    assert entry.main(["inspect", "flight.tlog", "--vehicle", "3"]) == 0
    [(_, args, named)] = calls
    assert args == (Path("flight.tlog"),)
    assert named == {
        "aircraft": None, "vehicle": 3, "segments": None, "columns": None, "can": None,
        "out": Path("flight-inspect"),
    }  # fmt: skip
    assert capsys.readouterr().out == "streams\nflight-inspect/inspect.json\n"


def test_identify(calls, capsys):
    arguments = ["flight.tlog", "other.tlog", "--aircraft", "aircraft.toml", "--prior", "none"]
    options = ["--segments", "segments.json", "--stepwise", "--out", "result", "--seed", "1"]
    assert entry.main(["identify", *arguments, *options]) == 0
    [(_, args, named)] = calls
    assert args == ((Path("flight.tlog"), Path("other.tlog")), Path("aircraft.toml"))
    assert named == {
        "prior": "none", "segments": Path("segments.json"), "vehicle": None, "stepwise": True,
        "columns": None, "can": None, "out": Path("result"), "method": "auto", "body": "file",
    }  # fmt: skip
    assert capsys.readouterr().out == "identify: result/samples.parquet\n"


def test_identify_as_json(calls, capsys):
    assert entry.main(["identify", "flight.tlog", "--aircraft", "aircraft.toml", "--json"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out) == SUMMARY
    assert captured.err == ""


def test_predict(calls, capsys):
    arguments = ["flight.tlog", "--model", "model", "--columns", "map.toml", "--can", "bus.blf"]
    assert entry.main(["predict", *arguments]) == 0
    [(_, args, named)] = calls
    assert args == (Path("flight.tlog"), Path("model"))
    assert named == {
        "vehicle": None, "segments": None, "columns": Path("map.toml"), "can": Path("bus.blf"),
        "out": Path("flight-predict"), "method": "auto",
    }  # fmt: skip
    assert capsys.readouterr().out == "predict: flight-predict/predictions.parquet\n"


def test_evaluate(calls, capsys):
    assert entry.main(["evaluate", "--model", "model", "--at", "points.csv"]) == 0
    [(_, args, _)] = calls
    assert args == (Path("model"), Path("points.csv"), Path("points-evaluate.csv"))
    assert capsys.readouterr().out == "3 rows, 1 of them outside what was flown\nflown.csv\n"


def test_evaluate_does_not_overwrite_what_it_reads(calls, capsys):
    arguments = ["evaluate", "--model", "model", "--at", "points.csv", "--out", "./points.csv"]
    assert entry.main(arguments) == 1
    assert calls == []
    assert "points.csv: is both read and written" in capsys.readouterr().err


def test_a_refusal_leaves_no_empty_folder_behind(calls, monkeypatch, tmp_path):
    def refuse(*_args, **_named):
        raise RefusedError("flight.tlog", "no airspeed", fix="stream VFR_HUD at 10 Hz")

    monkeypatch.setattr(gcs_sysid.offline.predict, "run", refuse)
    assert entry.main(["predict", "flight.tlog", "--model", "model"]) == 1
    assert not (tmp_path / "flight-predict").exists()
