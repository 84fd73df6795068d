from __future__ import annotations

import tracemalloc
from collections import defaultdict
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink import DFReader

from gcs_sysid.errors import RefusedError, SourceError
from gcs_sysid.sources.dataflash import binary, text
from gcs_sysid.sources.dataflash.log import DataflashLog
from gcs_sysid.sources.dataflash.recording import recording
from gcs_sysid.sources.registry import open_recording
from tests.sources.made_dataflash import Dataflash, flight

ONBOARD = "data/arduplane_sitl/B_first_part.BIN"
COMPARED = 3_000_000
"""Bytes of the real log that are compared value by value; pymavlink reads 7 MB a second."""


def read(data: bytes) -> DataflashLog:
    return binary.read(np.frombuffer(data, dtype=np.uint8))


def by_pymavlink(path: Path, *, reader: type) -> dict[str, list]:
    log = reader(str(path))
    rows: dict[str, list] = defaultdict(list)
    while (message := log.recv_msg()) is not None:
        rows[message.get_type()].append(message)
    for one in ("data_map", "filehandle"):  # which pymavlink leaves open
        if hasattr(log, one):
            getattr(log, one).close()
    return rows


def assert_same(ours: DataflashLog, theirs: dict[str, list]) -> None:
    assert {name: one.time_us.size for name, one in ours.messages.items()} == {
        name: len(rows) for name, rows in theirs.items()
    }
    for name, rows in theirs.items():
        one = ours.messages[name]
        for field, letter in zip(one.format.fields, one.format.letters, strict=True):
            expected = [getattr(row, field) for row in rows]
            if letter in "nNZ":
                if name != "FILE":
                    found = [v.split(b"\0")[0].decode("utf-8", "replace") for v in one.raw(field)]
                    # Of a text that holds a comma pymavlink's reader of text keeps the beginning.
                    cut = [
                        whole.split(", ")[0] if ours.messages[name].scaled else whole
                        for whole in found
                    ]
                    assert cut == expected, (name, field)
            elif letter in "cCeEL":
                np.testing.assert_allclose(one.value(field), expected, rtol=1e-12, err_msg=name)
            else:
                np.testing.assert_array_equal(one.raw(field), np.array(expected), f"{name}.{field}")


@pytest.mark.shared
def test_same_messages_as_pymavlink(shared: Path, tmp_path: Path) -> None:
    head = (shared / ONBOARD).read_bytes()[:COMPARED]
    path = tmp_path / "head.BIN"
    path.write_bytes(head)
    ours = read(head)
    theirs = by_pymavlink(path, reader=DFReader.DFReader_binary)
    assert_same(ours, theirs)
    assert ours.lost == {"unknown": 0, "garbage_bytes": 0, "truncated": 1, "bad_stamp": 0}


@pytest.mark.parametrize("form", ["binary", "text"])
def test_a_made_log_reads_as_by_pymavlink(tmp_path: Path, form: str) -> None:
    log = flight()
    path = tmp_path / "made.log"
    path.write_bytes(getattr(log, form))
    if form == "binary":
        ours, theirs = read(log.binary), by_pymavlink(path, reader=DFReader.DFReader_binary)
    else:
        ours, theirs = text.read(log.text), by_pymavlink(path, reader=DFReader.DFReader_text)
        del theirs["FMT"]
    assert_same(ours, theirs)


@pytest.mark.parametrize("form", ["binary", "text"])
def test_streams_have_the_names_and_units_of_telemetry(tmp_path: Path, form: str) -> None:
    path = tmp_path / ("made.BIN" if form == "binary" else "made.log")
    path.write_bytes(getattr(flight(parameters=[("SYSID_THISMAV", 7.0)]), form))
    found = open_recording(path)
    assert found.vehicle.system == 7
    assert found.vehicle.kind == "MAV_TYPE_FIXED_WING"
    assert found.parameters == {"SYSID_THISMAV": 7.0}
    assert found.texts == ((0.0, "ArduPlane V4.6.3, made here"),)
    streams = found.streams
    assert streams["RAW_IMU"].rate == pytest.approx(100.0)
    assert streams["RAW_IMU"].channels["p"][50] == pytest.approx(0.5)
    assert streams["SCALED_IMU2"].channels["acc_x"][0] == pytest.approx(0.25)
    assert streams["RAW_IMU"].channels["temperature"][0] == pytest.approx(298.65)
    assert streams["RAW_IMU"].channels["mag_x"][0] == pytest.approx(224e-7)
    assert np.isnan(streams["RAW_IMU"].channels["mag_x"][1])
    assert np.degrees(streams["ATTITUDE"].channels["roll"][0]) == pytest.approx(10.25)
    assert np.degrees(streams["ATTITUDE"].channels["yaw"][0]) == pytest.approx(-10.0)
    assert streams["SERVO_OUTPUT_RAW"].channels["pwm_1"][1] == 1502.0
    assert not streams["SERVO_OUTPUT_RAW"].has("pwm_3")
    assert streams["GPS_RAW_INT"].channels["v_east"][0] == pytest.approx(20.0)
    assert streams["GPS_RAW_INT"].channels["v_down"][0] == pytest.approx(1.5)
    assert streams["ESC_TELEMETRY_5_TO_8"].channels["rpm_6"][0] == 7000.0
    assert streams["AETR"].channels["demand_elevator"][0] == pytest.approx(-0.5)
    assert streams["AIRSPEED"].channels["airspeed"][0] == pytest.approx(21.5)
    assert streams["VIBE"].count == 20
    assert streams["VIBE"].channels == {}


def test_velocity_is_that_of_the_core_that_flew(tmp_path: Path) -> None:
    """XKF4 names core 1. Its stamps are 40 µs behind those of POS, and still one row with them."""
    path = tmp_path / "made.bin"
    path.write_bytes(flight().binary)
    position = open_recording(path).streams["GLOBAL_POSITION_INT"]
    assert position.count == 100
    np.testing.assert_allclose(position.channels["v_north"], 21.0)
    np.testing.assert_allclose(np.degrees(position.channels["latitude"]), -35.3, rtol=1e-7)


def test_wall_time_comes_from_the_receiver(tmp_path: Path) -> None:
    """GPS week 2445 and 574670.2 s of it, less 18 leap seconds, is 21 November 2026 16:57:32.2."""
    path = tmp_path / "made.bin"
    path.write_bytes(flight().binary)
    found = open_recording(path)
    assert found.epoch_us == 1_795_275_452_200_000
    assert any("from 20 GPS messages" in note for note in found.clock_notes)


def test_a_log_without_wall_time_says_so() -> None:
    log = Dataflash().add("ATT", 5_000_000, 1.0, 2.0, 3.0)
    found = recording(read(log.binary), source="log", sha256="")
    assert found.epoch_us == 5_000_000
    assert any("no wall time" in note for note in found.clock_notes)


def test_units_that_the_log_states_are_obeyed() -> None:
    """A later version might log attitude in radians or a field in another power of ten."""
    log = Dataflash().units("MAG", "s#GGG", "F-BBB")
    log.add("MAG", 5_000_000, 0, 22, 8, -53)
    channels = recording(read(log.binary), source="log", sha256="").streams["RAW_IMU"].channels
    assert channels["mag_x"][0] == pytest.approx(22e-2 * 1e-4)


def test_a_sensor_that_is_not_healthy_was_not_measured() -> None:
    log = Dataflash()
    for i in range(4):
        log.add("ARSP", 1_000_000 * (i + 1), 0, 20.0, int(i != 2))
    airspeed = recording(read(log.binary), source="log", sha256="").streams["AIRSPEED"]
    assert airspeed.valid("airspeed").tolist() == [True, True, False, True]


def test_what_the_autopilot_could_not_write_is_counted() -> None:
    log = flight(0.1).add("DSF", 1_050_000, 3).add("DSF", 1_090_000, 12)
    assert recording(read(log.binary), source="log", sha256="").lost["dropped"] == 12


def test_losses_are_counted_by_reason() -> None:
    log = flight(0.5)
    frames = log.frames
    broken = b"".join(frames[:40]) + b"\0" * 100 + b"".join(frames[40:60])
    broken += b"\xa3\x95\xf0" + b"?" * 8 + b"".join(frames[60:-1]) + frames[-1][:-2]
    found = read(broken)
    # The frame in front of the zeros may itself be cut: without a checksum nothing tells.
    assert found.lost["truncated"] == 2
    assert found.lost["unknown"] == 1
    assert found.lost["garbage_bytes"] == 100 + 11 + len(frames[39])
    assert found.count == len(frames) - 2


def test_a_start_mark_inside_a_message_is_no_message() -> None:
    log = Dataflash()
    for i in range(5):
        log.add("RCOU", 1_000_000 + i, 0x95A3, 131, 7)
    assert read(log.binary).messages["RCOU"].time_us.size == 5
    assert "ATT" not in read(log.binary).messages


def test_a_damaged_stamp_is_counted_and_left_out() -> None:
    log = Dataflash()
    for i in range(30):
        log.add("ATT", 1_000_000 + 10_000 * i if i != 7 else 2**50, 1.0, 2.0, 3.0)
    found = recording(read(log.binary), source="log", sha256="")
    assert found.lost["bad_stamp"] == 1
    assert found.streams["ATTITUDE"].count == 29
    assert found.streams["ATTITUDE"].time[-1] == pytest.approx(0.29)


def test_a_sensor_with_an_impossible_number_is_no_sensor() -> None:
    """In text a damaged digit made the number of a sensor negative, and the reader failed on it."""
    data = flight(0.2).text.replace(b"IMU, 1000000, 0,", b"IMU, 1000000, -7,")
    found = recording(text.read(data), source="log", sha256="")
    assert found.streams["RAW_IMU"].valid("p").sum() == 19
    assert found.streams["SCALED_IMU2"].valid("p").sum() == 20
    assert found.lost["bad_instance"] == 1


def test_two_logs_in_one_file_follow_each_other() -> None:
    data = flight(4.0).binary
    found = recording(read(data + data), source="log", sha256="")
    inertial = found.streams["RAW_IMU"]
    assert inertial.count == 800
    assert np.all(np.diff(inertial.time) > 0.0)
    assert any("restarted 1 time" in note for note in found.clock_notes)


def test_blocks_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    data = flight(1.0).binary
    whole = read(data)
    monkeypatch.setattr(binary, "_BLOCK", 997)
    parts = read(data)
    assert parts.lost == whole.lost
    for name, one in whole.messages.items():
        np.testing.assert_array_equal(parts.messages[name].rows, one.rows, name)
        np.testing.assert_array_equal(parts.messages[name].time_us, one.time_us)


@pytest.mark.parametrize("content", [b"\0" * 500, b"\xa3\x95" * 300, b"PK\x03\x04" + b"x" * 200])
@pytest.mark.parametrize("name", ["flight.bin", "flight.log"])
def test_files_that_are_no_such_log(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(SourceError, match="no DataFlash message in") as error:
        open_recording(path)
    assert "\n" not in str(error.value)


def test_another_vehicle_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "made.bin"
    path.write_bytes(flight(0.1).binary)
    assert open_recording(path, vehicle=1).vehicle.system == 1
    with pytest.raises(RefusedError, match=r"system id is 1; .*--vehicle 1"):
        open_recording(path, vehicle=9)


def test_progress_is_told(tmp_path: Path) -> None:
    path = tmp_path / "made.bin"
    path.write_bytes(flight(0.1).binary)
    told: list[float] = []
    open_recording(path, progress=told.append)
    assert told[-1] == 1.0


@settings(max_examples=40)
@given(
    flips=st.lists(st.tuples(st.integers(0, 10**6), st.integers(1, 255)), max_size=20),
    cuts=st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 200)), max_size=4),
    seed=st.integers(0, 2**32),
    form=st.sampled_from(["binary", "text"]),
)
def test_damage_never_breaks_the_reader(
    flips: list[tuple[int, int]], cuts: list[tuple[int, int]], seed: int, form: str
) -> None:
    """Flipped bytes, cuts, repeated and reordered messages: read what is left, count the rest."""
    log = DAMAGED
    pieces = log.frames if form == "binary" else [f"{line}\n".encode() for line in log.lines]
    data = bytearray(
        b"".join([*pieces[:DEFINITIONS], *Random(seed).choices(pieces, k=len(pieces))])
    )
    for place, bits in flips:
        data[place % len(data)] ^= bits
    for place, width in cuts:
        at = place % len(data)
        data = data[:at] + data[at + width :]
    found = read(bytes(data)) if form == "binary" else text.read(bytes(data))
    assert set(found.lost) == {"unknown", "garbage_bytes", "truncated", "bad_stamp"}
    try:
        whole = recording(found, source="log", sha256="")
    except SourceError:
        return
    for stream in whole.streams.values():
        assert np.all(np.isfinite(stream.time))
        assert np.all(np.diff(stream.time) >= 0.0)


def test_hostile_files_take_bounded_memory() -> None:
    """A file of headers only makes every second place a candidate."""
    data = np.frombuffer(flight(0.0).binary + b"\xa3\x95\x82" * 300_000, dtype=np.uint8)
    tracemalloc.start()
    binary.read(data)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 150e6


@pytest.mark.shared
def test_a_large_log_takes_bounded_memory(shared: Path) -> None:
    """Thirty megabytes become a Recording of sixty and never take more than 250."""
    tracemalloc.start()
    open_recording(shared / ONBOARD)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 250e6


DEFINITIONS = len(Dataflash().frames)
DAMAGED = flight(0.3, parameters=[("ARSPD_RATIO", 2.0)])

SAME = {
    "ATTITUDE": {"roll": 2e-4, "pitch": 6e-4},
    "GLOBAL_POSITION_INT": {
        "latitude": 3e-9, "longitude": 3e-9, "altitude": 5e-3, "height": 5e-3,
        "v_north": 0.015, "v_east": 0.015, "v_down": 0.035,
    },
    "LOCAL_POSITION_NED": {"north": 0.02, "east": 0.02, "height": 5e-3, "v_north": 0.01},
    "GPS_RAW_INT": {"latitude": 4e-9, "longitude": 4e-9, "v_north": 0.015, "v_east": 0.015},
    "RAW_IMU": {"p": 3e-3, "q": 0.015, "r": 5e-3, "temperature": 0.011},
    "SCALED_PRESSURE": {"temperature": 0.011},
    "WIND": {"wind_north": 0.011, "wind_east": 0.011},
    "ESC_TELEMETRY_1_TO_4": {"rpm_3": 20.0},
    "VFR_HUD": {"throttle": 0.02},
}  # fmt: skip
"""99 % of the telemetry's values are this close to the onboard log's, interpolated. Reasons: the
steps of the MAVLink fields, and what changes within the five milliseconds between two samples."""


@pytest.mark.shared
def test_the_onboard_log_and_the_telemetry_of_one_flight_agree(shared: Path) -> None:
    onboard = open_recording(shared / ONBOARD)
    sent = open_recording(shared / "data/arduplane_sitl/B.tlog")
    for name, channels in SAME.items():
        mine, theirs = onboard.streams[name], sent.streams[name]
        for channel, tolerance in channels.items():
            good, known = mine.valid(channel), theirs.valid(channel)
            time, wanted = onboard.time_us(mine.time[good]), sent.time_us(theirs.time[known])
            inside = (wanted > time[0]) & (wanted < time[-1])
            found = np.interp(wanted[inside], time, mine.channels[channel][good])
            error = np.abs(found - theirs.channels[channel][known][inside])
            assert inside.sum() > 200
            assert np.percentile(error, 99.0) < tolerance, (name, channel)
    assert onboard.vehicle.system == sent.vehicle.system
    assert onboard.vehicle.kind == sent.vehicle.kind
    assert set(onboard.parameters) == set(sent.parameters)
    same = [onboard.parameters[name] == sent.parameters[name] for name in sent.parameters]
    assert sum(same) >= len(same) - 5  # counters and calibrations at start-up go on changing
    assert onboard.lost["truncated"] == 1
