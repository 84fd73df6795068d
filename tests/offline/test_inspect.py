from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_sysid.aircraft import COEFFICIENTS, Vanes
from gcs_sysid.errors import InputError, RefusedError
from gcs_sysid.offline import envelope, inspect
from gcs_sysid.offline.documents import plain
from gcs_sysid.reconstruct.airborne import airborne
from gcs_sysid.recording import Vehicle
from tests.offline.made_aircraft import small
from tests.reconstruct.made_flights import Input, flight, without

SERVO = {"aileron": "servo1", "elevator": "servo2", "rudder": "servo4"}
INPUTS = [
    Input(kind, 20.0 + 12.0 * number, output)
    for number, (kind, output) in enumerate(
        (kind, output) for kind in ("doublet", "multistep") for output in SERVO.values()
    )
]
TESTED = flight(INPUTS, duration=110.0)


def document(recording=TESTED, aircraft=None, segments=None):
    """The document as JSON holds it."""
    return json.loads(json.dumps(plain(inspect.inspected(recording, aircraft, segments))))


def verdicts(found):
    return {name: entry["verdict"] for name, entry in found["identifiable"].items()}


def test_streams_are_counted_on_the_clock_of_the_log():
    stream = TESTED.streams["RAW_IMU"]
    whole = np.ones(stream.count, dtype=bool)
    whole[1000:1100] = whole[3000:3050] = False
    holed = replace(
        stream,
        time=stream.time[whole],
        link_time=stream.link_time[whole],
        channels={name: values[whole] for name, values in stream.channels.items()},
    )
    found = document(replace(TESTED, streams={**TESTED.streams, "RAW_IMU": holed}))
    entry = found["streams"]["RAW_IMU"]
    assert entry["count"] == 5350
    assert entry["rate_hz"] == pytest.approx(50.0)
    assert (entry["gaps"], entry["longest_gap_s"]) == (2, pytest.approx(2.02))
    assert entry["first_us"] == TESTED.epoch_us
    assert entry["last_us"] == TESTED.epoch_us + round(1e6 * (110.0 - 0.02))


def test_deliberate_inputs_in_calm_air_can_tell_every_moment():
    found = document(aircraft=small())
    assert verdicts(found) == dict.fromkeys(COEFFICIENTS, "yes")
    assert "2 inputs on elevator" in found["identifiable"]["Cm"]["reason"]
    assert [item["kind"] for item in found["maneuvers"]].count("doublet") == 3
    assert found["held_out"]


def test_an_autopilot_at_work_makes_everything_weak_at_best():
    found = document(flight(duration=120.0, feedback=30.0, turns=[(30.0, 50.0)]), small())
    assert set(verdicts(found).values()) == {"weak"}
    assert "no test input on rudder" in found["identifiable"]["Cn"]["reason"]
    assert any("doublets" in line for line in found["next_flight"])


def test_surfaces_that_never_move_tell_nothing():
    found = document(flight(duration=120.0, feedback=1.0), small())
    assert [verdicts(found)[name] for name in ("Cl", "Cm", "Cn")] == ["no"] * 3
    assert "hardly moved" in found["identifiable"]["Cm"]["reason"]


def test_gusts_without_vanes_weaken_what_vanes_would_tell():
    gusty = flight(INPUTS, duration=110.0, gust=1.5)
    assert set(verdicts(document(gusty, small())).values()) == {"weak"}
    angles = {"alpha": np.full(gusty.streams["VFR_HUD"].count, 0.05)}
    angles["beta"] = angles["alpha"]
    vanes = replace(gusty.streams["VFR_HUD"], name="AOA_SSA", channels=angles)
    measured = replace(gusty, streams={**gusty.streams, "AOA_SSA": vanes})
    assert verdicts(document(measured, replace(small(), vanes=Vanes())))["Cm"] == "yes"


def test_two_surfaces_that_move_as_one_are_named():
    recording = flight(INPUTS, duration=110.0)
    servo = recording.streams["SERVO_OUTPUT_RAW"]
    mixed = {**servo.channels, "pwm_4": servo.channels["pwm_1"]}
    stream = replace(servo, channels=mixed)
    found = document(
        replace(recording, streams={**recording.streams, stream.name: stream}), small()
    )
    assert "aileron and rudder go together (+1.00)" in found["identifiable"]["Cl"]["reason"]
    assert verdicts(found)["Cn"] == "weak"
    assert verdicts(found)["Cm"] == "yes"


def test_four_hertz_says_no_with_the_reason_and_the_fix():
    found = document(flight(INPUTS, duration=110.0, rate=4.0), small())
    for name in ("Cl", "Cm"):
        entry = found["identifiable"][name]
        assert entry["verdict"] == "no"
        assert "at 4.0 Hz" in entry["reason"]
        assert "SET_MESSAGE_INTERVAL" in entry["reason"]
    assert set(verdicts(found).values()) <= {"no", "weak"}


def test_a_log_without_streams_worth_anything_is_described_all_the_same():
    bare = without(TESTED, *(name for name in TESTED.streams if name != "ATTITUDE"))
    found = document(bare)
    assert set(verdicts(found).values()) == {"no"}
    assert (found["airborne_s"], found["maneuvers"], found["wind"]) == (0.0, [], None)
    assert "Maneuvers: none" in inspect.text(found)


def test_gusts_on_a_straight_flight_are_no_tail_wind():
    """With airspeed's scale free, a constant wind and a scale of zero explained every gust."""
    recording = flight(duration=110.0, gust=1.5)
    wind = envelope.wind(recording, airborne(recording))
    assert wind is not None
    assert wind.gust == pytest.approx(1.1, abs=0.4)


def test_wind_and_gust_are_found_from_turns():
    recording = flight(duration=150.0, turns=[(20.0, 50.0), (80.0, 120.0)], gust=0.8, seed=3)
    ground = recording.streams["GLOBAL_POSITION_INT"]
    blown = {
        **ground.channels,
        "v_north": ground.channels["v_north"] + 4.0,
        "v_east": ground.channels["v_east"] - 3.0,
    }
    streams = {**recording.streams, ground.name: replace(ground, channels=blown)}
    recording = replace(recording, streams=streams)
    wind = envelope.wind(recording, airborne(recording))
    assert wind is not None
    assert (wind.north, wind.east) == (pytest.approx(4.0, abs=0.5), pytest.approx(-3.0, abs=0.5))


def test_words_fit_a_terminal_and_name_every_coefficient():
    other = Vehicle(9, 1, "MAV_AUTOPILOT_PX4", "MAV_TYPE_FIXED_WING", 5)
    recording = replace(TESTED, others=(other,), lost={"bad_crc": 3, "unknown": 0})
    for aircraft in (None, small()):
        words = inspect.text(document(recording, aircraft))
        assert max(len(line) for line in words.splitlines()) <= 96
        assert "vehicle 9" in words
        assert "3 bad crc" in words
        for name in COEFFICIENTS:
            assert name in words


def test_listed_maneuvers_replace_those_found(tmp_path):
    mine = tmp_path / "mine.json"
    listed = [{"kind": "other", "start_s": 5.0, "duration_s": 20.0, "held_out": True}]
    mine.write_text(json.dumps({"maneuvers": listed}), encoding="utf-8")
    found = document(segments=mine)
    assert [(item["kind"], item["start_s"]) for item in found["maneuvers"]] == [("other", 5.0)]
    assert found["held_out"] == [1]


@pytest.mark.shared
def test_a_real_log_leaves_its_document_and_nothing_half_written(shared, tmp_path):
    folder = shared / "cases" / "clean"
    found = inspect.run(
        folder / "flight.tlog", aircraft=folder / "aircraft.toml", out=tmp_path / "new"
    )
    written = json.loads((tmp_path / "new" / "inspect.json").read_text(encoding="utf-8"))
    assert written == found
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["inspect.json"]
    assert found["program"].startswith("gcs-sysid ")
    assert found["airborne_s"] == pytest.approx(240.0, abs=0.5)
    assert set(found["identifiable"]) == set(COEFFICIENTS)
    # Its list of maneuvers is a segments file.
    again = inspect.run(folder / "flight.tlog", segments=tmp_path / "new" / "inspect.json")
    assert [item["kind"] for item in again["maneuvers"]] == [
        item["kind"] for item in found["maneuvers"]
    ]
    assert again["held_out"] == found["held_out"]


@pytest.mark.shared
@pytest.mark.parametrize(
    ("log", "aircraft", "wanted"),
    [
        ("data/umn_thor/thor_flight75.tlog", "data/umn_thor/aircraft.toml", {"weak"}),
        ("data/solarsurfer/flight3.tlog", None, {"weak"}),
        ("data/quadplane_sitl/vtol.tlog", None, {"no"}),
        ("data/arduplane_sitl/A_lowrate.tlog", "data/arduplane_sitl/aircraft.toml", {"no"}),
        ("data/arduplane_sitl/A.tlog", "data/arduplane_sitl/aircraft.toml", {"yes"}),
        ("data/arduplane_sitl/B.tlog", "data/arduplane_sitl/aircraft.toml", {"weak"}),
        ("data/proto_flt09/proto_flt09.tlog", None, {"weak", "no"}),
    ],
)
def test_real_flights_are_judged_as_an_engineer_would(shared, log, aircraft, wanted):
    found = inspect.run(shared / log, aircraft=shared / aircraft if aircraft else None)
    assert set(verdicts(found).values()) == wanted
    words = inspect.text(found)
    assert max(len(line) for line in words.splitlines()) <= 96
    if log.startswith("data/proto"):
        assert [verdicts(found)[name] for name in ("CX", "CY", "CZ")] == ["no"] * 3
        assert "forces cannot be measured" in found["identifiable"]["CX"]["reason"]


@pytest.mark.shared
def test_a_vehicle_that_is_not_in_the_log_is_refused(shared):
    with pytest.raises(RefusedError):
        inspect.run(shared / "cases" / "clean" / "flight.tlog", vehicle=42)


def test_a_missing_log_is_one_line():
    with pytest.raises(InputError, match="no such file"):
        inspect.run(Path("nowhere.tlog"))
