"""What a maneuver would teach: the model's uncertainty before and after it.

A fit's uncertainty has parts with laws of their own (see `estimate.equation_error`, and
`estimate.inside_filter`):

- noise of the measurement: (N⁻¹ + I)⁻¹ once information I is added: of a fit of the filter's what
  that would hear (`estimate.innovation_spectrum`), of one by least squares XᵀX/v of rows X, v their
  variance;
- errors of the regressors, which gusts make: they pull a term by e/(1 − e) of its value, e being
  the errors' share of what was seen of it. More of the same changes nothing; larger motion makes
  the share smaller, so that it falls with the noise variance and grows with the number of rows;
- errors of mass, inertia and thrust, and of the moments' lag, which all flights share: they stay.

What was known before the flights is weighed in again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy import linalg

from gcs_sysid import regressors
from gcs_sysid.estimate import basis
from gcs_sysid.estimate.basis import Values
from gcs_sysid.estimate.innovation_spectrum import Spectrum
from gcs_sysid.estimate.result import AeroModel, CoefficientFit
from gcs_sysid.maneuvers.knowledge import Added, Knowledge

SAMPLE = 0.02
"""Interval of the samples of a fit [s]: those of an inertial unit at 50 Hz."""

Covariances = Mapping[str, Float[np.ndarray, "term term"]]
"""Of every coefficient's terms, by name."""
LEAST = 1e-12
"""Smallest eigenvalue of a covariance in units of its deviations."""


@dataclass(frozen=True)
class Reach:
    """How far a maneuver goes in the terms of one coefficient.

    Attributes:
        mean: of the terms' products over the maneuver, XᵀX/n.
        spread: how much the coefficient varies in the maneuver, one standard deviation.
    """

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


def nothing(model: AeroModel, heard: Spectrum | None = None) -> Knowledge:
    """Nothing added yet.

    Args:
        model: whose fits are added to.
        heard: by which the filter tells of them; None where least squares do.
    """
    errors = np.zeros(0) if heard is None else heard.precision
    placed, count = places(model)
    believed = np.diag(np.concatenate([np.zeros(count), errors]))
    for name, fit in model.fits.items():
        noise, _, _ = _parts(fit)
        root = np.sqrt(np.diagonal(noise))
        known = np.linalg.inv(noise / np.outer(root, root)) / np.outer(root, root)
        believed[placed[name], placed[name]] = known
    return Knowledge(placed, believed, Added(np.zeros(believed.shape), 0.0))


def places(model: AeroModel) -> tuple[dict[str, slice], int]:
    """Where the terms of each coefficient lie among those of all, and how many these are."""
    found, first = {}, 0
    for name, fit in model.fits.items():
        found[name] = slice(first, first + len(fit.keys))
        first += len(fit.keys)
    return found, first


def noise_deviation(fit: CoefficientFit) -> Float[np.ndarray, " term"]:
    """One standard deviation that noise of the measurement leaves; all of it where none is told."""
    root = np.sqrt(np.maximum(np.diagonal(fit.covariance), 1e-300))
    found = np.asarray(fit.deviations.get("noise", root), dtype=float)
    return np.where(found > 0.0, found, root)


def seen(fit: CoefficientFit) -> Float[np.ndarray, "term term"]:
    """What the flights so far tell of the terms by their noise: an information matrix."""
    root = np.sqrt(np.maximum(np.diagonal(fit.covariance), 1e-300))
    size = noise_deviation(fit)
    inner = np.linalg.pinv(fit.covariance / np.outer(root, root), rcond=1e-10, hermitian=True)
    return inner / np.outer(size, size)


def told(
    model: AeroModel, values: Values, step: float, heard: Spectrum | None, beside: float
) -> Added:
    """What a maneuver adds to all fits of a model, errors behind them.

    Args:
        model: identified so far.
        values: every variable of the model along the maneuver.
        step: between these samples [s].
        heard: by which the filter tells of coefficients; None where least squares do.
        beside: level flight that goes with the maneuver [s], of which the filter hears too.
    """
    samples = next(iter(values.values())).size * step / SAMPLE
    if heard is None:
        blocks = [rows(fit, model.controls, values, step) for fit in model.fits.values()]
        return Added(linalg.block_diag(*blocks), samples)
    more = np.zeros(round(beside / step))
    longer = {name: np.concatenate([item, more + item[0]]) for name, item in values.items()}
    return Added(heard.information(model, longer, step), samples + beside / SAMPLE)


def rows(
    fit: CoefficientFit, controls: Sequence[str], values: Values, step: float
) -> Float[np.ndarray, "term term"]:
    """What samples add to the regression of one coefficient, X̃ᵀX̃/v + n x̄x̄ᵀ/v₁.

    What stays as it is through a maneuver, its mean x̄ with that of the constant in it, counts as
    rows did for the constant (v₁), and not as motion about it does (v): slow wind and biases hide
    a constant. Counted alike, a sortie of the Aerosonde was foretold to leave a twelfth of what it
    left unknown of Cm by alpha and by elevator, all else known: level flight has them far from 0.

    Args:
        fit: of the coefficient.
        controls: that its terms may hold.
        values: every variable along the maneuver.
        step: between these samples [s].
    """
    columns = basis.columns(fit.keys, controls, values)
    root, still = np.sqrt(_variance(fit) * SAMPLE / step), 0.0
    moving = columns
    if regressors.CONSTANT in fit.keys:
        mean = columns.mean(axis=0)
        moving = columns - mean
        count, one = columns.shape[0], root[fit.keys.index(regressors.CONSTANT)]
        still = count * np.outer(mean, mean) / one**2
    return still + (moving.T @ moving) / np.outer(root, root)


def by_line(
    model: AeroModel,
    values: Values,
    step: float,
    heard: Spectrum | None,
    lines: Int[np.ndarray, " line"],
) -> Float[np.ndarray, "line unknown unknown"]:
    """What single harmonics of a motion that repeats itself add to all fits, each in one period.

    Args:
        model: identified so far.
        values: every variable of the model along one period.
        step: between these samples [s].
        heard: by which the filter tells of coefficients; None where least squares do.
        lines: harmonics.
    """
    if heard is not None:
        return heard.by_line(model, values, step, lines)
    placed, size = places(model)
    found = np.zeros((lines.size, size, size))
    for name, fit in model.fits.items():
        columns = basis.columns(fit.keys, model.controls, values)
        waves = np.fft.rfft(columns / np.sqrt(_variance(fit) * SAMPLE / step), axis=0)[lines]
        told = 2.0 / columns.shape[0] * (waves.conj()[:, :, None] * waves[:, None, :]).real
        found[:, placed[name], placed[name]] = told
    return found


def reach(fit: CoefficientFit, controls: Sequence[str], values: Values) -> Reach:
    """How far a maneuver goes in the terms of one coefficient."""
    columns = basis.columns(fit.keys, controls, values)
    return Reach(columns.T @ columns / columns.shape[0], float((columns @ fit.value).std()))


def _variance(fit: CoefficientFit) -> Float[np.ndarray, " term"]:
    """Variance v that a row counts with for each term: as a row of the fit did.

    From the deviation that noise left there, the number of rows, and how much the term varied. Of
    one that did not, the residual's variance over the share of independent rows.
    """
    share = fit.effective_samples / max(fit.samples, 1)
    usual = np.full(len(fit.keys), fit.residual**2 / max(share, 1e-12))
    moving = (fit.spread > 0.0) & (np.asarray(fit.deviations["noise"]) > 0.0)
    if not moving.any():
        return usual
    inner = np.linalg.pinv(fit.correlation[np.ix_(moving, moving)])
    left = np.asarray(fit.deviations["noise"])[moving] ** 2 / np.maximum(np.diagonal(inner), 1.0)
    usual[moving] = left * fit.samples * fit.spread[moving] ** 2
    return usual


def covariance(fit: CoefficientFit, added: Added) -> Float[np.ndarray, "term term"]:
    """Covariance of the terms once rows were added; with none it is the fit's."""
    regressor = _regressor(fit)
    if np.any(regressor):
        return _bent(fit, regressor, added, scale=_scale(fit))
    _, lag, stays = _parts(fit)
    return changeable(fit, added) + lag + stays


def changeable(fit: CoefficientFit, added: Added) -> Float[np.ndarray, "term term"]:
    """What of that more flight takes away: as if mass, inertia, thrust and the lag were known.

    Where regressors are free of errors information adds up.
    """
    regressor = _regressor(fit)
    if np.any(regressor):
        return _bent(fit, regressor, added, scale=np.zeros(len(fit.keys)))
    noise, _, _ = _parts(fit)
    return updated(noise, added.information)


def unchangeable(fit: CoefficientFit, added: Added) -> Float[np.ndarray, " term"]:
    """Standard deviation of each term that no flight takes away: by mass, inertia, thrust, lag."""
    left = np.diagonal(covariance(fit, added)) - np.diagonal(changeable(fit, added))
    return np.sqrt(np.maximum(left, 0.0))


def _regressor(fit: CoefficientFit) -> Float[np.ndarray, " term"]:
    return np.asarray(fit.deviations.get("regressor", np.zeros(len(fit.keys))))


def _scale(fit: CoefficientFit) -> Float[np.ndarray, " term"]:
    return np.asarray(fit.deviations.get("scale", np.zeros(len(fit.keys))))


def _parts(fit: CoefficientFit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Covariance by noise, by the lag, and by mass and inertia.

    The first is the inverse of all information, that of the prior among it.
    """
    stays, lag = lasting(fit), np.outer(fit.late, fit.late)
    return _positive(fit.covariance - stays - lag), lag, stays


def _positive(matrix: Float[np.ndarray, "term term"]) -> Float[np.ndarray, "term term"]:
    """Nothing is known better than exactly: rounding can leave less of what was taken from much."""
    size = np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    vectors = size[:, None] * vectors
    return (vectors * np.maximum(values, LEAST)) @ vectors.T


def _bent(
    fit: CoefficientFit,
    regressor: Float[np.ndarray, " term"],
    added: Added,
    *,
    scale: Float[np.ndarray, " term"],
) -> Float[np.ndarray, "term term"]:
    """Where errors of the regressors pull: deviations by the laws of the module, one by one.

    `scale` is what errors of mass, inertia and thrust leave.
    """
    now = np.diagonal(fit.covariance)
    noise = np.asarray(fit.deviations.get("noise", np.zeros(now.size))) ** 2
    raw = noise + _scale(fit) ** 2 + regressor**2
    believed = np.maximum(1.0 / np.maximum(now, 1e-300) - 1.0 / np.maximum(raw, 1e-300), 0.0)
    root = np.sqrt(np.maximum(now, 1e-300))
    correlated = fit.covariance / np.outer(root, root)
    start = np.sqrt(noise)
    later = np.diagonal(updated(correlated * np.outer(start, start), added.information))
    pulled = _pulled(fit, regressor, later / np.maximum(noise, 1e-300), added.samples)
    after = 1.0 / (1.0 / np.maximum(later + scale**2 + pulled**2, 1e-300) + believed)
    # Rounding must not make knowledge shrink, and a prior's share is counted once.
    size = np.sqrt(np.minimum(after, now))
    return correlated * np.outer(size, size)


def _pulled(
    fit: CoefficientFit,
    before: Float[np.ndarray, " term"],
    shrunk: Float[np.ndarray, " term"],
    samples: float,
) -> Float[np.ndarray, " term"]:
    """How far errors of the regressors pull each term: `shrunk` is the noise variance's factor."""
    size = np.maximum(np.abs(fit.flight_value), 1e-300)
    share = before / (before + size)
    share = share * shrunk * (1.0 + samples / max(fit.samples, 1))
    share = np.minimum(share, before / (before + size))
    return share / (1.0 - share) * size


def gain(fit: CoefficientFit, over: Reach, known: Added, later: Added) -> Gain:
    """Uncertainty of one coefficient before and after a maneuver was flown and fitted.

    Args:
        fit: of the coefficient.
        over: how far the maneuver goes.
        known: what was added to the fit before.
        later: what is with it.
    """
    before, after = covariance(fit, known), covariance(fit, later)
    return Gain(
        before=_deviation(over.mean, before),
        after=_deviation(over.mean, after),
        spread=over.spread,
        derivatives={
            key: (float(np.sqrt(before[index, index])), float(np.sqrt(after[index, index])))
            for index, key in enumerate(fit.keys)
        },
    )


def updated(
    before: Float[np.ndarray, "term term"], information: Float[np.ndarray, "term term"]
) -> Float[np.ndarray, "term term"]:
    """(Σ⁻¹ + I)⁻¹ without inverting Σ."""
    found = np.linalg.solve(np.eye(before.shape[0]) + before @ information, before)
    return 0.5 * (found + found.T)


def lasting(fit: CoefficientFit) -> Float[np.ndarray, "term term"]:
    """Part of the covariance that more data does not take away: errors of mass, inertia, thrust.

    They make all terms wrong by one factor, so that they lie along one direction d. Of d dᵀ as
    much counts as the covariance holds, t ≤ 1/(dᵀ Σ⁻¹ d): a prior may know it better.
    """
    along = np.sign(fit.value) * _scale(fit)
    ridge = 1e-12 * np.diag(np.diagonal(fit.covariance))
    reach = float(along @ np.linalg.solve(fit.covariance + ridge, along))
    return np.outer(along, along) * min(1.0, 1.0 / max(reach, 1e-300))


def _deviation(
    mean: Float[np.ndarray, "term term"], known: Float[np.ndarray, "term term"]
) -> float:
    """Root mean square over rows of √(x Σ xᵀ)."""
    return float(np.sqrt(max(np.sum(mean * known), 0.0)))
