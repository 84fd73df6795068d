from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.aircraft import COEFFICIENTS, FORCES, MOMENTS, Imu
from gcs_sysid.errors import RefusedError
from gcs_sysid.offline.asking import ask
from gcs_sysid.offline.modes import AXES, DENSITY, axes_of, modes
from gcs_sysid.offline.requirements import check
from gcs_sysid.reconstruct.airborne import airborne
from gcs_sysid.recording import NO_AUTOPILOT, Vehicle
from tests.offline.made_aircraft import small
from tests.reconstruct.made_flights import flight, without

FLIGHT = flight(duration=90.0, feedback=10.0)


def refused(recording, aircraft=None):
    usable = check(recording, aircraft).usable
    return {name for name, reason in usable.items() if reason is not None}


@pytest.mark.parametrize("aircraft", [None, small(), small(aerodynamics=False)])
def test_a_complete_flight_is_refused_nothing(aircraft):
    found = check(FLIGHT, aircraft)
    assert found.usable == dict.fromkeys(COEFFICIENTS)
    found.raise_if_unusable()


@pytest.mark.parametrize(
    ("lost", "said"),
    [
        (["VFR_HUD.airspeed"], "no airspeed was recorded"),
        (["RAW_IMU", "ATTITUDE.p"], "no angular rate was recorded"),
        (["ATTITUDE.roll"], "no attitude was recorded"),
        (["GLOBAL_POSITION_INT.v_north"], "no velocity over ground"),
        (["SERVO_OUTPUT_RAW"], "no surface command was recorded"),
        (["SCALED_PRESSURE", "GLOBAL_POSITION_INT.altitude"], "air density is unknown"),
    ],
)
def test_what_every_coefficient_needs_is_asked_for_by_message_and_rate(lost, said):
    found = check(without(FLIGHT, *lost), small())
    assert all(reason is not None for reason in found.usable.values())
    with pytest.raises(RefusedError) as caught:
        found.raise_if_unusable()
    message = str(caught.value)
    assert said in message
    assert "ask for" in message
    assert " Hz (ArduPilot: SR0_" in message
    assert "\n" not in message


def test_without_an_accelerometer_forces_are_refused_and_moments_are_not():
    lost = without(FLIGHT, "RAW_IMU")
    found = check(lost, small())
    assert refused(lost, small()) == set(FORCES)
    assert "forces cannot be measured" in str(found.usable["CX"])
    found.raise_if_unusable()


def test_an_accelerometer_that_ran_only_before_take_off_is_none():
    """A stream that exists but is silent in flight passed as measured."""
    recording = flight(duration=150.0, airborne=(60.0, 140.0))
    imu = recording.streams["RAW_IMU"]
    before = imu.time < 50.0
    silenced = replace(
        imu,
        channels={
            name: np.where(before, values, np.nan) if name.startswith("acc") else values
            for name, values in imu.channels.items()
        },
    )
    recording = replace(recording, streams={**recording.streams, "RAW_IMU": silenced})
    assert refused(recording, small()) == set(FORCES)


@pytest.mark.parametrize("aircraft", [None, small(), small(aerodynamics=False)])
def test_four_hertz_is_refused_with_the_mode_that_needs_more(aircraft):
    found = check(flight(duration=90.0, feedback=10.0, rate=4.0), aircraft)
    assert refused(flight(duration=90.0, feedback=10.0, rate=4.0), aircraft) >= set(MOMENTS) - {
        "Cn"
    }
    reason = str(found.usable["Cm"])
    assert "angular rate at 4.0 Hz: the short period (" in reason
    assert "RAW_IMU at 50 Hz" in reason or "RAW_IMU at 100 Hz" in reason
    assert any("SERVO_OUTPUT_RAW" in line for line in found.next_flight)


def test_a_big_slow_aircraft_may_be_sampled_slowly():
    manned = small(aerodynamics=False, span=30.0)
    assert "Cm" not in refused(flight(duration=90.0, feedback=10.0, rate=4.0), manned)


def test_a_surface_whose_output_is_not_in_the_log_is_named_with_its_channel():
    lost = without(FLIGHT, "SERVO_OUTPUT_RAW.pwm_2")
    assert refused(lost, small()) == {"CZ", "Cm"}  # what the file's model uses the elevator in
    assert refused(lost, small(aerodynamics=False)) == set(AXES["pitch"])
    reason = str(check(lost, small()).usable["Cm"])
    assert "`elevator` is not in the log: SERVO_OUTPUT_RAW has no servo2 (it has 1, 3, 4)" in reason


def test_findings_that_rule_everything_out_together_are_told_together():
    lost = without(FLIGHT, *(f"SERVO_OUTPUT_RAW.pwm_{channel}" for channel in (1, 2, 4)))
    bare = small(aerodynamics=False)
    with pytest.raises(RefusedError) as caught:
        check(lost, bare).raise_if_unusable()
    message = str(caught.value)
    assert "`elevator` is not in the log" in message
    assert "`aileron` is not in the log" in message or "`rudder` is not in the log" in message
    assert message.count("check `[[servos]] channel`") == 1


def test_commands_that_are_missing_altogether_name_the_controls():
    reason = str(check(without(FLIGHT, "SERVO_OUTPUT_RAW"), small()).usable["Cm"])
    assert "so nothing is known of aileron, elevator, rudder" in reason


def test_a_table_is_asked_for_columns_not_for_messages():
    table = replace(FLIGHT, vehicle=replace(FLIGHT.vehicle, autopilot=NO_AUTOPILOT))
    assert ask(table, "RAW_IMU", 49.2) == (
        "log acc_x to acc_z and p, q, r at 50 Hz and name the columns in the column map"
    )
    reason = str(check(without(table, "SERVO_OUTPUT_RAW.pwm_2"), small()).usable["Cm"])
    assert "`elevator` is not in the table: the column map names no `pwm_2`" in reason
    assert "add it to the column map" in reason
    assert "MAVLink" not in reason


def test_an_aircraft_that_never_flew_is_refused_with_how_fast_it_was():
    ground = flight(duration=60.0, airborne=(500.0, 600.0))
    with pytest.raises(RefusedError, match=r"airspeed stays below \d\.\d m/s, and made up flies"):
        check(ground, small()).raise_if_unusable()


def test_an_estimated_airspeed_and_other_vehicles_are_remarked_not_refused():
    other = Vehicle(7, 1, "MAV_AUTOPILOT_PX4", "MAV_TYPE_QUADROTOR", 10)
    recording = replace(FLIGHT, parameters={"ARSPD_TYPE": 0.0}, others=(other,))
    found = check(recording, small())
    assert not refused(recording, small())
    assert "ARSPD_TYPE is 0" in found.warnings[0]
    assert "vehicles in this log: 7" in found.warnings[1]


def test_each_autopilot_is_asked_in_its_own_words():
    assert "SR0_RAW_SENS = 50" in ask(FLIGHT, "RAW_IMU", 50.0)
    px4 = replace(FLIGHT, vehicle=replace(FLIGHT.vehicle, autopilot="MAV_AUTOPILOT_PX4"))
    assert "-s HIGHRES_IMU -r 50" in ask(px4, "RAW_IMU", 50.0)
    assert "MAV_0_RATE" in ask(px4, "RAW_IMU", 50.0)


def test_an_onboard_log_is_asked_for_by_its_own_parameters():
    """Servo outputs come at 25 Hz in ArduPlane's log, so telemetry has to bring them."""
    onboard = replace(FLIGHT, source="00000042.BIN")
    assert "LOG_BITMASK = 1114111" in ask(onboard, "RAW_IMU", 50.0)
    servos = ask(onboard, "SERVO_OUTPUT_RAW", 50.0)
    assert servos.startswith("record telemetry beside the onboard log: ask for SERVO_OUTPUT_RAW")
    px4 = replace(onboard, vehicle=replace(FLIGHT.vehicle, autopilot="MAV_AUTOPILOT_PX4"))
    assert "SDLOG_PROFILE = 17" in ask(replace(px4, source="a.ulg"), "SERVO_OUTPUT_RAW", 50.0)


def placed(told, position):
    told = dict(zip(("INS_POS1_X", "INS_POS1_Y", "INS_POS1_Z"), told, strict=True))
    aircraft = replace(small(), imu=Imu(position=position))
    return check(replace(FLIGHT, parameters=told), aircraft).warnings


def test_velocity_of_the_unit_instead_of_the_centre_of_gravity_is_warned_of():
    """An ArduPilot whose INS_POS1 is zero gives the velocity of its own place."""
    (warning,) = placed((0.0, 0.0, 0.0), (0.3, 0.0, -0.04))
    assert "velocity in this log is that of the inertial unit, 0.30 m from" in warning
    assert "set INS_POS1_X, Y, Z = 0.30, 0.00, -0.04" in warning


def test_places_that_contradict_each_other_are_warned_of():
    (warning,) = placed((0.1, 0.0, 0.0), (0.3, 0.0, 0.0))
    assert "at 0.10, 0.00, 0.00 m from" in warning


def test_places_that_agree_are_not():
    assert placed((0.0, 0.0, 0.0), (0.01, 0.0, 0.0)) == ()
    assert placed((0.3, 0.0, 0.0), (0.3, 0.0, 0.01)) == ()


def test_the_modes_of_a_described_aircraft_are_those_of_its_linear_model():
    """Second way: eigenvalues of the short-period matrix and the roll pole."""
    aircraft = small()
    guess = modes(FLIGHT, aircraft, airborne(FLIGHT, aircraft))
    assert guess is not None
    speed = float(np.median(FLIGHT.streams["VFR_HUD"].channels["airspeed"]))
    force = 0.5 * DENSITY * speed**2 * 0.55
    half_chord, half_span = 0.19 / (2.0 * speed), 2.9 / (2.0 * speed)
    matrix = np.array(
        [
            [-5.65 * force / (11.0 * speed), 1.0],
            [-2.74 * force * 0.19 / 1.135, -38.21 * half_chord * force * 0.19 / 1.135],
        ]
    )
    frequency = np.abs(np.linalg.eigvals(matrix)[0]) / (2.0 * np.pi)
    assert guess.by_axis["pitch"][1] == pytest.approx(frequency, rel=1e-3)
    pole = 0.51 * half_span * force * 2.9 / 0.824 / (2.0 * np.pi)
    assert guess.by_axis["roll"][1] == pytest.approx(pole, rel=1e-3)
    stiffness = np.sqrt(0.073 * force * 2.9 / 1.759) / (2.0 * np.pi)
    assert guess.by_axis["yaw"][1] == pytest.approx(stiffness, rel=1e-3)


def test_without_derivatives_modes_scale_with_the_root_of_the_span():
    flights = airborne(FLIGHT)
    large, little = (
        modes(FLIGHT, small(aerodynamics=False, span=span), flights) for span in (11.0, 2.75)
    )
    assert large is not None
    assert little is not None
    for axis in AXES:
        assert little.by_axis[axis][1] == pytest.approx(2.0 * large.by_axis[axis][1])
    assert 2.0 * np.pi * large.by_axis["pitch"][1] == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("name", "axes"),
    [
        ("elevator", ("pitch",)),
        ("Aileron_right", ("roll",)),
        ("flaperon_left", ("roll",)),
        ("elevon_left", ("pitch", "roll")),
        ("vtail_right", ("pitch", "yaw")),
        ("servo4", ("yaw",)),
        ("servo9", ()),
    ],
)
def test_a_control_is_placed_on_its_axes_by_its_name(name, axes):
    assert axes_of(name) == axes
