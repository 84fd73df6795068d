"""The main job as a user has it: the program as a process, without options, on bundled flights.

The first minute of one is identified, for whose model the filter with the aerodynamics inside is
asked, and the other predicted.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
import pytest

from gcs_sysid.aircraft import COEFFICIENTS
from tests import cores

ROOT = Path(__file__).resolve().parents[2]
FLIGHTS = ROOT / "data" / "flights"
AIRCRAFT = ROOT / "data" / "aircraft" / "ultra_stick_25e.toml"
REGRESSORS = ("alpha", "beta", "phat", "qhat", "rhat", "elevator", "aileron", "rudder")

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


def gcs_sysid(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "gcs_sysid", *map(str, arguments)]
    environment = os.environ | {"PYTHONWARNINGS": "error::RuntimeWarning"}
    with cores.every_one():
        return subprocess.run(
            command,
            cwd=cwd,
            env=environment,
            capture_output=True,
            text=True,
            timeout=800,
            check=False,
        )


@pytest.fixture(scope="module")
def identified(tmp_path_factory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    folder = tmp_path_factory.mktemp("identify")
    whole = (FLIGHTS / "demo_second.tlog").read_bytes()
    log = folder / "minute.tlog"
    log.write_bytes(whole[: len(whole) // 2])
    done = gcs_sysid("identify", log, "--aircraft", AIRCRAFT, cwd=folder)
    return folder / "minute-identify", done


@pytest.fixture(scope="module")
def predicted(identified, tmp_path_factory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    folder = tmp_path_factory.mktemp("predict")
    log = FLIGHTS / "demo.tlog"
    done = gcs_sysid("predict", log, "--model", identified[0], "--json", cwd=folder)
    return folder / "demo-predict", done


def test_identify_ends_with_ten_lines_and_the_report(identified):
    out, done = identified
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    assert len(lines) <= 10
    assert lines[-1].endswith(f"{out.name}/report.html")
    assert (out / "report.html").stat().st_size > 10_000


def test_identify_leaves_what_was_promised(identified):
    out, _ = identified
    assert {path.name for path in out.iterdir()} == {
        "model", "summary.json", "samples.parquet", "report.html",
    }  # fmt: skip
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    for name in COEFFICIENTS:
        assert {"relative_error", "coverage95", "nlpd"} <= summary["coefficients"][name].keys()
    assert {"value", "sd"} <= summary["derivatives"]["Cm"]["alpha"].keys()
    assert {"wind_ned", "gust_sd", "sensor", "delays"} <= summary["reconstruction"].keys()
    assert summary["maneuvers"]
    assert summary["method"]["name"] == "filter_error"
    kinds = {path.suffix for path in (out / "model").iterdir()}
    assert kinds == {".json", ".npz", ".toml"}, "a model is readable without running any code"


def test_samples_have_the_columns_that_others_read(identified):
    out, _ = identified
    table = parquet.read_table(out / "samples.parquet")
    expected = {"time_us", "V", "qbar", "p", "q", "r", "region", *REGRESSORS}
    for name in COEFFICIENTS:
        expected |= {name, f"{name}_sd", f"{name}_measured", f"{name}_measured_sd"}
    assert expected <= set(table.column_names)
    time = table["time_us"].to_numpy()
    assert time.dtype == np.int64
    assert np.all(np.diff(time) > 0)


def test_what_was_changed_about_the_aircraft_is_found(identified):
    """The bundled flights were flown with other derivatives than the file's: scenario.toml."""
    out, _ = identified
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    directional = summary["derivatives"]["Cn"]["beta"]
    true = 1.20 * directional["file"]
    assert abs(directional["value"] - true) < 4.0 * directional["sd"]


def test_predict_prints_its_summary_as_json(predicted):
    out, done = predicted
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    summary = json.loads(done.stdout)
    assert summary == json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["coefficients"]["CZ"]["relative_error"] < 60.0
    assert (out / "predictions.parquet").exists()


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_evaluate_adds_its_columns(suffix, identified, tmp_path):
    points = tmp_path / "points.csv"
    with points.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*REGRESSORS, "note"])
        writer.writerow([0.05, *[0.0] * 7, "trim"])
        writer.writerow([0.06, *[0.0] * 7, "a little more"])
    out = tmp_path / f"out{suffix}"
    model = identified[0] / "model"
    done = gcs_sysid("evaluate", "--model", model, "--at", points, "--out", out, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    if suffix == ".csv":
        with out.open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    else:
        rows = parquet.read_table(out).to_pylist()
    assert [row["note"] for row in rows] == ["trim", "a little more"]
    slope = (float(rows[1]["CZ"]) - float(rows[0]["CZ"])) / 0.01
    assert slope == pytest.approx(float(rows[0]["CZ_alpha"]), rel=0.05)
    assert all(float(row[f"{name}_sd"]) > 0.0 for row in rows for name in COEFFICIENTS)


def test_a_folder_of_results_is_renewed(identified, tmp_path):
    """Running twice into one folder is what people do; only others' files are left alone."""
    out, _ = identified
    done = gcs_sysid("inspect", FLIGHTS / "demo.tlog", "--out", out, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    document = json.loads((out / "inspect.json").read_text(encoding="utf-8"))
    assert {"streams", "lost", "vehicles", "airborne_s", "maneuvers", "identifiable"} <= set(
        document
    )
    (out / "inspect.json").unlink()


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"", "is empty"), (b"\x00" * 5000, "no MAVLink"), (None, "no such log")],
)
def test_what_is_no_log_is_refused_in_one_line(content, words, tmp_path):
    log = tmp_path / "flight.tlog"
    if content is not None:
        log.write_bytes(content)
    done = gcs_sysid("identify", log, "--aircraft", AIRCRAFT, cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert str(log) in done.stderr
    assert words in done.stderr
    assert not (tmp_path / "flight-identify").exists()
