"""Flights of a minute and a half in gusts without vanes, diagnosed as a user would.

One has nothing hidden, the others what such a flight tells: a sensor, the engine, a control. `make
blind` flies a dozen of four minutes, `make campaign` hundreds.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from gcs_sysid import aircraft_file
from tests.blind import fly
from tests.blind.draw import Draw, Fixed, draw
from tests.blind.score import Score, score

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]


def diagnosed(
    number: int, cause: str, folder: Path, aircraft: str = "aerosonde", file: str = "exact"
) -> tuple[Draw, dict[str, Any], Score]:
    drawn = draw(number, fixed=Fixed(cause, aircraft, file, "larger", short=True))
    flown = fly.fly(drawn, folder)
    assert not flown.departed
    found, _ = fly.diagnose(flown, folder / "out")
    assert sum(one["probability"] for one in found["ranking"]) <= 1.0 + 1e-9
    assert (folder / "out" / "report.html").stat().st_size > 1e5
    return drawn, found, score(drawn, found)


def test_where_nothing_is_hidden_nobody_is_accused(tmp_path: Path) -> None:
    _, found, worth = diagnosed(900, "none", tmp_path)
    assert found["verdict"] == "no_effect"
    assert not worth.false_alarm
    assert found["effects"] == []


def test_who_did_it_is_named_with_its_size_and_put_right(tmp_path: Path) -> None:
    drawn, found, worth = diagnosed(901, "airspeed_scale", tmp_path)
    assert worth.alone, worth.said
    assert found["effects"] == found["indistinguishable"] == ["airspeed_scale"]
    estimate = found["ranking"][0]["parameters"]["airspeed_scale"]
    (effect,) = drawn.effects
    assert abs(estimate["value"] - effect["airspeed_scale"]) < 3.0 * estimate["sd"]
    assert estimate["sd"] < 0.01
    assert found["gain"]["holdout_nlpd_after"] < found["gain"]["holdout_nlpd_before"]
    free = found["gain"]["free_run"]
    assert free["windows"] > 5
    # The aircraft flies as before: only what is shown of it was wrong.
    assert all(each["gained"] == pytest.approx(0.0) for each in free["channels"].values())
    extended = aircraft_file.load(tmp_path / "out" / "aircraft-extended.toml")
    assert extended.pitot.error.scale[0] == pytest.approx(estimate["value"])


def test_an_engine_that_is_weaker_than_the_file_thinks_possible_is_named(tmp_path: Path) -> None:
    """Two of the file's own deviations off: what matters is a finding, however unsure the file."""
    drawn, found, worth = diagnosed(903, "thrust_scale", tmp_path, "brumby_mk3")
    assert worth.alone, worth.said
    estimate = found["ranking"][0]["parameters"]["ratio"]
    (effect,) = drawn.effects
    assert abs(estimate["value"] - effect["ratio"]) < 3.0 * estimate["sd"]
    assert estimate["sd"] < 0.05
    gain = found["gain"]
    assert gain["holdout_error_before"] - gain["holdout_error_after"] > 0.0


def test_a_weak_aileron_is_told_in_strong_gusts_with_a_file_that_is_wrong(tmp_path: Path) -> None:
    """Gusts of 6 % of the airspeed, rms: gains make up for most of what such a control lacks.

    In so short a flight it may be told together with one that bends, which is a weak one where the
    dynamic pressure hardly changes.
    """
    drawn, found, worth = diagnosed(
        902, "surface_effectiveness", tmp_path, "ultra_stick_25e", "five_percent"
    )
    assert worth.grouped, worth.said
    assert worth.first, worth.said
    assert found["ranking"][0]["causes"] == ["surface_effectiveness"]
    estimate = found["ranking"][0]["parameters"]["ratio"]
    (effect,) = drawn.effects
    assert abs(estimate["value"] - effect["ratio"]) < 3.0 * estimate["sd"]
    assert estimate["sd"] < 0.05
    # All else is as wrong as the file says.
    assert 0.25 < found["file_accuracy"] < 4.0
    assert found["gain"]["holdout_error_after"] < found["gain"]["holdout_error_before"]
