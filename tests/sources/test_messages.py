from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as dialect

from gcs_sysid.recording import CHANNELS
from gcs_sysid.sources import messages
from gcs_sysid.sources.tlog import read

ROOT = Path(__file__).resolve().parents[2]

SI: dict[str, float] = {
    "mG": 9.80665e-3,
    "mrad/s": 1e-3,
    "mgauss": 1e-7,
    "gauss": 1e-4,
    "m/s/s": 1.0,
    "rad": 1.0,
    "rad/s": 1.0,
    "deg": np.pi / 180,
    "degE7": np.pi / 180e7,
    "cdeg": np.pi / 18000,
    "m": 1.0,
    "mm": 1e-3,
    "m/s": 1.0,
    "cm/s": 1e-2,
    "hPa": 100.0,
    "cdegC": 1e-2,
    "degC": 1.0,
    "mV": 1e-3,
    "cA": 1e-2,
    "us": 1.0,
    "%": 1e-2,
}
"""SI units per unit of the definitions; pulses stay in µs, as `CHANNELS` has them."""

UNITLESS = {"q1", "custom_mode", "rpm", "rpm1", "rpm2", "pressure_alt"}


def definition(name: str) -> type:
    return next(c for c in dialect.mavlink_map.values() if c.msgname == name)


@pytest.mark.parametrize("name", sorted(messages.QUANTITIES))
def test_scales_are_those_of_the_definition(name: str) -> None:
    units = definition(name).fieldunits_by_name
    for quantity in messages.QUANTITIES[name]:
        if quantity.field == "time_unix_usec":
            assert quantity.scale == 1e-6
            continue
        unit = units.get(quantity.field)
        if unit is None:
            assert quantity.field in UNITLESS, quantity.field
            assert quantity.scale == 1.0
            continue
        assert quantity.scale == pytest.approx(SI[unit], rel=1e-12), quantity
        assert quantity.offset == (273.15 if unit in ("cdegC", "degC") else 0.0)


def decode(writer: type, name: str, rows: list[dict[str, object]]) -> dict[str, np.ndarray]:
    """Channels of messages that went over the wire."""
    log = writer()
    for i, row in enumerate(rows):
        log.add(i * 1000, name, **row)
    (table,) = read(log.data).tables.values()
    return messages.channels(name, table.fields)


def one(writer: type, name: str, **fields: object) -> dict[str, float]:
    return {key: float(value[0]) for key, value in decode(writer, name, [fields]).items()}


@pytest.mark.parametrize("name", sorted({*messages.QUANTITIES, *messages.SPECIAL}))
def test_every_channel_has_a_meaning(writer: type, name: str) -> None:
    for channel in one(writer, name):
        assert re.sub(r"_\d+$", "_N", channel) in CHANNELS or channel in CHANNELS, channel


int16 = st.integers(-32768, 32767)


@given(acc=st.tuples(int16, int16, int16), gyro=st.tuples(int16, int16, int16))
def test_imu_round_trip(
    writer: type, acc: tuple[int, int, int], gyro: tuple[int, int, int]
) -> None:
    raw = dict(zip(("xacc", "yacc", "zacc"), acc, strict=True))
    raw |= dict(zip(("xgyro", "ygyro", "zgyro"), gyro, strict=True))
    found = one(writer, "SCALED_IMU2", **raw)
    back = [found[c] / 9.80665 * 1000 for c in ("acc_x", "acc_y", "acc_z")]
    if any(acc):
        np.testing.assert_allclose(back, acc, atol=1e-9)
        np.testing.assert_allclose([1000 * found[c] for c in "pqr"], gyro, atol=1e-9)
    else:
        assert np.all(np.isnan(back))


def test_an_accelerometer_that_has_not_started_measures_nothing(writer: type) -> None:
    found = decode(writer, "RAW_IMU", [{}, {"zacc": -1000, "xgyro": 0}])
    assert np.isnan(found["acc_x"]).tolist() == [True, False]
    assert np.isnan(found["p"]).tolist() == [True, False]
    assert np.isnan(found["mag_x"]).all()
    assert np.isnan(found["temperature"]).all()


def test_rates_count_without_an_accelerometer(writer: type) -> None:
    found = one(writer, "RAW_IMU", xgyro=20)
    assert np.isnan(found["acc_z"])
    assert found["p"] == pytest.approx(0.02)
    assert found["q"] == 0.0


def test_highres_imu_fields_that_were_not_updated_are_not_measured(writer: type) -> None:
    values = {"xacc": 1.0, "zacc": -9.8, "xgyro": 0.5, "abs_pressure": 1000.0, "temperature": 20.0}
    found = one(writer, "HIGHRES_IMU", fields_updated=0b000111, **values)
    assert found["acc_x"] == pytest.approx(1.0)
    assert np.isnan(found["p"])
    assert np.isnan(found["static_pressure"])
    without_bitmap = one(writer, "HIGHRES_IMU", fields_updated=0, **values)
    assert without_bitmap["p"] == pytest.approx(0.5)
    assert without_bitmap["static_pressure"] == pytest.approx(100_000.0)
    assert without_bitmap["temperature"] == pytest.approx(293.15)


@given(roll=st.floats(-3.1, 3.1), pitch=st.floats(-1.5, 1.5), yaw=st.floats(-3.1, 3.1))
def test_quaternion_and_angles_agree(writer: type, roll: float, pitch: float, yaw: float) -> None:
    c = [np.cos(a / 2) for a in (roll, pitch, yaw)]
    s = [np.sin(a / 2) for a in (roll, pitch, yaw)]
    found = one(
        writer,
        "ATTITUDE_QUATERNION",
        q1=c[0] * c[1] * c[2] + s[0] * s[1] * s[2],
        q2=s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
        q3=c[0] * s[1] * c[2] + s[0] * c[1] * s[2],
        q4=c[0] * c[1] * s[2] - s[0] * s[1] * c[2],
    )
    # Single precision on the wire; near the vertical a pitch of 1e-7 is one of 1e-3 in cos(pitch).
    tolerance = 2e-6 / max(np.cos(pitch), 1e-3)
    for name, angle in (("roll", roll), ("pitch", pitch), ("yaw", yaw)):
        error = (found[name] - angle + np.pi) % (2 * np.pi) - np.pi
        assert abs(error) < tolerance, name


def test_an_estimator_that_has_not_started_has_no_attitude(writer: type) -> None:
    found = decode(writer, "ATTITUDE", [{"rollspeed": 0.1}, {"roll": 0.1}])
    assert np.isnan(found["roll"]).tolist() == [True, False]
    assert np.isnan(found["yaw"]).tolist() == [True, False]
    assert found["p"].tolist() == pytest.approx([0.1, 0.0])


def test_no_fix_no_position(writer: type) -> None:
    place = {"lat": 473977420, "lon": 85455940, "alt": 488_000, "vel": 2000, "cog": 9000}
    found = decode(
        writer,
        "GPS_RAW_INT",
        [
            {"fix_type": 3, **place},
            {"fix_type": 2, **place},
            {"fix_type": 3},
            {"fix_type": 6, **place},
        ],
    )
    for channel, values in found.items():
        assert np.isnan(values).tolist() == [False, True, True, False], channel
    assert found["latitude"][0] == pytest.approx(np.radians(47.397742), abs=1e-10)
    assert found["altitude"][0] == pytest.approx(488.0)
    assert found["v_east"][0] == pytest.approx(20.0)
    assert found["v_north"][0] == pytest.approx(0.0, abs=1e-12)


def test_unknown_speed_and_course(writer: type) -> None:
    found = one(writer, "GPS_RAW_INT", fix_type=3, lat=473977420, lon=85455940, vel=65535, cog=100)
    assert np.isnan(found["v_north"])
    assert np.isfinite(found["latitude"])


def test_global_position(writer: type) -> None:
    found = one(
        writer,
        "GLOBAL_POSITION_INT",
        lat=-353632621,
        lon=1491652370,
        relative_alt=-1500,
        vx=-120,
        vy=250,
        vz=-33,
        hdg=27000,
    )
    assert found["longitude"] == pytest.approx(np.radians(149.165237))
    assert found["height"] == pytest.approx(-1.5)
    assert (found["v_north"], found["v_east"], found["v_down"]) == pytest.approx((-1.2, 2.5, -0.33))
    assert found["yaw"] == pytest.approx(-np.pi / 2)
    assert np.isnan(one(writer, "GLOBAL_POSITION_INT", lat=1, lon=-2, hdg=65535)["latitude"])


@given(direction=st.floats(-180, 180), speed=st.floats(0, 30))
def test_wind_blows_away_from_its_direction(writer: type, direction: float, speed: float) -> None:
    found = one(writer, "WIND", direction=direction, speed=speed, speed_z=0.5)
    origin = np.radians(np.float32(direction))
    toward = np.array([found["wind_north"], found["wind_east"]])
    assert toward @ [np.cos(origin), np.sin(origin)] == pytest.approx(-np.float32(speed), abs=1e-5)
    assert np.hypot(*toward) == pytest.approx(np.float32(speed), abs=1e-5)
    assert found["wind_down"] == pytest.approx(0.5)


def test_north_wind_blows_south(writer: type) -> None:
    assert one(writer, "WIND", direction=0.0, speed=5.0)["wind_north"] == pytest.approx(-5.0)


def test_pulses(writer: type) -> None:
    found = one(writer, "SERVO_OUTPUT_RAW", servo1_raw=1500, servo2_raw=0, servo16_raw=65535)
    assert found["pwm_1"] == 1500
    assert np.isnan(found["pwm_2"])
    assert np.isnan(found["pwm_16"])
    second = one(writer, "SERVO_OUTPUT_RAW", port=1, servo3_raw=1100)
    assert second["pwm_19"] == 1100
    assert "pwm_3" not in second


def test_pressures_and_temperature(writer: type) -> None:
    found = one(writer, "SCALED_PRESSURE", press_abs=955.25, press_diff=2.5, temperature=1500)
    assert found["static_pressure"] == pytest.approx(95525.0)
    assert found["dynamic_pressure"] == pytest.approx(250.0)
    assert found["temperature"] == pytest.approx(288.15)


def test_airspeed(writer: type) -> None:
    assert one(writer, "AIRSPEED", airspeed=21.5, flags=2)["airspeed"] == pytest.approx(21.5)
    unhealthy = one(writer, "AIRSPEED", airspeed=21.5, flags=3, temperature=32767)
    assert np.isnan(unhealthy["airspeed"])
    assert np.isnan(unhealthy["temperature"])


def test_vanes_and_not_a_number(writer: type) -> None:
    found = decode(writer, "AOA_SSA", [{"AOA": 5.0, "SSA": -2.0}, {"AOA": np.nan, "SSA": np.inf}])
    assert found["alpha"][0] == pytest.approx(np.radians(5.0))
    assert found["beta"][0] == pytest.approx(np.radians(-2.0))
    assert np.isnan(found["alpha"][1])
    assert np.isnan(found["beta"][1])


def test_battery(writer: type) -> None:
    cells = [4000, 3900, *[65535] * 8]
    found = one(writer, "BATTERY_STATUS", voltages=cells, current_battery=1234)
    assert found["voltage"] == pytest.approx(7.9)
    assert found["current"] == pytest.approx(12.34)
    silent = one(writer, "BATTERY_STATUS", voltages=[65535] * 10, current_battery=-1)
    assert np.isnan(silent["voltage"])
    assert np.isnan(silent["current"])


def test_motors_without_telemetry(writer: type) -> None:
    found = one(writer, "ESC_TELEMETRY_5_TO_8", rpm=[0, 2571, 0, 0], count=[0, 900, 12, 0])
    assert np.isnan(found["rpm_5"])
    assert found["rpm_6"] == 2571
    assert found["rpm_7"] == 0
    assert np.isnan(found["rpm_8"])


def test_mode_and_arming(writer: type) -> None:
    found = decode(writer, "HEARTBEAT", [{"base_mode": 209, "custom_mode": 7}, {"base_mode": 81}])
    assert found["armed"].tolist() == [1.0, 0.0]
    assert found["mode"].tolist() == [7.0, 0.0]


def test_messages_without_channels(writer: type) -> None:
    assert one(writer, "MEMINFO", freemem=100) == {}


def test_a_message_alone_says_what_it_says_among_others() -> None:
    """From a link messages come one by one, from a log all of a type at once."""
    tables = read((ROOT / "data/flights/demo.tlog").read_bytes()).tables
    for key, table in tables.items():
        together = messages.channels(key.name, table.fields)
        for row in range(0, table.count, max(table.count // 20, 1)):
            one = table.subset(np.array([row]))
            alone = messages.channels(key.name, one.fields)
            assert list(alone) == list(together)
            for name, value in alone.items():
                np.testing.assert_array_equal(value, together[name][[row]])
