from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyarrow import parquet

from gcs_sysid.errors import RefusedError, SourceError
from gcs_sysid.sources.registry import open_recording
from tests.sources import made_tables
from tests.sources.made_tables import HOLD, column_map, columns, made_recording, write

MADE = made_recording()
NOT_A_ROUNDING = 1e-12
"""Relative: a few operations in double precision."""


@pytest.fixture
def opened(tmp_path):
    """Writes a table and a column map, and opens them."""

    def to_recording(table, text=None, suffix=".csv", **options):
        path = write(table, tmp_path / f"flight{suffix}")
        map_path = tmp_path / "map.toml"
        map_path.write_text(column_map() if text is None else text, encoding="utf-8")
        return open_recording(path, columns=map_path, **options)

    return to_recording


def assert_same(found, expected):
    assert set(found.streams) == set(expected.streams)
    for name, stream in expected.streams.items():
        other = found.streams[name]
        np.testing.assert_allclose(
            found.time_us(other.time), expected.time_us(stream.time), atol=1, err_msg=name
        )
        assert set(other.channels) == set(stream.channels)
        for channel, values in stream.channels.items():
            np.testing.assert_allclose(
                other.channels[channel], values, rtol=NOT_A_ROUNDING, atol=1e-11, err_msg=channel
            )


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
def test_a_flight_written_as_a_table_comes_back(opened, suffix):
    found = opened(columns(MADE), suffix=suffix)
    assert found.epoch_us == MADE.epoch_us
    assert found.vehicle == MADE.vehicle.__class__(
        1, 1, "MAV_AUTOPILOT_INVALID", "MAV_TYPE_FIXED_WING", found.vehicle.messages
    )
    assert_same(found, MADE)


def test_held_values_count_once_and_commands_at_every_row(opened):
    found = opened(columns(MADE))
    assert found.streams["VFR_HUD"].count == MADE.streams["RAW_IMU"].count / HOLD
    assert found.streams["SERVO_OUTPUT_RAW"].count == MADE.streams["RAW_IMU"].count
    assert any(note.startswith("airspeed: held for 5 rows") for note in found.clock_notes)


def test_what_the_sensors_measure_together_is_thinned_together(opened):
    """Velocity that does not change in one component is still a new velocity."""
    table = columns(MADE)
    table["x_v_down"][:] = 0.0
    stream = opened(table).streams["GLOBAL_POSITION_INT"]
    whole = np.isfinite(stream.channels["v_north"]) & np.isfinite(stream.channels["v_down"])
    assert whole.sum() == MADE.streams["RAW_IMU"].count / HOLD


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=20)
@given(
    scale=st.floats(0.01, 100.0),
    sign=st.sampled_from([1, -1]),
    offset=st.floats(-50.0, 50.0),
    unit=st.sampled_from([("deg", np.pi / 180.0), ("rad", 1.0)]),
)
def test_scale_sign_and_offset_are_in_the_stated_unit(opened, scale, sign, offset, unit):
    raw = np.linspace(-2.0, 2.0, 7)
    text = (
        'time = { name = "t", unit = "s" }\n'
        f'alpha = {{ name = "a", unit = "{unit[0]}", scale = {scale!r}, sign = {sign}, '
        f"offset = {offset!r} }}"
    )
    stream = opened({"t": np.arange(7.0), "a": raw}, text).streams["AOA_SSA"]
    expected = unit[1] * (sign * scale * raw + offset)
    np.testing.assert_allclose(stream.channels["alpha"], expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("unit", "size"), [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)])
@pytest.mark.parametrize("start", [0.0, 1.6e9])
def test_time_in_any_unit_from_boot_or_from_1970(opened, unit, size, start):
    """Times since 1970 in whole milliseconds: a double holds 2e-7 s there."""
    time = start + 0.02 * np.arange(50)
    text = f'time = {{ name = "t", unit = "{unit}" }}\nq = {{ name = "q", unit = "rad/s" }}'
    found = opened({"t": time / size, "q": np.sin(time)}, text)
    assert found.epoch_us == pytest.approx(start * 1e6, abs=1)
    np.testing.assert_allclose(found.streams["RAW_IMU"].time, time - start, atol=1e-6)


def test_dates_are_times(tmp_path):
    dates = pa.array(np.arange(50) * 20_000 + 1_777_627_800_000_000, pa.timestamp("us"))
    path = tmp_path / "flight.parquet"
    parquet.write_table(pa.table({"when": dates, "q": np.arange(50.0)}), path)
    text = 'time = { name = "when", unit = "us" }\nq = { name = "q", unit = "rad/s" }'
    map_path = tmp_path / "map.toml"
    map_path.write_text(text)
    found = open_recording(path, columns=map_path)
    assert found.epoch_us == made_tables.EPOCH_US
    assert found.streams["RAW_IMU"].rate == pytest.approx(50.0)


def test_a_deflection_becomes_the_pulse_behind_it(opened):
    """The calibration of the aircraft file, inverted; its end slopes go on."""
    text = (
        'time = { name = "t", unit = "s" }\n'
        'pwm_2 = { name = "de", unit = "rad", pwm = [1000, 1500, 2100],'
        " deflection = [20.0, 0.0, -30.0] }"
    )
    degrees = np.array([20.0, 10.0, 0.0, -15.0, -30.0, 25.0, -35.0])
    found = opened({"t": np.arange(7.0), "de": np.radians(degrees)}, text)
    expected = [1000.0, 1250.0, 1500.0, 1800.0, 2100.0, 875.0, 2200.0]
    np.testing.assert_allclose(found.streams["SERVO_OUTPUT_RAW"].channels["pwm_2"], expected)


def test_course_and_speed_become_velocity(opened):
    angle = np.linspace(0.0, 359.0, 40)
    text = (
        'time = { name = "t", unit = "s" }\n'
        'course = { name = "c", unit = "deg" }\ngroundspeed = { name = "v", unit = "kt" }'
    )
    table = {"t": np.arange(40.0), "c": angle, "v": np.linspace(30.0, 40.0, 40)}
    channels = opened(table, text).streams["GLOBAL_POSITION_INT"].channels
    speed = table["v"] * 1852.0 / 3600.0
    np.testing.assert_allclose(np.hypot(channels["v_north"], channels["v_east"]), speed)
    np.testing.assert_allclose(channels["v_north"], speed * np.cos(np.radians(angle)), atol=1e-9)


def test_structs_matrices_and_their_labels_are_addressed_as_matlab_does(tmp_path):
    path, map_path = tmp_path / "flight.mat", tmp_path / "map.toml"
    time, slow = np.arange(50.0), np.arange(0.0, 50.0, 5.0)
    content = {
        "log": {"imu": {"t": time, "q": np.sin(time)}},
        "ATT": np.stack([slow, np.cos(slow)], axis=1),
        "ATT_label": np.array(["TimeMS", "Roll"], dtype=object),
    }
    scipy.io.savemat(path, content)
    map_path.write_text(
        'time = { name = "log.imu.t", unit = "s" }\n'
        'q = { name = "log.imu.q", unit = "rad/s" }\n'
        'roll = { name = "ATT.Roll", unit = "rad", time = "ATT(:,1)" }\n'
    )
    streams = open_recording(path, columns=map_path).streams
    np.testing.assert_array_equal(streams["RAW_IMU"].channels["q"], np.sin(time))
    np.testing.assert_array_equal(streams["ATTITUDE"].time, slow)
    np.testing.assert_allclose(streams["ATTITUDE"].channels["roll"], np.cos(slow), atol=1e-15)


def test_sensors_of_one_message_keep_their_own_times(opened):
    """Where only one of them measured, the other is unknown, not repeated."""
    text = (
        'time = { name = "t", unit = "s" }\nalpha = { name = "a", unit = "rad" }\n'
        'beta = { name = "b", unit = "rad" }'
    )
    blank = np.where(np.arange(40) % 4 == 0, np.arange(40.0), np.nan)
    stream = opened({"t": np.arange(40.0), "a": np.arange(40.0), "b": blank}, text).streams[
        "AOA_SSA"
    ]
    assert stream.count == 40
    np.testing.assert_array_equal(stream.valid("beta"), np.arange(40) % 4 == 0)


def test_rows_without_time_or_at_the_same_time_are_counted(opened):
    time = np.array([0.0, 1.0, np.nan, 2.0, 2.0, 3.0])
    text = 'time = { name = "t", unit = "s" }\nq = { name = "q", unit = "rad/s" }'
    found = opened({"t": time, "q": np.arange(6.0)}, text)
    assert found.lost == {"rows_without_time": 1, "rows_at_same_time": 1}
    assert found.streams["RAW_IMU"].channels["q"].tolist() == [0.0, 1.0, 3.0, 5.0]


def test_zeros_before_the_sensors_start_are_no_measurements(opened):
    table = columns(MADE)
    for name in ("acc_x", "acc_y", "acc_z", "roll", "pitch", "yaw"):
        table[f"x_{name}"][:7] = 0.0
    streams = opened(table).streams
    assert streams["RAW_IMU"].valid("acc_z").sum() == 493
    assert streams["RAW_IMU"].valid("p").sum() == 500
    assert streams["ATTITUDE"].time[0] == pytest.approx(7 * 0.02)


def lines(*more):
    return "\n".join(
        ['time = { name = "t", unit = "s" }', 'q = { name = "q", unit = "rad/s" }', *more]
    )


@pytest.mark.parametrize(
    ("table", "text", "said"),
    [
        ({"t": [0, 1], "pitch_rate": [1, 2]}, lines().replace('"q"', '"pitchrate"'),
         ["no column `pitchrate`", "map.toml gives for q", "did you mean `pitch_rate`?"]),
        ({"t": [0, 1], "w": [1, 2]}, lines(), ["no column `q`", "the columns are t, w"]),
        ({"time": [0, 1], "q": [1, 2]}, lines(), ["no column `t`", "for time"]),
        ({"t": [0, 1], "q": ["a", "b"]}, lines(), ["`q`, given for q, does not hold numbers"]),
        ({"t": [0.0, 2.0, 1.0], "q": [1, 2, 3]}, lines(),
         ["column `t`: time falls back in row 3, from 2 to 1", "two runs"]),
        ({"t": [0, 0, 0, 1], "q": [1, 2, 3, 4]}, lines(), ["stands still"]),
        ({"t": ["", ""], "q": [1, 2]}, lines(), ["column `t`"]),
        ({"t": [1e9, 2e9], "q": [1, 2]}, lines(), ["days apart", "units of time"]),
        ({"t": [1.6e9, 1.7e9 - 1e8 + 1], "q": [1, 2]}, lines("epoch = 2026-05-01T09:30:00Z"),
         ["counts from 1970 already", "take `epoch` out"]),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_told_in_one_line(opened, table, text, said):
    with pytest.raises(SourceError) as caught:
        opened({name: np.array(values) for name, values in table.items()}, text)
    message = str(caught.value)
    assert "\n" not in message
    assert "flight.csv" in message
    assert all(part in message for part in said), message


def test_columns_of_different_length_ask_for_a_time_of_their_own(opened):
    with pytest.raises(SourceError, match=r'`q` has 5 rows .* `t` 9; add `time = "COLUMN"` to q'):
        opened({"t": np.arange(9.0), "q": np.arange(5.0)}, lines(), suffix=".mat")


def test_without_a_map_the_columns_and_an_example_are_shown(tmp_path):
    path = write(columns(MADE), tmp_path / "flight.csv")
    with pytest.raises(SourceError) as caught:
        open_recording(path)
    message = str(caught.value)
    assert "`t`, `x_acc_x`" in message
    assert 'time = { name = "t", unit = "s" }' in message
    assert "--columns" in message
    assert "\n" not in message


def test_a_table_holds_one_vehicle(opened):
    assert opened(columns(MADE), vehicle=1).vehicle.system == 1
    with pytest.raises(RefusedError, match="leave --vehicle out"):
        opened(columns(MADE), vehicle=2)


def opened_or_said(path, map_path):
    try:
        return open_recording(path, columns=map_path).source
    except SourceError as error:
        return str(error)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25)
@given(data=st.data())
def test_damaged_files_are_told_in_one_line_or_read(tmp_path, suffix, data):
    """Bytes that are no table, and tables cut short or with a flipped byte."""
    whole = (write(columns(made_recording(count=30)), tmp_path / f"whole{suffix}")).read_bytes()
    kind = data.draw(st.sampled_from(["any", "cut", "flip"]))
    place = data.draw(st.integers(0, len(whole) - 1))
    flipped = whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :]
    content = {"any": data.draw(st.binary(min_size=1, max_size=300)), "cut": whole[: place + 1]}
    damaged = content.get(kind, flipped)
    path, map_path = tmp_path / f"damaged{suffix}", tmp_path / "map.toml"
    path.write_bytes(damaged)
    map_path.write_text(column_map(), encoding="utf-8")
    assert "\n" not in opened_or_said(path, map_path)


@pytest.mark.parametrize(
    "damage",
    [
        {896: 235, 176: 213},  # an unknown type of element
        {2849: 220},  # a vector that says it is complex and is not
    ],
)
def test_a_mat_file_that_would_crash_its_reader_is_told(tmp_path, damage):
    """SciPy's reader ended the whole program on these bytes."""
    damaged = bytearray(
        write(columns(made_recording(count=30)), tmp_path / "flight.mat").read_bytes()
    )
    for place, value in damage.items():
        damaged[place] = value
    (tmp_path / "flight.mat").write_bytes(bytes(damaged))
    with pytest.raises(SourceError, match=r"cannot be read as \.mat"):
        open_recording(tmp_path / "flight.mat", columns=Path("unused.toml"))


def test_a_matlab_7_3_file_says_how_to_save_it(tmp_path):
    path = tmp_path / "flight.mat"
    header = b"MATLAB 7.3 MAT-file".ljust(116) + bytes(8) + b"\x00\x02IM"
    path.write_bytes(header + b"\x89HDF\r\n\x1a\n" + bytes(600))
    with pytest.raises(SourceError, match="save -v7"):
        open_recording(path, columns=Path("unused.toml"))
