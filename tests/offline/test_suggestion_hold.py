"""The autopilot's hold, from the samples beside a model to what `suggest` says of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs_sysid.maneuvers.flown_hold import TURNED
from gcs_sysid.offline import parquet_file, suggest, suggestion_hold
from gcs_sysid.report.suggest import findings
from tests.maneuvers import made_loop
from tests.maneuvers.made_model import aircraft, model
from tests.offline.test_suggest import run, saved


def samples(folder: Path, *seeds: int) -> None:
    """Writes what `identify` leaves beside a model, of flights of a loop with known gains."""
    each = [made_loop.flown(seed=seed) for seed in seeds]
    columns = {
        "flight": np.repeat(np.arange(len(each)), [one.time.size for one in each]),
        "t": np.concatenate([one.time for one in each]),
        "qbar": np.concatenate([one.pressure for one in each]),
    }
    columns |= dict(zip(TURNED, np.concatenate([one.turned for one in each]).T, strict=True))
    for name in each[0].controls:
        columns[name] = np.concatenate([one.controls[name] for one in each])
    parquet_file.write(folder / "samples.parquet", columns)


def test_flights_of_a_model_are_looked_at_one_by_one(tmp_path) -> None:
    samples(saved(tmp_path), 0, 1)
    for folder in (tmp_path, tmp_path / "model"):
        hold = suggestion_hold.found(folder, model(), aircraft())
        assert hold is not None
        roll = hold.answers["aileron"].gain[TURNED.index("phi")]
        assert roll == pytest.approx(made_loop.GAIN["phi"], rel=0.03)
        # It did not move.
        assert "rudder" not in hold.answers


def test_where_no_samples_are_the_hold_is_assumed(tmp_path) -> None:
    assert suggestion_hold.found(saved(tmp_path), model(), aircraft()) is None


def test_a_suggestion_says_which_hold_it_reckons_with(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(suggest, "SPEEDS", (0.45,))
    monkeypatch.setattr(suggest, "LISTED", 1)
    samples(saved(tmp_path), 0)
    document = run(tmp_path, tmp_path / "out", target="Cl")
    told = document["hold"]
    assert {name: one["source"] for name, one in told.items()} == {
        "elevator": "assumed",
        "aileron": "flown",
        "rudder": "assumed",
    }
    one = told["aileron"]["gain"]["phi"]
    assert one["value"] == pytest.approx(made_loop.GAIN["phi"], rel=0.03)
    assert 0.0 < one["sd"] < 0.05
    (safe,) = [item.text for item in findings(document) if item.topic == "Safe"]
    assert "aileron (100 % of what it did) held as the autopilot did in the flights" in safe
    assert "elevator and rudder held as fast as servos allow (assumed)" in safe
