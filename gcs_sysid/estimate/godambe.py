"""What scores say of parameters, where they are not the slope of the likelihood.

An error e of all unknowns moves scores g by −A e, and they scatter by B. As though they were
normal,

    log L(e) = −½ (g − A e)ᵀ B⁻¹ (g − A e) + …,

information is Aᵀ B⁻¹ A (Godambe, Annals of Mathematical Statistics 31, 1960) and the slope
Aᵀ B⁻¹ g. Where A = B, as for the likelihood's own slope, these are B and g.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid.reconstruct.causal import Told

SEEN = 1e-10
"""Scores that scatter less than this share of the liveliest combination tell nothing: causes that
are one and the same leave sums that differ by rounding."""

BLURRED = 0.01
"""Share of the beliefs' precision that scores count as scattering more than they do. How errors
move them is carried from a stretch, and wrong by a little; where a flight tells next to nothing,
scores that hardly scatter would make much of that little."""


def quadratic(
    slope: Float[np.ndarray, "unknown unknown"],
    scatter: Float[np.ndarray, "unknown unknown"],
    score: Float[np.ndarray, " unknown"],
    precision: Float[np.ndarray, "unknown unknown"],
) -> tuple[Float[np.ndarray, "unknown unknown"], Float[np.ndarray, " unknown"]]:
    """Information and slope of the quadratic form that scores stand for.

    Args:
        slope: A, by how much an error of each unknown, in columns, moves the scores.
        scatter: B, their covariance; 0 where nothing was measured.
        score: g.
        precision: of what is ordinarily believed of the unknowns.
    """
    blurred = scatter + BLURRED * precision
    size, unit = _units(blurred)
    values, vectors = np.linalg.eigh(blurred / unit)
    seen = values > SEEN * max(values[-1], 1.0)
    white = (vectors[:, seen] / np.sqrt(values[seen])).T / size
    moved = white @ slope
    return moved.T @ moved, moved.T @ (white @ score)


def integrated(
    matrix: Float[np.ndarray, "unknown unknown"],
    score: Float[np.ndarray, " unknown"],
    precision: Float[np.ndarray, " nuisance"],
    pull: Float[np.ndarray, " nuisance"],
) -> tuple[Float[np.ndarray, "parameter parameter"], Float[np.ndarray, " parameter"]]:
    """Information and slope of parameters, the nuisances behind them integrated out.

    Args:
        matrix: of parameters and nuisances.
        score: likewise.
        precision: of what was believed of the nuisances.
        pull: slope of that belief.
    """
    count = score.size - precision.size
    inner = matrix[count:, count:] + np.diag(precision)
    across = np.linalg.solve(inner, matrix[count:, :count]).T
    return (
        matrix[:count, :count] - across @ matrix[count:, :count],
        score[:count] - across @ (score[count:] + pull),
    )


def placed(
    matrix: Float[np.ndarray, "free free"],
    score: Float[np.ndarray, " free"],
    free: Bool[np.ndarray, " parameter"],
    count: float,
) -> Told:
    """Of all parameters, 0 where a flight tells nothing."""
    out, slope = np.zeros((free.size, free.size)), np.zeros(free.size)
    out[np.ix_(free, free)], slope[free] = matrix, score
    return Told(out, slope, count)


def widened(own: Told, held: Told) -> Told:
    """With parameters behind them of which only sensitivities J' at held gains are known.

    What such a parameter shares with the others, gains take from it as they do from these; what it
    does not share stays. With J' = J X + R, R orthogonal to J, its information is XᵀMX + RᵀR.

    Args:
        own: M, what a flight says of the parameters.
        held: what it says of them and of the further ones at held gains.
    """
    count = own.score.size
    _, unit = _units(held.matrix[:count, :count])
    inner = np.linalg.pinv(held.matrix[:count, :count] / unit, rcond=SEEN, hermitian=True) / unit
    views = inner @ held.matrix[:count, count:]
    both = own.matrix @ views
    rest = held.matrix[count:, count:] - held.matrix[count:, :count] @ views
    matrix = np.block([[own.matrix, both], [both.T, views.T @ both + rest]])
    further = held.score[count:] + views.T @ (own.score - held.score[:count])
    return Told(matrix, np.concatenate([own.score, further]), held.count)


def _units(matrix: Float[np.ndarray, "row row"]) -> tuple[np.ndarray, np.ndarray]:
    """Roots of the diagonal, 1 where it is 0, and their products."""
    size = np.sqrt(np.diagonal(matrix))
    size = np.where(size > 0.0, size, 1.0)
    return size, np.outer(size, size)
