"""Aircraft drawn from what is believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.maneuvers import flown
from tests.maneuvers.made_model import aircraft, model


def test_an_unknown_inertia_draws_no_aircraft_that_answer_otherwise() -> None:
    made = model(relative=0.05)
    fit = made.fits["Cm"]
    scale = 0.3 * np.abs(fit.value)
    known = np.sign(fit.value) * scale
    unsure = replace(
        fit,
        covariance=fit.covariance + np.outer(known, known),
        deviations={**fit.deviations, "scale": scale},
    )
    both = AeroModel({**made.fits, "Cm": unsure}, made.controls)
    found = flown.draws(aircraft(), both, np.random.default_rng(0), 4000)["Cm"]
    for key, value in zip(fit.keys, fit.value, strict=True):
        assert found[key][0] == value
        assert found[key].std() == pytest.approx(0.05 * abs(value), rel=0.05)
