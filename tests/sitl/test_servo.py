"""Servos: closed forms against fine integration, and the order of their faults."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_sysid.aircraft import Propulsion, Servo
from gcs_sysid.sitl import servo as servos
from gcs_sysid.sitl.servo import Actuator, follow

ANGLES = st.floats(-1.0, 1.0)
TIMES = st.floats(0.0, 0.5)


def by_small_steps(position, target, duration, time_constant, rate_limit, *, steps=20_000):
    step = duration / steps
    for _ in range(steps):
        rate = (target - position) / time_constant
        position += step * min(max(rate, -rate_limit), rate_limit)
    return position


@pytest.mark.parametrize(
    ("time_constant", "rate_limit"), [(0.05, math.inf), (0.05, 4.0), (0.2, 1.0)]
)
@pytest.mark.parametrize("duration", [0.02, 0.1, 0.4])
def test_motion_is_that_of_the_differential_equation(time_constant, rate_limit, duration):
    exact = follow(-0.2, 0.3, duration, time_constant=time_constant, rate_limit=rate_limit)
    small = by_small_steps(-0.2, 0.3, duration, time_constant, rate_limit)
    # Explicit Euler is off by half a step over the time constant.
    assert exact == pytest.approx(small, abs=duration / 20_000 / time_constant)


@given(ANGLES, ANGLES, TIMES, TIMES, st.sampled_from([0.0, 0.03, 0.2]), st.sampled_from([0.5, 1e9]))
def test_two_moves_are_one(start, target, first, second, time_constant, rate_limit):
    options = {"time_constant": time_constant, "rate_limit": rate_limit}
    halfway = follow(start, target, first, **options)
    assert follow(halfway, target, second, **options) == pytest.approx(
        follow(start, target, first + second, **options), abs=1e-12
    )


@given(ANGLES, ANGLES, TIMES)
def test_it_never_overshoots_or_exceeds_its_rate(start, target, duration):
    end = follow(start, target, duration, time_constant=0.1, rate_limit=2.0)
    assert min(start, target) - 1e-12 <= end <= max(start, target) + 1e-12
    assert abs(end - start) <= 2.0 * duration + 1e-12


def test_a_delayed_command_acts_in_the_middle_of_a_step():
    actuator = Actuator((1000.0, 2000.0), (-1.0, 1.0), start=1500.0, time_constant=0.1, delay=0.013)
    actuator.command(0.0, 2000.0)
    assert actuator.advance(0.0129) == 0.0
    assert actuator.advance(0.02) == pytest.approx(1.0 - math.exp(-0.007 / 0.1), rel=1e-12)


def test_steps_of_any_size_give_the_same_position():
    def flown(times):
        actuator = servos.surface(
            Servo(1, "s", (1000.0, 2000.0), (-0.5, 0.5), 0.04, 0.011, 3.0, 0.02, 0.01, 0.9),
            start=1500.0,
        )
        for tick in range(5):
            actuator.command(0.02 * tick, 1500.0 + 200.0 * (-1.0) ** tick)
        return [actuator.advance(time) for time in times][-1]

    assert flown([0.001 * i for i in range(1, 151)]) == pytest.approx(flown([0.15]), rel=1e-12)


def test_backlash_holds_until_the_play_is_taken_up():
    actuator = Actuator((1000.0, 2000.0), (-1.0, 1.0), start=1500.0, backlash=0.1)
    positions = []
    for i, pulse in enumerate([1600.0, 1580.0, 1560.0, 1500.0]):
        actuator.command(float(i), pulse)
        positions.append(actuator.advance(i + 0.5))
    assert positions == pytest.approx([0.15, 0.15, 0.15, 0.05])


def test_effectiveness_and_offset_act_on_the_commanded_deflection():
    servo = Servo(
        2, "s", (1000.0, 1500.0, 2000.0), (0.4, 0.1, -0.3), offset=0.05, effectiveness=0.5
    )
    assert servos.surface(servo, start=1500.0).position == pytest.approx(0.05 + 0.5 * 0.1)
    assert servos.surface(servo, start=2500.0).position == pytest.approx(0.05 - 0.5 * 0.3)


def test_throttle_runs_from_nothing_to_all():
    thruster = Propulsion(3, (1100.0, 1900.0), (0.0, 1.0), (10.0,), ((0.0,), (9.0,)))
    assert servos.throttle(thruster, start=1100.0).position == 0.0
    assert servos.throttle(thruster, start=1700.0).position == pytest.approx(0.75)
