"""What a model's uncertainty does to the flow angles of a filter that holds it."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.model import aided
from gcs_sysid.offline import aided_states
from gcs_sysid.reconstruct import aided_smoother
from tests.estimate import made_flight as made
from tests.estimate import made_structures
from tests.offline import made_models


def alpha(constant: float, slope: float) -> np.ndarray:
    """Smoothed angle of attack of a made flight by a model whose CZ is so far off."""
    flight = made.made_flight(seed=31)
    # Nothing is known of the wind: else it would tell the angle of attack, with the inertial speed.
    covariance = np.array(flight.beginning.covariance)
    wind = np.arange(aided.SIZE)[aided.BLOCKS["wind"]]
    covariance[wind, wind] = 5.0**2
    known = made.unknowns(1.0)
    lift = dict(known.means.aerodynamics["CZ"])
    lift |= {"1": lift["1"] + constant, "alpha": lift["alpha"] + slope}
    means = known.means._replace(aerodynamics={**known.means.aerodynamics, "CZ": lift})
    states, done = aided_smoother.iterated(
        *(made.MODEL, means, known.log_noise, flight.rows, flight.nominal),
        flight.beginning._replace(covariance=jnp.asarray(covariance)),
        rounds=4,
    )
    felt, _ = aided_states._felt(
        jax.tree.map(jnp.asarray, states), jnp.asarray(done.covariance)[: made.COUNT]
    )
    return np.asarray(felt)[:, 1]


@pytest.mark.parametrize(("constant", "slope"), [(0.02, 0.0), (0.0, 0.25)])
def test_an_error_of_the_lift_bends_the_angle_of_attack_that_makes_it(
    monkeypatch: pytest.MonkeyPatch, constant: float, slope: float
) -> None:
    """δα = −δCZ/CZα to a tenth, rms: gravity holds a little of it. 0.02 of lift are 0.2°."""
    monkeypatch.setattr(aided_smoother, "CHUNK", made.COUNT)
    right = alpha(0.0, 0.0)
    # Once the beginning, which is told the wind's beginning only, is forgotten.
    later = slice(50, None)
    bent = (alpha(constant, slope) - right)[later]
    wanted = -(constant + slope * right[later]) / made.TERMS["CZ"]["alpha"]
    assert np.mean((bent - wanted) ** 2) < 0.1**2 * np.mean(wanted**2)


def test_the_variance_is_that_of_the_modelled_force_over_its_slope() -> None:
    """By the covariance of the fit; of beta nothing is said where no side force tells it."""
    model = made_models.model()
    values = made_models.conditions(5, 40)
    samples: Samples = replace(
        made_structures.flight({"alpha": -5.0}, seed=1, noise=0.01, count=40), regressors=values
    )
    found = aided_states.unsure_of(samples, model).regressor_lasting
    assert set(found) == {"alpha"}
    fit = model.fits["CZ"]
    terms = np.stack([np.ones(40), values["alpha"], values["alpha"] ** 2, values["elevator"]])
    slope = np.mean(fit.value[1] + 2.0 * fit.value[2] * values["alpha"])
    force = np.einsum("is,ij,js->s", terms, fit.covariance, terms)
    np.testing.assert_allclose(found["alpha"], force / slope**2, rtol=1e-9)
    without = replace(model, fits={**model.fits, "CY": model.fits["Cm"]})
    assert set(aided_states.unsure_of(samples, without).regressor_lasting) == {"alpha"}
