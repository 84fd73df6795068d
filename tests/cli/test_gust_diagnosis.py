"""A flight in gusts without vanes, diagnosed as a user would, in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from gcs_sysid import aircraft_file


@pytest.mark.shared
@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_who_did_it_is_named_with_its_size_and_put_right(shared: Path, tmp_path: Path) -> None:
    folder = shared / "cases" / "airspeed_scale"
    told = subprocess.run(
        [
            *(sys.executable, "-m", "gcs_sysid", "diagnose", folder / "flight.tlog"),
            *("--aircraft", folder / "aircraft.toml", "--out", tmp_path),
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "Verdict" in told.stdout
    found = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    assert (found["verdict"], found["cause"]) == ("effect", "airspeed_scale")
    assert found["effects"] == found["indistinguishable"] == ["airspeed_scale"]
    assert sum(item["probability"] for item in found["ranking"]) <= 1.0 + 1e-9
    estimate = found["ranking"][0]["parameters"]["airspeed_scale"]
    size = json.loads((folder / "truth.json").read_text(encoding="utf-8"))["size"]
    assert abs(estimate["value"] - size) < 3.0 * estimate["sd"]
    assert estimate["sd"] < 0.01
    assert found["gain"]["holdout_nlpd_after"] < found["gain"]["holdout_nlpd_before"]
    free = found["gain"]["free_run"]
    assert free["windows"] > 10
    # The aircraft flies as before: only what is shown of it was wrong.
    assert all(each["gained"] == pytest.approx(0.0) for each in free["channels"].values())
    extended = aircraft_file.load(tmp_path / "aircraft-extended.toml")
    assert extended.pitot.error.scale[0] == pytest.approx(estimate["value"])
    assert (tmp_path / "report.html").stat().st_size > 1e5
