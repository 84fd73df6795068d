from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.estimate.result import AeroModel, CoefficientFit
from gcs_sysid.maneuvers import information
from gcs_sysid.maneuvers.information import Gain

KEYS = ("alpha", "qhat")
VALUE = np.array([-2.0, -20.0])


def fitted(covariance: np.ndarray, scale: np.ndarray) -> CoefficientFit:
    nothing = np.zeros(2)
    return CoefficientFit(
        keys=KEYS,
        value=VALUE,
        covariance=covariance,
        flight_value=VALUE,
        deviations={"noise": np.sqrt(np.diagonal(covariance)), "scale": scale},
        white_deviation=nothing,
        repeated_covariance=covariance,
        discrepancy=0.0,
        calibration=1.0,
        residual=0.01,
        correlation=np.eye(2),
        excitation=nothing,
        lowest=nothing,
        highest=nothing,
        samples=1000,
        effective_samples=100.0,
    )


RANDOM = np.random.default_rng(2)
VALUES = {
    "alpha": 0.05 * RANDOM.standard_normal(500),
    "qhat": 0.003 * RANDOM.standard_normal(500),
}
COVARIANCE = np.array([[0.04, 0.01], [0.01, 9.0]])


def gain(model: AeroModel, values: dict[str, np.ndarray], step: float) -> Gain:
    fit = model.fits["Cm"]
    return information.gain(fit, information.rows(model, "Cm", values, step), fit.covariance)


def test_a_maneuver_adds_its_information() -> None:
    """(Σ⁻¹ + XᵀX/v)⁻¹ with v the residual's variance over the share of independent rows."""
    model = AeroModel({"Cm": fitted(COVARIANCE, np.zeros(2))}, ())
    found = gain(model, VALUES, information.SAMPLE)
    columns = np.stack([VALUES["alpha"], VALUES["qhat"]], axis=1)
    after = np.linalg.inv(np.linalg.inv(COVARIANCE) + columns.T @ columns / (0.01**2 * 10.0))
    for index, key in enumerate(KEYS):
        before_sd, after_sd = found.derivatives[key]
        assert before_sd == pytest.approx(np.sqrt(COVARIANCE[index, index]))
        assert after_sd == pytest.approx(np.sqrt(after[index, index]), rel=1e-9)
    assert found.before == pytest.approx(
        np.sqrt(np.mean(np.sum(columns @ COVARIANCE * columns, axis=1)))
    )
    assert found.after < 0.5 * found.before
    assert found.spread == pytest.approx(np.std(columns @ VALUE))


def test_twice_as_many_samples_of_half_the_step_are_worth_the_same() -> None:
    model = AeroModel({"Cm": fitted(COVARIANCE, np.zeros(2))}, ())
    doubled = {name: np.repeat(value, 2) for name, value in VALUES.items()}
    once = gain(model, VALUES, information.SAMPLE)
    twice = gain(model, doubled, 0.5 * information.SAMPLE)
    assert once.after == pytest.approx(twice.after)


def test_errors_of_inertia_stay_however_much_is_flown() -> None:
    scale = 0.05 * np.abs(VALUE)
    covariance = COVARIANCE + np.outer(0.05 * VALUE, 0.05 * VALUE)
    model = AeroModel({"Cm": fitted(covariance, scale)}, ())
    much = {name: np.tile(value, 10000) for name, value in VALUES.items()}
    found = gain(model, much, information.SAMPLE)
    for index, key in enumerate(KEYS):
        assert found.derivatives[key][1] == pytest.approx(scale[index], rel=1e-2)


def test_a_prior_that_knows_the_inertia_better_is_not_forgotten() -> None:
    model = AeroModel({"Cm": fitted(COVARIANCE, 10.0 * np.abs(VALUE))}, ())
    found = gain(model, VALUES, information.SAMPLE)
    assert found.after <= found.before
    assert all(after <= before * (1.0 + 1e-9) for before, after in found.derivatives.values())


def test_without_information_nothing_changes() -> None:
    model = AeroModel({"Cm": replace(fitted(COVARIANCE, np.zeros(2)), residual=1e6)}, ())
    found = gain(model, VALUES, information.SAMPLE)
    assert found.after == pytest.approx(found.before)
