"""Gaussian processes in a run: what the summary tells of them."""

from __future__ import annotations

import json

import numpy as np

from gcs_sysid.aircraft import Aircraft, Envelope, Geometry, Mass
from gcs_sysid.offline import documents, learned
from tests.gp.test_fitting import polynomial

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
