from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.aircraft import Aircraft, Propulsion, StreamTiming
from gcs_sysid.errors import RefusedError
from gcs_sysid.offline import flight
from gcs_sysid.reconstruct.reconstruction import States
from gcs_sysid.reconstruct.segments import Segment
from gcs_sysid.recording import Recording, Stream, Vehicle
from tests.estimate import made_motion
from tests.offline.made_aircraft import small

TIME = np.arange(500) / 50.0
SEA_LEVEL = 1.225


def recording(**streams: Mapping[str, np.ndarray]) -> Recording:
    return Recording(
        "made.tlog", "", Vehicle(1, 1, "MAV_AUTOPILOT_GENERIC", "MAV_TYPE_FIXED_WING", 1), 0,
        {name: Stream(name, TIME, TIME, channels) for name, channels in streams.items()},
    )  # fmt: skip


def states(speed: float = 20.0, density: float = SEA_LEVEL) -> States:
    """Straight flight."""
    flow = {"V": np.full(TIME.size, speed), "alpha": 0.0 * TIME, "beta": 0.0 * TIME}
    still = np.zeros((TIME.size, 3))
    straight = made_motion.states(TIME, still, still, flow, lever=np.zeros(3))
    return replace(straight, density=np.full(TIME.size, density))


def pulses(**values: float) -> dict[str, np.ndarray]:
    return {name: np.full(TIME.size, value) for name, value in values.items()}


ENGINE = Propulsion(
    3, (1000.0, 2000.0), (0.0, 1.0), (10.0, 30.0), ((0.0, 0.0), (40.0, 20.0)),
    axis=(2.0, 0.0, -0.2), position=(0.4, -0.1, 0.05), torque=((0.0, 0.0), (0.8, 0.8)),
)  # fmt: skip


def powered(*engines: Propulsion) -> Aircraft:
    aircraft = small()
    return replace(aircraft, propulsion=engines, mass=replace(aircraft.mass, cg=(0.1, 0.02, -0.03)))


def test_thrust_acts_along_its_axis_about_the_centre_of_gravity() -> None:
    """Half throttle at 20 m/s in air four fifths as dense: 0.5 · 30 N · 0.8, written out."""
    record = recording(SERVO_OUTPUT_RAW=pulses(pwm_3=1500.0))
    found = flight.thrust(record, powered(ENGINE), states(20.0, 0.8 * SEA_LEVEL))
    axis = np.array([2.0, 0.0, -0.2]) / np.hypot(2.0, 0.2)
    push = 12.0 * axis
    lever = np.array([0.4 - 0.1, -0.1 - 0.02, 0.05 + 0.03])
    moment = np.cross(lever, push) + 0.8 * 0.4 * axis
    assert found.force[100] == pytest.approx(push)
    assert found.moment[100] == pytest.approx(moment)
    assert found.sigma == 0.1


def test_thrust_of_engines_adds_up_and_symmetric_ones_do_not_yaw() -> None:
    left = replace(ENGINE, axis=(1.0, 0.0, 0.0), position=(0.0, -1.0 + 0.02, 0.0), torque=None)
    right = replace(left, position=(0.0, 1.0 + 0.02, 0.0), throttle_channel=5, thrust_sigma=0.2)
    record = recording(SERVO_OUTPUT_RAW=pulses(pwm_3=1500.0, pwm_5=1500.0))
    both = flight.thrust(record, powered(left, right), states())
    assert both.force[0] == pytest.approx([30.0, 0.0, 0.0])
    assert both.moment[0, 2] == pytest.approx(0.0, abs=1e-12)
    assert both.sigma == 0.2
    record = recording(SERVO_OUTPUT_RAW=pulses(pwm_3=2000.0, pwm_5=1000.0))
    one = flight.thrust(record, powered(left, right), states())
    assert one.moment[0, 2] == pytest.approx(30.0), "the left engine yaws right"


def test_each_engine_turns_at_its_own_measured_speed() -> None:
    """`rpm_channel` says which motor; all engines once read the first motor's speed."""
    first = replace(
        ENGINE, throttle=(), rpm=(0.0, 8000.0), rpm_channel=1, torque=None, axis=(1.0, 0.0, 0.0)
    )
    second = replace(first, rpm_channel=2, throttle_channel=5)
    record = recording(
        SERVO_OUTPUT_RAW=pulses(pwm_3=1500.0, pwm_5=1500.0),
        ESC_TELEMETRY_1_TO_4=pulses(rpm_1=8000.0, rpm_2=4000.0),
    )
    assert flight.thrust(record, powered(first), states()).force[0, 0] == pytest.approx(30.0)
    assert flight.thrust(record, powered(second), states()).force[0, 0] == pytest.approx(15.0)


def test_a_motor_whose_speed_was_not_recorded_is_refused() -> None:
    engine = replace(ENGINE, throttle=(), rpm=(0.0, 8000.0), rpm_channel=2)
    record = recording(
        SERVO_OUTPUT_RAW=pulses(pwm_3=1500.0), ESC_TELEMETRY_1_TO_4=pulses(rpm_1=8000.0)
    )
    with pytest.raises(RefusedError, match="motor 2"):
        flight.thrust(record, powered(engine), states())


def test_a_throttle_that_is_not_in_the_log_is_refused() -> None:
    record = recording(SERVO_OUTPUT_RAW=pulses(pwm_1=1500.0))
    with pytest.raises(RefusedError, match="has no servo3"):
        flight.thrust(record, powered(ENGINE), states())


def test_a_late_stream_is_late_for_the_throttle_too() -> None:
    """A step of the throttle in commands that come a quarter of a second late."""
    pwm = np.where(TIME < 5.0, 1000.0, 2000.0)
    record = recording(SERVO_OUTPUT_RAW={"pwm_3": pwm})
    made = powered(ENGINE)
    late = replace(made, streams={"SERVO_OUTPUT_RAW": StreamTiming(0.25, None)})
    at = np.array([5.1, 5.2, 5.4, 6.0])
    on_time = flight.setting(record, made, ENGINE, at)
    np.testing.assert_allclose(flight.setting(record, late, ENGINE, at + 0.25), on_time)
    assert flight.setting(record, late, ENGINE, at)[0] == 0.0
    assert on_time[0] > 0.0


def test_an_aircraft_without_engines_has_no_thrust() -> None:
    found = flight.thrust(recording(SERVO_OUTPUT_RAW=pulses(pwm_1=1500.0)), powered(), states())
    assert not found.force.any()
    assert not found.moment.any()
    assert found.sigma == 0.0


def test_a_control_without_its_servo_takes_its_terms_along() -> None:
    aircraft = flight.without_controls(small(), ["elevator"])
    assert aircraft.control_names == ("aileron", "rudder")
    assert set(aircraft.aerodynamics["Cm"].terms) == {"alpha", "qhat"}
    assert set(aircraft.aerodynamics["Cl"].terms) == {"phat", "aileron"}
    assert flight.without_controls(small(), []) == small()


def segment(number: int, kind: str, start: float, end: float) -> Segment:
    return Segment(number, kind, start, end)


def test_deliberate_inputs_tell_the_delay_where_they_are_long_enough() -> None:
    short = [segment(1, "doublet", 1.0, 3.0), segment(2, "turn", 4.0, 9.0)]
    rows = flight._input_rows(TIME, short)
    assert TIME[rows].min() == 1.0
    assert TIME[rows].max() == pytest.approx(8.98), "two seconds of inputs: ordinary flight helps"
    time = np.arange(2000) / 50.0
    long = [segment(1, "multisine", 1.0, 20.0), segment(2, "turn", 22.0, 39.0)]
    chosen = time[flight._input_rows(time, long)]
    assert (chosen.min(), chosen.max()) == (1.0, pytest.approx(19.98))
