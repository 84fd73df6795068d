from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.recording import Recording
from gcs_sysid.sources import assemble
from gcs_sysid.sources.samples import Sample, SampleDecoder
from gcs_sysid.sources.stream import FrameStream
from gcs_sysid.sources.tlog import read

PERIOD_US = 20_000


def flight(writer: type, count: int = 60, *, system: int = 1, first_ms: int = 5000) -> object:
    """Bursts of three messages at 50 Hz, as an autopilot sends them."""
    log = writer(system).heartbeat(0)
    for i in range(count):
        at, boot_ms = PERIOD_US * i + 100, first_ms + 20 * i
        log.add(at, "ATTITUDE", time_boot_ms=boot_ms, roll=0.01 * i, pitch=0.1, rollspeed=0.2)
        log.add(at, "RAW_IMU", time_usec=boot_ms * 1000 + 300, zacc=-1000, xgyro=i)
        log.add(at, "VFR_HUD", airspeed=20.0 + i, throttle=50)
        log.add(at, "SERVO_OUTPUT_RAW", time_usec=boot_ms * 1000 + 200, servo1_raw=1500, port=i % 2)
    return log


def live(log: object, decoder: SampleDecoder) -> list[Sample]:
    stream = FrameStream()
    samples: list[Sample] = []
    for link_us, frame in sorted(log.records, key=lambda record: record[0]):
        samples += decoder.samples(stream.feed(frame, link_us))
    return samples


def batch(log: object, vehicle: int | None = None) -> Recording:
    return assemble.recording(read(log.data), source="log", sha256="", vehicle=vehicle)


def test_live_values_and_times_are_those_of_the_log(writer: type) -> None:
    log = flight(writer)
    samples = live(log, SampleDecoder())
    recording = batch(log)
    assert len(samples) == sum(stream.count for stream in recording.streams.values())
    for name, stream in recording.streams.items():
        ours = [sample for sample in samples if sample.stream == name]
        assert len(ours) == stream.count
        for channel, values in stream.channels.items():
            found = [sample.channels[channel] for sample in ours]
            np.testing.assert_array_equal(found, values, err_msg=f"{name}.{channel}")
        if name != "HEARTBEAT":
            # The live clock is set by the first arrival, the log's by the earliest: here the same.
            found_us = np.array([sample.time_us for sample in ours])
            np.testing.assert_array_equal(found_us, recording.time_us(stream.time), err_msg=name)
        assert {sample.stamped for sample in ours} == {stream.stamped}


def test_jittered_arrivals_do_not_reach_stamped_samples(writer: type) -> None:
    rng = np.random.default_rng(9)
    log = writer().heartbeat(0)
    for i in range(100):
        log.add(20_000 * i + int(rng.integers(0, 15_000)), "ATTITUDE", time_boot_ms=9 + 20 * i)
    times = [s.time_us for s in live(log, SampleDecoder()) if s.stream == "ATTITUDE"]
    assert set(np.diff(times).tolist()) == {20_000}


def test_nothing_is_lost_before_the_vehicle_is_known(writer: type) -> None:
    log = writer()
    for i in range(30):
        log.add(20_000 * i, "ATTITUDE", time_boot_ms=100 + 20 * i, roll=0.1)
    log.heartbeat(400_000)
    decoder = SampleDecoder()
    samples = live(log, decoder)
    assert decoder.vehicle is not None
    assert len([s for s in samples if s.stream == "ATTITUDE"]) == 30


def test_parameters_are_those_of_the_log_and_only_those_wanted(writer: type) -> None:
    log, other = writer(), writer(system=2)
    log.heartbeat(0)
    for at, (name, value) in enumerate([("INS_GYRO_FILTER", 40.0), ("INS_GYRO_FILTER", 20.0),
                                        ("WP_RADIUS", 90.0)], start=1):  # fmt: skip
        log.add(1000 * at, "PARAM_VALUE", param_id=name.encode(), param_value=value, param_type=9)
    other.heartbeat(5000)
    other.add(6000, "PARAM_VALUE", param_id=b"INS_GYRO_FILTER", param_value=7.0, param_type=9)
    log.records += other.records
    decoder = SampleDecoder(watched=("INS_GYRO_FILTER", "INS_ACCEL_FILTER"))
    live(log, decoder)
    assert decoder.parameters == {"INS_GYRO_FILTER": 20.0}
    assert batch(log, vehicle=1).parameters == {**decoder.parameters, "WP_RADIUS": 90.0}


def test_a_second_vehicle_is_never_mixed_in(writer: type) -> None:
    first, second = flight(writer, system=1), flight(writer, system=2, first_ms=90_000)
    first.records += second.records
    decoder = SampleDecoder(vehicle=2)
    samples = live(first, decoder)
    assert len(samples) == len(second.records)
    assert decoder.vehicle is not None
    assert decoder.vehicle.system == 2
    assert set(decoder.others) == {1}
    assert SampleDecoder().vehicle is None


def test_the_first_vehicle_is_kept(writer: type) -> None:
    log, other = flight(writer), flight(writer, 20, system=9)
    log.records += [(link_us + 1_000_000, frame) for link_us, frame in other.records]
    decoder = SampleDecoder()
    samples = live(log, decoder)
    assert decoder.vehicle is not None
    assert decoder.vehicle.system == 1
    assert set(decoder.others) == {9}
    assert len(samples) == len(log.records) - len(other.records)


def test_a_reboot_in_flight(writer: type) -> None:
    log = flight(writer, 50, first_ms=100_000)
    again = flight(writer, 50, first_ms=3000)
    log.records += [(link_us + 10_000_000, frame) for link_us, frame in again.records]
    decoder = SampleDecoder()
    attitude = [s for s in live(log, decoder) if s.stream == "ATTITUDE"]
    assert decoder.clock.reboots == 1
    times = np.array([s.time_us for s in attitude]) - attitude[0].time_us
    assert np.all(np.diff(times) > 0)
    assert times[50:] == pytest.approx(10_000_000 + 20_000 * np.arange(50), abs=1000)


def test_milliseconds_wrap_in_flight(writer: type) -> None:
    log = writer().heartbeat(0)
    for i in range(100):
        boot_ms = (2**32 - 500 + 20 * i) % 2**32
        log.add(20_000 * i, "ATTITUDE", time_boot_ms=boot_ms, roll=1.0)
    times = [s.time_us for s in live(log, SampleDecoder()) if s.stream == "ATTITUDE"]
    assert set(np.diff(times).tolist()) == {20_000}


@pytest.mark.parametrize("hours", [0.5, 1.19, 3.0])
def test_microseconds_of_32_bits_join_the_live_clock(writer: type, hours: float) -> None:
    boot_ms = int(hours * 3_600_000)
    log = writer().heartbeat(0)
    for i in range(150):
        stamp = (boot_ms * 1000 + 20_000 * i + 123) % 2**32
        log.add(20_000 * i, "ATTITUDE", time_boot_ms=boot_ms + 20 * i, roll=1.0)
        log.add(20_000 * i, "SERVO_OUTPUT_RAW", time_usec=stamp, servo1_raw=1500)
    samples = live(log, SampleDecoder())
    attitude, servo = (
        np.array([s.time_us for s in samples if s.stream == name])
        for name in ("ATTITUDE", "SERVO_OUTPUT_RAW")
    )
    assert set((servo - attitude).tolist()) == {123}
