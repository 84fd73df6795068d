"""Which runs a scenario asks for, and what is made of their documents."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs_sysid.errors import InputError
from gcs_sysid.offline import scenario

LOGS = {"one": Path("one.tlog"), "two": Path("two.tlog"), "three": Path("three.tlog")}
AIRCRAFT = Path("aircraft.toml")
HEAD = 'schema = 1\nabout = "x"\n'


def runs(folder: Path, text: str) -> list[scenario.Run]:
    (folder / "expected.toml").write_text(HEAD + text, encoding="utf-8")
    return scenario.plan(scenario.expected(folder), LOGS, AIRCRAFT, Path("out"))


def test_a_flight_that_is_predicted_is_not_identified(tmp_path):
    [identify, predict] = runs(tmp_path, "[predict.two]\n[identify]\n")
    assert identify.arguments == (
        *("one.tlog", "three.tlog", "--aircraft", "aircraft.toml", "--prior", "file"),
        *("--out", "out/identify"),
    )
    assert predict.arguments == (
        *("two.tlog", "--model", "out/identify", "--out", "out/predict-two"),
    )
    assert predict.document == Path("out/predict-two/summary.json")


def test_runs_are_what_the_file_says(tmp_path):
    text = '[runs]\nidentify = ["one"]\nprior = "none"\nholdout = "three"\n'
    [identify, diagnose] = runs(tmp_path, text + "[identify]\n[diagnose]\n")
    assert identify.arguments[:5] == ("one.tlog", "--aircraft", "aircraft.toml", "--prior", "none")
    assert diagnose.arguments == (
        *("one.tlog", "--aircraft", "aircraft.toml", "--holdout", "three.tlog"),
        *("--out", "out/diagnose"),
    )


def test_a_flight_is_simulated_with_the_file(tmp_path):
    [simulate] = runs(tmp_path, "[simulate.two]\n")
    assert simulate.arguments == (
        *("two.tlog", "--aircraft", "aircraft.toml", "--out", "out/simulate-two"),
    )
    assert simulate.document == Path("out/simulate-two/simulate.json")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[predict.four]", "predict.four"),
        ('[runs]\nholdout = "four"', "runs.holdout"),
        ('[runs]\nidentify = ["four"]\n[identify]', "name flights of the scenario"),
        ("[idenitfy]", "did you mean `identify`"),
    ],
)
def test_what_is_not_there_is_named(text, words, tmp_path):
    with pytest.raises(InputError, match=words):
        runs(tmp_path, text)


def test_documents_are_compared_and_a_failure_is_demanded(tmp_path):
    text = "[identify]\ngood = { most = 2 }\nbad = { least = 2 }\n"
    [identify] = runs(tmp_path, text)

    def command(name, arguments):
        assert (name, arguments) == ("identify", planned.arguments)
        planned.document.parent.mkdir()
        planned.document.write_text(json.dumps({"good": 1.0, "bad": 1.0}), encoding="utf-8")

    [planned] = scenario.plan(scenario.expected(tmp_path), LOGS, AIRCRAFT, tmp_path)
    assert planned.expected == identify.expected
    document = scenario.run(
        "x", [planned], out=tmp_path, command=command, progress=lambda text, share: None
    )
    assert json.loads((tmp_path / "scenario.json").read_text()) == document
    assert [check["passed"] for check in document["checks"]] == [True, False]
    table = scenario.text(document).splitlines()
    assert table[1].startswith("ok ")
    assert table[2].startswith("FAIL ")
    assert table[-1] == "x: 1 of 2 expectations hold"
    with pytest.raises(InputError, match="1 of 2 expectations do not hold"):
        scenario.demand(document, tmp_path)
