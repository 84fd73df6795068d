"""Least squares on measured coefficients: the first model, and the baseline for all later ones.

    C(t) = Σ θ_j x_j(t) + v(t)

Ordinary least squares weighted by the noise of the measurement; what makes its standard errors hold
is what is added to them. v is coloured, so its autocorrelation enters (Klein & Morelli 2006, eqs.
5.88–5.91). Mass, inertia and thrust are wrong by a factor common to the flight, so their part does
not shrink with more samples. The regressors α and β are themselves estimates: their error pulls a
slope toward zero (Fuller, *Measurement Error Models*, 1987, section 2.2); how far it may have is
counted as one standard deviation, since with gusts unseen the pull may be anything up to that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gcs_sysid import regressors
from gcs_sysid.aircraft import COEFFICIENTS, MOMENTS, Aircraft
from gcs_sysid.estimate import basis, plausible
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.estimate.result import AeroModel, CoefficientFit, Prior
from gcs_sysid.reconstruct import rates

MOST_ERROR = 0.9
ANSWERED = 0.2
"""How far what errors leave goes with any regressor, one standard deviation: see `pull`."""
LEAST_RANK = 1e-10
"""Directions of XᵀX, columns scaled to one, that hold less than this of the largest are unseen."""
UNKNOWN = 1e3
LONGEST_LAG = 3.0
"""Residuals further apart than this [s] are taken as independent."""


@dataclass(frozen=True)
class Problem:
    """One coefficient's regression, all flights stacked.

    Attributes:
        keys: regressors, in the order of the columns.
        columns: their values.
        measured: the coefficient.
        noise: one standard deviation of a measurement.
        slopes: derivative of each column with respect to each uncertain variable.
        slope_variance: variance of these variables.
        plausible: largest size that each term can have, see `plausible`.
        systematic: what a relative error of one in mass or inertia, and in thrust, adds.
        systematic_sigma: relative standard deviations of the two.
        piece: which unbroken stretch of a flight a sample belongs to.
        step: sample interval [s].
    """

    keys: tuple[str, ...]
    columns: Float[np.ndarray, "sample term"]
    measured: Float[np.ndarray, " sample"]
    noise: Float[np.ndarray, " sample"]
    slopes: Float[np.ndarray, "variable sample term"]
    slope_variance: Float[np.ndarray, "variable sample"]
    plausible: Float[np.ndarray, " term"]
    systematic: Float[np.ndarray, "sample two"]
    systematic_sigma: Float[np.ndarray, " two"]
    piece: Int[np.ndarray, " sample"]
    step: float


class Scatter(NamedTuple):
    """Fields of a `CoefficientFit` that depend on the values alone; see there."""

    discrepancy: float
    calibration: float
    residual: float
    excitation: Float[np.ndarray, " term"]


def fit(
    flights: Sequence[Samples],
    aircraft: Aircraft,
    structure: Mapping[str, Sequence[str]],
    pieces: Sequence[Int[np.ndarray, " _sample"]],
    *,
    prior: Mapping[str, Prior] | None = None,
) -> AeroModel:
    """Fits every coefficient that the flights can give.

    Args:
        flights: measured coefficients.
        aircraft: relative uncertainty of mass, inertia and thrust.
        structure: regressor keys by coefficient.
        pieces: for each flight and sample, the maneuver it belongs to; negative leaves it out.
        prior: values believed before, by coefficient; None uses the flights alone.
    """
    fits = {}
    for name in COEFFICIENTS:
        if any(name in flight.refused for flight in flights):
            continue
        believed = None if prior is None else prior.get(name)
        fits[name] = solve(problem(name, flights, aircraft, structure[name], pieces), believed)
    return AeroModel(fits=fits, controls=aircraft.control_names)


def problem(
    name: str,
    flights: Sequence[Samples],
    aircraft: Aircraft,
    keys: Sequence[str],
    pieces: Sequence[Int[np.ndarray, " _sample"]],
) -> Problem:
    """Stacks one coefficient's regression over the flights.

    The regressors of a moment go through the same smoother as the moment itself did.
    """
    controls = aircraft.control_names
    keys = tuple(regressors.parse(key, controls=controls).key for key in keys)
    variables = tuple(flights[0].regressor_variance)
    stacked: dict[str, list[np.ndarray]] = {
        field: [] for field in ("x", "y", "s", "d", "v", "e", "p")
    }
    for index, (flight, piece) in enumerate(zip(flights, pieces, strict=True)):
        columns = basis.columns(keys, controls, flight.regressors)
        if name in MOMENTS:
            columns = rates.smooth(flight.time, columns, flight.smoothing).value
        used = piece >= 0
        stacked["x"].append(columns[used])
        stacked["y"].append(flight.measured[name][used])
        stacked["s"].append(flight.noise[name][used])
        stacked["d"].append(
            np.stack(
                [basis.slopes(keys, controls, flight.regressors, item)[used] for item in variables]
            )
        )
        stacked["v"].append(np.stack([flight.regressor_variance[item][used] for item in variables]))
        stacked["e"].append(
            np.stack([flight.mass_part[name][used], flight.thrust_part[name][used]], 1)
        )
        stacked["p"].append(piece[used] + 1_000_000 * index)
    scale = aircraft.mass.inertia_sigma if name in MOMENTS else aircraft.mass.mass_sigma
    push = max((item.thrust_sigma for item in aircraft.propulsion), default=0.0)
    return Problem(
        keys=keys,
        columns=np.concatenate(stacked["x"]),
        measured=np.concatenate(stacked["y"]),
        noise=np.concatenate(stacked["s"]),
        slopes=np.concatenate(stacked["d"], axis=1),
        slope_variance=np.concatenate(stacked["v"], axis=1),
        plausible=plausible.sizes(name, keys, controls),
        systematic=np.concatenate(stacked["e"]),
        systematic_sigma=np.array([scale, push]),
        piece=np.concatenate(stacked["p"]),
        step=float(np.median(np.diff(flights[0].time))),
    )


def solve(problem: Problem, prior: Prior | None) -> CoefficientFit:
    """Weighted least squares with honest standard errors, then the prior."""
    root = np.median(problem.noise) / problem.noise
    columns = problem.columns * root[:, None]
    measured = problem.measured * root
    information = columns.T @ columns
    inverse, unseen = inverse_where_seen(
        information, float(np.linalg.norm(measured)), measured.size
    )
    value = inverse @ (columns.T @ measured)
    residual = measured - columns @ value
    count, terms = columns.shape
    freedom = count / max(count - terms, 1)
    coloured = inverse @ _score_covariance(columns, residual, problem) @ inverse * freedom
    white = inverse * float(residual @ residual) / max(count - terms, 1)
    effect = (columns * root[:, None]).T @ problem.systematic * problem.systematic_sigma
    scale = inverse @ effect
    lengths = (float(np.linalg.norm(each)) for each in (residual, problem.noise * root))
    bent = pull(_errors(problem, root), information, value, *lengths)
    parts = {
        "noise": coloured + unseen @ unseen.T,
        "scale": scale @ scale.T,
        "regressor": bounded(bent @ bent.T, problem.plausible),
    }
    raw = sum(parts.values(), np.zeros_like(white))
    mean, covariance, kept = with_prior(value, raw, prior, problem.keys)
    return CoefficientFit(
        keys=problem.keys,
        value=mean,
        covariance=covariance,
        flight_value=value,
        deviations={name: np.sqrt(np.diagonal(part)) for name, part in parts.items()},
        late=np.zeros(terms),
        white_deviation=np.sqrt(np.diagonal(white)),
        repeated_covariance=kept @ (parts["noise"] + parts["scale"]) @ kept.T,
        correlation=basis.correlation(problem.columns),
        lowest=problem.columns.min(axis=0),
        highest=problem.columns.max(axis=0),
        spread=problem.columns.std(axis=0),
        samples=count,
        effective_samples=_effective(count, white, coloured),
        **scatter(problem, mean)._asdict(),
    )


def scatter(problem: Problem, value: Float[np.ndarray, " term"]) -> Scatter:
    """How the measurements lie about a model with these values, however it was found."""
    departure = problem.measured - problem.columns @ value
    left, noise = float(np.mean(departure**2)), float(np.mean(problem.noise**2))
    size = max(float(problem.measured.std()), 1e-12)
    return Scatter(
        discrepancy=float(np.sqrt(max(left - noise, 0.0))),
        calibration=min(1.0, left / noise),
        residual=float(np.std(departure)),
        excitation=np.abs(value) * problem.columns.std(axis=0) / size,
    )


def inverse_where_seen(
    information: Float[np.ndarray, "term term"], length: float, count: int
) -> tuple[Float[np.ndarray, "term term"], Float[np.ndarray, "term direction"]]:
    """Inverse of XᵀX on what the columns span, and one standard deviation along what they do not.

    A regressor that never moved, or moved as another did, leaves a direction about which the flight
    says nothing: its standard deviation is `UNKNOWN` times what would make the whole coefficient,
    whose `count` samples have the norm `length`.
    """
    norm = np.sqrt(np.diagonal(information))
    # A column of zeros has no size of its own: one of the regressor's unit stands in.
    scale = 1.0 / np.where(norm > 0.0, norm, np.sqrt(count))
    roots, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    directions = scale[:, None] * vectors
    seen = roots > LEAST_RANK * roots.max()
    inverse = (directions[:, seen] / roots[seen]) @ directions[:, seen].T
    return inverse, directions[:, ~seen] * UNKNOWN * length


def _score_covariance(
    columns: Float[np.ndarray, "sample term"],
    residual: Float[np.ndarray, " sample"],
    problem: Problem,
) -> Float[np.ndarray, "term term"]:
    """Σ_i Σ_j x_i R_vv(i−j) x_jᵀ over samples of the same piece, R_vv tapered to zero.

    The taper (Bartlett) keeps the sum positive semidefinite; correlations are computed by FFT.
    """
    lags = max(int(LONGEST_LAG / problem.step), 1)
    pieces = [np.flatnonzero(problem.piece == item) for item in np.unique(problem.piece)]
    products = np.zeros(lags + 1)
    pairs = np.zeros(lags + 1)
    for rows in pieces:
        reach = min(lags + 1, rows.size)
        products[:reach] += _lagged(residual[rows, None], reach)[:, 0, 0]
        pairs[:reach] += rows.size - np.arange(reach)
    taper = 1.0 - np.arange(lags + 1) / (lags + 1.0)
    kernel = taper * np.where(pairs > 0, products / np.maximum(pairs, 1.0), 0.0)
    total = np.zeros((columns.shape[1],) * 2)
    for rows in pieces:
        reach = min(lags + 1, rows.size)
        lagged = _lagged(columns[rows], reach)
        one_sided = np.tensordot(kernel[:reach], lagged, axes=1)
        total += one_sided + one_sided.T - kernel[0] * lagged[0]
    values, vectors = np.linalg.eigh(0.5 * (total + total.T))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T


def _lagged(
    signal: Float[np.ndarray, "sample term"], reach: int
) -> Float[np.ndarray, "lag term term"]:
    """Σ_i s_i s_{i+k}ᵀ for lags k below `reach`."""
    size = int(2 ** np.ceil(np.log2(signal.shape[0] + reach)))
    spectrum = np.fft.rfft(signal, size, axis=0)
    cross = np.conj(spectrum)[:, :, None] * spectrum[:, None, :]
    return np.fft.irfft(cross, size, axis=0)[:reach]


def _errors(problem: Problem, root: Float[np.ndarray, " sample"]) -> Float[np.ndarray, "term term"]:
    """Covariance of the columns' errors, weighted and summed over the samples."""
    weight = problem.slope_variance * root**2
    return np.einsum("vs,vsi,vsj->ij", weight, problem.slopes, problem.slopes, optimize=True)


def pull(
    error: Float[np.ndarray, "term term"],
    information: Float[np.ndarray, "term term"],
    value: Float[np.ndarray, " term"],
    left: float,
    noise: float,
) -> Float[np.ndarray, "term direction"]:
    """How far errors of the regressors may have moved the estimate, one column a direction.

    Were the errors independent of the true regressors, the true values would be
    (XᵀX − Σ_e)⁻¹ Xᵀy, Σ_e being the errors' covariance summed over the samples. In directions in
    which the errors make up more than `MOST_ERROR` of what was seen the correction is stopped
    there: the flight then says next to nothing about them.

    Errors are seldom independent: an aircraft turns into a gust that nobody sees, so that the
    error of its angle of attack goes against the angle itself and the slope may seem to be none.
    What the fit leaves (`left`, the length of the residual) then holds it. Errors of the share s of
    a direction that moved the estimate by Δ leave √((1−s)/s) Δ, so that √(s/(1−s)) of what is left
    beyond the noise of the measurement (`noise`, its length) counts; and where s is near one, and
    itself known roughly, s²/(1−s) of all that is left.

    And whoever flies answers the gusts with the controls, so that errors go with what has none:
    `ANSWERED` times √(s/(1−s)) of what is left, s of the direction with most errors, counts along
    every one. See decision 0021 for what either does to intervals.
    """
    norm = np.sqrt(np.diagonal(information))
    # What never moved has no errors, and what is not known of it is counted elsewhere.
    scale = np.divide(1.0, norm, out=np.zeros_like(norm), where=norm > 0.0)
    balanced = information * np.outer(scale, scale)
    roots, vectors = np.linalg.eigh(balanced)
    half = vectors / np.sqrt(np.maximum(roots, 1e-10 * roots.max()))
    share, turn = np.linalg.eigh(half.T @ (error * np.outer(scale, scale)) @ half)
    basis = half @ turn
    share = np.clip(share, 0.0, MOST_ERROR)
    ratio = share / (1.0 - share)
    seen = ratio * np.abs(basis.T @ (balanced @ (value * norm)))
    beyond = np.sqrt(max(left**2 - noise**2, 0.0))
    hidden = np.maximum(np.sqrt(ratio) * beyond, share * ratio * left)
    answered = ANSWERED * np.sqrt(ratio.max()) * left
    along = np.concatenate([basis * np.maximum(seen, hidden), answered * half], axis=1)
    return scale[:, None] * along


def bounded(
    covariance: Float[np.ndarray, "term term"], size: Float[np.ndarray, " term"]
) -> Float[np.ndarray, "term term"]:
    """A covariance combined with the knowledge that each term is of `size` at most (one sd)."""
    root = 1.0 / size
    inner = np.eye(size.size) + root[:, None] * covariance * root
    gain = covariance * root
    return covariance - gain @ np.linalg.solve(inner, gain.T)


def with_prior(
    value: Float[np.ndarray, " term"],
    covariance: Float[np.ndarray, "term term"],
    prior: Prior | None,
    keys: tuple[str, ...],
) -> tuple[
    Float[np.ndarray, " term"], Float[np.ndarray, "term term"], Float[np.ndarray, "term term"]
]:
    """Flight and prior weighed by their covariances; terms the prior does not hold stay free.

    Returns the mean, its covariance, and what is kept of the flight's own estimate.
    """
    if prior is None:
        return value, covariance, np.eye(len(keys))
    held = [key in prior.value for key in keys]
    pick = np.eye(len(keys))[held]
    believed = np.array([prior.value[key] for key in keys if key in prior.value])
    variance = np.diag([prior.sigma[key] ** 2 for key in keys if key in prior.value])
    gain = np.linalg.solve(pick @ covariance @ pick.T + variance, pick @ covariance).T
    kept = np.eye(len(keys)) - gain @ pick
    mean = value + gain @ (believed - pick @ value)
    return mean, kept @ covariance @ kept.T + gain @ variance @ gain.T, kept


def _effective(
    count: int, white: Float[np.ndarray, "term term"], coloured: Float[np.ndarray, "term term"]
) -> float:
    """Independent samples that would give the coloured standard errors (median over terms)."""
    ratio = np.diagonal(white) / np.maximum(np.diagonal(coloured), 1e-300)
    return float(count * np.clip(np.median(ratio), 0.0, 1.0))
