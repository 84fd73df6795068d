"""Sensors: what they say with an effect and without, of the same state."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_sysid.sitl import record
from gcs_sysid.sitl.autopilot import PERIOD
from gcs_sysid.sitl.inputs import TestInput
from gcs_sysid.sitl.plan import Leg
from tests.sitl.effects import hidden


def pair(name: str, **sizes: float):
    base = hidden.measured(hidden.flight(), hidden.MOVING)
    return base, hidden.measured(hidden.hide(name, **sizes), hidden.MOVING)


def test_indicated_airspeed_is_true_and_a_tenth_less():
    before, after = pair("airspeed_scale", airspeed_scale=-0.1)
    assert after.indicated_airspeed == pytest.approx(0.9 * before.indicated_airspeed)
    assert after.dynamic_pressure == pytest.approx(0.81 * before.dynamic_pressure)


def test_a_slow_tube_answers_a_step_late():
    faster = dataclasses.replace(hidden.MOVING, u_air=25.0)
    states = [hidden.MOVING] + [faster] * 10
    slow = hidden.measured(hidden.hide("pitot_lag", pitot_lag=0.2), *states).indicated_airspeed
    start = hidden.measured(hidden.flight(), hidden.MOVING).indicated_airspeed
    end = hidden.measured(hidden.flight(), faster).indicated_airspeed
    # Nine samples and a half of the step have been seen when the last one is taken.
    left = math.exp(-9.5 * PERIOD / 0.2)
    assert (end - slow) / (end - start) == pytest.approx(left, rel=(PERIOD / 0.2) ** 2 / 20.0)


def test_a_biased_accelerometer_says_more():
    before, after = pair("accelerometer_bias", bias_x=0.3, bias_z=-0.5)
    difference = np.subtract(after.specific_force, before.specific_force)
    assert difference == pytest.approx([0.3, 0.0, -0.5])


def test_a_gyro_with_a_scale_error_says_more_of_what_turns():
    before, after = pair("gyro_scale", scale_x=0.03, scale_z=-0.02)
    assert np.divide(after.rates, before.rates) == pytest.approx([1.03, 1.0, 0.98])


def test_a_unit_pitched_up_feels_lift_as_thrust():
    """Its x axis points up by the tilt, along the lift; its rates are turned alike."""
    before, after = pair("imu_misalignment", tilt_y=0.05)
    x, _, z = before.specific_force
    assert after.specific_force[0] == pytest.approx(x * math.cos(0.05) - z * math.sin(0.05))
    assert after.specific_force[0] > x
    p, _, r = before.rates
    assert after.rates[2] == pytest.approx(r * math.cos(0.05) + p * math.sin(0.05))


def test_a_unit_further_ahead_feels_pitch_acceleration():
    before, after = pair("imu_position", dx=0.1)
    state = hidden.MOVING
    wanted = (
        -(state.q**2 + state.r**2) * 0.1,
        state.p * state.q * 0.1,
        (state.p * state.r - state.q_dot) * 0.1,
    )
    assert np.subtract(after.specific_force, before.specific_force) == pytest.approx(wanted)


def test_biased_vanes_say_more():
    before, after = pair("vane_bias", alpha_bias=0.03, beta_bias=-0.02)
    assert after.alpha - before.alpha == pytest.approx(0.03)
    assert after.beta - before.beta == pytest.approx(-0.02)


def test_a_turned_compass_turns_heading_and_nothing_else():
    before, after = pair("heading_bias", heading_bias=0.1)
    assert after.attitude[2] - before.attitude[2] == pytest.approx(0.1)
    assert after.attitude[:2] == before.attitude[:2]
    assert after.velocity == before.velocity


def decoded(flown: record.Flown, kind: str) -> list:
    parser = mavlink.MAVLink(None)
    found = [parser.parse_char(frame.data) for frame in flown.frames]
    return [m for m in found if m is not None and m.get_type() == kind]


@pytest.fixture(scope="module")
def punctual() -> record.Flown:
    return record.fly(hidden.flight())


@pytest.mark.parametrize(("stream", "delay"), [("ATTITUDE", 0.05), ("SERVO_OUTPUT_RAW", -0.05)])
def test_a_late_stream_says_the_same_later(punctual, stream, delay):
    late = record.fly(hidden.hide("time_skew", stream=stream, delay=delay))
    stamp, unit = ("time_boot_ms", 1e3) if stream == "ATTITUDE" else ("time_usec", 1e6)
    for old, new in zip(decoded(punctual, stream), decoded(late, stream), strict=True):
        before, after = old.to_dict(), new.to_dict()
        assert after.pop(stamp) - before.pop(stamp) == round(0.05 * unit)
        assert before == after
    assert np.array_equal(punctual.truth.rows, late.truth.rows)
    other = "RAW_IMU"
    assert [m.to_dict() for m in decoded(punctual, other)] == [
        m.to_dict() for m in decoded(late, other)
    ]


def test_surfaces_move_later_after_servo_outputs_that_are_early():
    """The first motion after a step of 0.1 rad comes two and a half periods later."""
    step = TestInput("elevator", "step", 0.2, 1.0, 0.1)
    legs = (Leg("step", 1.0, 18.0, 120.0, inputs=(step,)),)
    base = dataclasses.replace(hidden.flight(), legs=legs)
    late = hidden.hide("time_skew", base, stream="SERVO_OUTPUT_RAW", delay=0.06)
    moved = []
    for made in (base, late):
        elevator = record.fly(made).truth.column("elevator")
        moved.append(np.flatnonzero(np.abs(elevator - elevator[9]) > 0.02)[0])
    assert moved[1] - moved[0] == 3
