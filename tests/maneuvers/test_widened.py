"""A model with further terms, against one that was fitted with them, and what that separates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.aircraft import CoefficientModel, Value
from gcs_sysid.estimate import basis, traces
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.maneuvers import information, separation
from gcs_sysid.maneuvers.widened import widened
from gcs_sysid.offline import suggestion_target
from gcs_sysid.offline.model_store import StoredModel
from tests.maneuvers.made_model import aircraft, model, rows_of, white

COUNT = 500
NOISE = 0.02


def flown(seed: int, *, thrust: float) -> dict[str, np.ndarray]:
    """Random motions; thrust varies by a part of itself."""
    generator = np.random.default_rng(seed)
    names = ("alpha", "beta", "phat", "qhat", "rhat", *model().controls)
    found = {name: 0.05 * generator.standard_normal(COUNT) for name in names}
    found["V"] = 15.0 + generator.standard_normal(COUNT)
    found["qbar"] = 0.6 * found["V"] ** 2
    found["Tc"] = 0.1 * (1.0 + thrust * generator.standard_normal(COUNT))
    found["elevator"] = found["elevator"] + 2.0 * found["qhat"]
    return found | traces.values(found, model().controls, 0.02 * np.arange(COUNT))


def fitted(values: dict[str, np.ndarray]) -> AeroModel:
    """As least squares knows the terms of such motions."""
    fits = {}
    for name, fit in model().fits.items():
        columns = basis.columns(fit.keys, model().controls, values)
        covariance = NOISE**2 * np.linalg.inv(columns.T @ columns)
        fits[name] = replace(
            fit,
            covariance=covariance,
            deviations={**fit.deviations, "noise": np.sqrt(np.diagonal(covariance))},
            residual=NOISE,
            samples=COUNT,
            effective_samples=float(COUNT),
        )
    return AeroModel(fits, model().controls)


def test_further_terms_are_known_as_if_fitted_with_the_others() -> None:
    values = flown(1, thrust=0.3)
    further = {"CX": ("Tc",), "Cm": ("elevator_rate", "Tc")}
    wide = widened(fitted(values), further, values)
    for name, more in further.items():
        fit = wide.fits[name]
        assert fit.keys[-len(more) :] == more
        columns = basis.columns(fit.keys, wide.controls, values)
        np.testing.assert_allclose(
            information.seen(fit), columns.T @ columns / NOISE**2, rtol=1e-4, atol=1e-3
        )
        np.testing.assert_allclose(np.asarray(fit.value)[-len(more) :], 0.0)
    assert wide.fits["Cl"] is not None
    assert wide.fits["Cl"].keys == model().fits["Cl"].keys


def test_by_the_filter_they_are_known_as_rows_of_it_tell() -> None:
    """Where rows count alike and nothing else is unknown that is least squares again."""
    values = flown(1, thrust=0.3)
    further = {"CX": ("Tc",), "Cm": ("elevator_rate", "Tc")}
    plain, heard = (
        widened(fitted(values), further, values, told) for told in (None, white(NOISE**2))
    )
    for name in further:
        one, other = (information.seen(item.fits[name]) for item in (heard, plain))
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-4 * other.max())


def test_a_servo_that_lags_is_told_less_well_where_all_surfaces_may_be_late() -> None:
    values = flown(1, thrust=0.3)
    known, unknown = (
        widened(fitted(values), {"Cm": ("elevator_rate",)}, values, white(NOISE**2, delay=delay))
        for delay in (1e-6, 0.005)
    )
    sure, unsure = (float(item.fits["Cm"].deviation[-1]) for item in (known, unknown))
    # What aileron and rudder say of it, whose lags are none.
    told = 0.005**-2.0
    for name, control in (("CY", "rudder"), ("Cl", "aileron"), ("Cn", "rudder")):
        fit = model().fits[name]
        columns = basis.columns(fit.keys, model().controls, values)
        late = fit.value[fit.keys.index(control)] * values[f"{control}_rate"]
        left = late - columns @ np.linalg.lstsq(columns, late, rcond=None)[0]
        told += left @ left / NOISE**2
    # The lag times the elevator's slope is what the term holds.
    size = abs(known.fits["Cm"].value[known.fits["Cm"].keys.index("elevator")])
    assert unsure > 1.5 * sure
    assert unsure == pytest.approx(np.hypot(sure, size / np.sqrt(told)), rel=0.05)


def test_what_is_no_noise_stays_with_the_terms_that_had_it() -> None:
    values = flown(1, thrust=0.3)
    made = fitted(values)
    doubted = replace(made.fits["CX"], covariance=4.0 * made.fits["CX"].covariance)
    both = replace(made, fits={**made.fits, "CX": doubted})
    wide = widened(both, {"CX": ("Tc",)}, values).fits["CX"]
    plain = widened(made, {"CX": ("Tc",)}, values).fits["CX"]
    rest = 3.0 * np.diagonal(made.fits["CX"].covariance)
    np.testing.assert_allclose(
        np.diagonal(wide.covariance) - np.diagonal(plain.covariance), [*rest, 0.0], rtol=1e-6
    )


@pytest.mark.parametrize("asked", ["thrust_scale,drag_increase", "drag_increase,thrust_scale"])
def test_thrust_and_drag_come_apart_where_thrust_varies(asked: str) -> None:
    """By hand: of thrust that does not vary nothing is left beside drag."""
    values = flown(2, thrust=0.0)
    # A file that is right, so that the two are all there is.
    exact = {
        name: CoefficientModel({key: Value(term.value, 0.0) for key, term in each.terms.items()})
        for name, each in aircraft().aerodynamics.items()
    }
    stored = StoredModel(fitted(values), replace(aircraft(), aerodynamics=exact), 0.0, [])
    pair = suggestion_target.causes(stored.model, aircraft(), asked)
    target, wide = suggestion_target.separating(stored, pair, lambda: values)
    assert set(target.coefficients) == {"CX"}
    before = separation.apart(wide, information.nothing(wide), target.pair)
    columns = basis.columns(wide.fits["CX"].keys, wide.controls, flown(3, thrust=0.3))
    rows = rows_of(wide, {"CX": columns.T @ columns / NOISE**2}, float(COUNT))
    after = separation.apart(wide, information.nothing(wide).with_more(rows), target.pair)
    assert before < 1e-3 * after
    thrust, one = columns[:, -1], np.ones(COUNT)
    # Two flights of one constant each: the first fixes the drag by its own thrust.
    both = np.concatenate([np.full(COUNT, 0.1), thrust]), np.concatenate([one, one])
    first, second = both if asked.startswith("thrust") else both[::-1]
    left = first - second * (first @ second) / (second @ second)
    assert after == pytest.approx(left @ left / NOISE**2, rel=1e-3)
