"""Output error: truth without noise, other implementations, coverage, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize

from gcs_sysid.errors import UsageError
from gcs_sysid.estimate import output_error
from gcs_sysid.estimate.output_error import Fit, Model, OutputError
from gcs_sysid.estimate.simulated_aircraft import simulated
from gcs_sysid.model import trim
from gcs_sysid.model.linear import OUTPUTS, STATES, motion_of
from tests.estimate.made_short_period import NAMES, STEP, TRUE, elevator, flights, flown, model
from tests.model.made_linear import AIRSPEED, DENSITY, HEIGHT, flying

FAR = 0.6 * TRUE


@pytest.fixture(scope="module")
def estimator() -> OutputError:
    return OutputError(model(), free_start=(0, 1))


def test_the_truth_is_found_without_noise_over_maneuvers_of_different_length(estimator) -> None:
    """Limited by RK4 at 20 ms on roots of 3 rad/s: its error is about 1e-7 of the motion."""
    records = flights(0, seconds=(20.0, 9.0, 14.0), noise=0.0)
    found = estimator.fit(records, FAR)
    assert found.status == "converged"
    np.testing.assert_allclose(found.value, TRUE, rtol=2e-6)
    np.testing.assert_allclose(found.start, [[0.01 * i, -0.02 * i] for i in (1, 2, 3)], atol=1e-7)


def test_the_simulation_is_the_exact_solution(estimator) -> None:
    # RK4's error at 20 ms and roots of 3 rad/s, (λh)⁵/120 a step over a time constant.
    records = flights(0, noise=0.0)
    own = np.array([[0.01, -0.02]])
    exact = flown(records.inputs[0], own[0])
    np.testing.assert_allclose(estimator.simulate(TRUE, own, records)[0], exact, atol=1e-7)


def test_derivatives_are_differences(estimator) -> None:
    records, own = flights(0), np.array([[0.01, -0.02]])
    slopes = np.asarray(estimator._slopes(TRUE, own, records.start, records.inputs, records.step))[
        0
    ]
    for place in range(6):
        step = np.zeros(6)
        step[place] = 1e-6
        above = estimator.simulate(TRUE + step[:4], own + step[4:], records)
        below = estimator.simulate(TRUE - step[:4], own - step[4:], records)
        np.testing.assert_allclose(
            slopes[..., place], (above - below)[0] / 2e-6, rtol=1e-6, atol=1e-7
        )


def test_a_dense_least_squares_finds_the_same(estimator) -> None:
    """SciPy on all parameters at once, by finite differences, with the noise that was found."""
    records = flights(3, seconds=(20.0, 12.0), missing=0.05)
    found = estimator.fit(records, FAR)
    assert found.status == "converged"

    def residual(free):
        out = estimator.simulate(free[:4], free[4:].reshape(2, 2), records)
        return np.nan_to_num((records.measured - out) / found.noise).ravel()

    other = optimize.least_squares(residual, np.concatenate([TRUE, np.zeros(4)]), x_scale="jac")
    deviation = np.sqrt(np.diagonal(found.white_covariance))
    assert np.all(np.abs(other.x[:4] - found.value) < 1e-3 * deviation)
    np.testing.assert_allclose(other.x[4:].reshape(2, 2), found.start, atol=1e-6)
    dense = np.linalg.inv(other.jac.T @ other.jac)[:4, :4]
    np.testing.assert_allclose(np.sqrt(np.diagonal(dense)), deviation, rtol=0.01)


def ratios(estimator: OutputError, seeds: range, **made) -> tuple[np.ndarray, np.ndarray]:
    """Errors over stated deviations, by coloured and by white residuals."""
    coloured, white = [], []
    for seed in seeds:
        found = estimator.fit(flights(seed, **made), TRUE)
        assert found.status == "converged"
        error = found.value - TRUE
        coloured.append(error / found.deviation)
        white.append(error / np.sqrt(np.diagonal(found.white_covariance)))
    return np.array(coloured), np.array(white)


def test_intervals_hold_in_white_noise(estimator) -> None:
    coloured, white = ratios(estimator, range(100, 160))
    assert np.std(white) == pytest.approx(1.0, abs=0.15)
    assert np.std(coloured) == pytest.approx(1.0, abs=0.2)
    assert np.mean(np.abs(coloured) < 1.96) > 0.9


def test_intervals_hold_in_gusts_that_the_model_does_not_know(estimator) -> None:
    """Gusts of 1° at 60 s: white residuals would claim several times too much."""
    coloured, white = ratios(estimator, range(300, 360), seconds=(60.0,), gust=0.017)
    assert np.std(white) > 3.0
    assert 0.88 < np.mean(np.abs(coloured) < 1.96) <= 1.0
    assert np.std(coloured) < 1.3


def test_units_of_inputs_and_outputs_do_not_matter(estimator) -> None:
    """In degrees throughout, and an hour later: the same derivatives and intervals."""
    records = flights(5)
    degrees = replace(
        records,
        inputs=np.degrees(records.inputs),
        measured=np.degrees(records.measured),
        start=np.degrees(records.start),
    )
    plain, turned = estimator.fit(records, FAR), estimator.fit(degrees, FAR)
    np.testing.assert_allclose(turned.value, plain.value, rtol=1e-6)
    np.testing.assert_allclose(turned.covariance, plain.covariance, rtol=1e-4)


def test_biases_belong_to_a_maneuver() -> None:
    records = flights(6, seconds=(15.0, 15.0), noise=0.0)
    offset = np.array([[0.02, -0.01], [-0.03, 0.04]])
    shifted = replace(records, measured=records.measured + offset[:, None, :])
    found = OutputError(model(), free_start=(0, 1), free_bias=(0, 1)).fit(shifted, TRUE * 1.1)
    np.testing.assert_allclose(found.bias, offset, atol=1e-7)
    np.testing.assert_allclose(found.value, TRUE, rtol=5e-6)


def test_what_was_not_excited_is_unknown_and_the_rest_is_not_harmed() -> None:
    """A second control that never moved."""

    def rate(value, state, inputs):
        return model().rate(value[:4], state, inputs) + value[4] * inputs[1:2]

    records = flights(7)
    still = replace(
        records, inputs=np.concatenate([records.inputs, np.zeros_like(records.inputs)], axis=2)
    )
    both = OutputError(Model(rate, model().output), free_start=(0, 1))
    found = both.fit(still, np.append(FAR, 0.3))
    assert found.status == "converged"
    assert found.deviation[4] > 100.0
    assert found.value[4] == pytest.approx(0.3)
    assert np.all(np.abs(found.value[:4] - TRUE) < 5.0 * found.deviation[:4])


def test_a_simulation_that_diverges_is_a_status_with_a_remedy(estimator) -> None:
    records = flights(8)
    found: Fit = estimator.fit(records, np.array([1e6, 1e6, 1e6, 1e6]))
    assert found.status == "start not finite"
    assert "shorten" in output_error.REMEDY[found.status]
    assert np.all(np.isnan(found.covariance))


def test_the_whole_aircraft_is_found_from_its_own_flight() -> None:
    """Six derivatives of the nonlinear aircraft, all outputs, two maneuvers, without noise."""
    aircraft = flying()
    level = trim.find(aircraft, AIRSPEED, HEIGHT, DENSITY)
    free = [("CZ", "alpha"), ("Cm", "alpha"), ("Cm", "qhat"), ("Cm", "elevator"), ("Cl", "phat"),
            ("Cl", "aileron")]  # fmt: skip
    truth = np.array([aircraft.aerodynamics[name].terms[key].value for name, key in free])
    command = elevator(6.0, 0.03)
    rest = np.concatenate([level.controls, level.settings])
    inputs = np.tile(rest, (2, len(command), 1))
    place = {name: index for index, name in enumerate(aircraft.control_names)}
    inputs[0, :, place["elevator"]] += command[:, 0]
    inputs[1, :, place["aileron"]] += command[:, 0]
    start = np.tile(np.asarray(motion_of(level.state)), (2, 1))
    records = output_error.Records(
        inputs=inputs, measured=np.zeros((2, len(command), len(OUTPUTS))), start=start, step=STEP
    )
    whole = OutputError(
        simulated(aircraft, free, height=HEIGHT, density=DENSITY),
        free_start=range(len(STATES)),
        substeps=1,
    )
    measured = whole.simulate(truth, np.zeros((2, len(STATES))), records)
    found = whole.fit(replace(records, measured=measured), 0.8 * truth)
    assert found.status == "converged"
    np.testing.assert_allclose(found.value, truth, rtol=1e-6)


def test_a_value_that_the_aircraft_does_not_have_cannot_be_free() -> None:
    with pytest.raises(UsageError, match="no term `beta` in Cm"):
        simulated(flying(), [("Cm", "beta")], height=HEIGHT, density=DENSITY)


def test_names_of_the_short_period_are_four() -> None:
    assert len(NAMES) == TRUE.size
