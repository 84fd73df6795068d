"""What a diagnosis says beside its verdict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Posterior
from gcs_sysid.diagnose.hypothesis import Estimate, Ranked
from gcs_sysid.diagnose.verdict import INCREDIBLE, Verdict
from gcs_sysid.offline import diagnosis_entries as entries
from tests.maneuvers.made_model import aircraft


def one(cause: str, about: str = "", **off: tuple[float, float]) -> tuple[Candidate, tuple]:
    """A cause with its parameters: nominal value, and what was found in deviations beside it."""
    estimates = (
        Estimate(name, nominal + 0.1 * deviations, 0.1, "1", nominal)
        for name, (nominal, deviations) in off.items()
    )
    return Candidate(CAUSES[cause], about), tuple(estimates)


SHIFT = one("cg_shift", cg_x_chord=(0.0, 4.0))
SLOPE = one("aero_derivative", "Cm.alpha", ratio=(1.0, 4.0))
INERTIA = one("inertia", Ixx_ratio=(1.0, 0.2), Iyy_ratio=(1.0, -3.0), Izz_ratio=(1.0, 2.0))
BIAS = one("accelerometer_bias", bias_x=(0.0, 5.0), bias_y=(0.0, 1.0), bias_z=(0.0, -2.0))
STALL = one("stall", alpha_break=(0.0, 1.0), slope_loss=(0.0, 3.0))
LATE = one("time_skew", "SERVO_OUTPUT_RAW", delay=(0.0, 3.0))


def verdict(answer: str, *sets: tuple) -> Verdict:
    ranked = tuple(
        Ranked(
            tuple(each for each, _ in causes),
            *(0.1, 0.3, 5.0),
            tuple(found for _, found in causes),
            Posterior(np.zeros(1), np.eye(1), 0.0),
        )
        for causes in sets
    )
    return Verdict(answer, ranked[0], ranked, ranked, {})


def test_what_is_perhaps_at_work_has_its_size() -> None:
    told = verdict("effect", (SHIFT,))
    lag, late = one("actuator_lag", "rudder", time_constant=(0.0, 3.0)), LATE
    told = replace(
        told, perhaps={lag[0]: 0.6, late[0]: 0.3}, sizes={lag[0]: lag[1], late[0]: late[1]}
    )
    found = entries.verdict(told, aircraft(), None)
    assert found["perhaps"] == {"actuator_lag rudder": 0.6, "time_skew SERVO_OUTPUT_RAW": 0.3}
    size = found["perhaps_parameters"]["actuator_lag rudder"]["time_constant"]
    assert size == {"value": pytest.approx(0.3), "sd": 0.1, "unit": "1", "control": "rudder"}
    assert found["perhaps_parameters"].keys() == found["perhaps"].keys()
    silent = entries.verdict(replace(told, answer="insufficient_data"), aircraft(), None)
    assert silent["perhaps"] == silent["perhaps_parameters"] == {}


def separate(*sets: tuple) -> str | None:
    return entries.separate(verdict("ambiguous", *sets), aircraft())


def test_a_size_that_nobody_would_believe_is_told() -> None:
    assert entries.incredible(0.0) == []
    assert entries.incredible(0.99 * INCREDIBLE) == []
    [told] = entries.incredible(4.61)
    assert "4.6" in told
    assert "no cause here" in told


def test_a_group_is_asked_about_in_the_words_of_suggest() -> None:
    assert separate((SHIFT,), (SLOPE,)) == "cg_shift,aero_derivative:Cm_alpha"
    assert separate((LATE,), (SHIFT,)) == "time_skew:SERVO_OUTPUT_RAW,cg_shift"
    either = verdict("ambiguous", (SHIFT,), (SLOPE,))
    assert entries.verdict(either, aircraft(), None)["separate"] == separate((SHIFT,), (SLOPE,))


def test_of_several_axes_it_is_the_one_that_is_farthest_off() -> None:
    assert separate((INERTIA,), (BIAS,)) == "inertia:Iyy,accelerometer_bias:x"


def test_what_all_sets_have_in_common_is_not_asked_about() -> None:
    assert separate((INERTIA, SHIFT), (INERTIA, SLOPE)) == "cg_shift,aero_derivative:Cm_alpha"
    assert separate((SHIFT,), (SHIFT, SLOPE)) is None


def test_what_suggest_does_not_know_is_left_out() -> None:
    assert separate((SHIFT,), (), (STALL,), (SLOPE,)) == "cg_shift,aero_derivative:Cm_alpha"
    assert separate((SHIFT,), (STALL,)) is None


def test_nothing_is_asked_where_nobody_must_be_told_apart() -> None:
    assert entries.separate(verdict("effect", (SHIFT,), (SLOPE,)), aircraft()) is None


def test_each_cause_of_an_explanation_says_what_it_is_about() -> None:
    """Two streams that may be late looked the same."""
    told = entries.ranking(verdict("effect", (LATE, INERTIA), (SLOPE,), ()).ranked)
    assert [item["label"] for item in told] == [
        "time_skew SERVO_OUTPUT_RAW and inertia",
        "aero_derivative Cm.alpha",
        "nothing",
    ]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("CZ.alpha", "CZ.alpha had to go 3.5"),
        ("sensors.airspeed_scale", "the airspeed scale had to go 3.5"),
        ("sensors.vane_bias.1", "the vane bias (beta) had to go 3.5"),
        ("departures.inertia.0", "the inertia (x) had to go 3.5"),
        ("departures.offset.1", "the offset of the aileron had to go 3.5"),
        ("sensors.attitude_tilt.1", "the attitude tilt (pitch) had to go 3.5"),
    ],
)
def test_what_was_bent_too_far_is_told_in_words(name: str, words: str) -> None:
    (said,) = entries.strained({name: -3.5}, ("elevator", "aileron"))
    assert said.startswith(words)
