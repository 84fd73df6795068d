"""Draws: reproducible, balanced, as large as they say, and flyable as files and scenarios."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.sitl import scenario
from gcs_sysid.sitl.effects import catalogue
from gcs_sysid.sitl.slopes import trim
from gcs_sysid.sitl.terms import slope
from tests.blind import fly, plans
from tests.blind.draw import AIRCRAFT, Fixed, draw, load
from tests.blind.sizes import CAUSES, depends_on, hidden, sizes

ROUND = len(CAUSES) + 20


def test_the_catalogue_is_drawn_from_as_a_whole():
    assert {*CAUSES, "unlisted"} == set(catalogue.EFFECTS)


def test_the_same_number_is_the_same_flight_and_another_one_is_not():
    assert draw(5) == draw(5)
    assert draw(5, seed=1) != draw(5)
    assert len({draw(i).seed for i in range(60)}) == 60


def test_every_round_hides_each_cause_once():
    for start in (0, ROUND):
        drawn = Counter(draw(i).cause for i in range(start, start + ROUND))
        assert drawn == Counter({**dict.fromkeys(CAUSES, 1), "none": 10, "unlisted": 4, "two": 6})


def test_all_the_rest_is_drawn_at_random():
    draws = [draw(i) for i in range(400)]
    assert Counter(one.file for one in draws)["exact"] == pytest.approx(200, abs=40)
    assert Counter(one.size for one in draws)["larger"] == pytest.approx(160, abs=40)
    for name in AIRCRAFT:
        assert Counter(one.aircraft for one in draws)[name] == pytest.approx(100, abs=35)
    assert {one.plan for one in draws if one.cause == "none"} == set(plans.PLANS)
    assert all(0.03 <= one.gust <= 0.06 for one in draws)


def test_fixing_one_thing_changes_no_other():
    for i in range(20):
        free = draw(i)
        fixed = draw(i, fixed=Fixed(file="five_percent"))
        assert replace(free, file="five_percent") == fixed


@pytest.mark.parametrize("cause", [one for one in CAUSES if one != "actuator_rate_limit"])
def test_sizes_lie_between_the_smaller_and_the_larger(cause):
    aircraft = load("aerosonde")
    options = {size.parameter: size for size in sizes(cause, aircraft)}
    generator = np.random.default_rng(3)
    for _ in range(50):
        entry, share = hidden(cause, None, aircraft, generator)
        ((name, size),) = ((key, options[key]) for key in entry if key in options)
        assert size.least - 1e-12 <= share <= 1.0
        assert abs(entry[name] - size.nominal) == pytest.approx(share * size.larger)


def test_both_signs_are_drawn_where_both_make_sense():
    aircraft, generator = load("aerosonde"), np.random.default_rng(4)
    ratios = [hidden("mass", 1.0, aircraft, generator)[0]["mass_ratio"] for _ in range(30)]
    assert set(np.round(ratios, 3)) == {0.88, 1.12}


@pytest.mark.parametrize("name", AIRCRAFT)
def test_a_shift_aft_leaves_every_aircraft_stable(name):
    aircraft, generator = load(name), np.random.default_rng(5)
    for _ in range(20):
        forward = hidden("cg_shift", 1.0, aircraft, generator)[0]["cg_x_chord"]
        assert abs(forward) == pytest.approx(0.12)
        assert slope(aircraft, "Cm", "alpha") + forward * slope(aircraft, "CZ", "alpha") < 0.0


@pytest.mark.parametrize("name", ["aerosonde", "skywalker_x8"])
@pytest.mark.parametrize("cause", [*CAUSES, "none", "unlisted", "two"])
def test_every_cause_can_be_hidden_in_an_aircraft_with_and_without_rudder(tmp_path, cause, name):
    one = draw(8, fixed=Fixed(cause, name, "five_percent", "larger"))
    true, generator = fly.equipped(one), np.random.default_rng(1)
    aircraft_file.save(fly.believed(true, one.file, generator), tmp_path / "aircraft.toml")
    (tmp_path / "scenario.toml").write_text(fly.scenario(one, true, generator), encoding="utf-8")
    loaded = scenario.load(tmp_path / "scenario.toml")
    (planned,) = loaded.flights
    assert planned.told["effects"] == [
        {"name": entry["name"], "parameters": {k: v for k, v in entry.items() if k != "name"}}
        for entry in one.effects
    ]
    assert planned.flight.duration == pytest.approx(240.0)
    assert slope(loaded.flown, "Cl", "phat") == slope(load(name), "Cl", "phat")


@pytest.mark.parametrize("name", AIRCRAFT)
def test_an_unlisted_effect_is_named_by_what_it_depends_on(name):
    generator = np.random.default_rng(6)
    for _ in range(20):
        entry, _ = hidden("unlisted", 1.0, load(name), generator)
        coefficient, variables = depends_on(entry)
        (term,) = entry["terms"][coefficient]
        assert set(variables) == set(term.replace("^2", "").split("*"))
        assert "rudder" not in variables or name != "skywalker_x8"


@pytest.mark.parametrize("name", AIRCRAFT)
def test_slow_flight_is_a_gust_away_from_the_stall_that_is_hidden(name):
    aircraft = load(name)
    slow = min(leg.airspeed for leg in plans.legs(aircraft, "slow"))
    assert 0.0 < plans.STALL - trim(aircraft, slow).alpha < math.radians(1.5)


@pytest.mark.parametrize("name", AIRCRAFT)
def test_low_passes_are_below_half_a_span_and_the_other_plans_above_the_trees(name):
    aircraft = load(name)
    heights = [leg.height for leg in plans.legs(aircraft, "low")]
    assert sum(height < 0.5 * aircraft.geometry.wing_span for height in heights) == 6
    for plan in ("usual", "climbs", "slow"):
        assert min(leg.height for leg in plans.legs(aircraft, plan)) > 60.0
    assert sum(leg.duration for leg in plans.legs(aircraft, "usual", short=True)) == 90.0


def test_a_wrong_file_is_five_percent_wrong_and_says_so():
    true = load("aerosonde")
    errors, generator = [], np.random.default_rng(2)
    for _ in range(10):
        file = fly.believed(true, "five_percent", generator)
        for name, model in true.aerodynamics.items():
            for key, term in model.terms.items():
                held = file.aerodynamics[name].terms[key]
                assert held.sigma == pytest.approx(0.05 * abs(held.value))
                errors.append(held.value / term.value - 1.0)
    assert np.std(errors) == pytest.approx(0.05, rel=0.15)
    exact = fly.believed(true, "exact", generator)
    assert slope(exact, "Cm", "alpha") == slope(true, "Cm", "alpha")
