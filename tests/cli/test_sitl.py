"""`sitl` from the command line."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

from gcs_sysid.cli import entry
from gcs_sysid.sitl import plan
from gcs_sysid.sitl.plan import Leg
from tests.sitl import examples


@pytest.fixture
def brief(monkeypatch):
    """A standard flight of two seconds."""
    monkeypatch.setattr(plan, "standard", lambda aircraft: (Leg("brief", 2.0, 17.0, 100.0),))


def test_it_records_and_tells_the_truth(brief, tmp_path, capsys):
    record, truth = tmp_path / "flight.tlog", tmp_path / "truth"
    arguments = ["--aircraft", str(examples.ULTRA_STICK), "--record", str(record)]
    assert entry.main(["sitl", *arguments, "--truth", str(truth), "--wind", "200", "3"]) == 0
    out = capsys.readouterr().out
    assert "flight: 2 s flown" in out
    assert out.rstrip().endswith(str(truth.with_suffix(".json")))
    assert json.loads(truth.with_suffix(".json").read_text())["cause"] == "none"
    assert record.stat().st_size > 10_000
    assert np.load(truth)["rows"].shape[0] == 100


def test_the_seed_is_the_flight(brief, tmp_path, capsys):
    contents = []
    for seed in ("4", "4", "5"):
        record = tmp_path / "flight.tlog"
        arguments = ["--aircraft", str(examples.ULTRA_STICK), "--record", str(record)]
        assert entry.main(["sitl", *arguments, "--seed", seed, "--gust", "0.4", "--json"]) == 0
        [flight] = json.loads(capsys.readouterr().out)["flights"]
        assert flight["received"] <= flight["sent"]
        contents.append(record.read_bytes())
    assert contents[0] == contents[1] != contents[2]


def test_effects_are_hidden_and_told_beside_the_truth(brief, tmp_path, capsys):
    first, second = tmp_path / "one.toml", tmp_path / "two.toml"
    first.write_text('name = "mass"\nmass_ratio = 1.1\n[truth]\nscenario = "x"\n')
    second.write_text('[[effects]]\nname = "asymmetry"\nCl0 = 0.01\n')
    truth = tmp_path / "truth.npz"
    arguments = ["--aircraft", str(examples.ULTRA_STICK), "--truth", str(truth)]
    arguments += ["--record", str(tmp_path / "x.tlog"), "--effect", str(first)]
    assert entry.main(["sitl", *arguments, "--effect", str(second), "--json"]) == 0
    [flight] = json.loads(capsys.readouterr().out)["flights"]
    told = json.loads((tmp_path / "truth.json").read_text())
    assert flight["hidden"] == str(tmp_path / "truth.json")
    assert told["cause"] == "several"
    assert told["scenario"] == "x"
    assert told["effects"] == [
        {"name": "mass", "parameters": {"mass_ratio": 1.1}},
        {"name": "asymmetry", "parameters": {"Cl0": 0.01}},
    ]


def test_flights_of_a_scenario_go_to_a_folder(tmp_path, capsys):
    plan = tmp_path / "scenario.toml"
    plan.write_text(
        f'''schema = 1
name = "x"
aircraft = "{examples.ULTRA_STICK}"
[[effects]]
name = "mass"
mass_ratio = 1.1
[[flights]]
name = "one"
seed = 3
begins = 2026-10-03T09:12:00Z
legs = [{{ name = "out", duration = 1, airspeed = 17, height = 100, heading = 90 }}]
''',
        encoding="utf-8",
    )
    assert entry.main(["sitl", "--scenario", str(plan)]) == 2
    assert "--out DIR" in capsys.readouterr().err
    out = tmp_path / "flights"
    assert entry.main(["sitl", "--scenario", str(plan), "--out", str(out)]) == 0
    names = ["one.tlog", "one_truth.json", "one_truth.npz"]
    assert sorted(path.name for path in out.iterdir()) == names
    assert str(out / "one.tlog") in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--aircraft", str(examples.ULTRA_STICK), "--record", "x.tlog", "--out", "x"],
        ["--aircraft", str(examples.ULTRA_STICK)],
        ["--scenario", str(examples.ROOT / "replay/demo/scenario.toml"), "--record", "x.tlog"],
        ["--aircraft", str(examples.ULTRA_STICK), "--record", "x.tlog", "--seed", "-1"],
    ],
)
def test_what_it_cannot_do_it_says_in_one_line(arguments, capsys):
    assert entry.main(["sitl", *arguments]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_missing_jsbsim_is_named_with_its_remedy(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    record = str(tmp_path / "x.tlog")
    arguments = ["--aircraft", str(examples.ULTRA_STICK), "--record", record]
    assert entry.main(["sitl", *arguments]) == 2
    assert "pip install 'gcs-sysid[sitl]'" in capsys.readouterr().err
