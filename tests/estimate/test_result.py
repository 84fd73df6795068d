from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_sysid.estimate import basis, equation_error
from gcs_sysid.estimate.result import AeroModel
from tests.estimate.made_problems import coloured, problem

CONTROLS = ("elevator", "aileron")
STRUCTURE = ("1", "alpha", "alpha^2", "qhat", "elevator", "alpha*elevator", "max(0, alpha - 0.06)")
VARIABLES = ("alpha", "qhat", "elevator")


def conditions(seed: int, count: int) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(seed)
    return {
        "alpha": 0.05 + 0.05 * generator.standard_normal(count),
        "qhat": 0.003 * generator.standard_normal(count),
        "elevator": 0.06 * generator.standard_normal(count),
    }


@pytest.fixture(scope="module")
def model() -> AeroModel:
    values = conditions(1, 4000)
    matrix = basis.columns(STRUCTURE, CONTROLS, values)
    generator = np.random.default_rng(2)
    truth = matrix @ np.array([-0.03, -0.7, 0.4, -13.0, -0.85, 0.6, 1.5])
    fit = equation_error.solve(
        problem(
            matrix,
            truth + 0.01 * coloured(generator, 4000, 0.9),
            keys=STRUCTURE,
            noise=0.003,
            error=np.array([0, 1e-4, 0, 0, 0, 0, 0], dtype=float),
        ),
        None,
    )
    return AeroModel({"Cm": fit}, CONTROLS)


@pytest.mark.parametrize("variable", VARIABLES)
def test_derivatives_are_finite_differences_of_the_prediction(
    model: AeroModel, variable: str
) -> None:
    """Central differences of 1e-6 in float64: good to 1e-9 but at the knot, left out."""
    values = conditions(3, 200)
    kept = np.abs(values["alpha"] - 0.06) > 1e-4
    values = {name: value[kept] for name, value in values.items()}
    step = 1e-6

    def moved(by: float) -> np.ndarray:
        changed = {**values, variable: values[variable] + by}
        return model.predict(changed, measured=False)["Cm"].mean

    slope = (moved(step) - moved(-step)) / (2.0 * step)
    derivative = model.derivative("Cm", variable, values)
    assert derivative.mean == pytest.approx(slope, rel=1e-7, abs=1e-8)
    assert np.all(derivative.deviation > 0.0)


def test_the_deviation_of_a_prediction_is_that_of_drawn_models(model: AeroModel) -> None:
    """Second implementation: 4000 draws of the parameters; a spread is known to 1.1 % then."""
    fit = model.fits["Cm"]
    values = conditions(4, 20)
    rows = basis.columns(fit.keys, CONTROLS, values)
    drawn = np.random.default_rng(5).multivariate_normal(fit.value, fit.covariance, 4000)
    spread = np.std(drawn @ rows.T, axis=0)
    expected = np.hypot(spread, fit.discrepancy)
    found = model.predict(values, measured=False)["Cm"].deviation
    assert found == pytest.approx(expected, rel=0.05)


def test_measured_conditions_are_predicted_more_surely_than_exact_ones(model: AeroModel) -> None:
    """There the errors of the regressors repeat what they did in the fit."""
    values = conditions(6, 50)
    exact = model.predict(values, measured=False)["Cm"]
    measured = model.predict(values, measured=True)["Cm"]
    assert np.all(measured.deviation < exact.deviation)
    assert np.array_equal(measured.mean, exact.mean)


@given(st.floats(2.0, 10.0))
def test_uncertainty_grows_away_from_the_data(model: AeroModel, factor: float) -> None:
    inside = {"alpha": np.array([0.05]), "qhat": np.zeros(1), "elevator": np.zeros(1)}
    outside = {**inside, "elevator": np.array([0.5 * factor])}
    further = {**inside, "elevator": np.array([1.0 * factor])}
    deviations = [
        float(model.predict(at, measured=False)["Cm"].deviation[0])
        for at in (inside, outside, further)
    ]
    assert deviations == sorted(deviations)
    assert deviations[2] > deviations[0]


def test_variables_are_those_used_in_order(model: AeroModel) -> None:
    assert model.variables == VARIABLES


def test_what_noise_does_not_explain_is_the_discrepancy(model: AeroModel) -> None:
    """Residuals of 0.010 with a noise of 0.003 leave √(0.01² − 0.003²)."""
    fit = model.fits["Cm"]
    assert fit.discrepancy == pytest.approx(np.sqrt(0.01**2 - 0.003**2), rel=0.1)
    assert fit.calibration == 1.0


def test_residuals_smaller_than_the_stated_noise_calibrate_it() -> None:
    matrix = basis.columns(STRUCTURE, CONTROLS, conditions(7, 4000))
    noise = 0.002 * np.random.default_rng(8).standard_normal(4000)
    fit = equation_error.solve(problem(matrix, noise, keys=STRUCTURE, noise=0.01), None)
    assert fit.discrepancy == 0.0
    assert fit.calibration == pytest.approx(0.04, rel=0.1)
