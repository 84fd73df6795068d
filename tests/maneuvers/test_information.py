from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.estimate.result import AeroModel, CoefficientFit
from gcs_sysid.maneuvers import information
from gcs_sysid.maneuvers.information import Gain
from gcs_sysid.maneuvers.knowledge import Added

KEYS = ("alpha", "qhat")
VALUE = np.array([-2.0, -20.0])
COVARIANCE = np.array([[0.04, 0.01], [0.01, 9.0]])


def fitted(
    covariance: np.ndarray, scale: np.ndarray, *, noise: np.ndarray = COVARIANCE
) -> CoefficientFit:
    nothing = np.zeros(2)
    return CoefficientFit(
        keys=KEYS,
        value=VALUE,
        covariance=covariance,
        flight_value=VALUE,
        deviations={"noise": np.sqrt(np.diagonal(noise)), "scale": scale},
        late=nothing,
        white_deviation=nothing,
        repeated_covariance=covariance,
        discrepancy=0.0,
        calibration=1.0,
        residual=0.01,
        correlation=np.eye(2),
        excitation=nothing,
        lowest=nothing,
        highest=nothing,
        spread=nothing,
        samples=1000,
        effective_samples=100.0,
    )


RANDOM = np.random.default_rng(2)
VALUES = {
    "alpha": 0.05 * RANDOM.standard_normal(500),
    "qhat": 0.003 * RANDOM.standard_normal(500),
}


def gain(model: AeroModel, values: dict[str, np.ndarray], step: float) -> Gain:
    fit = model.fits["Cm"]
    none = information.nothing(model)
    later = none.with_more(information.told(model, values, step, None, 0.0))
    reach = information.reach(fit, model.controls, values)
    return information.gain(fit, reach, none.of("Cm"), later.of("Cm"))


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


def test_a_lag_that_all_flights_share_stays_too() -> None:
    """It had counted as noise, and a sortie was foretold to take it away."""
    lag = 0.02 * np.abs(VALUE)
    fit = fitted(COVARIANCE + np.outer(lag, lag), np.zeros(2))
    late = replace(fit, deviations={**fit.deviations, "lag": lag}, late=lag)
    model = AeroModel({"Cm": late}, ())
    much = {name: np.tile(value, 10000) for name, value in VALUES.items()}
    found = gain(model, much, information.SAMPLE)
    for index, key in enumerate(KEYS):
        assert found.derivatives[key][1] == pytest.approx(lag[index], rel=1e-2)


def test_what_flying_can_change_is_what_is_left_were_inertia_and_lag_known() -> None:
    lag, scale = 0.02 * np.abs(VALUE), 0.05 * np.abs(VALUE)
    whole = COVARIANCE + np.outer(lag, lag) + np.outer(0.05 * VALUE, 0.05 * VALUE)
    made = fitted(whole, scale)
    filtered = replace(made, deviations={**made.deviations, "lag": lag}, late=lag)
    more = Added(3.0 * np.linalg.inv(COVARIANCE), 100.0)
    found = np.sqrt(np.diagonal(information.changeable(filtered, more)))
    np.testing.assert_allclose(found, 0.5 * np.sqrt(np.diagonal(COVARIANCE)), rtol=1e-9)
    bent = pulled(0.2)
    heavy = replace(bent, deviations={**bent.deviations, "scale": scale})
    heavy = replace(heavy, covariance=bent.covariance + np.outer(0.05 * VALUE, 0.05 * VALUE))
    known = information.changeable(replace(bent, covariance=heavy.covariance), more)
    left = information.changeable(heavy, more)
    stated = information.covariance(heavy, more)
    np.testing.assert_allclose(np.diagonal(left), np.diagonal(known), rtol=1e-9)
    np.testing.assert_allclose(np.diagonal(stated - left), scale**2, rtol=1e-9)


def test_a_prior_that_knows_the_inertia_better_is_not_forgotten() -> None:
    model = AeroModel({"Cm": fitted(COVARIANCE, 10.0 * np.abs(VALUE))}, ())
    found = gain(model, VALUES, information.SAMPLE)
    assert found.after <= found.before
    assert all(after <= before * (1.0 + 1e-9) for before, after in found.derivatives.values())


def test_without_information_nothing_changes() -> None:
    model = AeroModel({"Cm": replace(fitted(COVARIANCE, np.zeros(2)), residual=1e6)}, ())
    found = gain(model, VALUES, information.SAMPLE)
    assert found.after == pytest.approx(found.before)


def pulled(share: float) -> CoefficientFit:
    """A fit that noise hardly touches, and whose terms errors of the regressors may have bent."""
    bent = share / (1.0 - share) * np.abs(VALUE)
    noise = 1e-4 * COVARIANCE
    made = fitted(noise + np.diag(bent**2), np.zeros(2), noise=noise)
    return replace(made, deviations={**made.deviations, "regressor": bent})


def test_more_of_the_same_does_not_take_errors_of_the_regressors_away() -> None:
    """As many rows with as much information as the fit had: half the noise variance, same pull."""
    fit = pulled(0.2)
    same = Added(np.linalg.inv(1e-4 * COVARIANCE), 1000.0)
    found = np.sqrt(np.diagonal(information.covariance(fit, same)))
    np.testing.assert_allclose(found, 0.25 * np.abs(VALUE), rtol=2e-3)


def test_larger_motion_does() -> None:
    """Three times the amplitude for as long: 9 + 1 times the information, twice the errors."""
    fit = pulled(0.2)
    larger = Added(9.0 * np.linalg.inv(1e-4 * COVARIANCE), 1000.0)
    found = np.sqrt(np.diagonal(information.covariance(fit, larger)))
    share = 0.2 * 2.0 / 10.0
    np.testing.assert_allclose(found, share / (1.0 - share) * np.abs(VALUE), rtol=1e-2)


def test_a_fit_that_nothing_was_added_to_is_as_sure_as_it_was() -> None:
    for fit in (fitted(COVARIANCE, 0.1 * np.abs(VALUE)), pulled(0.3)):
        none = Added(np.zeros((2, 2)), 0.0)
        np.testing.assert_allclose(information.covariance(fit, none), fit.covariance, rtol=1e-9)


def test_flying_the_same_flight_again_halves_the_noise() -> None:
    """Rows count as those of the fit did, by the deviation that noise left in it."""
    deviation = {"alpha": 0.02, "qhat": 0.001}
    values = {name: size * RANDOM.standard_normal(1000) for name, size in deviation.items()}
    sizes = np.array(list(deviation.values()))
    noise = np.diag(3.0**2 / (1000.0 * sizes**2))
    fit = replace(fitted(noise, np.zeros(2), noise=noise), spread=sizes)
    found = gain(AeroModel({"Cm": fit}, ()), values, information.SAMPLE)
    for before, after in found.derivatives.values():
        assert after / before == pytest.approx(np.sqrt(0.5), rel=0.05)


@pytest.mark.parametrize("share", [1.0, 1e-4])
def test_what_stays_as_it_is_counts_as_rows_did_for_the_constant(share: float) -> None:
    """Where all rows are independent that is plain regression; where few are, all but motion."""
    alpha = 0.02 * RANDOM.standard_normal(1000)
    alpha -= alpha.mean()
    noise = np.diag([0.01**2 / (1000.0 * share), 0.01**2 / (alpha @ alpha)])
    fit = replace(
        fitted(noise, np.zeros(2), noise=noise),
        keys=("1", "alpha"),
        spread=np.array([0.0, alpha.std()]),
        effective_samples=1000.0 * share,
    )
    values = {"alpha": 0.1 + alpha}
    added = information.rows(fit, (), values, information.SAMPLE)
    columns = np.stack([np.ones(1000), values["alpha"]], axis=1)
    mean = np.outer([1.0, 0.1], [1.0, 0.1]) * 1000.0 * share
    expected = (mean + np.diag([0.0, alpha @ alpha])) / 0.01**2
    np.testing.assert_allclose(added, expected, rtol=1e-6, atol=1e-6)
    if share == 1.0:
        np.testing.assert_allclose(expected, columns.T @ columns / 0.01**2, rtol=1e-6)
