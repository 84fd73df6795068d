"""A made-up flight as columns of a 50 Hz table in the units of an engineer, and its column map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import scipy.io
from pyarrow import csv, parquet

from gcs_sysid.recording import NO_AUTOPILOT, Recording, Stream, Vehicle

HOLD = 5
"""Rows for which the table repeats values of the slow sensors."""
EPOCH = "2026-05-01T09:30:00Z"
EPOCH_US = 1_777_627_800_000_000

UNITS = {
    "acc_x": ("g", 9.80665),
    "acc_y": ("ft/s^2", 0.3048),
    "acc_z": ("m/s^2", 1.0),
    "p": ("deg/s", np.pi / 180.0),
    "q": ("rad/s", 1.0),
    "r": ("deg/s", np.pi / 180.0),
    "roll": ("deg", np.pi / 180.0),
    "pitch": ("rad", 1.0),
    "yaw": ("deg", np.pi / 180.0),
    "pwm_1": ("us", 1.0),
    "pwm_2": ("us", 1.0),
    "airspeed": ("kt", 1852.0 / 3600.0),
    "v_north": ("m/s", 1.0),
    "v_east": ("ft/s", 0.3048),
    "v_down": ("km/h", 1.0 / 3.6),
    "altitude": ("ft", 0.3048),
    "static_pressure": ("psi", 4.4482216152605 / 0.0254**2),
    "alpha": ("deg", np.pi / 180.0),
}
"""Unit in the table, and its size in SI, as standards print it."""
STREAMS = {
    "RAW_IMU": ("acc_x", "acc_y", "acc_z", "p", "q", "r"),
    "ATTITUDE": ("roll", "pitch", "yaw"),
    "SERVO_OUTPUT_RAW": ("pwm_1", "pwm_2"),
    "VFR_HUD": ("airspeed",),
    "GLOBAL_POSITION_INT": ("v_north", "v_east", "v_down", "altitude"),
    "SCALED_PRESSURE": ("static_pressure",),
    "AOA_SSA": ("alpha",),
}
FAST = ("RAW_IMU", "ATTITUDE", "SERVO_OUTPUT_RAW")


def made_recording(*, count: int = 500, seed: int = 4) -> Recording:
    """Random values; attitude goes through ±180°, pulses stand still for long."""
    random = np.random.default_rng(seed)
    time = 0.02 * np.arange(count)
    streams = {}
    for name, channels in STREAMS.items():
        at = time if name in FAST else time[::HOLD]
        values = {channel: random.standard_normal(at.size) for channel in channels}
        streams[name] = Stream(name, at, at, values)
    for angle in ("roll", "yaw"):
        turned = np.linspace(0.0, 9.0, count)
        streams["ATTITUDE"].channels[angle][:] = (turned + np.pi) % (2.0 * np.pi) - np.pi
    for pulse in streams["SERVO_OUTPUT_RAW"].channels.values():
        pulse[:] = np.where(time < 2.0, 1500.0, 1500.0 + np.round(100.0 * pulse))
    return Recording(
        "made_up", "", Vehicle(1, 1, NO_AUTOPILOT, "MAV_TYPE_FIXED_WING", 1), EPOCH_US, streams
    )


def columns(recording: Recording) -> dict[str, np.ndarray]:
    """One row a sample of the inertial unit, slow sensors held; names start with `x_`."""
    time = recording.streams["RAW_IMU"].time
    table = {"t": 1e3 * time}
    for stream in recording.streams.values():
        held = np.searchsorted(stream.time, time + 1e-9) - 1
        for channel, values in stream.channels.items():
            table[f"x_{channel}"] = values[held] / UNITS[channel][1]
    return table


def column_map(names=tuple(UNITS)) -> str:
    lines = ['time = { name = "t", unit = "ms" }', f"epoch = {EPOCH}"]
    lines += [f'{name} = {{ name = "x_{name}", unit = "{UNITS[name][0]}" }}' for name in names]
    return "\n".join(lines)


def write(table: dict[str, np.ndarray], path: Path) -> Path:
    """The table in the format that the path's ending names."""
    if path.suffix == ".mat":
        scipy.io.savemat(path, table)
    else:
        writer = {".csv": csv.write_csv, ".parquet": parquet.write_table}[path.suffix]
        writer(pa.table(table), path)
    return path
