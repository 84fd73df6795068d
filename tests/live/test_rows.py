"""Messages become rows: late ones with their age, missing ones absent, decimated ones counted."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_sysid.aircraft import Aircraft, Geometry, Imu, Mass, SensorError, StreamTiming
from gcs_sysid.live.rows import Row, RowMaker
from gcs_sysid.model.kinematics import GRAVITY, MEASURED
from gcs_sysid.reconstruct import cut, inertial_filter
from gcs_sysid.sources.samples import Sample

EPOCH_US = 1_790_000_000_000_000
STEP_S = 0.02


def aircraft(**changes: object) -> Aircraft:
    return Aircraft("kite", Mass(1.0, 0.1, 0.1, 0.2), Geometry(0.3, 1.2, 0.25), **changes)


def sample(stream: str, time: float, **channels: float) -> Sample:
    time_us = EPOCH_US + round(time * 1e6)
    return Sample(stream, time_us, time_us, True, channels)


def inertial(time: float, *, stream: str = "RAW_IMU", p: float = 0.1) -> Sample:
    force = {"acc_x": 0.0, "acc_y": 0.0, "acc_z": -GRAVITY}
    return sample(stream, time, p=p, q=0.0, r=0.0, **force)


def velocity(time: float, north: float = 15.0) -> Sample:
    channels = {"v_north": north, "v_east": 0.0, "v_down": 0.0, "altitude": 100.0}
    return sample("GLOBAL_POSITION_INT", time, **channels)


def started(maker: RowMaker) -> int:
    """Feeds inertial samples until one stream is chosen; returns the next sample's number."""
    maker.take(velocity(0.0))
    for index in range(1000):
        if maker.take(inertial(index * STEP_S)):
            return index + 1
    raise AssertionError("no row came")


def group(row: Row, name: str) -> tuple[bool, float]:
    index = list(MEASURED).index(name)
    return bool(row.measured.valid[index]), float(row.measured.age[index])


def rows_of(maker: RowMaker, samples: list[Sample]) -> list[Row]:
    rows = [row for item in samples for row in maker.take(item)]
    last = maker.once_more()
    return rows if last is None else [*rows, last]


def test_a_row_is_made_at_once_of_what_came_before_it() -> None:
    maker = RowMaker(aircraft())
    n = started(maker)
    maker.take(inertial(n * STEP_S))
    at = (n + 1) * STEP_S
    assert maker.take(velocity(at - 0.006, 17.0)) == []
    assert maker.once_more() is None, "it belongs to the sample that follows"
    (row,) = maker.take(inertial(at))
    assert row.time == pytest.approx(at)
    assert row.step == pytest.approx(STEP_S)
    assert group(row, "velocity") == (True, pytest.approx(-0.006))
    assert row.measured.velocity[0] == 17.0
    assert row.new[list(MEASURED).index("velocity")]
    assert not row.again


def test_what_comes_behind_its_row_makes_it_once_more() -> None:
    """As an autopilot sends them: the inertial unit first, then attitude and velocity."""
    maker = RowMaker(aircraft())
    n = started(maker)
    at = n * STEP_S
    maker.take(inertial(at))
    later = velocity(at + 0.004, 17.0)
    maker.take(later)
    row = maker.once_more()
    assert row is not None
    assert row.again
    assert row.time == pytest.approx(at)
    assert row.link_us == later.link_us
    assert group(row, "velocity") == (True, pytest.approx(0.004))
    assert row.new.sum() == 1
    maker.take(sample("ATTITUDE", at, roll=0.1, pitch=0.0, yaw=0.0, p=0.0, q=0.0, r=0.0))
    angles, after = maker.take(inertial(at + STEP_S))
    assert group(angles, "velocity") == (True, pytest.approx(0.004))
    assert group(angles, "attitude") == (True, pytest.approx(0.0))
    assert angles.new.sum() == 1
    assert not after.again
    assert maker.once_more() is None


def test_what_a_radio_repeats_counts_once() -> None:
    maker = RowMaker(aircraft())
    n = started(maker)
    at = n * STEP_S
    rows = rows_of(maker, [inertial(at), velocity(at), velocity(at), inertial(at + STEP_S)])
    assert [bool(row.new.any()) for row in rows] == [False, True, False]


def test_an_airspeed_shown_again_is_no_measurement() -> None:
    """As in a log; see `measurements.held`."""
    maker = RowMaker(aircraft())
    n = started(maker)
    shown = [17.123456, 17.123456, 17.234567, 17.25, 17.25]
    given = [
        item
        for i, value in enumerate(shown)
        for item in (
            sample("VFR_HUD", (n + i) * STEP_S - 0.004, airspeed=value, altitude=100.0),
            inertial((n + i) * STEP_S),
        )
    ]
    rows = rows_of(maker, given)
    assert [group(row, "airspeed")[0] for row in rows] == [True, False, True, True, True]


def test_a_late_measurement_goes_to_the_newest_row_with_its_age() -> None:
    maker = RowMaker(aircraft())
    n = started(maker)
    late = velocity((n - 5) * STEP_S)
    row = rows_of(maker, [inertial(n * STEP_S), late])[-1]
    assert group(row, "velocity") == (True, pytest.approx(-5 * STEP_S))
    assert maker.late == 0


def test_one_too_late_is_left_out_and_counted() -> None:
    maker = RowMaker(aircraft())
    n = started(maker)
    late = velocity((n - 20) * STEP_S)
    row = rows_of(maker, [inertial(n * STEP_S), late, inertial((n + 1) * STEP_S)])[-1]
    assert group(row, "velocity") == (False, 0.0)
    assert maker.late == 1


def test_a_known_delay_of_a_stream_is_taken_off() -> None:
    timing = {"GLOBAL_POSITION_INT": StreamTiming(delay=0.1)}
    maker = RowMaker(aircraft(streams=timing))
    n = started(maker)
    row = rows_of(maker, [inertial(n * STEP_S), velocity(n * STEP_S)])[-1]
    assert group(row, "velocity") == (True, pytest.approx(-0.1))


def test_inertial_samples_out_of_order_are_left_out() -> None:
    maker = RowMaker(aircraft())
    n = started(maker)
    rows = rows_of(
        maker,
        [inertial(n * STEP_S), inertial((n - 2) * STEP_S), inertial((n + 1) * STEP_S)],
    )
    assert [row.time for row in rows] == pytest.approx([n * STEP_S, (n + 1) * STEP_S])
    assert maker.late == 1


def test_every_other_sample_is_left_out_when_asked() -> None:
    maker = RowMaker(aircraft())
    n = started(maker)
    maker.keep = 2
    rows = rows_of(maker, [inertial((n + index) * STEP_S) for index in range(20)])
    assert maker.decimated == 10
    assert [row.step for row in rows[2:]] == pytest.approx([2 * STEP_S] * len(rows[2:]))


@pytest.mark.parametrize(
    ("rate", "used"), [(50, 50), (100, 100), (200, 100), (400, 400 / 3), (1000, 1000 / 7)]
)
def test_the_filter_gets_no_more_samples_than_it_needs(rate: float, used: float) -> None:
    maker = RowMaker(aircraft())
    n = started(maker)
    rows = rows_of(maker, [inertial((n + 1) * STEP_S + k / rate) for k in range(rate)])
    assert len(rows) == pytest.approx(used, abs=2)
    assert maker.decimated == rate - len(rows)


def test_the_fastest_inertial_stream_is_used() -> None:
    maker = RowMaker(aircraft())
    maker.take(velocity(0.0))
    for index in range(200):
        maker.take(inertial(index * 0.01, stream="SCALED_IMU2"))
        if index % 5 == 0:
            maker.take(inertial(index * 0.01 + 0.001, stream="RAW_IMU"))
    assert maker.used["gyro"] == "SCALED_IMU2"
    assert maker.used["accelerometer"] == "SCALED_IMU2"


def test_an_autopilots_filter_is_undone_from_when_it_is_told() -> None:
    """At 20 Hz rates come 11 ms late; a lag that the aircraft file states goes before."""
    late = inertial_filter.delay(20.0)
    told = {inertial_filter.GYRO: 20.0, inertial_filter.ACCELEROMETER: 10.0}
    maker = RowMaker(aircraft())
    n = started(maker)
    (before,) = maker.take(inertial(n * STEP_S))
    maker.told(told)
    (after,) = maker.take(inertial((n + 1) * STEP_S))
    assert maker.inertial_delay == late == pytest.approx(0.01125, abs=1e-5)
    assert before.time == pytest.approx(n * STEP_S)
    assert after.time == pytest.approx((n + 1) * STEP_S - late)
    assert after.step == pytest.approx(STEP_S - late)
    stated = RowMaker(aircraft(imu=Imu(gyro=SensorError(bias=(0.0, 0.0, 0.0), lag=0.003))))
    stated.told(told)
    started(stated)
    assert stated.inertial_delay == 0.003


def test_what_the_autopilot_cuts_off_is_given_back_once_that_shows() -> None:
    maker = RowMaker(aircraft())
    first = started(maker)
    noise = 2.0 * np.random.default_rng(4).standard_normal((4000, 6))
    noise[-cut.WINDOW :] = [3.7, -3.7, 0.7, 5.2, -5.2, -0.3]
    for index, values in enumerate(np.trunc(noise) * cut.STEPS, start=first):
        channels = dict(zip(cut.CHANNELS, values.tolist(), strict=True))
        rows = maker.take(sample("RAW_IMU", index * STEP_S, **channels))
    (row,) = rows
    np.testing.assert_allclose(row.after.gyro, [3.5e-3, -3.5e-3, 0.0])
    force = 1e-3 * GRAVITY * np.array([5.5, -5.5, 0.0])
    np.testing.assert_allclose(row.after.accelerometer, force)


def test_without_accelerometer_the_attitude_stands_in() -> None:
    """Specific force is then that of unaccelerated flight, as in the batch run."""
    maker = RowMaker(aircraft())
    maker.take(velocity(0.0))
    angles = {"roll": 0.2, "pitch": 0.1, "yaw": 0.0, "p": 0.1, "q": 0.0, "r": 0.0}
    row = rows_of(maker, [sample("ATTITUDE", index * STEP_S, **angles) for index in range(100)])[-1]
    force = np.asarray(row.after.accelerometer)
    assert np.linalg.norm(force) == pytest.approx(GRAVITY)
    assert force[0] == pytest.approx(GRAVITY * math.sin(0.1))
    assert "accelerometer" not in maker.used


def test_what_is_missing_has_a_name() -> None:
    maker = RowMaker(aircraft())
    assert maker.missing == (
        "angular rate", "airspeed", "velocity", "attitude", "static pressure or altitude",
    )  # fmt: skip
    started(maker)
    assert maker.missing == ("airspeed", "attitude")


def test_a_preferred_stream_that_falls_silent_is_replaced() -> None:
    maker = RowMaker(aircraft())
    maker.take(velocity(0.0))
    maker.take(sample("AIRSPEED", 0.0, airspeed=15.0))
    maker.take(sample("VFR_HUD", 0.1, airspeed=16.0))
    assert maker.used["airspeed"] == "AIRSPEED"
    maker.take(sample("VFR_HUD", 3.0, airspeed=16.0))
    assert maker.used["airspeed"] == "VFR_HUD"
