"""What is told of a cause: its numbers, and words for their signs."""

from __future__ import annotations

import re

import pytest

from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate, Cause
from gcs_sysid.diagnose.explanation import explained
from gcs_sysid.diagnose.hypothesis import Estimate


def told(cause: Cause, *sigmas: float) -> str:
    """The line for a cause whose parameters are so many deviations off."""
    found = [
        Estimate(one.name, one.nominal + off * one.sigma, 0.1 * one.sigma, one.unit, one.nominal)
        for one, off in zip(cause.parameters, sigmas, strict=True)
    ]
    if cause.where:
        found.append(Estimate(cause.where, 0.25, 0.0, cause.where_unit, 0.25))
    return explained(Candidate(cause, about="rudder"), found)


@pytest.mark.parametrize("cause", CAUSES.values(), ids=lambda one: one.name)
def test_every_cause_is_told_once_with_every_number_that_it_frees(cause: Cause) -> None:
    nothing = [0.0] * len(cause.parameters)
    line = told(cause, *nothing)
    assert not re.search(r"(.{20,}).*\1", line)
    assert "{" not in line
    assert "|" not in line
    for index, one in enumerate(cause.parameters):
        off = [float(index == each) for each in range(len(cause.parameters))]
        # A limit that is there at all is there wholly: only where is told.
        assert (told(cause, *off) != line) == (not one.expected)


@pytest.mark.parametrize(
    ("name", "above", "below"),
    [
        ("mass", "is 10.0 % more than", "is 10.0 % less than"),
        ("cg_shift", "0.080 mean chords forward of", "0.080 mean chords aft of"),
        ("airspeed_scale", "6.0 % higher than", "6.0 % lower than"),
        ("time_skew", "rudder comes 0.080 s late:", "rudder comes 0.080 s early:"),
        ("aeroelastic", "the rudder gains 0.25 of", "the rudder loses 0.25 of"),
        ("thrust_offset", "acts 0.030 m lower than", "acts 0.030 m higher than"),
        ("wind_shear", "0.050 m/s stronger", "0.050 m/s weaker"),
        # Where a sign needs a convention, it is a sign.
        ("surface_offset", "stands +0.050 rad", "stands -0.050 rad"),
    ],
)
def test_a_sign_is_told_in_a_word_where_there_is_one(name: str, above: str, below: str) -> None:
    cause = CAUSES[name]
    all_off = [1.0] * len(cause.parameters)
    assert above in told(cause, *all_off)
    assert below in told(cause, *(-off for off in all_off))


def test_controls_that_the_same_servos_move_are_told_with_it() -> None:
    both = Candidate(CAUSES["actuator_lag"], about="aileron", also=("elevator",))
    lag = Estimate("time_constant", 0.1, 0.01, "s", 0.0)
    assert "the aileron (and the elevator, by the same servos) has 0.100 s more lag" in explained(
        both, (lag,)
    )
