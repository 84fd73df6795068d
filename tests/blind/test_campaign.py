"""A campaign goes on where it stopped, and its shares and intervals are those of the textbook."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.blind import campaign, fly, tables
from tests.blind.draw import AIRCRAFT, Draw, Fixed, draw
from tests.blind.fly import Recorded
from tests.blind.score import Sized, score
from tests.blind.sizes import CAUSES
from tests.blind.tables import Result


class Flights:
    """Stands for flying and diagnosing; counts what is asked of it."""

    def __init__(self) -> None:
        self.flown: list[int] = []
        self.fails_at: int | None = None

    def fly(self, one: Draw, folder: Path) -> Recorded:
        if one.index == self.fails_at:
            raise KeyboardInterrupt
        folder.mkdir(parents=True)
        self.flown.append(one.index)
        return Recorded(folder / "flight.tlog", folder / "aircraft.toml", one.index == 2)

    def diagnose(self, recorded: Recorded, folder: Path) -> tuple[dict[str, Any], float]:
        answer: dict[str, Any] = {
            "verdict": "no_effect",
            "cause": "none",
            "effects": [],
            "large": "left out",
        }
        answer["gain"] = {"holdout_error_before": 1.0, "holdout_error_after": 0.5}
        return {**answer, "ranking": [{"causes": ["none"], "probability": 0.9}]}, 1.5

    def least_error(self, recorded: Recorded, folder: Path) -> float:
        return 0.25


@pytest.fixture
def flights(monkeypatch: pytest.MonkeyPatch) -> Flights:
    stand_in = Flights()
    monkeypatch.setattr(fly, "fly", stand_in.fly)
    monkeypatch.setattr(fly, "diagnose", stand_in.diagnose)
    monkeypatch.setattr(fly, "least_error", stand_in.least_error)
    return stand_in


def test_what_is_finished_is_not_flown_again(tmp_path, flights):
    draws = [draw(i) for i in range(5)]
    flights.fails_at = 3
    with pytest.raises(KeyboardInterrupt):
        list(campaign.run(draws, tmp_path))
    assert flights.flown == [0, 1, 2]
    flights.fails_at = None
    results = list(campaign.run(draws, tmp_path))
    assert flights.flown == [0, 1, 2, 3, 4]
    assert [result.departed for result in results] == [False, False, True, False, False]
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".json"] * 5
    list(campaign.run(draws[:1], tmp_path, again=True))
    assert flights.flown == [0, 1, 2, 3, 4, 0]


def test_the_file_that_knows_everything_is_asked_only_when_told_to(tmp_path, flights):
    draws = [draw(0)]
    (without,) = campaign.run(draws, tmp_path)
    (result,) = campaign.run(draws, tmp_path, again=True, bound=True)
    assert (without.least_error, result.least_error) == (None, 0.25)
    assert result.error == 0.5


def test_every_cause_is_compared_with_the_file_that_knows_all_when_asked(tmp_path, flights, capsys):
    """`--bound` was dropped with `--every`, and nothing told of what it asks for."""
    assert campaign.main(["--every", "--bound", "--out", str(tmp_path)]) == 0
    held = [json.loads(path.read_text(encoding="utf-8")) for path in tmp_path.iterdir()]
    assert {each["least_error"] for each in held if not each["departed"]} == {0.25}
    assert "What was hidden and what was said" in capsys.readouterr().out


def test_the_dozen_fails_where_a_flight_is_answered_wrong(tmp_path, flights, capsys):
    assert campaign.main(["--dozen", "--out", str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert "missed: draw 3: wrong" in said
    assert "missed: draw 2: lost control" in said
    assert "missed: draw 0" not in said


def test_tables_of_other_flights_have_other_names():
    """A campaign's tables took the place of the dozen's, and of each other's."""
    parse = campaign._parser().parse_args
    asked = ("--dozen", "--every", "--count 8", "--count 8 --start 8", "--count 8 --cause none")
    asked += ("--count 8 --short", "--count 8 --seed 3", "--dozen --seed 3", "--every --seed 3")
    names = [campaign.which(parse(words.split())).suffix for words in asked]
    assert len(set(names)) == len(asked)
    assert names[0] == ""
    assert names[2] == "_draws_0_to_7"


def test_the_file_keeps_what_was_drawn_and_said(tmp_path, flights):
    (result,) = campaign.run([draw(0)], tmp_path)
    held = json.loads((tmp_path / f"{campaign.name(draw(0))}.json").read_text(encoding="utf-8"))
    assert held["draw"]["seed"] == draw(0).seed
    assert held["diagnosis"]["verdict"] == "no_effect"
    assert "large" not in held["diagnosis"]
    assert result.seconds == 1.5


def test_a_file_of_another_draw_is_not_taken_for_this_one(tmp_path, flights):
    list(campaign.run([draw(0)], tmp_path))
    other = draw(0, seed=1, fixed=Fixed(draw(0).cause, draw(0).aircraft, draw(0).file))
    path = tmp_path / f"{campaign.name(draw(0))}.json"
    path.rename(tmp_path / f"{campaign.name(other)}.json")
    list(campaign.run([other], tmp_path))
    assert flights.flown == [0, 0]


def test_every_cause_is_flown_once_and_no_aircraft_is_left_out():
    assert [each.cause for each in campaign.EVERY] == list(CAUSES)
    assert {each.aircraft for each in campaign.EVERY} == set(AIRCRAFT)


def test_the_dozen_are_a_dozen_of_all_kinds():
    draws = [draw(i, fixed=fixed) for i, fixed in enumerate(campaign.DOZEN)]
    assert len({campaign.name(one) for one in draws}) == 12
    assert {"none", "unlisted", "two"} < {one.cause for one in draws}
    assert len({one.aircraft for one in draws}) == 4


def test_intervals_of_shares_are_exact():
    """Against published values: 0 and 2 of 100, and the coverage that makes them exact."""
    assert tables.clopper_pearson(0, 100) == pytest.approx((0.0, 0.0362), abs=1e-4)
    assert tables.clopper_pearson(2, 100) == pytest.approx((0.0024, 0.0704), abs=1e-4)
    assert tables.clopper_pearson(5, 5)[1] == 1.0


def test_stated_probabilities_that_come_true_as_often_are_calibrated():
    generator = np.random.default_rng(0)
    stated = generator.uniform(0.3, 1.0, 20000)
    true = (generator.uniform(size=20000) < stated).tolist()
    assert tables.calibration_error(stated.tolist(), true) < 0.01
    assert tables.calibration_error([0.95] * 10, [True] * 5 + [False] * 5) == pytest.approx(0.45)
    assert tables.calibration_error([1.0, 0.0], [True, False]) == 0.0


def test_the_tables_say_what_was_found(capsys):
    clean = {"verdict": "no_effect", "ranking": [{"causes": ["none"], "probability": 0.9}]}
    size = {"mass_ratio": {"value": 1.12, "sd": 0.5, "unit": "1"}}
    accused = {
        "verdict": "effect",
        "effects": ["mass"],
        "ranking": [{"causes": ["mass"], "probability": 0.99, "parameters": size}],
        "detectable": {"mass": {"mass_ratio": {"named_from": 0.08}}},
    }
    answers = (("none", clean), ("none", accused), ("mass", accused), ("mass", clean))
    results = []
    for index, (cause, diagnosis) in enumerate(answers):
        one = draw(index, fixed=Fixed(cause, "aerosonde", "exact", "larger"))
        results.append(Result(one, score(one, diagnosis), 10.0, 2, departed=False))
    lost = Result(results[2].draw, results[2].score, 0.0, 2, departed=True)
    results[2] = replace(results[2], error=2.1, least_error=2.0)
    tables.summary([*results, lost])
    printed = capsys.readouterr().out
    assert "1 flights lost control" in printed
    for line in (
        "mass    2        50 % (1-99)      50 % (1-99)    none 1",
        "none    2        50 % (1-99)      50 % (1-99)    mass 1",
        "exact  2        50 % (1-99)   50 % (1-99)",
        "one cause  larger  exact  2        50 % (1-99)      50 % (1-99)",
        "1.4 to 2                         1        100 % (3-100)    100 % (3-100)",
        "0.900                    2        0.500",
        "mass    1      100 % (3-100)",
        "mass    1        1.05    100 % (3-100)",
    ):
        assert line in printed
    tables.one_by_one(results)
    assert "FALSE ALARM" in capsys.readouterr().out
    tables.right([*results, lost])
    printed = capsys.readouterr().out
    for line in (
        "something hidden, named alone         1 of 2",
        "so, or in a group of three at most    1 of 2",
        "nothing hidden, nobody accused        1 of 2",
        "sizes that their 95 % intervals hold  1 of 1",
        "seconds, median, cores: 2             10",
    ):
        assert line in printed
    assert tables.missed(results[:1]) == ()
    assert tables.missed(results[:2]) == ("draw 1: FALSE ALARM",)
    far = replace(results[2].score, sizes=(Sized("mass_ratio", 4.0, 1.0),) * 3)
    (missing,) = tables.missed([replace(results[2], score=far)])
    assert missing == "0 of 3 sizes are inside their 95 % intervals"
