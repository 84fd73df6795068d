"""Gaussian processes in a run: what the summary tells of them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv

from gcs_sysid.aircraft import Aircraft, Envelope, Geometry, Mass
from gcs_sysid.gp import fitting
from gcs_sysid.gp.aerodynamics import LearnedModel
from gcs_sysid.offline import documents, evaluate, learned, model_store, predict
from gcs_sysid.offline.model_store import StoredModel
from tests.gp.test_fitting import EFFORT, INPUTS, OUTPUTS, data, polynomial
from tests.offline.made_aircraft import small

AIRCRAFT = Aircraft(
    name="made",
    mass=Mass(10.0, 1.0, 1.0, 1.0),
    geometry=Geometry(1.0, 2.0, 0.5),
    envelope=Envelope((15.0, 30.0), (-0.1, 0.2), (-0.2, 0.2), (-1.0, 3.0), 1.0, 50.0),
)


def table() -> dict[str, np.ndarray]:
    """Columns as the table of samples has them, whole numbers among them."""
    random = np.random.default_rng(1)
    count = 400
    columns = {
        name: 0.05 * random.standard_normal(count)
        for name in ("alpha", "beta", "phat", "qhat", "rhat", "elevator", "thrust_coefficient")
    }
    columns |= {f"{name}_measured": random.standard_normal(count) for name in ("CZ", "Cm")}
    columns["CZ_measured"][:5] = np.nan
    return columns | {
        "time_us": np.arange(count) * 20_000,
        "t": 0.02 * np.arange(count),
        "maneuver": np.zeros(count, dtype=int),
    }


def test_the_map_of_a_polynomial_covers_the_envelope_and_is_plain_json():
    told = documents.plain(learned.confidence_map(polynomial(), AIRCRAFT, table()))
    json.dumps(told, allow_nan=False)
    assert (told["alpha"][0], told["alpha"][-1]) == (-0.1, 0.2)
    assert set(told["coefficients"]) == {"CZ", "Cm"}
    assert set(told["derivatives"]["CZ"]) == {"alpha"}
    assert np.sum(told["seconds"]) <= 8.0


def test_a_polynomial_alone_says_why_there_is_no_process():
    assert learned.told(polynomial())["kept"] is False


def test_where_a_process_was_not_told_the_answer_extrapolates(tmp_path: Path):
    """Inside the range of the polynomial, beyond the samples that CZ's process learned from."""
    plain = polynomial()
    model = LearnedModel(plain.fits, plain.controls, fitting.fit(data(1), EFFORT), INPUTS, OUTPUTS)
    stored = StoredModel(model, small(), 0.0, [])
    model_store.save(tmp_path / "model", stored)
    alpha = np.array([0.05, 0.1, 0.9, 0.1])
    at = {"alpha": alpha, "elevator": np.zeros(4)}
    pacsv.write_csv(pa.table(at), tmp_path / "at.csv")
    assert np.all(np.abs(alpha) < plain.fits["CZ"].highest[0])
    told = evaluate.run(tmp_path / "model", tmp_path / "at.csv", tmp_path / "to.csv")
    assert told["extrapolated"] == 1
    (warning,) = predict._beyond({**at, "maneuver": np.array([0, 0, 0, -1])}, stored)
    assert warning.startswith("CZ: for 33 % of this flight the Gaussian process has no data near")
