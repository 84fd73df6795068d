"""What kinematics alone say, and an identified model as the simulation to test."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.offline import model_store, tested
from gcs_sysid.offline.observed import _without_prior
from tests.offline import made_models


def test_a_prior_is_taken_off_again() -> None:
    """Data of 0.04 ± 0.02 under a prior of 0 ± 0.03 combine by their precisions."""
    weight = 0.02**-2 + 0.03**-2
    value, deviation = 0.04 * 0.02**-2 / weight, weight**-0.5
    assert _without_prior(value, deviation, 0.03) == pytest.approx((0.04, 0.02))


def test_without_data_nothing_is_said() -> None:
    assert _without_prior(0.0, 0.05, 0.05) == (0.0, float("inf"))


def test_an_identified_model_is_a_simulation(tmp_path) -> None:
    stored = made_models.stored()
    model_store.save(tmp_path, stored)
    under = tested.load(None, tmp_path)
    fit = stored.model.fits["Cm"]
    terms = under.aircraft.aerodynamics["Cm"].terms
    assert tuple(terms) == fit.keys
    np.testing.assert_allclose([item.value for item in terms.values()], fit.value)
    np.testing.assert_allclose([item.sigma for item in terms.values()], fit.deviation)
    assert under.delay is not None
    assert under.delay.value == stored.surface_delay
