"""Choice of streams, slots on the gyro's clock, and the aircraft file's known errors undone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from gcs_sysid import atmosphere, frames
from gcs_sysid.aircraft import Aircraft, Imu, Pitot, SensorError, StreamTiming, Vanes
from gcs_sysid.errors import RefusedError
from gcs_sysid.model.kinematics import GRAVITY, MEASURED
from gcs_sysid.reconstruct import measurements
from gcs_sysid.reconstruct.measurements import FlightData
from gcs_sysid.recording import Recording, Stream
from tests.reconstruct import kinematic_flights
from tests.reconstruct.kinematic_flights import without

EVERYTHING = (-np.inf, np.inf)
GROUP = {name: index for index, name in enumerate(MEASURED)}


@pytest.fixture(scope="module")
def recording() -> Recording:
    return kinematic_flights.flight(20, duration=10.0).recording


@pytest.fixture(scope="module")
def aircraft() -> Aircraft:
    return kinematic_flights.aircraft()


def altered(recording: Recording, name: str, **channels: np.ndarray) -> Recording:
    stream = recording.streams[name]
    changed = replace(stream, channels={**stream.channels, **channels})
    return replace(recording, streams={**recording.streams, name: changed})


def seen(data: FlightData, group: str) -> tuple[np.ndarray, np.ndarray]:
    """Times at which a group's samples describe the aircraft, and their values."""
    valid = data.measured.valid[:, GROUP[group]]
    times = data.time[valid] + data.measured.age[valid, GROUP[group]]
    return times, getattr(data.measured, group)[valid]


def test_airspeed_is_as_shown_where_the_lag_of_the_tube_is_modelled(
    recording: Recording, aircraft: Aircraft
) -> None:
    """What the file's lag moved earlier lies where it lay without it; nothing else is moved."""
    lag = 0.17
    lagging = replace(aircraft, pitot=replace(aircraft.pitot, error=SensorError(lag=lag)))
    data = measurements.select(recording, lagging, EVERYTHING)
    shown = replace(data, measured=measurements.as_shown(data, lag))
    plain = measurements.select(recording, aircraft, EVERYTHING)
    times, airspeed = seen(shown, "airspeed")
    wanted_times, wanted = seen(plain, "airspeed")
    both = np.isin(np.round(wanted_times, 6), np.round(times, 6))
    assert both.sum() > 0.9 * both.size
    np.testing.assert_allclose(times, wanted_times[both], atol=1e-9)
    # True airspeed is worked out with the pressure of 0.17 s before.
    np.testing.assert_allclose(airspeed, wanted[both], rtol=1e-4)
    for group in ("velocity", "attitude"):
        for now, before in zip(seen(shown, group), seen(data, group), strict=True):
            np.testing.assert_array_equal(now, before)


def test_each_sample_lies_on_the_nearest_inertial_one_with_its_age(
    recording: Recording, aircraft: Aircraft
) -> None:
    data = measurements.select(recording, aircraft, EVERYTHING)
    stream = recording.streams["GLOBAL_POSITION_INT"]
    times, velocity = seen(data, "velocity")
    np.testing.assert_allclose(times, stream.time, atol=1e-12)
    np.testing.assert_array_equal(velocity[:, 1], stream.channels["v_east"])
    half = 0.5 / 50.0
    assert np.abs(data.measured.age).max() <= half + 1e-9
    assert data.rates["velocity"] == pytest.approx(5.0, rel=0.1)
    assert data.used["velocity"] == "GLOBAL_POSITION_INT"


def test_an_airspeed_shown_again_is_no_measurement(
    recording: Recording, aircraft: Aircraft
) -> None:
    """Measured every fifth time that it is told, as ArduPlane does; rounded ones may repeat."""
    stream = recording.streams["VFR_HUD"]
    measured = 5 * (np.arange(stream.time.size) // 5)
    airspeed = stream.channels["airspeed"].astype(np.float32).astype(float)
    shown = measurements.select(
        altered(recording, "VFR_HUD", airspeed=airspeed[measured]), aircraft, EVERYTHING
    )
    times, _ = seen(shown, "airspeed")
    np.testing.assert_allclose(times, stream.time[::5], atol=1e-12)
    rounded = np.round(airspeed[measured], 2).astype(np.float32).astype(float)
    coarse = measurements.select(
        altered(recording, "VFR_HUD", airspeed=rounded), aircraft, EVERYTHING
    )
    np.testing.assert_allclose(seen(coarse, "airspeed")[0], stream.time, atol=1e-12)


def test_of_two_samples_on_one_row_the_nearer_stays() -> None:
    time = np.array([0.0, 0.1, 0.2])
    rows, chosen, offset = measurements._slots(time, np.array([0.07, 0.11, 0.16, 0.201, 0.6]))
    np.testing.assert_array_equal(rows, [1, 2])
    np.testing.assert_array_equal(chosen, [1, 3])  # 0.6 s is too far from any row
    np.testing.assert_allclose(offset, [0.01, 0.001])


def test_what_was_not_measured_is_not_slotted(recording: Recording, aircraft: Aircraft) -> None:
    east = recording.streams["GLOBAL_POSITION_INT"].channels["v_east"].copy()
    east[::2] = np.nan
    data = measurements.select(
        altered(recording, "GLOBAL_POSITION_INT", v_east=east), aircraft, EVERYTHING
    )
    _, velocity = seen(data, "velocity")
    assert velocity.shape[0] == east[1::2].size
    assert np.isfinite(velocity).all()


def test_a_pitot_tube_at_a_standstill_says_nothing(
    recording: Recording, aircraft: Aircraft
) -> None:
    speed = recording.streams["VFR_HUD"].channels["airspeed"].copy()
    speed[:40] = 1.0
    data = measurements.select(altered(recording, "VFR_HUD", airspeed=speed), aircraft, EVERYTHING)
    assert seen(data, "airspeed")[1].min() > 10.0
    assert seen(data, "airspeed")[1].shape[0] == speed.size - 40


def test_the_fastest_inertial_stream_and_the_first_of_the_others_are_used(
    recording: Recording, aircraft: Aircraft
) -> None:
    imu = recording.streams["RAW_IMU"]
    slow = Stream("HIGHRES_IMU", imu.time[::5], imu.time[::5],
                  {name: values[::5] for name, values in imu.channels.items()})  # fmt: skip
    speed = recording.streams["VFR_HUD"]
    both = replace(
        recording,
        streams={
            **recording.streams,
            "HIGHRES_IMU": slow,
            "AIRSPEED": replace(speed, name="AIRSPEED"),
        },
    )
    used = measurements.select(both, aircraft, EVERYTHING).used
    assert used["gyro"] == "RAW_IMU"
    assert used["airspeed"] == "AIRSPEED"


def test_without_accelerometer_the_aircraft_is_taken_to_fly_unaccelerated(
    recording: Recording,
) -> None:
    """Bias and scale of an accelerometer that is not there must not bend the made-up values."""
    believed = replace(
        kinematic_flights.aircraft(),
        imu=Imu(accelerometer=SensorError(bias=(1.0, 2.0, 3.0), scale=(0.1, 0.1, 0.1))),
    )
    data = measurements.select(without(recording, "RAW_IMU"), believed, EVERYTHING)
    assert not data.has_accelerometer
    assert data.used["gyro"] == "ATTITUDE"
    assert "accelerometer" not in data.used
    np.testing.assert_allclose(np.linalg.norm(data.accelerometer, axis=1), GRAVITY, rtol=1e-12)
    times, quaternions = seen(data, "attitude")
    inside = np.isin(times, data.time)
    up = frames.unrotate(quaternions[inside], np.array([[0.0, 0.0, -GRAVITY]]))
    rows = np.isin(data.time, times)
    np.testing.assert_allclose(data.accelerometer[rows], up, atol=1e-9)


def test_without_vanes_in_the_file_or_in_the_log_none_are_used(
    recording: Recording, aircraft: Aircraft
) -> None:
    for log, believed in (
        (recording, kinematic_flights.aircraft(vanes=False)),
        (without(recording, "AOA_SSA"), aircraft),
    ):
        data = measurements.select(log, believed, EVERYTHING)
        assert "vanes" not in data.used
        assert not data.measured.valid[:, GROUP["vanes"]].any()


@pytest.mark.parametrize("measures", ["EAS", "CAS", "TAS"])
def test_airspeed_becomes_true_airspeed_with_the_files_errors_off(measures: str) -> None:
    """At 3000 m, by the standard atmosphere's own closed forms (ISA, ICAO Doc 7488)."""
    temperature = 288.15 - 0.0065 * 3000.0
    pressure = 101325.0 * (temperature / 288.15) ** (9.80665 / (0.0065 * 287.05287))
    density = pressure / (287.05287 * temperature)
    true = 40.0
    equivalent = true * np.sqrt(density / 1.225)
    mach = true / np.sqrt(1.4 * 287.05287 * temperature)
    impact = pressure * ((1.0 + 0.2 * mach**2) ** 3.5 - 1.0)
    calibrated = np.sqrt(
        2.0 * 1.4 / 0.4 * 101325.0 / 1.225 * ((impact / 101325.0 + 1.0) ** (1.0 / 3.5) - 1.0)
    )
    shown = {"EAS": equivalent, "CAS": calibrated, "TAS": true}[measures]
    believed = replace(
        kinematic_flights.aircraft(),
        pitot=Pitot(measures=measures, error=SensorError(bias=(0.7,), scale=(-0.04,))),
    )
    found = measurements.true_airspeed(
        believed, np.array([[0.96 * shown + 0.7]]), np.array([pressure])
    )
    np.testing.assert_allclose(found, [[true]], rtol=2e-6)  # constants of the atmosphere rounded


def test_known_errors_and_mounting_come_off_in_the_order_they_went_on() -> None:
    """A unit mounted nose up by a pitch angle sees a level roll rate partly as yaw."""
    mounting = (0.05, 0.1, -0.08)
    body_to_unit = Rotation.from_euler("ZYX", mounting[::-1]).inv()
    rate, force = np.array([[0.8, -0.2, 0.1]]), np.array([[1.0, 0.5, -9.0]])
    bias, scale = np.array([0.01, -0.02, 0.03]), np.array([0.02, 0.0, -0.01])
    believed = replace(
        kinematic_flights.aircraft(),
        imu=Imu(
            misalignment=mounting,
            gyro=SensorError(bias=tuple(bias), scale=tuple(scale)),
            accelerometer=SensorError(bias=tuple(10.0 * bias), scale=tuple(-scale)),
        ),
    )
    found = measurements.known_errors_off(
        believed,
        (1.0 + scale) * body_to_unit.apply(rate) + bias,
        (1.0 - scale) * body_to_unit.apply(force) + 10.0 * bias,
    )
    np.testing.assert_allclose(found[0], rate, atol=1e-13)
    np.testing.assert_allclose(found[1], force, atol=1e-13)
    nose_up = replace(believed, imu=Imu(misalignment=(0.0, 0.1, 0.0)))
    turned, _ = measurements.known_errors_off(nose_up, np.array([[1.0, 0.0, 0.0]]), force)
    np.testing.assert_allclose(turned, [[np.cos(0.1), 0.0, -np.sin(0.1)]], atol=1e-15)


def test_upwash_turns_alpha_and_leaves_sideslip_alone() -> None:
    """Upwash used to be taken off sideslip too."""
    believed = replace(
        kinematic_flights.aircraft(),
        vanes=Vanes(
            upwash=0.2,
            alpha=SensorError(bias=(0.01,), scale=(0.1,)),
            beta=SensorError(bias=(-0.02,), scale=(0.05,)),
        ),
    )
    alpha, beta = 0.08, -0.06
    shown = np.array([[1.1 * 1.2 * alpha + 0.01, 1.05 * beta - 0.02]])
    found = measurements.vane_errors_off(believed, shown)
    np.testing.assert_allclose(found, [[alpha, beta]], rtol=1e-12)


def test_known_delays_and_lags_move_samples_back(recording: Recording, aircraft: Aircraft) -> None:
    """A pitot tube's lag stated in the file used to be ignored."""
    late = replace(
        aircraft,
        streams={"GLOBAL_POSITION_INT": StreamTiming(0.15), "VFR_HUD": StreamTiming(0.02)},
        pitot=replace(aircraft.pitot, error=SensorError(lag=0.08)),
    )
    plain = measurements.select(recording, aircraft, EVERYTHING)
    moved = measurements.select(recording, late, EVERYTHING)
    for group, delay in (("velocity", 0.15), ("airspeed", 0.1), ("attitude", 0.0)):
        before, values = seen(plain, group)
        after, same = seen(moved, group)
        count = min(after.size, 20)
        np.testing.assert_allclose(after[-count:], before[-count:] - delay, atol=1e-9)
        np.testing.assert_allclose(same[-count:], values[-count:], rtol=1e-6)


def test_an_inertial_unit_that_is_late_describes_the_motion_before_its_stamp(
    recording: Recording, aircraft: Aircraft
) -> None:
    """Ramps: a gyro 20 ms and an accelerometer 50 ms late are seen as their values shifted."""
    unit = recording.streams["RAW_IMU"]
    ramps = {name: np.asarray(unit.time) * slope for slope, name in enumerate(unit.channels, 1)}
    ramped = replace(unit, channels=ramps)
    flown = replace(recording, streams={**recording.streams, "RAW_IMU": ramped})
    late = replace(
        aircraft,
        streams={"RAW_IMU": StreamTiming(0.015)},
        imu=Imu(
            gyro=SensorError(bias=(0.0,) * 3, scale=(0.0,) * 3, lag=0.005),
            accelerometer=SensorError(bias=(0.0,) * 3, scale=(0.0,) * 3, lag=0.035),
        ),
    )
    data = measurements.select(flown, late, EVERYTHING)
    names = list(unit.channels)
    slope = {name: 1.0 + names.index(name) for name in names}
    inside = slice(5, -5)  # beyond the last accelerometer sample its value is held
    for index, axis in enumerate("pqr"):
        expected = slope[axis] * (data.time + 0.02)
        np.testing.assert_allclose(data.gyro[inside, index], expected[inside], rtol=1e-9)
    for index, axis in enumerate("xyz"):
        expected = slope[f"acc_{axis}"] * (data.time + 0.05)
        np.testing.assert_allclose(data.accelerometer[inside, index], expected[inside], rtol=1e-9)


def test_density_and_height_follow_from_static_pressure(
    recording: Recording, aircraft: Aircraft
) -> None:
    time = np.linspace(0.0, 10.0, 50)
    climb = 200.0 + 5.0 * time
    pressure = Stream(
        "SCALED_PRESSURE", time, time, {"static_pressure": atmosphere.pressure(climb)}
    )
    data = measurements.select(
        replace(recording, streams={**recording.streams, "SCALED_PRESSURE": pressure}),
        aircraft,
        EVERYTHING,
    )
    expected = atmosphere.density(200.0 + 5.0 * data.time)
    np.testing.assert_allclose(data.density, expected, rtol=1e-6)  # linear between samples


def with_height(recording: Recording, altitude: np.ndarray, height: np.ndarray) -> Recording:
    """The flight with a position that tells these at its samples."""
    place = recording.streams["GLOBAL_POSITION_INT"]
    told = {**place.channels, "altitude": altitude, "height": height}
    return replace(
        recording,
        streams={**recording.streams, "GLOBAL_POSITION_INT": replace(place, channels=told)},
    )


def test_height_is_above_home_where_the_autopilot_tells_it(
    recording: Recording, aircraft: Aircraft
) -> None:
    """A log that begins in the air, two metres over the ground, and once below home."""
    time = np.asarray(recording.streams["GLOBAL_POSITION_INT"].time)
    above = 2.0 + 3.0 * np.sin(time)
    data = measurements.select(with_height(recording, 450.0 + above, above), aircraft, EVERYTHING)
    assert data.above_home
    expected = np.maximum(np.interp(data.time, time, above), 0.0)
    np.testing.assert_allclose(data.height, expected, atol=1e-9)


def test_a_height_that_does_not_follow_the_altitude_is_none(
    recording: Recording, aircraft: Aircraft
) -> None:
    time = np.asarray(recording.streams["GLOBAL_POSITION_INT"].time)
    climb = 450.0 + 2.0 * np.sin(time)
    data = measurements.select(with_height(recording, climb, 0.0 * time), aircraft, EVERYTHING)
    assert not data.above_home
    assert data.height[0] == 0.0


@pytest.mark.parametrize(
    ("gone", "named"),
    [
        (("ATTITUDE", "RAW_IMU"), "angular rate"),
        (("ATTITUDE",), "attitude"),
        (("VFR_HUD",), "airspeed"),
        (("GLOBAL_POSITION_INT",), "height"),
    ],
)
def test_what_is_missing_is_named_in_one_line(
    recording: Recording, aircraft: Aircraft, gone: tuple[str, ...], named: str
) -> None:
    with pytest.raises(RefusedError, match=named) as refused:
        measurements.select(without(recording, *gone), aircraft, EVERYTHING)
    assert "\n" not in str(refused.value)
    assert recording.source in str(refused.value)


def test_a_window_without_flight_is_refused(recording: Recording, aircraft: Aircraft) -> None:
    with pytest.raises(RefusedError, match="while airborne"):
        measurements.select(recording, aircraft, (0.0, 1.0))


def test_rows_for_the_filter_hold_both_ends_of_each_step(
    recording: Recording, aircraft: Aircraft
) -> None:
    data = measurements.select(recording, aircraft, EVERYTHING)
    rows = data.inputs()
    assert rows.step[0] == 0.0
    np.testing.assert_allclose(np.cumsum(rows.step), data.time - data.time[0], atol=1e-12)
    np.testing.assert_array_equal(rows.before.gyro[1:], rows.after.gyro[:-1])
    np.testing.assert_array_equal(rows.after.accelerometer, data.accelerometer)


def test_what_comes_faster_than_motion_asks_for_is_averaged(
    recording: Recording, aircraft: Aircraft
) -> None:
    """Five samples in place of each, with noise that alternates: what is left is the motion."""
    slow = measurements.select(recording, aircraft, EVERYTHING)
    stream = recording.streams["RAW_IMU"]
    time = np.linspace(stream.time[0], stream.time[-1], 5 * (stream.time.size - 1) + 1)
    shaken = 0.3 * np.sin(2.0 * np.pi * 100.0 * time)
    channels = {
        name: CubicSpline(stream.time, np.asarray(values))(time) + shaken
        for name, values in stream.channels.items()
    }
    fast = replace(stream, time=time, link_time=time, channels=channels)
    data = measurements.select(
        replace(recording, streams={**recording.streams, "RAW_IMU": fast}), aircraft, EVERYTHING
    )
    assert data.rates["gyro"] == pytest.approx(250.0)
    assert np.diff(data.time).max() == pytest.approx(0.02)
    for name, within in (("gyro", 0.01), ("accelerometer", 0.05)):
        there = CubicSpline(slow.time, getattr(slow, name))(data.time)
        off = np.asarray(getattr(data, name)) - there
        assert np.sqrt(np.mean(off[5:-5] ** 2)) < within
    times, velocity = seen(data, "velocity")
    wanted_times, wanted = seen(slow, "velocity")
    np.testing.assert_allclose(times, wanted_times, atol=1e-9)
    np.testing.assert_array_equal(velocity, wanted)
