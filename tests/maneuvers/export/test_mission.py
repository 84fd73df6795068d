"""Missions read back by pymavlink's loader, plans against QGroundControl's documented format."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavutil, mavwp

from gcs_sysid.errors import UsageError
from gcs_sysid.maneuvers.export import mission, pulses, system_id
from gcs_sysid.offline import suggestion_exports
from tests.maneuvers.made_model import aircraft

HOME = mission.Home(47.3, 8.5, 30.0)
STEPS = [
    {"leg": 1, "direction": "out", "airspeed": 20.0, "height": 100.0, "duration_s": 18.0},
    {"leg": 1, "direction": "out", "airspeed": 20.0, "height": 110.0, "duration_s": 4.0},
    {"leg": 2, "direction": "back", "airspeed": 25.0, "height": 100.0, "duration_s": 18.0},
]


@pytest.fixture(scope="module")
def made() -> tuple[mission.Item, ...]:
    return mission.items(STEPS, HOME)


def test_a_ground_station_reads_the_waypoints(made, tmp_path: Path) -> None:
    path = tmp_path / "sortie.waypoints"
    path.write_text(mission.waypoints(made))
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(path)) == len(made)
    commands = [loader.wp(index).command for index in range(loader.count())]
    enum = mavutil.mavlink
    point, speed = enum.MAV_CMD_NAV_WAYPOINT, enum.MAV_CMD_DO_CHANGE_SPEED
    assert commands == [
        *(point, point, speed, point, point, speed, point), enum.MAV_CMD_NAV_RETURN_TO_LAUNCH,
    ]  # fmt: skip
    assert loader.wp(1).frame == enum.MAV_FRAME_GLOBAL_RELATIVE_ALT
    assert loader.wp(2).param2 == 20.0
    assert [loader.wp(index).z for index in (1, 3, 4, 6)] == [110.0, 110.0, 100.0, 100.0]


def test_legs_are_as_long_as_their_runs_and_lead_out_and_back(made) -> None:
    """Great-circle distance and bearing by pymavlink's own formulas."""
    from pymavlink import mavextra

    ends = [item for item in made[1:] if item.command == mission.WAYPOINT]
    for (first, last), seconds, speed, bearing in zip(
        [ends[:2], ends[2:]], (20.0 + 10.0 + 22.0, 20.0 + 5.0 + 18.0), (20.0, 25.0), (30.0, 210.0),
        strict=True,
    ):  # fmt: skip
        place = (first.latitude_deg, first.longitude_deg, last.latitude_deg, last.longitude_deg)
        assert mavextra.distance_lat_lon(*place) == pytest.approx(seconds * speed, rel=3e-3)
        north = last.latitude_deg - first.latitude_deg
        east = (last.longitude_deg - first.longitude_deg) * np.cos(np.radians(47.3))
        assert np.degrees(np.arctan2(east, north)) % 360.0 == pytest.approx(bearing, abs=0.1)


def test_the_plan_is_what_qgroundcontrol_documents(made) -> None:
    document = json.loads(mission.plan(made, firmware=mission.PX4, cruise=20.0))
    assert document["fileType"] == "Plan"
    assert document["version"] == 1
    assert set(document) >= {"geoFence", "groundStation", "mission", "rallyPoints"}
    inner = document["mission"]
    assert (inner["version"], inner["firmwareType"], inner["vehicleType"]) == (2, 12, 1)
    assert inner["plannedHomePosition"] == [47.3, 8.5, 0.0]
    assert len(inner["items"]) == len(made) - 1
    for number, item in enumerate(inner["items"], 1):
        assert item["type"] == "SimpleItem"
        assert item["doJumpId"] == number
        assert len(item["params"]) == 7
        assert isinstance(item["autoContinue"], bool)
        if item["command"] == 16:
            assert item["AltitudeMode"] == 1
            assert item["Altitude"] == item["params"][6]


def test_places_are_checked() -> None:
    assert suggestion_exports.home("47.3, 8.5, 30") == HOME
    with pytest.raises(UsageError, match=r"47\.3,8\.5,270"):
        suggestion_exports.home("47.3,8.5")
    with pytest.raises(UsageError, match="latitude comes first"):
        suggestion_exports.home("147.3,8.5,0")


def test_pulses_are_those_of_the_servos_and_engines() -> None:
    """0.1 rad of 0.5 rad at 500 µs is 100 µs; 20 % of throttle over 1000 µs is 200 µs."""
    columns = {"elevator": np.array([0.0, 0.1]), "throttle": np.array([0.2, 0.0])}
    found = pulses.added(aircraft(), columns)
    assert sorted(found) == [2, 3]
    np.testing.assert_allclose(found[2], [0.0, 100.0], rtol=1e-9)
    np.testing.assert_allclose(found[3], [200.0, 0.0], rtol=1e-9)


def test_a_sweep_as_parameters() -> None:
    values = system_id.parameters("pitch", amplitude=0.1, travel=0.5, last=1.8)
    text = system_id.file(values)
    rows = dict(line.split(",") for line in text.splitlines() if not line.startswith("#"))
    assert float(rows["SID_AXIS"]) == 11.0
    assert float(rows["SID_MAGNITUDE"]) == pytest.approx(0.2)
    assert float(rows["SID_F_STOP_HZ"]) == 1.8
