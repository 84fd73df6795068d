from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as dialect

from gcs_sysid.errors import RefusedError, SourceError
from gcs_sysid.sources.registry import open_recording

Save = Callable[[bytes], Path]


def interleaved(*writers: object) -> bytes:
    """One log of what several senders sent, in the order of arrival."""
    joined = type(writers[0])()
    joined.records = [record for writer in writers for record in writer.records]
    return joined.data


def flight(writer: type, system: int = 1, *, messages: int = 20, component: int = 1) -> object:
    log = writer(system, component).heartbeat(0)
    for i in range(messages):
        log.add(1000 * (20 * i + 3), "ATTITUDE", time_boot_ms=500 + 20 * i, roll=0.01 * (i + 1))
    return log


def test_a_flight(writer: type, save: Save) -> None:
    log = flight(writer).add(1_000_000, "MEMINFO", freemem=3).add(1_000_100, "MEMINFO")
    path = save(log.data)
    recording = open_recording(path)
    assert recording.source == str(path)
    assert recording.sha256 == hashlib.sha256(log.data).hexdigest()
    assert recording.vehicle.system == 1
    assert recording.vehicle.autopilot == "MAV_AUTOPILOT_ARDUPILOTMEGA"
    assert recording.vehicle.kind == "MAV_TYPE_FIXED_WING"
    assert recording.vehicle.messages == 23
    assert recording.lost == {"bad_crc": 0, "unknown": 0, "garbage_bytes": 0, "truncated": 0}
    attitude = recording.streams["ATTITUDE"]
    assert attitude.stamped
    assert attitude.rate == pytest.approx(50.0)
    np.testing.assert_allclose(attitude.channels["roll"], 0.01 * np.arange(1, 21), rtol=1e-6)
    assert recording.streams["MEMINFO"].count == 2
    assert recording.streams["MEMINFO"].channels == {}


@pytest.mark.parametrize("how", [{"version": 1}, {"version": 2}, {"signed": True}])
def test_every_wire_format(writer: type, save: Save, how: dict[str, object]) -> None:
    log = writer(**how).heartbeat(0).add(1000, "ATTITUDE", time_boot_ms=10, pitch=0.25)
    attitude = open_recording(save(log.data)).streams["ATTITUDE"]
    assert attitude.channels["pitch"][0] == pytest.approx(0.25)


def test_losses_are_counted_by_reason(writer: type, save: Save) -> None:
    log = flight(writer)
    data = log.data
    broken = bytearray(writer().add(0, "ATTITUDE", time_boot_ms=1, roll=1.0).data)
    broken[20] ^= 0xFF
    unknown = bytearray(writer().add(0, "ATTITUDE", time_boot_ms=1, roll=1.0).data)
    unknown[15:18] = b"\xef\xcd\xab"
    recording = open_recording(save(broken + b"?" * 5 + data + unknown + data[:20]))
    assert recording.lost == {"bad_crc": 1, "unknown": 1, "garbage_bytes": 5, "truncated": 1}


def test_sentinel_for_a_sensor_that_does_not_exist(writer: type, save: Save) -> None:
    log = flight(writer)
    for i in range(30):
        log.add(i * 20_000, "RAW_IMU", time_usec=500_000 + i * 20_000, zacc=-1000)
        log.add(i * 20_000, "SCALED_PRESSURE", time_boot_ms=500 + 20 * i, press_abs=950.0)
    recording = open_recording(save(log.data))
    assert not recording.streams["RAW_IMU"].has("p")
    assert recording.streams["RAW_IMU"].has("acc_x", "acc_z")
    assert not recording.streams["SCALED_PRESSURE"].has("dynamic_pressure")
    (note,) = [n for n in recording.clock_notes if "zero throughout" in n]
    assert "RAW_IMU.p" in note
    assert "SCALED_PRESSURE.dynamic_pressure" in note


def test_parameters_and_texts(writer: type, save: Save) -> None:
    log = flight(writer)
    log.add(1000, "PARAM_VALUE", param_id=b"ARSPD_RATIO", param_value=1.5)
    log.add(2000, "PARAM_VALUE", param_id=b"SIXTEEN_LETTERS_", param_value=-2.0)
    log.add(3000, "PARAM_VALUE", param_id=b"ARSPD_RATIO", param_value=2.0)
    log.add(203_000, "STATUSTEXT", severity=6, text=b"Throttle armed")
    log.add(303_000, "STATUSTEXT", severity=6, text=b"x" * 50)
    recording = open_recording(save(log.data))
    assert recording.parameters == {"ARSPD_RATIO": 2.0, "SIXTEEN_LETTERS_": -2.0}
    assert [text for _, text in recording.texts] == ["Throttle armed", "x" * 50]
    assert recording.texts[0][0] == pytest.approx(0.2, abs=0.01)


def test_whole_parameters_of_a_px4_go_byte_by_byte(writer: type, save: Save) -> None:
    """MAVLink's bytewise encoding: the float's bytes are those of the integer."""
    log = writer().heartbeat(0, autopilot=dialect.MAV_AUTOPILOT_PX4)
    whole = struct.unpack("<f", struct.pack("<i", -201))[0]
    log.add(1000, "PARAM_VALUE", param_id=b"PWM_MAIN_FUNC1", param_value=whole, param_type=6)
    log.add(2000, "PARAM_VALUE", param_id=b"FW_AIRSPD_MAX", param_value=25.5, param_type=9)
    log.add(3000, "ATTITUDE", time_boot_ms=1)
    found = open_recording(save(log.data)).parameters
    assert found == {"PWM_MAIN_FUNC1": -201.0, "FW_AIRSPD_MAX": 25.5}


def test_second_instances_have_their_own_stream(writer: type, save: Save) -> None:
    log = flight(writer)
    for i in range(5):
        log.add(20_000 * i, "SERVO_OUTPUT_RAW", time_usec=500_000 + i, servo1_raw=1500)
        log.add(20_000 * i, "SERVO_OUTPUT_RAW", time_usec=500_000 + i, servo1_raw=1100, port=1)
        log.add(20_000 * i, "AIRSPEED", id=0, airspeed=20.0)
        log.add(20_000 * i, "AIRSPEED", id=1, airspeed=30.0)
    streams = open_recording(save(log.data)).streams
    assert set(streams["SERVO_OUTPUT_RAW"].channels["pwm_1"]) == {1500.0}
    assert set(streams["SERVO_OUTPUT_RAW[1]"].channels["pwm_17"]) == {1100.0}
    assert set(streams["AIRSPEED"].channels["airspeed"]) == {20.0}
    assert set(streams["AIRSPEED[1]"].channels["airspeed"]) == {30.0}


def test_two_vehicles_must_be_chosen_from(writer: type, save: Save) -> None:
    path = save(interleaved(flight(writer, 1, messages=10), flight(writer, 7, messages=30)))
    with pytest.raises(RefusedError, match=r"system ids 7 .*, 1 .*--vehicle N"):
        open_recording(path)
    recording = open_recording(path, vehicle=1)
    assert recording.vehicle.system == 1
    assert recording.streams["ATTITUDE"].count == 10
    assert [v.system for v in recording.others] == [7]
    with pytest.raises(RefusedError, match=r"no vehicle with system id 3.*--vehicle 7"):
        open_recording(path, vehicle=3)


def test_ground_stations_and_companions_are_no_vehicles(writer: type, save: Save) -> None:
    ground = writer(255, 190).heartbeat(5, type=dialect.MAV_TYPE_GCS, autopilot=8)
    ground.add(50_000, "ATTITUDE", time_boot_ms=99, roll=3.0)
    camera = writer(1, 100).heartbeat(5, type=dialect.MAV_TYPE_CAMERA, autopilot=8)
    camera.add(60_000, "ATTITUDE", time_boot_ms=99, roll=2.0)
    recording = open_recording(save(interleaved(flight(writer), ground, camera)))
    assert recording.vehicle.component == 1
    assert recording.others == ()
    assert recording.streams["ATTITUDE"].channels["roll"].max() < 1.0


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"\x00" * 100, "no MAVLink message in 100 bytes"),
        (b"\xfe" * 3000, "no MAVLink message"),
        (b"\x93NUMPY" + b"123" * 999, "no MAVLink message"),
    ],
)
def test_files_that_are_no_tlog(save: Save, content: bytes, words: str) -> None:
    path = save(content)
    with pytest.raises(SourceError, match=words) as error:
        open_recording(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_paths_that_are_no_file(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="no such file"):
        open_recording(tmp_path / "missing.tlog")
    folder = tmp_path / "folder.tlog"
    folder.mkdir()
    with pytest.raises(SourceError, match="is a directory"):
        open_recording(folder)
    with pytest.raises(SourceError, match=r"unknown kind of log `.xyz`.*\.tlog"):
        open_recording(tmp_path / "flight.xyz")


def test_a_log_without_an_autopilot(writer: type, save: Save) -> None:
    log = writer(255, 190).heartbeat(0, type=dialect.MAV_TYPE_GCS, autopilot=8)
    with pytest.raises(SourceError, match="no autopilot's HEARTBEAT"):
        open_recording(save(log.data))
