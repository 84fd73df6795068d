from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.recording import Recording
from gcs_sysid.sources import assemble
from gcs_sysid.sources.tlog import read

UNIX_US = 1_790_000_500_000_000
ARRIVAL_US = 1_790_000_000_000_000


def open_log(log: object) -> Recording:
    return assemble.recording(read(log.data), source="log", sha256="", vehicle=None)


def absolute_us(recording: Recording, name: str) -> np.ndarray:
    return recording.time_us(recording.streams[name].time)


def steady(writer: type, *, late_us: np.ndarray, first_ms: int = 5000, step_ms: int = 20) -> object:
    """ATTITUDE every `step_ms`, each `late_us` late on a link without other delay."""
    log = writer().heartbeat(0)
    for i, late in enumerate(late_us.tolist()):
        log.add(
            step_ms * 1000 * i + late, "ATTITUDE", time_boot_ms=first_ms + step_ms * i, roll=1.0
        )
    return log


def jitter(count: int, largest_us: int, seed: int) -> np.ndarray:
    late = np.random.default_rng(seed).integers(0, largest_us, count)
    late[count // 2] = 0
    return late


def test_wall_time_comes_from_the_vehicle(writer: type) -> None:
    log = steady(writer, late_us=jitter(200, 10_000, 1))
    for i in range(4):
        boot_ms = 5000 + 1000 * i
        log.add(
            1_000_000 * i + 11,
            "SYSTEM_TIME",
            time_boot_ms=boot_ms,
            time_unix_usec=UNIX_US + boot_ms * 1000,
        )
    recording = open_log(log)
    expected = UNIX_US + 1000 * (5000 + 20 * np.arange(200))
    assert absolute_us(recording, "ATTITUDE").tolist() == expected.tolist()


def test_without_wall_time_the_earliest_arrival_counts(writer: type) -> None:
    recording = open_log(steady(writer, late_us=jitter(200, 10_000, 2)))
    expected = ARRIVAL_US + 20_000 * np.arange(200)
    assert absolute_us(recording, "ATTITUDE").tolist() == expected.tolist()
    assert any("earliest arrivals" in note for note in recording.clock_notes)


def test_arrivals_are_kept(writer: type) -> None:
    late = jitter(50, 10_000, 3)
    stream = open_log(steady(writer, late_us=late)).streams["ATTITUDE"]
    np.testing.assert_allclose(stream.link_time - stream.time, late * 1e-6, atol=1e-9)


def test_a_wall_clock_that_was_never_set_is_not_used(writer: type) -> None:
    log = steady(writer, late_us=np.zeros(100, dtype=int))
    log.add(500, "SYSTEM_TIME", time_boot_ms=5000, time_unix_usec=0)
    assert absolute_us(open_log(log), "ATTITUDE")[0] == ARRIVAL_US


def test_milliseconds_wrap(writer: type) -> None:
    first = 2**32 - 1000
    log = writer().heartbeat(0)
    for i in range(100):
        log.add(20_000 * i, "ATTITUDE", time_boot_ms=(first + 20 * i) % 2**32, roll=1.0)
    recording = open_log(log)
    np.testing.assert_allclose(recording.streams["ATTITUDE"].time, 0.02 * np.arange(100))
    assert any("wrapped 1 time" in note for note in recording.clock_notes)


@pytest.mark.parametrize("hours", [0.5, 1.19, 3.0, 30.0])
def test_microseconds_of_32_bits_join_the_clock(writer: type, hours: float) -> None:
    """SERVO_OUTPUT_RAW.time_usec has 32 bits: it is back at zero after 71.6 minutes."""
    boot_ms = int(hours * 3_600_000)
    log = steady(writer, late_us=np.zeros(3000, dtype=int), first_ms=boot_ms)
    for i in range(3000):
        stamp = (boot_ms * 1000 + 20_000 * i + 123) % 2**32
        log.add(20_000 * i + 200, "SERVO_OUTPUT_RAW", time_usec=stamp, servo1_raw=1500)
    streams = open_log(log).streams
    assert streams["SERVO_OUTPUT_RAW"].stamped
    difference = streams["SERVO_OUTPUT_RAW"].time - streams["ATTITUDE"].time
    np.testing.assert_allclose(difference, 123e-6, atol=1e-9)


def test_microseconds_since_1970(writer: type) -> None:
    log = steady(writer, late_us=np.zeros(50, dtype=int))
    for i in range(50):
        unix = UNIX_US + 1000 * (5000 + 20 * i)
        log.add(20_000 * i, "SYSTEM_TIME", time_boot_ms=5000 + 20 * i, time_unix_usec=unix)
        log.add(20_000 * i, "HIGHRES_IMU", time_usec=unix + 7, zacc=-9.8)
    recording = open_log(log)
    difference = absolute_us(recording, "HIGHRES_IMU") - absolute_us(recording, "ATTITUDE")
    assert set(difference.tolist()) == {7}


def test_a_reboot_goes_on_in_wall_time(writer: type) -> None:
    log = steady(writer, late_us=np.zeros(500, dtype=int), first_ms=100_000)
    pause_us = 500 * 20_000 + 8_000_000
    for i in range(500):
        log.add(pause_us + 20_000 * i, "ATTITUDE", time_boot_ms=3000 + 20 * i, roll=1.0)
    recording = open_log(log)
    time = recording.streams["ATTITUDE"].time
    np.testing.assert_allclose(time[:500], 0.02 * np.arange(500), atol=1e-9)
    np.testing.assert_allclose(time[500:], pause_us * 1e-6 + 0.02 * np.arange(500), atol=1e-9)
    assert any("restarted 1 time" in note for note in recording.clock_notes)


def test_wall_time_known_before_a_reboot_serves_after_it(writer: type) -> None:
    log = steady(writer, late_us=np.zeros(500, dtype=int), first_ms=100_000)
    log.add(10, "SYSTEM_TIME", time_boot_ms=100_000, time_unix_usec=UNIX_US)
    for i in range(50):
        log.add(20_000_000 + 20_000 * i, "ATTITUDE", time_boot_ms=3000 + 20 * i, roll=1.0)
    recording = open_log(log)
    time_us = absolute_us(recording, "ATTITUDE")
    assert time_us[0] == UNIX_US
    assert time_us[500] == UNIX_US + 20_000_000


def test_one_late_message_is_no_reboot(writer: type) -> None:
    log = steady(writer, late_us=np.zeros(300, dtype=int), first_ms=100_000)
    log.add(4_000_001, "ATTITUDE", time_boot_ms=100_010, roll=1.0)
    recording = open_log(log)
    assert not any("restarted" in note for note in recording.clock_notes)
    assert np.all(np.diff(recording.streams["ATTITUDE"].time) >= 0.0)
    assert recording.streams["ATTITUDE"].time[1] == pytest.approx(0.01)


def test_messages_in_a_burst_share_its_stamp(writer: type) -> None:
    """A simulation's bursts: the wall clock runs unevenly, the vehicle's does not."""
    rng = np.random.default_rng(4)
    log = writer().heartbeat(0)
    arrival = 0
    for i in range(300):
        arrival += int(rng.integers(2_000, 90_000))
        log.add(arrival, "ATTITUDE", time_boot_ms=7000 + 20 * i, roll=1.0)
        log.add(arrival + 60, "VFR_HUD", airspeed=20.0)
    recording = open_log(log)
    assert not recording.streams["VFR_HUD"].stamped
    np.testing.assert_array_equal(
        recording.streams["VFR_HUD"].time, recording.streams["ATTITUDE"].time
    )


def test_periodic_messages_without_a_stamp_are_put_on_their_period(writer: type) -> None:
    """25 Hz without a stamp between 50 Hz with one, every arrival up to 10 ms late, some lost."""
    late = jitter(1000, 10_000, 5)
    log = steady(writer, late_us=late)
    rng = np.random.default_rng(6)
    sent = [i for i in range(500) if rng.random() > 0.05]
    for i in sent:
        log.add(40_000 * i + int(rng.integers(0, 10_000)), "VFR_HUD", airspeed=20.0)
    recording = open_log(log)
    time = recording.streams["VFR_HUD"].time - recording.streams["ATTITUDE"].time[0]
    error = time - 0.04 * np.array(sent)
    # A jitter of 10 ms has an sd of 2.9 ms, a line through 475 of them one of 0.26 ms at its ends.
    assert np.abs(error).max() < 0.001
    assert any("VFR_HUD" in note and "even" in note for note in recording.clock_notes)


def test_messages_without_a_period_stay_where_they_arrived(writer: type) -> None:
    log = steady(writer, late_us=np.zeros(2000, dtype=int))
    rng = np.random.default_rng(7)
    arrivals = np.sort(rng.integers(0, 40_000_000, 200))
    for arrival in arrivals.tolist():
        log.add(arrival, "WIND", speed=3.0)
    time = open_log(log).streams["WIND"].time
    np.testing.assert_allclose(
        time[arrivals < 39_980_000], 1e-6 * arrivals[arrivals < 39_980_000], atol=2e-6
    )


def test_stamps_that_are_no_sampling_times_are_not_used(writer: type) -> None:
    """HOME_POSITION.time_usec is when home was set, repeated."""
    log = steady(writer, late_us=np.zeros(100, dtype=int), first_ms=60_000)
    for i in range(10):
        log.add(200_000 * i, "HOME_POSITION", time_usec=12_345)
    home = open_log(log).streams["HOME_POSITION"]
    assert not home.stamped
    np.testing.assert_allclose(home.time, 0.2 * np.arange(10), atol=0.021)


def test_single_false_stamps_are_replaced_by_arrival(writer: type) -> None:
    log = steady(writer, late_us=np.zeros(200, dtype=int), first_ms=60_000)
    for i in range(200):
        stamp = 17 if i == 100 else 60_000_000 + 20_000 * i
        log.add(20_000 * i + 5, "RAW_IMU", time_usec=stamp, zacc=-1000)
    recording = open_log(log)
    np.testing.assert_allclose(recording.streams["RAW_IMU"].time, 0.02 * np.arange(200), atol=1e-9)
    assert any("RAW_IMU: 1 stamps" in note for note in recording.clock_notes)


def test_nothing_stamped_at_all(writer: type) -> None:
    log = writer().heartbeat(0)
    for i in range(10):
        log.add(100_000 * i, "VFR_HUD", airspeed=20.0)
    recording = open_log(log)
    np.testing.assert_allclose(recording.streams["VFR_HUD"].time, 0.1 * np.arange(10))
    assert any("no message carries" in note for note in recording.clock_notes)


def test_a_damaged_arrival_stamp_moves_nothing(writer: type) -> None:
    log = steady(writer, late_us=np.zeros(100, dtype=int))
    data = log.data
    last = data.rindex(log.records[50][1]) - 8
    data = data[:last] + b"\x80" + data[last + 1 :]
    recording = assemble.recording(read(data), source="log", sha256="", vehicle=None)
    assert absolute_us(recording, "ATTITUDE")[0] == ARRIVAL_US
    assert recording.streams["ATTITUDE"].link_time.max() < 3.0
