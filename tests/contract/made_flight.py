"""One flight, written in every form in which it can reach the program."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from gcs_sysid import frames
from tests.sources.can.made_can import Bus
from tests.sources.conftest import EPOCH_US, Writer
from tests.sources.made_dataflash import Dataflash
from tests.sources.made_ulog import Ulog

BOOT_US = 5_000_000
"""Time since boot at which the flight begins."""
STEP_US = 20_000
COUNT = 1500
GPS_EPOCH_S, LEAP_S, WEEK_S = 315_964_800, 18, 604_800
CAN_BEHIND_S = 321.0625
"""By how much the clock of the bus is behind the flight's."""


def truth() -> dict[str, np.ndarray]:
    """All channels at 50 Hz, in SI units, with no period that could be mistaken for a shift."""
    t = 1e-6 * STEP_US * np.arange(COUNT)
    sway = np.sin(0.9 * t + 0.03 * t * t)
    return {
        "t": t,
        "roll": 0.3 * sway, "pitch": 0.1 * np.cos(1.3 * t), "yaw": 0.05 * t,
        "p": 0.4 * np.cos(0.9 * t), "q": 0.2 * np.sin(1.7 * t + 0.05 * t * t), "r": 0.1 * sway,
        "acc_x": 0.5 + 0.0 * t, "acc_y": 0.3 * sway, "acc_z": -9.8 + np.sin(1.1 * t),
        "airspeed": 20.0 + 2.0 * sway, "alpha": 0.08 + 0.02 * sway, "beta": 0.03 * np.sin(0.5 * t),
        "v_north": 18.0 + sway, "v_east": 3.0 * np.cos(0.2 * t), "v_down": 0.5 * sway,
        "latitude": np.radians(47.3) + 1e-6 * t, "longitude": np.radians(8.5) + 1e-6 * t,
        "altitude": 500.0 + 5.0 * sway, "static_pressure": 95_000.0 + 60.0 * sway,
        "pwm_1": np.round(1500.0 + 200.0 * sway), "pwm_2": np.round(1500.0 - 150.0 * sway),
        "rpm_1": np.round(6000.0 + 500.0 * sway),
    }  # fmt: skip


def telemetry(*, vanes: bool = True) -> Writer:
    """As a .tlog; without `vanes` what a CAN bus may bring is left out."""
    log, v = Writer().heartbeat(0), truth()
    for i in range(COUNT):
        link, boot_us = i * STEP_US, BOOT_US + i * STEP_US
        boot_ms = boot_us // 1000
        one = {name: float(column[i]) for name, column in v.items()}
        log.add(
            link,
            "ATTITUDE",
            time_boot_ms=boot_ms,
            roll=one["roll"],
            pitch=one["pitch"],
            yaw=one["yaw"],
            rollspeed=one["p"],
            pitchspeed=one["q"],
            yawspeed=one["r"],
        )
        log.add(
            link,
            "RAW_IMU",
            time_usec=boot_us,
            **{f"{a}acc": round(one[f"acc_{a}"] / 9.80665e-3) for a in "xyz"},
            **{f"{a}gyro": round(1e3 * one[r]) for a, r in zip("xyz", "pqr", strict=True)},
        )
        log.add(
            link,
            "GLOBAL_POSITION_INT",
            time_boot_ms=boot_ms,
            alt=round(1e3 * one["altitude"]),
            lat=round(1e7 * math.degrees(one["latitude"])),
            lon=round(1e7 * math.degrees(one["longitude"])),
            **{
                f"v{a}": round(1e2 * one[f"v_{name}"])
                for a, name in zip("xyz", ("north", "east", "down"), strict=True)
            },
        )
        log.add(
            link,
            "SERVO_OUTPUT_RAW",
            time_usec=boot_us,
            servo1_raw=int(one["pwm_1"]),
            servo2_raw=int(one["pwm_2"]),
        )
        if vanes:
            log.add(link, "AIRSPEED", airspeed=one["airspeed"], id=0)
            log.add(
                link,
                "SCALED_PRESSURE",
                time_boot_ms=boot_ms,
                press_abs=one["static_pressure"] / 100.0,
            )
            log.add(
                link,
                "AOA_SSA",
                time_usec=boot_us,
                AOA=math.degrees(one["alpha"]),
                SSA=math.degrees(one["beta"]),
            )
            log.add(
                link,
                "ESC_TELEMETRY_1_TO_4",
                rpm=[int(one["rpm_1"]), 0, 0, 0],
                count=[i + 1, 0, 0, 0],
            )
        if i % 50 == 0:
            log.add(link, "SYSTEM_TIME", time_boot_ms=boot_ms, time_unix_usec=EPOCH_US + link)
    return log  # fmt: skip


def onboard() -> bytes:
    """As ArduPilot's onboard log."""
    log, v = Dataflash(), truth()
    for i in range(COUNT):
        t = BOOT_US + i * STEP_US
        one = {name: float(column[i]) for name, column in v.items()}
        log.add(
            "IMU",
            t,
            0,
            one["p"],
            one["q"],
            one["r"],
            one["acc_x"],
            one["acc_y"],
            one["acc_z"],
            25.0,
        )
        log.add(
            "ATT",
            t,
            *(math.degrees(one[name]) for name in ("roll", "pitch")),
            math.degrees(one["yaw"]) % 360.0,
        )
        log.add(
            "POS",
            t,
            math.degrees(one["latitude"]),
            math.degrees(one["longitude"]),
            one["altitude"],
            0.0,
        )
        log.add("XKF1", t, 0, one["v_north"], one["v_east"], one["v_down"])
        log.add("RCOU", t, int(one["pwm_1"]), int(one["pwm_2"]), 0)
        log.add("ARSP", t, 0, one["airspeed"], 1)
        log.add("BARO", t, 0, 0.0, one["static_pressure"])
        log.add("AOA", t, math.degrees(one["alpha"]), math.degrees(one["beta"]))
        log.add("ESC", t, 0, one["rpm_1"])
        if i % 50 == 0:
            gps = 1e-6 * (EPOCH_US + i * STEP_US) - GPS_EPOCH_S + LEAP_S
            week = int(gps // WEEK_S)
            log.add(
                "GPS",
                t,
                0,
                3,
                round(1e3 * (gps - week * WEEK_S)),
                week,
                47.3,
                8.5,
                500.0,
                18.0,
                0.0,
                0.0,
            )
    return log.binary  # fmt: skip


def px4() -> bytes:
    """As PX4's onboard log."""
    log, v = Ulog(start_us=BOOT_US).parameter("MAV_SYS_ID", 1), truth()
    euler = np.stack([v["roll"], v["pitch"], v["yaw"]], axis=-1)
    quaternion = frames.quaternion_from_euler(euler)
    for i in range(COUNT):
        t = BOOT_US + i * STEP_US
        one = {name: float(column[i]) for name, column in v.items()}
        log.add(
            "sensor_combined",
            t,
            one["p"],
            one["q"],
            one["r"],
            one["acc_x"],
            one["acc_y"],
            one["acc_z"],
        )
        log.add("vehicle_attitude", t + 200, t, *quaternion[i].tolist())
        log.add("vehicle_angular_velocity", t, one["p"], one["q"], one["r"])
        log.add(
            "vehicle_global_position",
            t,
            math.degrees(one["latitude"]),
            math.degrees(one["longitude"]),
            one["altitude"],
        )
        log.add(
            "vehicle_local_position",
            t,
            0.0,
            0.0,
            0.0,
            one["v_north"],
            one["v_east"],
            one["v_down"],
            True,
            True,
            True,
            True,
        )
        log.add("actuator_outputs", t, 2, one["pwm_1"], one["pwm_2"], *[0.0] * 14)
        log.add("airspeed", t, one["airspeed"], 20.0)
        log.add("vehicle_air_data", t, one["static_pressure"], 15.0)
        log.add("airflow_aoa", t, one["alpha"], True)
        log.add("airflow_slip", t, one["beta"], True)
        log.add("esc_status", t, 1, int(one["rpm_1"]), 16.0, 0, 0.0)
        if i % 50 == 0:
            log.add("sensor_gps", t, EPOCH_US + i * STEP_US, 47.3, 8.5, 500.0, 18.0, 0.0, 0.0, 3)
    return log.data  # fmt: skip


COLUMNS = {
    "unit": {
        "rad": "roll pitch yaw alpha beta latitude longitude",
        "rad/s": "p q r",
        "m/s^2": "acc_x acc_y acc_z",
        "m/s": "airspeed v_north v_east v_down",
        "m": "altitude",
        "Pa": "static_pressure",
        "us": "pwm_1 pwm_2",
        "rpm": "rpm_1",
    }
}


def table(folder: Path) -> tuple[Path, Path]:
    """As a .csv and its column map."""
    v = truth()
    path, columns = folder / "flight.csv", folder / "map.toml"
    rows = zip(*(column.tolist() for column in v.values()), strict=True)
    lines = [",".join(v), *(",".join(repr(value) for value in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    lines = ['time = { name = "t", unit = "s" }', "epoch = 2026-09-21T14:13:20Z"]
    for unit, names in COLUMNS["unit"].items():
        lines += [f'{name} = {{ name = "{name}", unit = "{unit}" }}' for name in names.split()]
    columns.write_text("\n".join(lines) + "\n")
    return path, columns


def bus() -> Bus:
    """What CAN nodes saw of it, on a clock of their own."""
    log, v = Bus(), truth()
    for i in range(COUNT):
        t = float(v["t"][i]) - CAN_BEHIND_S
        one = {name: float(column[i]) for name, column in v.items()}
        log.send(t, "air_data.IndicatedAirspeed", indicated_airspeed=one["airspeed"])
        log.send(t, "air_data.StaticPressure", static_pressure=one["static_pressure"])
        log.send(t, "air_data.AngleOfAttack", sensor_id=254, aoa=one["alpha"])
        log.send(t, "air_data.Sideslip", sideslip_angle=one["beta"])
        log.send(t, "esc.Status", esc_index=0, rpm=int(one["rpm_1"]))
        log.send(t, "ahrs.RawIMU", rate_gyro_latest=[one["p"], one["q"], one["r"]])
    return log
