"""`scenario` from the command line: flights are flown once, failures are told."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from gcs_sysid.cli import entry
from gcs_sysid.cli.commands import scenario as command
from gcs_sysid.sitl import truth
from tests.sitl import examples

PLAN = f"""
schema = 1
name = "short"
aircraft = "{examples.ULTRA_STICK}"
[[flights]]
name = "one"
seed = 3
begins = 2026-10-03T09:12:00Z
legs = [{{ name = "out", duration = 2, airspeed = 17, height = 100, heading = 90 }}]
"""


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "short"
    made.mkdir()
    (made / "scenario.toml").write_text(PLAN, encoding="utf-8")
    (made / "expected.toml").write_text(
        'schema = 1\nabout = "two seconds"\n[identify]\nsize = { least = 10000 }\n',
        encoding="utf-8",
    )
    return made


@pytest.fixture
def identified(monkeypatch):
    """Logs given to `identify`, which only weighs them."""
    logs: list[Path] = []

    def weigh(name, arguments):
        logs.append(Path(arguments[0]))
        out = Path(arguments[-1])
        out.mkdir()
        (out / "summary.json").write_text(json.dumps({"size": logs[-1].stat().st_size}))

    monkeypatch.setattr(command, "_command", weigh)
    return logs


def run(folder, tmp_path, name="a"):
    cache = ["--cache", str(tmp_path / "cache")]
    return entry.main(["scenario", str(folder), "--out", str(tmp_path / name), *cache])


def test_a_flight_is_flown_once_and_again_when_its_plan_changes(
    folder, identified, tmp_path, capsys
):
    assert run(folder, tmp_path) == 0
    assert "1 of 1 expectations hold" in capsys.readouterr().out
    [log] = identified
    before = log.stat().st_mtime_ns
    beside = {path.name for path in log.parent.iterdir()}
    assert beside == {"one.tlog", "one_truth.npz", "one_truth.json"}
    assert run(folder, tmp_path, "b") == 0
    assert identified[1] == log
    assert log.stat().st_mtime_ns == before
    (folder / "scenario.toml").write_text(PLAN.replace("seed = 3", "seed = 4"), encoding="utf-8")
    assert run(folder, tmp_path, "c") == 0
    assert identified[2] != log
    assert identified[2].read_bytes() != log.read_bytes()
    # Nothing half flown is left.
    assert len(list((tmp_path / "cache" / "flights").iterdir())) == 2


def test_the_code_that_flies_is_part_of_the_key(folder, identified, tmp_path, monkeypatch):
    assert run(folder, tmp_path) == 0
    monkeypatch.setattr("gcs_sysid.cli.flights._code", lambda: "changed")
    assert run(folder, tmp_path, "b") == 0
    assert identified[0] != identified[1]


def test_a_flight_that_fails_leaves_nothing(folder, identified, tmp_path, monkeypatch):
    def crash(*_, **__):
        raise OSError("disk full")

    monkeypatch.setattr(truth, "save", crash)
    assert run(folder, tmp_path) == 1
    assert list((tmp_path / "cache" / "flights").iterdir()) == []
    assert not (tmp_path / "a").exists()


def test_a_recorded_flight_is_taken_as_it_is(folder, identified, tmp_path):
    log = examples.ROOT / "data" / "flights" / "demo.tlog"
    recorded = PLAN.split("[[flights]]")[0] + f'[[flights]]\nname = "one"\nlog = "{log}"\n'
    (folder / "scenario.toml").write_text(recorded, encoding="utf-8")
    assert run(folder, tmp_path) == 0
    assert identified == [log]
    (folder / "scenario.toml").write_text(recorded.replace("demo.tlog", "no.tlog"), "utf-8")
    assert run(folder, tmp_path, "b") == 1


def test_what_does_not_hold_is_exit_status_1_and_one_line(folder, identified, tmp_path, capsys):
    expected = folder / "expected.toml"
    expected.write_text(expected.read_text().replace("10000", "10000000"), encoding="utf-8")
    assert run(folder, tmp_path) == 1
    captured = capsys.readouterr()
    assert "FAIL" in captured.out
    assert captured.err.count("\n") == 1
    assert "1 of 1 expectations do not hold" in captured.err
    document = json.loads((tmp_path / "a" / "scenario.json").read_text())
    assert document["passed"] is False


def test_all_scenarios_are_listed(capsys):
    assert entry.main(["scenario"]) == 0
    lines = capsys.readouterr().out.splitlines()
    names = [line.split()[0] for line in lines]
    assert names == sorted(path.parent.name for path in command.SCENARIOS.glob("*/scenario.toml"))
    assert "demo" in names


def test_an_unknown_name_gets_those_there_are(capsys):
    assert entry.main(["scenario", "no such"]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "demo" in error


@pytest.mark.slow
def test_a_scenario_of_replay_is_flown_identified_and_found_as_expected(tmp_path):
    """The cheapest of them; all are in tests/benchmarks/bench_scenarios.py."""
    command = [sys.executable, "-m", "gcs_sysid", "scenario", "low_rate"]
    done = subprocess.run(
        [*command, "--out", "a", "--cache", "cache"],
        cwd=tmp_path, capture_output=True, text=True, timeout=280, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr + done.stdout
    assert done.stdout.splitlines()[-1] == "low_rate: 8 of 8 expectations hold"
    assert (tmp_path / "a" / "identify" / "report.html").exists()
