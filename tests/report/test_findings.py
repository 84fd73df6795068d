from __future__ import annotations

from pathlib import Path

import pytest

from gcs_sysid.report.findings import findings, refused, scored, ten_lines


def _text(summary: dict, topic: str) -> str:
    return next((item.text for item in findings(summary) if item.topic == topic), "")


def test_at_most_ten_lines_and_the_last_names_the_report(summary: dict) -> None:
    lines = ten_lines(summary, Path("/somewhere/report.html")).splitlines()
    assert len(lines) <= 10
    assert lines[-1].endswith("/somewhere/report.html")
    assert any(line.startswith("Cannot tell") for line in lines)
    assert any(line.startswith("Fly next") for line in lines)
    assert any(line.startswith("Warning") for line in lines)


def test_terminal_and_page_use_the_same_sentences(summary: dict) -> None:
    lines = ten_lines(summary, "r.html")
    assert sum(item.text in lines for item in findings(summary)) >= 6


def test_line_breaks_in_a_warning_do_not_make_more_lines(summary: dict) -> None:
    text = ten_lines(summary | {"warnings": ["one\ntwo\n\nthree"]}, "r.html")
    assert len(text.splitlines()) <= 10
    assert "One two three." in text


def test_accuracy_is_listed_best_first(summary: dict) -> None:
    text = _text(summary, "Accuracy")
    order = sorted(scored(summary), key=lambda n: summary["coefficients"][n]["relative_error"])
    assert [text.index(f"{name} ") for name in order] == sorted(
        text.index(f"{name} ") for name in order
    )


@pytest.mark.parametrize(
    ("shares", "words"),
    [
        ((0.94, 0.96), "intervals can be trusted"),
        ((0.62, 0.95), "CX: too sure of itself"),
        ((1.0, 0.95), "CX: wider than this flight needs"),
    ],
)
def test_intervals_are_judged_by_what_they_hold(
    summary: dict, shares: tuple[float, float], words: str
) -> None:
    low, high = shares
    table = {
        name: entry | {"coverage95": low if name == "CX" else high}
        for name, entry in summary["coefficients"].items()
    }
    assert words in _text(summary | {"coefficients": table}, "Intervals")


def test_refused_coefficients_share_a_sentence_and_have_no_error(summary: dict) -> None:
    reason = {"refused": "no accelerometer in the log", "samples": 0}
    table = summary["coefficients"] | {"CX": reason, "CY": reason, "CZ": reason}
    changed = summary | {"coefficients": table}
    assert _text(changed, "Refused") == "CX, CY, CZ: no accelerometer in the log."
    assert list(refused(changed)) == ["CX", "CY", "CZ"]
    assert "CX" not in _text(changed, "Accuracy")


def test_what_the_model_lacks_comes_before_what_was_learned(summary: dict) -> None:
    topics = [one.topic for one in findings(summary)]
    assert "Lacks" not in topics
    term = {"coefficient": "CZ", "regressor": "max(0, alpha - 0.12)", "log_bayes_factor": 327.2}
    summary["lacking"] = [{**term, "value": 3.0, "sd": 0.1, "share": 0.162}]
    told = findings(summary)
    place = [one.topic for one in told].index("Lacks")
    assert told[place + 1].topic == "Learned"
    assert "max(0, alpha - 0.12) in CZ (16 % of its spread, Bayes factor e^327)" in told[place].text
    assert "--stepwise" in told[place].text


def test_a_constant_is_not_counted_as_a_derivative(summary: dict) -> None:
    count = sum(key != "1" for entries in summary["derivatives"].values() for key in entries)
    assert f"of {count} derivatives" in _text(summary, "Learned")


def test_disagreement_with_the_file_names_both_numbers(summary: dict) -> None:
    entry = {"value": -0.9, "sd": 0.01, "file": -0.5, "file_sigma": 0.02, "verdict": "yes"}
    changed = summary | {"derivatives": {"Cm": {"alpha": entry}}}
    assert "Cm_alpha \u22120.900 ± 0.020 against \u22120.500" in _text(changed, "Aircraft file")
    agreed = summary | {"derivatives": {"Cm": {"alpha": entry | {"file": -0.89}}}}
    assert "Agrees" in _text(agreed, "Aircraft file")


def test_wind_is_told_as_where_it_comes_from(summary: dict) -> None:
    """Air that moves to the south comes from the north."""
    wind = {"wind_ned": {"value": [-5.0, 0.0, 0.3], "sd": [0.1, 0.1, 0.1], "unit": "m/s"}}
    assert "5.0 m/s from 000°, sinking 0.3 m/s" in _text(summary | {"reconstruction": wind}, "Air")


def test_a_bare_summary_still_has_findings() -> None:
    bare = {
        "command": "predict", "aircraft": "A", "flights": [{"airborne_s": 61.0}], "maneuvers": [],
        "coefficients": {"Cm": {"relative_error": None, "refused": None, "samples": 1}},
    }  # fmt: skip
    assert [item.topic for item in findings(bare)] == ["Flight"]
    assert "not seen by the model" in ten_lines(bare, "r.html")
