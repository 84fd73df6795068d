"""Modes: what the vehicle does in each of them."""

from __future__ import annotations

import dataclasses
import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_sysid.sitl import live
from gcs_sysid.sitl.inputs import TestInput
from gcs_sysid.sitl.link import Link
from gcs_sysid.sitl.modes import IGNORE, RELEASE, Mode, Sticks
from gcs_sysid.sitl.navigation import Place, around
from tests.sitl.live.ground import Ground, Wire, usual


def flying(mode: Mode) -> Ground:
    ground = Ground()
    ground.fly(1.0)
    ground.computer.change_mode(mode)
    return ground


def override(ground: Ground, **pulses: int) -> None:
    channels = [pulses.get(f"c{i}", IGNORE) for i in range(1, 9)]
    ground.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *channels))


def test_sticks_move_surfaces_in_manual_until_they_time_out():
    ground = flying(Mode.MANUAL)
    ground.fly(0.2)
    neutral = ground.last("SERVO_OUTPUT_RAW")
    override(ground, c1=1600, c2=1600)
    ground.fly(0.3)
    moved = ground.last("SERVO_OUTPUT_RAW")
    # Right stick: left aileron down, right one up; back stick: elevator up.
    assert moved.servo5_raw - neutral.servo5_raw == pytest.approx(100, abs=1)
    assert moved.servo1_raw - neutral.servo1_raw == pytest.approx(-100, abs=1)
    assert moved.servo2_raw - neutral.servo2_raw == pytest.approx(-100, abs=1)
    assert ground.last("ATTITUDE").rollspeed > 0.1
    assert ground.last("RC_CHANNELS").chan1_raw == 1600
    ground.fly(3.2)
    assert ground.last("SERVO_OUTPUT_RAW").servo2_raw == neutral.servo2_raw


def test_manual_control_is_sticks_with_its_own_signs():
    ground = flying(Mode.MANUAL)
    ground.send(mavlink.MAVLink_manual_control_message(1, -200, 200, 700, 0, 0))
    ground.fly(0.3)
    channels = ground.computer.status(ground.vehicle.time).channels
    assert channels[:4] == (1600, 1600, 1700, 1500)


def test_overrides_can_be_ignored_and_released():
    sticks = Sticks({3: 1400}).override({1: 1700, 3: 1900}, 10.0)
    kept = sticks.override({1: IGNORE, 3: RELEASE}, 11.0)
    assert (kept.pulse(1, 12.9), kept.pulse(1, 13.1)) == (1700, 1500)
    assert kept.pulse(3, 11.0) == 1400


def test_the_stick_banks_in_fly_by_wire():
    ground = flying(Mode.FBWA)
    for _ in range(4):
        override(ground, c1=1750)
        ground.fly(1.0)
    limit = math.radians(ground.computer.parameters["ROLL_LIMIT_DEG"])
    assert ground.last("ATTITUDE").roll == pytest.approx(0.5 * limit, abs=0.05)


def test_it_circles_at_its_radius_and_height():
    ground = flying(Mode.LOITER)
    ground.fly(10.0)
    radius = ground.computer.parameters["WP_LOITER_RAD"]
    centre = ground.computer.target
    for _ in range(3):
        ground.fly(3.0)
        place = ground.last("LOCAL_POSITION_NED")
        away = math.hypot(place.x - centre.north, place.y - centre.east)
        assert away == pytest.approx(radius, rel=0.15)
        assert -place.z == pytest.approx(centre.height, abs=3.0)
        assert ground.last("ATTITUDE").roll > 0.2, "clockwise"


def test_a_course_leads_onto_a_circle_both_ways():
    centre = Place(0.0, 0.0, 100.0)
    west = Place(0.0, -100.0, 100.0)
    assert around(west, centre, 100.0, lead=0.0) == pytest.approx(0.0)
    assert abs(around(west, centre, -100.0, lead=0.0)) == pytest.approx(math.pi)
    far = Place(0.0, -5000.0, 100.0)
    assert around(far, centre, 100.0, lead=0.0) == pytest.approx(math.pi / 2.0)


def test_it_goes_where_it_is_guided():
    ground = flying(Mode.AUTO)
    latitude = 47.3 + math.degrees(150.0 / 6371000.0)
    place = (round(latitude * 1e7), round(8.5e7), 130.0)
    head = (1, 1, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, 192, 0, 0)
    ground.send(mavlink.MAVLink_command_int_message(*head, -1, 1, 0, 0, *place))
    ground.fly(0.2)
    assert ground.last("COMMAND_ACK").result == mavlink.MAV_RESULT_ACCEPTED
    assert ground.computer.mode == Mode.GUIDED
    ground.fly(18.0)
    here = ground.last("LOCAL_POSITION_NED")
    radius = ground.computer.parameters["WP_LOITER_RAD"]
    assert math.hypot(here.x - 150.0, here.y) == pytest.approx(radius, rel=0.3)
    assert -here.z == pytest.approx(130.0, abs=4.0)


def test_an_attitude_target_is_held_and_times_out():
    ground = flying(Mode.GUIDED)
    half = math.radians(10.0)
    q = [math.cos(half), math.sin(half), 0.0, 0.0]
    target = mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 0b111, q, 0.0, 0.0, 0.0, 0.45)
    for _ in range(3):
        ground.send(target)
        ground.fly(1.0)
    assert ground.last("ATTITUDE").roll == pytest.approx(2.0 * half, abs=0.03)
    assert ground.last("VFR_HUD").throttle == 45
    ground.fly(4.0)
    assert ground.last("ATTITUDE").roll != pytest.approx(2.0 * half, abs=0.01)
    assert ground.computer.attitude.until < ground.vehicle.time


def test_without_a_mission_it_flies_its_legs_over_and_over_with_their_inputs():
    step = TestInput("elevator", "step", 0.5, 0.4, 0.1)
    base = usual()
    first = dataclasses.replace(base.legs[0], name="first", duration=1.0, inputs=(step,))
    second = dataclasses.replace(first, name="second", inputs=())
    ground = Ground(dataclasses.replace(base, legs=(first, second)))
    ground.fly(2.5)
    texts = [m.text for m in ground.received if m.get_type() == "STATUSTEXT"]
    assert texts == ["Leg: first", "Leg: second", "Leg: first"]
    pulses = [m.servo2_raw for m in ground.received if m.get_type() == "SERVO_OUTPUT_RAW"]
    # 0.1 rad are 115 µs; nothing has moved yet that the autopilot could answer.
    assert pulses[25] - pulses[24] == pytest.approx(115, abs=3)


def test_a_radio_loses_and_delays():
    ground = Ground(usual(link=Link(latency=0.1, jitter=0.02, loss=0.2)))
    counts = ground.counts(4.0)
    # Four standard deviations of a binomial loss; the first tenth of a second is under way.
    assert counts["ATTITUDE"] == pytest.approx(0.8 * 195, abs=4.0 * math.sqrt(0.16 * 200))
    first = next(m for m in ground.received if m.get_type() == "ATTITUDE")
    assert first.time_boot_ms < 93_200


def test_a_hidden_effect_reaches_a_live_vehicle():
    flight = usual()
    late = dataclasses.replace(flight.hidden, delays={"ATTITUDE": 0.05})
    ground = Ground(dataclasses.replace(flight, hidden=late))
    ground.fly(0.5)
    stamps = [m.time_boot_ms for m in ground.received if m.get_type() == "ATTITUDE"]
    assert stamps[0] == 93_050


def test_real_time_is_kept_by_waiting_and_given_up_when_too_slow(caplog):
    time = 0.0
    waits: list[float] = []

    def wait(seconds: float) -> None:
        nonlocal time
        waits.append(seconds)
        time += seconds

    vehicle = live.LiveVehicle(usual(), Wire())
    live.fly(vehicle, duration=0.2, now=lambda: time, wait=wait)
    assert time == pytest.approx(0.2)
    assert waits == pytest.approx([0.02] * 10)

    slow = live.LiveVehicle(usual(), Wire())
    late = iter(range(1, 1000))
    live.fly(slow, duration=0.2, now=lambda: float(next(late)), wait=wait)
    assert [record.message for record in caplog.records] == [
        "this machine is too slow to fly in real time"
    ]
