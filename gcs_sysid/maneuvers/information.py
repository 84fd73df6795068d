"""What a maneuver would teach: the model's uncertainty before and after it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid.estimate import basis
from gcs_sysid.estimate.basis import Values
from gcs_sysid.estimate.result import AeroModel, CoefficientFit


@dataclass(frozen=True)
class Gain:
    """One coefficient's uncertainty along a maneuver.

    Attributes:
        before: standard deviation of the coefficient, root mean square over the maneuver.
        after: the same once the maneuver has been flown.
        spread: how much the coefficient varies in the maneuver, one standard deviation.
        derivatives: standard deviation of each term before and after.
    """

    before: float
    after: float
    spread: float
    derivatives: dict[str, tuple[float, float]]


def gain(model: AeroModel, name: str, values: Values, step: float) -> Gain:
    """Uncertainty of one coefficient before and after a maneuver was flown and fitted.

    The regression of the model's own fit with the maneuver's rows added: its residual is its noise,
    and rows count for what they counted for there, coloured residuals included. What does not
    shrink with more data, the errors of mass, inertia and thrust, stays.

    Args:
        model: identified so far.
        name: the coefficient.
        values: every variable of the model along the maneuver.
        step: between these samples [s].
    """
    fit = model.fits[name]
    columns = basis.columns(fit.keys, model.controls, values)
    before, stays = fit.covariance, lasting(fit)
    after = stays + updated(before - stays, fit, columns, step)
    value = columns @ fit.value
    return Gain(
        before=_deviation(columns, before),
        after=_deviation(columns, after),
        spread=float(value.std()),
        derivatives={
            key: (float(np.sqrt(before[index, index])), float(np.sqrt(after[index, index])))
            for index, key in enumerate(fit.keys)
        },
    )


def updated(
    covariance: Float[np.ndarray, "term term"],
    fit: CoefficientFit,
    columns: Float[np.ndarray, "sample term"],
    step: float,
) -> Float[np.ndarray, "term term"]:
    """Covariance Σ of the terms after more rows: (Σ⁻¹ + XᵀX/v)⁻¹, without inverting Σ.

    v is the variance of the residual over the share of rows that were independent.
    """
    share = fit.effective_samples / fit.samples
    variance = fit.residual**2 / max(share, 1e-12) * SAMPLE / step
    added = columns.T @ columns / variance
    found = np.linalg.solve(np.eye(len(fit.keys)) + covariance @ added, covariance)
    return 0.5 * (found + found.T)


SAMPLE = 0.02
"""Interval of the samples of a fit [s]: those of an inertial unit at 50 Hz."""


def lasting(fit: CoefficientFit) -> Float[np.ndarray, "term term"]:
    """Part of the covariance that more data does not take away: errors of mass, inertia, thrust.

    They make all terms wrong by one factor, so that they lie along one direction d. Of d dᵀ as
    much counts as the covariance holds, t ≤ 1/(dᵀ Σ⁻¹ d): a prior may know it better.
    """
    size = fit.deviations.get("scale", np.zeros(len(fit.keys)))
    along = np.sign(fit.value) * size
    ridge = 1e-12 * np.diag(np.diagonal(fit.covariance))
    reach = float(along @ np.linalg.solve(fit.covariance + ridge, along))
    return np.outer(along, along) * min(1.0, 1.0 / max(reach, 1e-300))


def _deviation(
    columns: Float[np.ndarray, "sample term"], covariance: Float[np.ndarray, "term term"]
) -> float:
    variance = np.sum((columns @ covariance) * columns, axis=1)
    return float(np.sqrt(np.mean(np.maximum(variance, 0.0))))
