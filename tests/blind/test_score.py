"""Scores of made-up diagnoses whose worth is plain."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from tests.blind.draw import Draw, Fixed, draw
from tests.blind.score import score


def hides(*effects: dict[str, Any], cause: str | None = None) -> Draw:
    named = cause or ("none" if not effects else effects[0]["name"])
    return replace(draw(0, fixed=Fixed("none", "aerosonde")), cause=named, effects=effects)


MASS = {"name": "mass", "mass_ratio": 1.12}
SHIFT = {"name": "cg_shift", "cg_x_chord": -0.1}
LAG = {"name": "actuator_lag", "control": "elevator", "time_constant": 0.2}


def entry(*causes: str, probability: float = 0.97, **parameters: dict[str, Any]) -> dict[str, Any]:
    return {
        "causes": list(causes) or ["none"],
        "probability": probability,
        "log_bayes_factor": 10.0,
        "parameters": parameters,
    }


def says(verdict: str, *named: str, ranking: list[dict[str, Any]], **more: Any) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "cause": named[0] if named else "none",
        "effects": list(named),
        "indistinguishable": list(named),
        "ranking": ranking,
        **more,
    }


def found(value: float, sd: float, **about: str) -> dict[str, Any]:
    return {"value": value, "sd": sd, "unit": "1", **about}


def test_the_cause_alone_with_its_size():
    given = score(
        hides(MASS), says("effect", "mass", ranking=[entry("mass", mass_ratio=found(1.11, 0.01))])
    )
    assert given.alone
    assert given.grouped
    assert given.first
    assert not given.false_alarm
    assert (given.said, given.probability) == ("mass", 0.97)
    (size,) = given.sizes
    assert size.deviations == pytest.approx(-1.0)
    assert size.relative == pytest.approx(-0.01 / 0.12)
    assert size.inside


def test_a_size_outside_of_its_interval():
    given = score(
        hides(SHIFT),
        says("effect", "cg_shift", ranking=[entry("cg_shift", cg_x_chord=found(-0.079, 0.01))]),
    )
    assert given.alone
    assert [size.inside for size in given.sizes] == [False]


def test_another_cause_is_wrong_and_no_false_alarm():
    given = score(hides(MASS), says("effect", "cg_shift", ranking=[entry("cg_shift")]))
    assert not given.alone
    assert not given.grouped
    assert not given.first
    assert not given.false_alarm
    assert given.said == "cg_shift"


def test_the_cause_with_another_one_beside_it_is_not_alone():
    diagnosis = says("effect", "mass", "cg_shift", ranking=[entry("mass", "cg_shift")])
    given = score(hides(MASS), diagnosis)
    assert not given.alone
    assert not given.grouped
    assert given.said == "cg_shift + mass"


@pytest.mark.parametrize(
    ("group", "right"),
    [
        (("mass", "thrust_scale"), True),
        (("mass", "thrust_scale", "cg_shift"), True),
        (("mass", "thrust_scale", "cg_shift", "inertia"), False),
        (("thrust_scale", "cg_shift"), False),
    ],
)
def test_a_group_holds_the_cause_and_no_more_than_two_others(group, right):
    ranking = [entry("thrust_scale", probability=0.5), entry("mass", probability=0.4)]
    given = score(hides(MASS), says("ambiguous", *group, ranking=ranking))
    assert not given.alone
    assert given.grouped == right
    assert given.said == " or ".join(sorted(group))
    assert not given.first


def test_the_wrong_control_is_wrong():
    about = [entry("actuator_lag", time_constant=found(0.2, 0.01, control="aileron"))]
    assert not score(hides(LAG), says("effect", "actuator_lag", ranking=about)).alone
    about = [entry("actuator_lag", time_constant=found(0.2, 0.01, control="elevator"))]
    given = score(hides(LAG), says("effect", "actuator_lag", ranking=about))
    assert given.alone
    assert given.sizes[0].inside


def test_a_control_by_the_same_servos_is_the_right_one():
    told = {**found(0.2, 0.01, control="aileron"), "same_servos": ["elevator"]}
    about = [entry("actuator_lag", time_constant=told)]
    given = score(hides(LAG), says("effect", "actuator_lag", ranking=about))
    assert given.alone
    assert given.sizes[0].inside


def test_of_two_controls_the_size_is_that_of_the_one_hidden():
    parameters = {
        "time_constant": found(0.5, 0.01, control="aileron"),
        "time_constant elevator": found(0.2, 0.01, control="elevator"),
    }
    ranked = {**entry("actuator_lag"), "parameters": parameters}
    given = score(hides(LAG), says("effect", "actuator_lag", ranking=[ranked]))
    assert given.sizes[0].deviations == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("verdict", "named", "alone", "false"),
    [
        ("no_effect", (), True, False),
        ("insufficient_data", (), False, False),
        ("effect", ("mass",), False, True),
        ("ambiguous", ("mass", "cg_shift"), False, True),
        ("ambiguous", ("none", "cg_shift"), False, False),
        ("unlisted_effect", ("unlisted",), False, True),
    ],
)
def test_nothing_hidden(verdict, named, alone, false):
    given = score(hides(), says(verdict, *named, ranking=[entry()]))
    assert (given.alone, given.false_alarm) == (alone, false)
    assert given.first


TERM = {"name": "unlisted", "terms": {"Cn": {"rudder*qhat": 40.0}}}


@pytest.mark.parametrize(
    ("coefficient", "variables", "right"),
    [
        ("Cn", ["qhat", "rudder"], True),
        ("Cn", ["rudder", "qhat", "beta"], True),
        ("Cn", ["rudder", "qhat", "beta", "phat"], False),
        ("Cn", ["rudder"], False),
        ("Cl", ["qhat", "rudder"], False),
    ],
)
def test_an_unlisted_effect_is_found_by_coefficient_and_variables(coefficient, variables, right):
    diagnosis = says(
        "unlisted_effect",
        "unlisted",
        ranking=[entry("unlisted")],
        unlisted={"coefficient": coefficient, "depends_on": variables},
    )
    given = score(hides(TERM), diagnosis)
    assert given.alone == right
    assert given.first
    assert given.said == "unlisted"


def test_both_of_two_must_be_found():
    both = hides(MASS, SHIFT, cause="two")
    ranked = entry("cg_shift", "mass", mass_ratio=found(1.12, 0.01), cg_x_chord=found(-0.13, 0.01))
    given = score(both, says("effect", "cg_shift", "mass", ranking=[ranked]))
    assert given.alone
    assert [size.inside for size in given.sizes] == [True, False]
    assert not score(both, says("effect", "mass", ranking=[entry("mass")])).alone


def test_a_command_that_failed_is_wrong_and_counts():
    given = score(hides(MASS), {"verdict": "failed", "message": "no such file"})
    assert not given.alone
    assert not given.grouped
    assert not given.first
    assert (given.said, given.probability) == ("failed", None)


def test_a_size_is_held_against_the_one_that_the_flight_would_show():
    """Of what the cause is about, and by the parameter that shows most."""
    told = says("no_effect", ranking=[entry()])
    assert score(hides(LAG), told).shown is None
    lag = {"time_constant": {"sd": 0.01, "named_from": 0.05}}
    told["detectable"] = {
        "actuator_lag elevator": lag,
        "actuator_lag rudder": {"time_constant": {"sd": 0.01, "named_from": 0.5}},
        "mass": {"mass_ratio": {"sd": 0.01, "named_from": 0.08}},
        "cg_shift": {"cg_x_chord": {"sd": 0.01, "named_from": None}},
        "inertia": {f"I{axis}_ratio": {"named_from": 0.2} for axis in ("xx", "yy")},
    }
    assert score(hides(LAG), told).shown == pytest.approx(4.0)
    assert score(hides(MASS), told).shown == pytest.approx(1.5)
    assert score(hides(SHIFT), told).shown == 0.0
    two = {"name": "inertia", "Ixx_ratio": 1.1, "Iyy_ratio": 0.7}
    assert score(hides(two), told).shown == pytest.approx(1.5)
    assert score(hides(MASS, SHIFT, cause="two"), told).shown is None
