"""Evidence of linear-Gaussian hypotheses that share their data and differ in what is free.

    y = Σ_j x_j θ_j + e,   e ~ N(0, I),   θ_j ~ N(0, σ_j²)

A hypothesis is a set of σ_j: a quantity of σ 0 is known. With G = XᵀX, b = Xᵀy and D = diag(σ),
the marginal likelihood in closed form is (Rasmussen & Williams, *Gaussian Processes for Machine
Learning*, 2006, eq. 2.30, by the matrix inversion lemma)

    log p(y) = -½ (yᵀy - bᵀ D Λ⁻¹ D b) - ½ log|Λ| - ½ n log 2π,   Λ = 1 + D G D

so that only G and b are needed, whatever the number of samples. It is the Laplace approximation,
exact here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Information:
    """What whitened data say of the unknowns.

    Attributes:
        gram: XᵀX.
        score: Xᵀy.
        energy: yᵀy.
        count: number of rows.
    """

    gram: Float[np.ndarray, "unknown unknown"]
    score: Float[np.ndarray, " unknown"]
    energy: float
    count: float

    def plus(self, other: Information) -> Information:
        """Of independent data taken together."""
        return Information(
            self.gram + other.gram,
            self.score + other.score,
            self.energy + other.energy,
            self.count + other.count,
        )


@dataclass(frozen=True)
class Posterior:
    """Mean and covariance of the unknowns under one hypothesis, and its log evidence [nat]."""

    mean: Float[np.ndarray, " unknown"]
    covariance: Float[np.ndarray, "unknown unknown"]
    log_evidence: float


def information(
    columns: Float[np.ndarray, "row unknown"], left: Float[np.ndarray, " row"]
) -> Information:
    """Of whitened rows: what is left by the file, and its change with each unknown."""
    return Information(
        columns.T @ columns, columns.T @ left, float(left @ left), float(left.shape[0])
    )


def posterior(data: Information, sigma: Float[np.ndarray, " unknown"]) -> Posterior:
    """Posterior and evidence under one hypothesis.

    Args:
        data: what the rows say.
        sigma: prior standard deviation of each unknown, 0 where it is known.
    """
    scaled = sigma[:, None] * data.gram * sigma
    factor = np.linalg.cholesky(np.eye(sigma.size) + scaled)
    inverse = np.linalg.inv(factor)
    whitened = inverse @ (sigma * data.score)
    spread = sigma[:, None] * inverse.T
    explained = float(whitened @ whitened)
    determinant = 2.0 * float(np.sum(np.log(np.diagonal(factor))))
    constant = data.count * np.log(2.0 * np.pi)
    return Posterior(
        mean=spread @ whitened,
        covariance=spread @ spread.T,
        log_evidence=float(-0.5 * (data.energy - explained + determinant + constant)),
    )
