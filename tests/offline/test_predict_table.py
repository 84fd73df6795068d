"""A saved model meets a flight that comes as a table of columns instead of telemetry."""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.offline import model_store, predict
from gcs_sysid.sources.registry import open_recording
from tests.offline import made_models
from tests.offline.conftest import AIRCRAFT, SECOND, silent
from tests.sources import made_tables

UNITS = {
    **dict.fromkeys(("acc_x", "acc_y", "acc_z"), ("m/s^2", 1.0)),
    **dict.fromkeys(("p", "q", "r"), ("deg/s", np.pi / 180.0)),
    **dict.fromkeys(("roll", "pitch", "yaw", "alpha", "beta"), ("deg", np.pi / 180.0)),
    **dict.fromkeys(("airspeed", "v_north", "v_east", "v_down"), ("m/s", 1.0)),
    **dict.fromkeys(("altitude",), ("ft", 0.3048)),
    **dict.fromkeys(("static_pressure",), ("Pa", 1.0)),
    **{f"pwm_{channel}": ("us", 1.0) for channel in range(1, 6)},
}
"""Unit of each column and its size in SI."""
SOURCES = (
    "RAW_IMU", "ATTITUDE", "AOA_SSA", "VFR_HUD", "GLOBAL_POSITION_INT", "SCALED_PRESSURE",
    "SERVO_OUTPUT_RAW",
)  # fmt: skip
PART = slice(1500, 3500)
"""Forty seconds of the flight."""


def columns() -> tuple[dict[str, np.ndarray], int]:
    """Part of the bundled flight, a row a sample of the inertial unit, and the time of its zero."""
    recording = open_recording(SECOND)
    time = recording.streams["RAW_IMU"].time[PART]
    table = {"t": time - time[0]}
    for name in SOURCES:
        stream = recording.streams[name]
        held = np.maximum(np.searchsorted(stream.time, time + 1e-9) - 1, 0)
        for channel in set(UNITS) & set(stream.channels) - set(table):
            table[channel] = stream.channels[channel][held] / UNITS[channel][1]
    return table, recording.epoch_us + round(1e6 * float(time[0]))


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
def test_a_table_is_predicted_as_a_log_is(suffix: str, tmp_path: Path) -> None:
    table, start_us = columns()
    log = made_tables.write(table, tmp_path / f"part{suffix}")
    epoch = datetime.datetime.fromtimestamp(start_us // 10**6, tz=datetime.UTC)
    lines = [f"epoch = {epoch:%Y-%m-%dT%H:%M:%SZ}", 'time = { name = "t", unit = "s" }']
    lines += [
        f'{name} = {{ name = "{name}", unit = "{unit}" }}' for name, (unit, _) in UNITS.items()
    ]
    meaning = tmp_path / "columns.toml"
    meaning.write_text("\n".join(lines), encoding="utf-8")
    aircraft = aircraft_file.load(AIRCRAFT)
    model = replace(made_models.model(), controls=aircraft.control_names)
    stored = replace(made_models.stored(), model=model, aircraft=aircraft)
    model_store.save(tmp_path / "model", stored)
    summary = predict.run(
        log, tmp_path, vehicle=None, segments=None, out=tmp_path, progress=silent, columns=meaning
    )
    predictions = pq.read_table(tmp_path / "predictions.parquet")
    time = predictions["time_us"].to_numpy() - start_us // 10**6 * 10**6
    assert set(summary["coefficients"]) >= {"CZ", "Cl", "Cm"}
    with np.load(SECOND.with_name("demo_second_truth.npz")) as file:
        true = {str(name): file["rows"][:, index] for index, name in enumerate(file["cols"])}
        since = (start_us - int(file["t0_us"])) * 1e-6
    measured = predictions["CZ_measured"].to_numpy()
    flown = np.interp(since + 1e-6 * time, true["t"], true["CZ"])
    inside = slice(100, -100)
    assert np.corrcoef(measured[inside], flown[inside])[0, 1] > 0.9
    assert measured[inside].mean() == pytest.approx(flown[inside].mean(), rel=0.05)
