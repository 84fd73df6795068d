"""Our reader against pymavlink's on real logs: same messages, same counts, same values."""

from __future__ import annotations

import tracemalloc
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink import mavutil

from gcs_sysid.sources import assemble, tlog
from gcs_sysid.sources.registry import open_recording
from gcs_sysid.sources.tables import LogTables, TableKey

LOGS = (
    "cases/airspeed_scale/flight.tlog",
    "cases/cg_shift/flight.tlog",
    "cases/clean/flight.tlog",
    "cases/clean_second/flight.tlog",
    "data/arduplane_sitl/A.tlog",
    "data/arduplane_sitl/A_lowrate.tlog",
    "data/arduplane_sitl/B.tlog",
    "data/arduplane_sitl/B_lowrate.tlog",
    "data/proto_flt09/proto_flt09.tlog",
    "data/quadplane_sitl/vtol.tlog",
    "data/solarsurfer/flight3.tlog",
    "data/umn_thor/thor_flight75.tlog",
)
COMPARED = 1_000_000
"""Bytes of each log that are compared value by value; pymavlink reads a megabyte a second."""


def by_pymavlink(path: Path) -> dict[TableKey, list]:
    """(arrival [µs], values in the order of the definition) of all messages."""
    log = mavutil.mavlink_connection(str(path), dialect="all")
    rows: dict[TableKey, list] = defaultdict(list)
    while (message := log.recv_msg()) is not None:
        name = message.get_type()
        if name != "BAD_DATA" and not name.startswith("UNKNOWN"):
            key = TableKey(message.get_srcSystem(), message.get_srcComponent(), name)
            values = [getattr(message, field) for field in message.fieldnames]
            rows[key].append((round(message._timestamp * 1e6), message.fieldnames, values))
    log.close()
    return rows


def assert_same(ours: LogTables, theirs: dict[TableKey, list]) -> None:
    assert {key: table.count for key, table in ours.tables.items()} == {
        key: len(rows) for key, rows in theirs.items()
    }
    for key, rows in theirs.items():
        table = ours.tables[key]
        np.testing.assert_allclose(table.link_us, [row[0] for row in rows], atol=1)
        for i, field in enumerate(rows[0][1]):
            expected = [row[2][i] for row in rows]
            if table.fields[field].dtype.kind == "S":
                found = [value.decode("utf-8", "replace") for value in table.fields[field].tolist()]
                assert found == [str(text) for text in expected], (key, field)
            else:
                found = table.fields[field].astype(np.float64)
                np.testing.assert_array_equal(found, np.array(expected, np.float64), str(key))


@pytest.mark.shared
@pytest.mark.parametrize("log", LOGS)
def test_same_as_pymavlink(shared: Path, tmp_path: Path, log: str) -> None:
    head = (shared / log).read_bytes()[:COMPARED]
    path = tmp_path / "head.tlog"
    path.write_bytes(head)
    assert_same(tlog.read(head), by_pymavlink(path))


@pytest.mark.shared
@pytest.mark.parametrize("log", LOGS)
def test_real_logs_are_read_whole(shared: Path, log: str) -> None:
    recording = open_recording(shared / log)
    assert sum(recording.lost.values()) == 0
    data = (shared / log).read_bytes()
    frames = tlog.frames(data)
    assert sum(8 + len(frame) for _, frame in frames) == len(data)
    assert len(frames) == recording.vehicle.messages
    for stream in recording.streams.values():
        assert np.all(np.diff(stream.time) >= 0.0)
    assert recording.streams["ATTITUDE"].stamped


@pytest.mark.shared
def test_the_log_clock_is_that_of_the_truth(shared: Path) -> None:
    """Arrivals there are up to 10 ms late; the truth's time zero is the vehicle's."""
    for case in ("clean", "clean_second"):
        truth = np.load(shared / "cases" / case / "truth.npz")
        recording = open_recording(shared / "cases" / case / "flight.tlog")
        boot = recording.streams["SYSTEM_TIME"]
        first_us = recording.time_us(boot.time)[0]
        assert first_us == round(boot.channels["time_unix"][0] * 1e6)
        assert (first_us - int(truth["t0_us"])) % 1000 == 0
        rows, columns = truth["rows"], [str(name) for name in truth["cols"]]
        t = rows[:, columns.index("t")] + (int(truth["t0_us"]) - recording.epoch_us) * 1e-6
        attitude = recording.streams["ATTITUDE"]
        at_truth = np.interp(attitude.time, t, rows[:, columns.index("q")])
        assert np.std(attitude.channels["q"] - at_truth) < 0.01
        late = np.interp(attitude.time - 0.01, t, rows[:, columns.index("q")])
        assert np.std(attitude.channels["q"] - late) > np.std(attitude.channels["q"] - at_truth)


@pytest.mark.shared
def test_streams_without_a_stamp_fit_those_with_one(shared: Path) -> None:
    """VFR_HUD shows the speed of the pitot whose pressure SCALED_PRESSURE brings with a stamp."""
    recording = open_recording(shared / "data/arduplane_sitl/A.tlog")
    pressure, display = recording.streams["SCALED_PRESSURE"], recording.streams["VFR_HUD"]
    dynamic = np.clip(pressure.channels["dynamic_pressure"], 0.0, None)
    speed = np.sqrt(2.0 * dynamic / 1.225)
    grid = np.arange(100.0, 700.0, 0.02)
    shown = np.gradient(np.interp(grid, display.time, display.channels["airspeed"]))
    shifts = np.arange(-0.06, 0.061, 0.01)
    errors = [
        np.std(np.gradient(np.interp(grid - shift, pressure.time, speed)) - shown)
        for shift in shifts
    ]
    assert abs(shifts[int(np.argmin(errors))]) < 0.011


@pytest.mark.shared
def test_memory_stays_within_bounds(shared: Path) -> None:
    """A log of 21 MB takes less than 300 MB, the file itself included."""
    path = shared / "data/arduplane_sitl/A.tlog"
    tracemalloc.start()
    open_recording(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 300e6


@pytest.mark.parametrize("byte", [0xFD, 0xFE])
def test_hostile_files_take_no_more(byte: int) -> None:
    """A file of start bytes only makes every place a candidate."""
    tracemalloc.start()
    tables = tlog.read(bytes([byte]) * 400_000)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert tables.tables == {}
    assert peak < 150e6


def some_log(writer: type) -> bytes:
    log = writer().heartbeat(0)
    for i in range(12):
        log.add(20_000 * i, "ATTITUDE", time_boot_ms=5000 + 20 * i, roll=0.1)
        log.add(20_000 * i + 5, "RAW_IMU", time_usec=5_000_000 + 20_000 * i, zacc=-1000)
        log.add(20_000 * i + 9, "SYSTEM_TIME", time_boot_ms=5000, time_unix_usec=10**15 + i)
        log.add(20_000 * i + 9, "VFR_HUD", airspeed=12.0)
    return log.data


@settings(max_examples=60)
@given(
    flips=st.lists(st.tuples(st.integers(0, 10**6), st.integers(1, 255)), max_size=20),
    cuts=st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 80)), max_size=4),
    order=st.randoms(use_true_random=False),
)
def test_damage_never_breaks_the_reader(
    writer: type, flips: list[tuple[int, int]], cuts: list[tuple[int, int]], order: object
) -> None:
    """Flipped bytes, cuts, repeated and reordered frames: read what is left, count what is not."""
    records = [at.to_bytes(8, "big") + frame for at, frame in tlog.frames(some_log(writer))]
    records = order.choices(records, k=len(records))
    data = bytearray(b"".join(records))
    for place, bits in flips:
        data[place % len(data)] ^= bits
    for place, width in cuts:
        at = place % len(data)
        data = data[:at] + data[at + width :]
        if not data:
            return
    log = tlog.read(bytes(data))
    assert set(log.lost) == {"bad_crc", "unknown", "garbage_bytes", "truncated"}
    if assemble.vehicles(log.tables):
        vehicle = assemble.vehicles(log.tables)[0].system
        recording = assemble.recording(log, source="log", sha256="", vehicle=vehicle)
        for stream in recording.streams.values():
            assert np.all(np.isfinite(stream.time))
            assert np.all(np.diff(stream.time) >= 0.0)


def test_absurd_values_are_read(writer: type) -> None:
    log = writer().heartbeat(0)
    for i, stamp in enumerate([2**64 - 1, 0, 1, 2**63, 10**18, 5_000_000]):
        log.add(1000 * i, "RAW_IMU", time_usec=stamp, xacc=-32768)
        log.add(1000 * i, "SYSTEM_TIME", time_unix_usec=2**64 - 1 - i, time_boot_ms=2**32 - 1)
        log.add(1000 * i, "GPS_RAW_INT", time_usec=stamp, fix_type=255, lat=-(2**31), alt=2**31 - 1)
    recording = assemble.recording(tlog.read(log.data), source="log", sha256="", vehicle=None)
    counts = Counter({name: stream.count for name, stream in recording.streams.items()})
    assert counts["RAW_IMU"] == 6
    for stream in recording.streams.values():
        assert np.all(np.isfinite(stream.time))
