"""The documents of `suggest` for a made-up model."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_sysid.cli import reports
from gcs_sysid.errors import RefusedError, UsageError
from gcs_sysid.offline import model_store, suggest
from gcs_sysid.offline.model_store import StoredModel
from tests.maneuvers.test_design import aircraft, model


def saved(folder: Path, **changes: object) -> Path:
    made = replace(aircraft(), **changes)
    model_store.save(folder / "model", StoredModel(model(), made, 0.0, []))
    return folder


def run(folder: Path, out: Path, *, target: str | None = None, confidence: float = 0.01) -> dict:
    return suggest.run(
        folder,
        confidence=confidence,
        target=target,
        seed=0,
        out=out,
        progress=lambda _text, _share: None,
    )


@pytest.fixture(scope="module")
def planned(tmp_path_factory) -> tuple[dict, Path]:
    folder = tmp_path_factory.mktemp("suggest")
    return run(saved(folder), folder / "out", target="Cm"), folder / "out"


def test_maneuvers_have_the_keys_of_the_interface(planned) -> None:
    document, out = planned
    listed = json.loads((out / "maneuvers.json").read_text())
    assert listed == document["maneuvers"]
    assert {item["kind"] for item in listed} == {"multisine", "multistep", "doublet"}
    for item in listed:
        assert item["target"]["coefficients"] == ["Cm"]
        assert item["controls"] == ["elevator"]
        expected = item["expected"]["Cm"]
        assert 0.0 < expected["sd_after"] < expected["sd_before"]
        low, high = item["envelope"]["alpha"]
        assert -0.1 < low < high < 0.2
        assert 0.0 < item["envelope"]["violation_probability"] <= 0.02
    worth = [item["worth"] for item in listed]
    assert worth == sorted(worth, reverse=True)


def test_the_csv_is_the_input_in_degrees(planned) -> None:
    document, out = planned
    for item in document["maneuvers"]:
        with (out / item["csv"]).open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert list(rows[0]) == ["t", "elevator"]
        time = np.array([float(row["t"]) for row in rows])
        value = np.array([float(row["elevator"]) for row in rows])
        np.testing.assert_allclose(np.diff(time), 0.02, atol=1e-9)
        assert time[-1] == pytest.approx(item["duration_s"], abs=0.02)
        assert np.abs(value).max() == pytest.approx(
            np.degrees(item["amplitude"]["elevator"]), abs=1e-3
        )


def test_the_report_shows_every_maneuver(planned) -> None:
    document, out = planned
    text = reports.sheet("suggest", document, out / "maneuvers.parquet")
    assert "elevator" in text
    assert len(text.splitlines()) <= 10
    page = (out / "report.html").read_text(encoding="utf-8")
    assert all(item["name"].replace("_", " ") in page for item in document["maneuvers"])


def test_a_model_that_is_sure_enough_needs_nothing(tmp_path) -> None:
    document = run(saved(tmp_path), tmp_path / "out", confidence=10.0)
    assert document["maneuvers"] == []
    assert json.loads((tmp_path / "out" / "maneuvers.json").read_text()) == []
    text = reports.sheet("suggest", document, tmp_path / "out" / "maneuvers.parquet")
    assert "Nothing to fly" in text


def test_without_an_envelope_nothing_is_suggested(tmp_path) -> None:
    with pytest.raises(RefusedError, match=r"no \[envelope\]"):
        run(saved(tmp_path, envelope=None), tmp_path / "out")


def test_a_coefficient_that_the_model_lacks_is_named(tmp_path) -> None:
    folder = saved(tmp_path)
    with pytest.raises(UsageError, match="Cl, Cm, Cn; name one of them"):
        run(folder, tmp_path / "out", target="CZ")
