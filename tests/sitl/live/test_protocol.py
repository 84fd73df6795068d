"""What a ground station asks of a live vehicle, and what it gets; pymavlink is the client."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_sysid.sitl.mission import Item, Mission
from gcs_sysid.sitl.modes import Mode
from tests.sitl.live.ground import Ground


@pytest.fixture
def ground() -> Ground:
    started = Ground()
    started.fly(0.5)
    return started


def test_it_introduces_itself_as_a_plane_in_the_air(ground):
    heartbeat = ground.last("HEARTBEAT")
    assert heartbeat.type == mavlink.MAV_TYPE_FIXED_WING
    assert heartbeat.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    assert heartbeat.custom_mode == Mode.AUTO
    assert heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    assert ground.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 148) == mavlink.MAV_RESULT_ACCEPTED
    capabilities = ground.last("AUTOPILOT_VERSION").capabilities
    assert capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    assert ground.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 9999) == mavlink.MAV_RESULT_UNSUPPORTED


def test_parameters_are_listed_read_and_set(ground):
    ground.send(mavlink.MAVLink_param_request_list_message(1, 1))
    listed = [m for m in ground.fly(0.3) if m.get_type() == "PARAM_VALUE"]
    # The radio's jitter lets them overtake each other.
    assert sorted(m.param_index for m in listed) == list(range(listed[0].param_count))
    values = {m.param_id: m.param_value for m in listed}
    assert values["SYSID_THISMAV"] == 1.0
    assert values["SERVO2_FUNCTION"] == 19.0
    ground.send(
        mavlink.MAVLink_param_set_message(1, 1, b"WP_LOITER_RAD", 90.0, 9),
    )
    ground.fly(0.1)
    assert ground.last("PARAM_VALUE").param_value == 90.0
    ground.send(mavlink.MAVLink_param_request_read_message(1, 1, b"WP_LOITER_RAD", -1))
    [read] = [m for m in ground.fly(0.1) if m.get_type() == "PARAM_VALUE"]
    assert (read.param_id, read.param_value) == ("WP_LOITER_RAD", 90.0)
    assert ground.computer.parameters["WP_LOITER_RAD"] == 90.0


def test_message_intervals_are_those_asked_for(ground):
    assert ground.command(511, 30, 100_000) == mavlink.MAV_RESULT_ACCEPTED
    assert ground.command(511, 105, 40_000) == mavlink.MAV_RESULT_ACCEPTED
    assert ground.command(511, 27, -1) == mavlink.MAV_RESULT_ACCEPTED
    assert ground.command(511, 9999, 1e5) == mavlink.MAV_RESULT_DENIED
    counts = ground.counts(2.0)
    assert counts["ATTITUDE"] == pytest.approx(20, abs=1)
    assert counts["HIGHRES_IMU"] == pytest.approx(50, abs=1)
    assert counts["RAW_IMU"] == 0
    ground.command(510, 30)
    assert ground.last("MESSAGE_INTERVAL").interval_us == 100_000
    ground.command(511, 30, 0)
    assert ground.counts(1.0)["ATTITUDE"] == pytest.approx(50, abs=1)


def test_data_streams_change_a_group(ground):
    ground.send(mavlink.MAVLink_request_data_stream_message(1, 1, 10, 5, 1))
    ground.fly(0.1)
    counts = ground.counts(2.0)
    assert counts["ATTITUDE"] == pytest.approx(10, abs=1)
    assert counts["AOA_SSA"] == pytest.approx(10, abs=1)
    assert counts["RAW_IMU"] == pytest.approx(100, abs=1)
    ground.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 0, 0))
    ground.fly(0.1)
    assert set(ground.counts(1.0)) <= {"HEARTBEAT", "EXTENDED_SYS_STATE", "HOME_POSITION"}


def test_rates_that_do_not_divide_the_loop_are_kept_on_average(ground):
    ground.command(511, 30, 33_333)
    assert ground.counts(3.0)["ATTITUDE"] == pytest.approx(90, abs=1)


def waypoints(*places: tuple[float, float, float]) -> list[mavlink.MAVLink_message]:
    """A mission: home, then waypoints [m north, m east, m above home]."""
    items = []
    for seq, (north, east, height) in enumerate([(0.0, 0.0, 0.0), *places]):
        latitude = 47.3 + math.degrees(north / 6371000.0)
        longitude = 8.5 + math.degrees(east / 6371000.0 / math.cos(math.radians(47.3)))
        items.append(
            mavlink.MAVLink_mission_item_int_message(
                *(1, 1, seq, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, 16, 0, 1, 0.0, 0.0, 0.0, 0.0),
                *(round(latitude * 1e7), round(longitude * 1e7), height),
            )
        )
    return items


def upload(ground: Ground, items: list[mavlink.MAVLink_message]) -> None:
    ground.send(mavlink.MAVLink_mission_count_message(1, 1, len(items)))
    for seq, item in enumerate(items):
        ground.fly(0.1)
        assert ground.last("MISSION_REQUEST_INT").seq == seq
        ground.send(item)
    ground.fly(0.1)
    assert ground.last("MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED


def test_a_mission_is_loaded_read_back_and_flown_to_its_end(ground):
    upload(ground, waypoints((120.0, 0.0, 130.0), (160.0, 60.0, 130.0)))
    ground.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    ground.fly(0.1)
    assert ground.last("MISSION_COUNT").count == 3
    ground.send(mavlink.MAVLink_mission_request_int_message(1, 1, 2))
    ground.fly(0.1)
    item = ground.last("MISSION_ITEM_INT")
    assert (item.x, item.y, item.z) == tuple(
        getattr(waypoints((0.0, 0.0, 0.0), (160.0, 60.0, 130.0))[2], axis) for axis in "xyz"
    )
    assert ground.until(lambda: ground.computer.mode == Mode.RTL, 60.0)
    reached = [m.seq for m in ground.received if m.get_type() == "MISSION_ITEM_REACHED"]
    assert reached == [1, 2]
    place = ground.last("LOCAL_POSITION_NED")
    # WP_RADIUS, and a second of flight until it is looked at.
    assert math.hypot(place.x - 160.0, place.y - 60.0) < 60.0


def test_an_item_that_got_lost_is_asked_for_again_and_then_given_up():
    mission, sender = Mission(Item(16)), (255, 190)
    items = waypoints((300.0, 0.0, 120.0))
    count = mavlink.MAVLink_mission_count_message(1, 1, 2)

    def upload_from(time: float) -> int:
        [asked] = mission.receive(count, sender, time)
        return asked.seq

    assert upload_from(0.0) == 0
    assert mission.remind(0.5) == []
    assert [m.seq for m in mission.remind(1.0)] == [0]
    assert [m.seq for m in mission.receive(items[0], sender, 1.1)] == [1]
    assert mission.receive(items[0], sender, 1.2) == [], "it came twice"
    assert [m.type for m in mission.receive(items[1], sender, 1.3)] == [0]
    assert len(mission.items) == 2

    upload_from(10.0)
    [given_up] = mission.remind(19.0)
    assert given_up.type == mavlink.MAV_MISSION_OPERATION_CANCELLED
    assert mission.remind(20.0) == []
    assert len(mission.items) == 2, "what was there stays"


def test_arming_and_disarming_in_the_air(ground):
    assert ground.command(400, 0) == mavlink.MAV_RESULT_FAILED
    assert ground.computer.armed
    assert ground.command(400, 0, 21196) == mavlink.MAV_RESULT_ACCEPTED
    ground.fly(1.0)
    assert not ground.last("HEARTBEAT").base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    assert ground.last("SERVO_OUTPUT_RAW").servo3_raw == 1000
    assert ground.command(400, 1) == mavlink.MAV_RESULT_ACCEPTED
    ground.fly(1.0)
    assert ground.last("SERVO_OUTPUT_RAW").servo3_raw > 1000


@pytest.mark.parametrize("wanted", [Mode.MANUAL, Mode.FBWA, Mode.CRUISE, Mode.LOITER, Mode.GUIDED])
def test_modes_are_set_by_command_and_by_message(ground, wanted):
    assert ground.command(176, 1, float(wanted)) == mavlink.MAV_RESULT_ACCEPTED
    assert ground.computer.mode == wanted
    ground.send(mavlink.MAVLink_set_mode_message(1, 1, Mode.RTL))
    ground.fly(1.0)
    assert ground.last("HEARTBEAT").custom_mode == Mode.RTL
    assert ground.command(176, 1, 3.0) == mavlink.MAV_RESULT_UNSUPPORTED


def test_what_is_for_somebody_else_is_left_alone(ground):
    ground.send(mavlink.MAVLink_set_mode_message(2, 1, Mode.RTL))
    ground.send(mavlink.MAVLink_command_long_message(7, 1, 400, 0, *[0.0] * 7))
    answers = ground.fly(0.3)
    assert ground.computer.mode == Mode.AUTO
    assert not [m for m in answers if m.get_type() == "COMMAND_ACK"]


def test_clocks_are_compared(ground):
    ground.send(mavlink.MAVLink_timesync_message(0, 12345))
    ground.fly(0.1)
    answer = ground.last("TIMESYNC")
    assert answer.ts1 == 12345
    # Boot was 93 s before the flight began.
    assert answer.tc1 == pytest.approx(93.5e9, abs=0.1e9)
    ground.send(mavlink.MAVLink_ping_message(1, 5, 0, 0))
    ground.fly(0.1)
    assert ground.last("PING").seq == 5


def test_speeds_outside_the_envelope_are_denied(ground):
    assert ground.command(178, 0, 60.0) == mavlink.MAV_RESULT_DENIED
    assert ground.command(178, 0, 20.0) == mavlink.MAV_RESULT_ACCEPTED
    assert ground.computer.airspeed == 20.0
