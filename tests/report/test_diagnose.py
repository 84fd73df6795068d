"""What the first lines of a diagnosis report say of the gain."""

from __future__ import annotations

from typing import Any

import pytest

from gcs_sysid.report import diagnose


def summary(channels: dict[str, Any]) -> dict[str, Any]:
    width = {"width": {"value": 0.034, "sd": 0.001, "unit": "rad"}}
    best = {"causes": ["actuator_backlash"], "label": "actuator_backlash elevator",
            "probability": 0.94, "log_bayes_factor": 50.0, "parameters": width}  # fmt: skip
    return {
        "verdict": "effect",
        "cause": "actuator_backlash",
        "probability": 0.94,
        "explanation": ["the elevator has play"],
        "ranking": [best, {**best, "probability": 0.02}],
        "separating_maneuver": None,
        "indistinguishable": ["actuator_backlash"],
        "warnings": [],
        "detectable": {},
        "gain": {
            "holdout_error_before": 22.8,
            "holdout_error_after": 19.4,
            "holdout_nlpd_before": 0.0,
            "holdout_nlpd_after": -0.1,
            "free_run": {"windows": 20, "length_s": 3.0, "channels": channels},
        },
    }


def gain(channels: dict[str, Any]) -> str:
    found = diagnose.findings(summary(channels))
    return next(item.text for item in found if item.topic == "Gain")


def channel(before: float, after: float, sd: float) -> dict[str, Any]:
    return {"before": before, "after": after, "gained": before - after, "gained_sd": sd,
            "unit": "rad/s"}  # fmt: skip


def test_the_channel_that_gains_most_in_free_flight_is_told() -> None:
    text = gain({"q": channel(0.04, 0.006, 0.001), "p": channel(0.009, 0.005, 0.001)})
    assert "flown freely for 3 s it is off by 0.344 deg/s in q, by 2.29 before" in text


def test_a_gain_in_free_flight_that_is_not_sure_is_not_told() -> None:
    assert "freely" not in gain({"q": channel(0.04, 0.006, 0.02), "p": channel(0.005, 0.009, 0.0)})
    assert "freely" not in gain({})


def test_rivals_are_told_that_are_not_all_but_impossible() -> None:
    told = summary({})
    near = [{**told["ranking"][0], "label": one, "probability": share}
            for one, share in (("mass", 0.04), ("inertia", 0.0004))]  # fmt: skip
    first = told["ranking"][0]

    def said(*others: dict[str, Any]) -> str:
        found = diagnose.findings({**told, "ranking": [first, *others]})
        return next(item.text for item in found if item.topic == "Rivals")

    assert said(*near) == "mass 4 %."
    assert said(near[1]) == said() == "no other explanation is above 0.1 %."


def test_the_gain_of_coefficients_has_an_interval() -> None:
    told = summary({})
    told["gain"]["holdout_error_gained_sd"] = 0.5
    text = next(item.text for item in diagnose.findings(told) if item.topic == "Gain")
    assert "a gain of 3.40 ± 0.98 % (± 95 %)" in text


def test_a_term_that_no_cause_stands_for_has_a_size_and_a_gain_too() -> None:
    told = summary({}) | {"verdict": "unlisted_effect", "cause": "unlisted", "explanation": []}
    told["unlisted"] = {"coefficient": "Cn", "depends_on": ["alpha", "aileron"]}
    size = {"value": 0.342, "sd": 0.01, "unit": "1"}
    told["ranking"][0] = {
        "causes": ["unlisted"],
        "label": "unlisted",
        "probability": 1.0,
        "log_bayes_factor": 500.0,
        "parameters": {"Cn.alpha*aileron": size},
    }
    found = {item.topic: item.text for item in diagnose.findings(told)}
    assert "0.342 ± 0.020" in found["Size"]
    assert "22.8 % before, 19.4 % after" in found["Gain"]


def test_what_to_fly_is_said_of_causes_that_would_not_have_shown() -> None:
    """The nearest to being seen first; those that were seen are no reason to fly again."""
    told = summary({}) | {
        "detectable": {
            # Seen well, and named only from beyond what matters, by what the file states of it.
            "mass": {"mass_ratio": {"sd": 0.01, "matters": 0.06, "unit": "1", "named_from": 0.07}},
            "pitot_lag": {"pitot_lag": {"sd": 0.5, "matters": 0.1, "unit": "s"}},
            "surface_effectiveness rudder": {"ratio": {"sd": 0.1, "matters": 0.2, "unit": "1"}},
            "wind_shear": {"gradient": {"sd": 9.0, "matters": 0.05, "unit": "1/s"}},
        }
    }
    next_one = {item.topic: item.text for item in diagnose.findings(told)}["Fly next"]
    assert next_one.startswith("For surface_effectiveness rudder: short pulses on each control")
    assert "; for pitot_lag: throttle steps" in next_one
    assert next_one.endswith("(this flight would not have shown it).")
    assert "mass" not in next_one
    assert "wind_shear" not in next_one
    doubted = told | {"perhaps": {"mass": 0.3}}
    next_one = {item.topic: item.text for item in diagnose.findings(doubted)}["Fly next"]
    assert next_one.startswith("For mass: load-factor turns")
    size = {"mass_ratio": {"value": 1.072, "sd": 0.02, "unit": "1"}}
    sized = doubted | {"perhaps_parameters": {"mass": size}}
    for one, words in (
        (doubted, "mass 30 %."),
        (sized, "mass 30 % (mass_ratio 1.072 ± 0.039) (sizes ± 95 %)."),
    ):
        assert words in {item.topic: item.text for item in diagnose.findings(one)}["Perhaps"]
    assert "would not have shown" not in next_one
    silent = told | {"verdict": "insufficient_data", "explanation": [], "strained": {}}
    next_one = {item.topic: item.text for item in diagnose.findings(silent)}["Fly next"]
    assert next_one.startswith("For actuator_backlash: slow triangles")
    faint = [NOTHING, NOTHING]
    next_one = {item.topic: item.text for item in diagnose.findings(silent | {"ranking": faint})}
    assert next_one["Fly next"].startswith("For surface_effectiveness rudder")
    quiet = told | {"verdict": "no_effect", "explanation": []}
    assert "Fly next" not in {item.topic for item in diagnose.findings(quiet)}
    assert "Fly next" not in {item.topic for item in diagnose.findings(summary({}))}


def test_the_verdict_says_what_each_cause_is_about() -> None:
    """Of several causes it had been said behind the last: "… and inertia (elevator)"."""
    told = summary({})
    told["ranking"][0]["label"] = "actuator_lag elevator and inertia"
    found = {item.topic: item.text for item in diagnose.findings(told)}
    assert found["Verdict"].startswith("actuator_lag elevator and inertia, probability")


def test_what_a_flight_could_show_is_said_with_what_is_like_it() -> None:
    entry = {"sd": 0.01, "matters": 0.06, "unit": "1", "named_from": 0.072, "alone_from": None,
             "rival": "cg_shift"}  # fmt: skip
    lag = {"sd": 9.0, "matters": 0.1, "unit": "s", "named_from": None, "alone_from": None,
           "rival": None}  # fmt: skip
    told = {"detectable": {"mass": {"mass_ratio": entry}, "pitot_lag": {"pitot_lag": lag}}}
    mass, pitot = diagnose._detectable(told).rows
    assert mass[-3:] == ("0.072", "no", "any size (cg_shift)")
    assert pitot[-3:] == ("no size", "no", "")


def test_coefficients_are_told_for_what_took_no_part_where_that_is_known() -> None:
    told = {**summary({}), "discrepancy": {"Cm": {"before": 0.31, "after": 0.05}}}
    plain = diagnose._coefficients(told)
    assert plain.head == ("", "all, before", "after")
    assert plain.rows == (("Cm", "31.0", "5.00"),)
    told["gain"]["channels"] = {"Cm": {"before": 30.0, "after": 6.0, "gained": 24.0,
                                       "gained_sd": 1.0}}  # fmt: skip
    judged = diagnose._coefficients(told)
    assert judged.head[1:4] == ("held out, before", "after", "gained")
    assert judged.rows[0][:4] == ("Cm", "30.0", "6.00", "24.0 ± 2.0")
    assert len(judged.rows[0]) == len(judged.head)


NOTHING = {"causes": ["none"], "label": "nothing", "probability": 0.3, "log_bayes_factor": 0.0,
           "parameters": {}}  # fmt: skip


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"followed": False, "stands_out": []}, "cannot follow this simulation"),
        ({"strained": {}}, "actuator_backlash elevator fits best, but what took no part"),
        ({"ranking": [NOTHING] * 2, "strained": {"Cm.alpha": 4.0}}, "had to go farther"),
        ({"ranking": [NOTHING] * 2, "strained": {}}, "no cause is sure enough"),
    ],
)
def test_why_a_flight_cannot_tell_is_said(changed: dict[str, Any], why: str) -> None:
    silent = {"verdict": "insufficient_data", "cause": "none", "explanation": []}
    found = diagnose.findings({**summary({}), **silent, **changed})
    assert why in found[0].text
    assert found[0].text.startswith("this flight cannot tell: ")


def test_what_stood_out_is_told_where_no_cause_has_a_measure() -> None:
    late = {"parameter": "sensors.surface_delay", "label": "the surface delay", "off": 0.0337,
            "ordinary": 0.01, "unit": "s"}  # fmt: skip
    refused = {"verdict": "insufficient_data", "cause": "none", "explanation": [],
               "followed": False, "stands_out": [late]}  # fmt: skip
    told = {**summary({}), **refused}
    topics = {item.topic: item.text for item in diagnose.findings(told)}
    assert topics["Look at"].startswith("the surface delay +33.7 ms: farther off than is ordinary")
    assert "Rivals" not in topics
    (section,) = diagnose._explanations(told)
    assert section.heading == "Where to look first"
    assert section.tables[0].rows == (("the surface delay", "+33.7 ms", "10 ms"),)
    assert diagnose._could(told) == diagnose._gains(told) == ()
    assert diagnose._explanations({**told, "stands_out": []}) == ()


@pytest.mark.parametrize(
    ("nats", "said"),
    [
        (0.6931, "2.0 times less probable"),
        (8.0, "2981 times less probable"),
        (11.5, "10⁵ times less probable"),
        (2000.0, "10⁸⁶⁹ times less probable"),
    ],
)
def test_how_much_less_probable_needs_no_logarithm(nats: float, said: str) -> None:
    assert diagnose._times(nats) == said


@pytest.mark.parametrize(
    ("names", "sure", "said"),
    [
        (["mass", "cg_shift"], [], "mass or cg_shift: this flight cannot tell them apart."),
        (
            ["mass", "stall", "propwash"],
            ["mass"],
            "mass, and beside it stall or propwash: which, this flight cannot tell.",
        ),
        # Of two controls, one of them sure: no more can be said by names alone.
        (
            ["surface_effectiveness"],
            ["surface_effectiveness"],
            "surface_effectiveness: this flight cannot tell them apart.",
        ),
    ],
)
def test_of_a_group_is_said_what_is_sure(names: list[str], sure: list[str], said: str) -> None:
    group = {"verdict": "ambiguous", "indistinguishable": names, "sure": sure}
    found = diagnose.findings({**summary({}), **group})
    assert next(item.text for item in found if item.topic == "Verdict") == said


def test_what_was_not_asked_about_is_said() -> None:
    told = {"detectable": {}, "not_asked": {"wind_shear": "climbs in a wind"}}
    (section,) = diagnose._could(told)
    assert "wind_shear (climbs in a wind)" in section.lead
    (section,) = diagnose._could({"detectable": {}})
    assert "Not asked" not in section.lead
