from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.offline import summary
from tests.offline import made_models
from tests.offline.made_aircraft import small


def table(error: np.ndarray, deviation: float, measured_deviation: float) -> dict[str, np.ndarray]:
    """All six coefficients alike: a known signal, predicted with a known error."""
    measured = np.sin(np.linspace(0.0, 60.0, error.size))
    columns = {}
    for name in ("CX", "CY", "CZ", "Cl", "Cm", "Cn"):
        columns[name] = measured + error
        columns[f"{name}_sd"] = np.full(error.size, deviation)
        columns[f"{name}_measured"] = measured
        columns[f"{name}_measured_sd"] = np.full(error.size, measured_deviation)
    return columns


def test_scores_of_a_known_error_are_the_closed_forms() -> None:
    """A normal error of standard deviation s under the band s: 95 % inside, nlpd ½ + ln(s√2π)."""
    error = 0.05 * np.random.default_rng(1).standard_normal(200_000)
    rows = np.ones(error.size, dtype=bool)
    score = summary.scores(table(error, 0.03, 0.04), rows, {})["Cm"]
    assert score["relative_error"] == pytest.approx(100.0 * 0.05 * np.sqrt(2.0), rel=0.01)
    assert score["coverage95"] == pytest.approx(0.95, abs=0.002)
    assert score["nlpd"] == pytest.approx(0.5 + np.log(0.05 * np.sqrt(2.0 * np.pi)), abs=0.01)
    assert score["r2"] == pytest.approx(1.0 - 2.0 * 0.05**2, abs=1e-3)
    assert score["samples"] == error.size


def test_bands_that_are_too_narrow_are_found_out() -> None:
    error = 0.05 * np.random.default_rng(2).standard_normal(10_000)
    rows = np.ones(error.size, dtype=bool)
    honest = summary.scores(table(error, 0.03, 0.04), rows, {})["CX"]
    proud = summary.scores(table(error, 0.006, 0.008), rows, {})["CX"]
    assert proud["coverage95"] < 0.4
    assert proud["nlpd"] > honest["nlpd"]
    assert proud["relative_error"] == honest["relative_error"]


def test_only_the_rows_asked_for_are_scored() -> None:
    error = np.concatenate([np.zeros(500), np.ones(500)])
    score = summary.scores(table(error, 0.1, 0.1), np.arange(1000) < 500, {})["CZ"]
    assert score["relative_error"] == 0.0
    assert score["samples"] == 500


def test_refused_coefficients_carry_their_reason_and_no_score() -> None:
    scores = summary.scores(
        table(np.zeros(10), 0.1, 0.1), np.ones(10, dtype=bool), {"CX": "no accelerometer"}
    )
    assert scores["CX"] == {"refused": "no accelerometer", "samples": 0}
    assert scores["CY"]["refused"] is None


def test_without_held_out_rows_there_is_no_score() -> None:
    score = summary.scores(table(np.zeros(10), 0.1, 0.1), np.zeros(10, dtype=bool), {})["CX"]
    assert score["relative_error"] is None
    assert score["coverage95"] is None


def flown(quiet: int, moving: int) -> dict[str, np.ndarray]:
    """Level flight at known values, then a turn at others."""
    count = quiet + moving

    def column(level: float, turning: float) -> np.ndarray:
        return np.concatenate([np.full(quiet, level), np.full(moving, turning)])

    names = ("qbar", "phat", "qhat", "rhat", "p", "q", "r", "elevator", "aileron", "rudder")
    return {
        **{name: column(0.0, 0.3) for name in names},
        "V": column(20.0, 27.0),
        "alpha": column(0.05, 0.12),
        "beta": column(0.0, 0.02),
        "theta": column(0.04, 0.1),
        "phi": column(0.0, 0.8),
        "thrust_coefficient": column(0.1, 0.2),
        "maneuver": np.zeros(count, dtype=int),
    }


def test_trim_is_the_quiet_part_of_the_flight() -> None:
    trim = summary.trim(flown(300, 700), ("elevator", "aileron", "rudder"))
    assert trim["V"] == 20.0
    assert trim["alpha"] == 0.05
    assert trim["controls"] == {"elevator": 0.0, "aileron": 0.0, "rudder": 0.0}
    assert trim["thrust_coefficient"] == 0.1


def test_the_envelope_is_what_was_visited_in_maneuvers() -> None:
    columns = flown(500, 500)
    columns["V"][:2] = 99.0
    columns["maneuver"][:2] = -1
    envelope = summary.envelope(columns, ("elevator",))
    assert envelope["V"] == [20.0, 27.0]
    assert envelope["alpha"] == [0.05, 0.12]
    assert envelope["elevator"] == [0.0, 0.3]


def test_derivatives_stand_beside_those_of_the_file() -> None:
    found = summary.derivatives(made_models.model(), small())
    alpha = found["CZ"]["alpha"]
    fit = made_models.model().fits["CZ"]
    assert alpha["file"] == -5.65
    assert alpha["value"] == fit.value[1]
    assert alpha["sd"] == pytest.approx(
        np.sqrt(alpha["sd_noise"] ** 2 + alpha["sd_scale"] ** 2 + alpha["sd_regressor"] ** 2)
    )
    assert found["CZ"]["alpha^2"]["file"] is None
    assert alpha["sd_white"] < alpha["sd_noise"], "coloured residuals know less"
    assert alpha["verdict"] == "yes"


def test_limits_are_those_of_the_file() -> None:
    limits = summary.limits(small())
    assert limits is not None
    assert limits["V"] == [13.0, 35.0]
    assert limits["phi"] == [-1.0, 1.0]
