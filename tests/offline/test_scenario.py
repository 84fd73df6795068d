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
        *("--method", "equation-error"),
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
        *("--method", "coefficients", "--out", "out/diagnose"),
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


def compared(folder: Path, text: str, document: dict[str, float]) -> dict:
    """What is made of a document of `identify`."""
    (folder / "expected.toml").write_text(HEAD + text, encoding="utf-8")
    expected = scenario.expected(folder)
    [planned] = scenario.plan(expected, LOGS, AIRCRAFT, folder)

    def command(name, arguments):
        assert (name, arguments) == ("identify", planned.arguments)
        planned.document.parent.mkdir()
        planned.document.write_text(json.dumps(document), encoding="utf-8")

    return scenario.run(
        *("x", [planned], scenario.shortfalls(expected)),
        out=folder, command=command, progress=lambda text, share: None,
    )  # fmt: skip


GOOD_AND_BAD = "[identify]\ngood = { most = 2 }\nbad = { least = 2 }\n"
SHORT = '[[known_shortfall]]\nrun = "identify"\nplace = "bad"\nreason = "too small"\n'


def test_documents_are_compared_and_a_failure_is_demanded(tmp_path):
    document = compared(tmp_path, GOOD_AND_BAD, {"good": 1.0, "bad": 1.0})
    assert json.loads((tmp_path / "scenario.json").read_text()) == document
    assert [check["passed"] for check in document["checks"]] == [True, False]
    assert not document["passed"]
    table = scenario.text(document).splitlines()
    assert table[1].startswith("ok ")
    assert table[2].startswith("FAIL ")
    assert table[-1] == "x: 1 of 2 expectations hold"
    with pytest.raises(InputError, match="1 of 2 expectations do not hold"):
        scenario.demand(document, tmp_path)


def test_what_is_known_not_to_hold_is_told_with_its_reason(tmp_path):
    document = compared(tmp_path, GOOD_AND_BAD + SHORT, {"good": 1.0, "bad": 1.0})
    assert document["passed"]
    table = scenario.text(document).splitlines()
    assert table[2].startswith("short ")
    assert table[-2:] == [
        "short: identify bad: too small",
        "x: 1 of 2 expectations hold, 1 known not to",
    ]
    scenario.demand(document, tmp_path)


def test_a_known_shortfall_that_holds_is_a_failure(tmp_path):
    document = compared(tmp_path, GOOD_AND_BAD + SHORT, {"good": 1.0, "bad": 3.0})
    assert not document["passed"]
    assert scenario.text(document).splitlines()[2].startswith("HOLDS ")
    with pytest.raises(InputError, match=r"1 hold that are known not to; .*take the entries out"):
        scenario.demand(document, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"bad"', '"abd"', "nothing is expected of `abd`"),
        ("reason", "raeson", "did you mean `reason`"),
        ('reason = "too small"', "", "reason"),
    ],
)
def test_a_known_shortfall_is_of_something_and_has_a_reason(old, new, words, tmp_path):
    with pytest.raises(InputError, match=words):
        compared(tmp_path, GOOD_AND_BAD + SHORT.replace(old, new), {"good": 1.0, "bad": 1.0})
