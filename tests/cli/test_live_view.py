"""What is shown of a flight: right numbers in the units people use, on terminals and in pipes."""

from __future__ import annotations

import io
import math

import pytest
from rich.console import Console

from gcs_sysid.cli import live_view

RAD = math.radians
STATE = {
    "V": {"value": 15.04, "sd": 0.1, "unit": "m/s"},
    "alpha": {"value": RAD(3.0), "sd": RAD(0.5), "unit": "rad"},
    "beta": {"value": RAD(-1.0), "sd": RAD(0.5), "unit": "rad"},
    "roll": {"value": RAD(10.0), "sd": RAD(0.2), "unit": "rad"},
    "pitch": {"value": RAD(4.0), "sd": RAD(0.2), "unit": "rad"},
    "yaw": {"value": RAD(-90.0), "sd": RAD(0.2), "unit": "rad"},
    "wind_north": {"value": -3.0, "sd": 0.5, "unit": "m/s"},
    "wind_east": {"value": 0.0, "sd": 0.1, "unit": "m/s"},
    "wind_down": {"value": 0.2, "sd": 0.1, "unit": "m/s"},
}


def document(**changes: object) -> dict:
    return {
        "aircraft": "kite",
        "link": "udp:127.0.0.1:14550",
        "vehicle": 1,
        "other_vehicles": [],
        "departures": {},
        "phase": "flying",
        "state": STATE,
        "coefficients": {"CZ": {"value": -0.4123, "sd": 0.01, "age_s": 0.3}},
        "derivatives": {
            "CZ": {"1": {"value": -0.3, "sd": 0.01}, "alpha": {"value": -4.51, "sd": 0.2}}
        },
        "processes": {
            "phase": "known", "samples": 600, "wanted": 512,
            "coefficients": {"CZ": {"value": -0.4071, "sd": 0.002}},
        },
        "latency": {"packet_to_update": {"p50_ms": 21.7, "p99_ms": 34.2}},
        "counts": {
            "received": 1000, "recorded": 1003, "updates": 400, "decimated": 2, "late": 1,
            "restarts": 0, "lost": {"bad_crc": 3, "unknown": 1},
        },
        **changes,
    }  # fmt: skip


def shown(content: dict) -> str:
    console = Console(file=io.StringIO(), width=120)
    console.print(live_view.table(content))
    return console.file.getvalue()


def test_a_line_holds_state_coefficients_and_counts():
    text = live_view.line(document())
    assert "\n" not in text
    for words in (
        "airspeed 15.0 ± 0.2 m/s", "alpha 3.0 ± 1.0°", "beta -1.0 ± 1.0°",
        "wind 3.0 ± 1.0 m/s from 000°", "CZ -0.412 ± 0.020", "1003 frames", "2 decimated",
        "1 late", "4 lost", "latency 22/34 ms",
    ):  # fmt: skip
        assert words in text


def test_what_happened_is_counted_where_it_did():
    told = document()
    assert "reboots" not in live_view.line(told)
    told["counts"] |= {"frozen": 12, "reboots": 1, "restarts": 2, "failures": 3}
    for text in (live_view.line(told), shown(told)):
        assert "12 frozen, 1 reboots, 2 restarts, 3 failures" in " ".join(text.split())


def test_a_terminal_shows_first_model_and_processes_too():
    text = shown(document())
    for words in (
        "-0.4071 ± 0.0039",
        "roll 10.0 ± 0.4°",
        "const -0.300 ± 0.020",
        "alpha -4.51 ± 0.39",
        "up -0.2 ± 0.2 m/s",
    ):
        assert words in text


def test_before_the_first_state_only_what_is_waited_for_is_shown():
    waiting = document(
        phase="waiting for data", state={}, coefficients={}, derivatives={},
        latency={"packet_to_update": {"p50_ms": None, "p99_ms": None}},
    )  # fmt: skip
    assert live_view.line(waiting).startswith("waiting for data | 1003 frames")
    assert "kite  udp:127.0.0.1:14550  waiting for data" in shown(waiting)


def test_a_first_model_without_samples_says_that_it_collects():
    assert "collecting" in shown(document(derivatives={}))


def test_a_simulation_that_departs_is_told_with_its_time() -> None:
    departs = {"Cm": {"since_us": 1_000_000, "size": 0.02, "deviations": 4.26}}
    told = document(departures=departs, time_us=13_400_000)
    words = "the simulation departs: Cm since 12 s (+4.3 sd)"
    assert words in live_view.line(told)
    assert words in shown(told)
    departs["Cm"]["derivative"] = "elevator"
    assert "Cm by elevator since 12 s" in live_view.line(told)


def test_alarms_causes_the_maneuver_and_what_to_fly_are_told() -> None:
    told = document(
        alarms=[{"kind": "silent", "what": "airspeed", "words": "airspeed is not heard for 5 s"}],
        causes=[
            {"cause": "surface_offset", "about": "elevator", "probability": 0.9,
             "log_bayes_factor": 7.0, "size": RAD(-2.0), "sd": RAD(0.5), "unit": "rad"},
            {"cause": "mass", "about": "", "probability": 0.05,
             "log_bayes_factor": 4.0, "size": 0.1, "sd": 0.02, "unit": "1"},
        ],
        maneuver={"number": 2, "controls": ["elevator"], "seconds": 8.2, "learned": 0.5,
                  "stop": "known to 10 %", "gauge": []},
        suggestions=[{"fly": "rudder doublets", "for": ["Cn_rhat"], "wanted": 0.1}],
    )  # fmt: skip
    line, table = live_view.line(told), shown(told)
    for words in (
        "airspeed is not heard for 5 s",
        "likely: surface_offset elevator -2.00 ± 0.98 deg (90 %)",
        "maneuver 2 on elevator, 8 s, 50 % learned, STOP: known to 10 %",
    ):
        assert words in line
        assert words in table
    assert "likely: mass 0.100 ± 0.039 (5 %)" in table
    assert "[##########..........]" in table
    assert "fly next: rudder doublets (for Cn_rhat)" in table


@pytest.mark.parametrize(("age", "old"), [(None, False), (0.1, False), (4.4, True)])
def test_old_values_are_called_old(age: float | None, old: bool) -> None:
    told = document(state_age_s=age)
    for text in (live_view.line(told), shown(told)):
        assert ("VALUES ARE 4 s OLD" in text) == old


@pytest.mark.parametrize(("age", "old"), [(0.3, False), (12.3, True)])
def test_old_coefficients_are_called_old(age: float, old: bool) -> None:
    """After the servo outputs fell silent the last ones stood there as if they were of now."""
    told = document(coefficients={"CZ": {"value": -0.4123, "sd": 0.01, "age_s": age}})
    assert ("CZ -0.412 ± 0.020 (12 s OLD)" in live_view.line(told)) == old
    assert ("-0.412 ± 0.020 (12 s OLD)" in shown(told)) == old


def test_another_vehicle_is_named_with_the_way_to_choose_it():
    two = document(other_vehicles=[7])
    for text in (shown(two), live_view.line(two)):
        assert "vehicle 1 is followed; 7 heard too (--vehicle N chooses)" in text


@pytest.mark.parametrize(
    ("value", "band", "text"),
    [
        (-0.41234, 0.0123, "-0.412 ± 0.012"),
        (12.3456, 3.2, "12.3 ± 3.2"),
        (123.0, 40.0, "123 ± 40"),
        (1.0, math.nan, "1"),
        (0.5, 0.0, "0.5"),
    ],
)
def test_numbers_have_the_digits_that_their_interval_leaves(value, band, text):
    assert live_view._number(value, band) == text


def test_without_a_terminal_each_document_is_a_line(capsys):
    with live_view.opened(to_stderr=False) as show:
        show(document())
        show(document())
    assert capsys.readouterr().out.count("flying | airspeed") == 2
    with live_view.opened(to_stderr=True) as show:
        show(document())
    assert capsys.readouterr().err.count("flying | airspeed") == 1
