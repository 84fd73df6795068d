"""A summary in ten lines: the numbers in it are the ones a person reads."""

from __future__ import annotations

import copy

import pytest

from gcs_sysid.cli import findings


def derivative(value, sd, file=None):
    return {"value": value, "sd": sd, "file": file, "verdict": "yes", "reason": ""}


SUMMARY = {
    "flights": [{"source": "logs/morning.tlog", "airborne_s": 300.0}],
    "maneuvers": [{"held_out": False}] * 7 + [{"held_out": True}] * 2,
    "coefficients": {
        "CX": {"relative_error": None, "refused": "no accelerometer"},
        "Cm": {"relative_error": 12.4, "refused": None},
    },
    "derivatives": {
        "CZ": {"alpha": derivative(-4.612, 0.1, file=-4.8)},
        "Cm": {
            "alpha": derivative(-0.7234, 0.02),
            "qhat": derivative(-11.2, 1.0),
            "elevator": derivative(-0.9, 0.0),
        },
        "Cl": {"phat": derivative(-0.4, 0.01)},
        "CY": {"beta": derivative(-0.4, 0.01)},
        "Cn": {"beta": derivative(0.08, 0.01)},
    },
    "reconstruction": {
        "wind_ned": {"value": [-3.0, -4.0, 0.0], "sd": [0.1, 0.1, 0.1], "unit": "m/s"},
        "delays": {"SERVO_OUTPUT_RAW": {"value": 0.072, "sd": 0.002, "unit": "s"}},
    },
    "cannot_tell": [
        {"what": "Cn_rudder", "why": "the rudder did not move", "fly": "fly a rudder doublet"},
        {"what": "CY_rudder", "why": "the rudder did not move", "fly": "fly a rudder doublet"},
    ],
}


def text(tmp_path, **changes):
    return findings.text(copy.deepcopy(SUMMARY) | changes, tmp_path)


def test_a_full_summary_takes_ten_lines(tmp_path):
    assert len(text(tmp_path).splitlines()) == 10


def test_flights_and_maneuvers(tmp_path):
    first = text(tmp_path).splitlines()[0]
    assert first == "morning.tlog: 5.0 min airborne, 9 maneuvers, 2 held out of the fit"


def test_errors_and_refusals(tmp_path):
    assert "CX refused  Cm 12 %" in text(tmp_path).splitlines()[1]


def test_an_interval_holds_95_percent_and_two_digits(tmp_path):
    shown = text(tmp_path)
    assert "CZ_alpha -4.61 ± 0.20 (file -4.80)" in shown
    assert "Cm_alpha -0.723 ± 0.039" in shown
    assert "Cm_qhat -11.2 ± 2.0" in shown
    assert "Cm_elevator -0.900 ± 0.000" in shown


@pytest.mark.parametrize(
    ("toward", "come_from"),
    [([0, -5, 0], "from 90°"), ([-5, 0, 0], "from 0°"), ([5, 0, 0], "from 180°")],
)
def test_wind_is_named_for_where_it_comes_from(toward, come_from, tmp_path):
    reconstruction = {"wind_ned": {"value": toward, "sd": [1, 1, 1], "unit": "m/s"}}
    assert f"Wind 5.0 m/s {come_from}" in text(tmp_path, reconstruction=reconstruction)


def test_delays_in_milliseconds(tmp_path):
    assert "SERVO_OUTPUT_RAW late by 72 ± 4 ms" in text(tmp_path)


def test_what_cannot_be_told_and_what_to_fly(tmp_path):
    shown = text(tmp_path)
    assert "Cannot tell Cn_rudder: the rudder did not move; fly a rudder doublet; 1 more" in shown


def test_ends_with_the_report_or_else_the_summary(tmp_path):
    assert text(tmp_path).endswith(str(tmp_path / "summary.json"))
    (tmp_path / "report.html").touch()
    assert text(tmp_path).endswith(str(tmp_path / "report.html"))


def test_a_prediction_has_no_derivatives(tmp_path):
    shown = text(tmp_path, derivatives={}, reconstruction={}, cannot_tell=[])
    assert len(shown.splitlines()) == 3
