from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_sysid.figures.data import SIGMAS_95
from gcs_sysid.figures.derivatives import derivatives, strip

number = st.floats(-1e3, 1e3)
positive = st.floats(0.0, 1e3)


@settings(deadline=None)
@given(number, positive, st.none() | number, positive)
def test_a_strip_holds_everything_marked_and_zero(
    value: float, sd: float, file: float | None, sigma: float
) -> None:
    shown = strip(value, sd, file, None if file is None else sigma)
    low, high = shown.limits
    assert math.isfinite(low)
    assert low < high
    assert low <= 0.0 <= high
    for item in shown.intervals:
        assert low <= item.low <= item.high <= high
    for mark in shown.marks:
        assert low <= mark.value <= high


def _entry(**changes: object) -> dict:
    return {
        "value": -0.9, "sd": 0.03, "sd_noise": 0.01, "sd_scale": 0.02, "sd_regressor": 0.005,
        "file": -0.7, "file_sigma": 0.04, "verdict": "yes", "reason": "",
    } | changes  # fmt: skip


def test_interval_and_distance_follow_from_the_deviations() -> None:
    row = derivatives({"Cm": {"alpha": _entry()}})["Cm"][0]
    assert row.half == pytest.approx(SIGMAS_95 * 0.03)
    assert row.distance == pytest.approx(-0.2 / 0.05)
    assert row.limited_by == "mass, inertia and thrust"


def test_with_a_prior_the_flight_alone_is_held_against_the_file() -> None:
    entry = _entry(value=-0.75, flight_value=-0.9, sd_noise=0.03, sd_scale=0.0, sd_regressor=0.0)
    row = derivatives({"Cm": {"alpha": entry}})["Cm"][0]
    assert row.distance == pytest.approx(-0.2 / 0.05)


def test_without_a_file_value_nothing_is_compared() -> None:
    row = derivatives({"Cm": {"alpha": _entry(file=None, file_sigma=None)}})["Cm"][0]
    assert row.distance is None
    assert [mark.role for mark in row.strip.marks] == ["measured"]


def test_no_single_source_is_blamed_when_none_prevails() -> None:
    entry = _entry(sd_noise=0.01, sd_scale=0.01, sd_regressor=0.01)
    assert derivatives({"Cm": {"alpha": entry}})["Cm"][0].limited_by == ""
