"""What a maneuver would teach: the model's uncertainty before and after it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid.estimate import basis
from gcs_sysid.estimate.basis import Values
from gcs_sysid.estimate.result import AeroModel, CoefficientFit

SAMPLE = 0.02
"""Interval of the samples of a fit [s]: those of an inertial unit at 50 Hz."""

Covariances = Mapping[str, Float[np.ndarray, "term term"]]
"""Of every coefficient's terms, by name."""


@dataclass(frozen=True)
class Rows:
    """What a maneuver adds to the regression of one coefficient.

    Attributes:
        information: XᵀX/v of its terms, what it adds to the inverse of their covariance.
        mean: of the terms' products over the maneuver, XᵀX/n.
        spread: how much the coefficient varies in the maneuver, one standard deviation.
    """

    information: Float[np.ndarray, "term term"]
    mean: Float[np.ndarray, "term term"]
    spread: float


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


def rows(model: AeroModel, name: str, values: Values, step: float) -> Rows:
    """What the samples of a maneuver add to the fit of one coefficient.

    The regression of the model's own fit with the maneuver's rows added: its residual is its noise,
    and rows count for what they counted for there, coloured residuals included. v is the variance
    of the residual over the share of rows that were independent.

    Args:
        model: identified so far.
        name: the coefficient.
        values: every variable of the model along the maneuver.
        step: between these samples [s].
    """
    fit = model.fits[name]
    columns = basis.columns(fit.keys, model.controls, values)
    share = fit.effective_samples / fit.samples
    variance = fit.residual**2 / max(share, 1e-12) * SAMPLE / step
    products = columns.T @ columns
    return Rows(
        information=products / variance,
        mean=products / columns.shape[0],
        spread=float((columns @ fit.value).std()),
    )


def after(
    covariance: Float[np.ndarray, "term term"],
    fit: CoefficientFit,
    information: Float[np.ndarray, "term term"],
) -> Float[np.ndarray, "term term"]:
    """Covariance of the terms once information was added; what more data cannot tell stays."""
    stays = lasting(fit)
    return stays + updated(covariance - stays, information)


def gain(
    fit: CoefficientFit,
    added: Rows,
    covariance: Float[np.ndarray, "term term"],
    *,
    repeats: int = 1,
) -> Gain:
    """Uncertainty of one coefficient before and after a maneuver was flown and fitted.

    Args:
        fit: of the coefficient.
        added: by the maneuver.
        covariance: of its terms before.
        repeats: how often it is flown.
    """
    later = after(covariance, fit, repeats * added.information)
    return Gain(
        before=_deviation(added.mean, covariance),
        after=_deviation(added.mean, later),
        spread=added.spread,
        derivatives={
            key: (float(np.sqrt(covariance[index, index])), float(np.sqrt(later[index, index])))
            for index, key in enumerate(fit.keys)
        },
    )


def updated(
    covariance: Float[np.ndarray, "term term"], information: Float[np.ndarray, "term term"]
) -> Float[np.ndarray, "term term"]:
    """(Σ⁻¹ + I)⁻¹ without inverting Σ."""
    found = np.linalg.solve(np.eye(covariance.shape[0]) + covariance @ information, covariance)
    return 0.5 * (found + found.T)


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
    mean: Float[np.ndarray, "term term"], covariance: Float[np.ndarray, "term term"]
) -> float:
    """Root mean square over rows of √(x Σ xᵀ)."""
    return float(np.sqrt(max(np.sum(mean * covariance), 0.0)))
