"""Evidence of linear-Gaussian hypotheses that share their data and differ in what is free.

    y = Σ_j x_j θ_j + e,   e ~ N(0, I),   θ_j ~ N(0, σ_j²)

A hypothesis is a set of σ_j: a quantity of σ 0 is known. With G = XᵀX, b = Xᵀy and D = diag(σ),
the marginal likelihood in closed form is (Rasmussen & Williams, *Gaussian Processes for Machine
Learning*, 2006, eq. 2.30, by the matrix inversion lemma)

    log p(y) = ½ bᵀ D Λ⁻¹ D b - ½ log|Λ| + what all hypotheses share,   Λ = 1 + D G D

so that only G and b are needed, whatever the number of samples. It is the Laplace approximation,
exact here. A prior mean m is taken off first: b − G m stands for b, and mᵀb − ½ mᵀG m is added.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

BENT = 3.0
"""Deviations by which a quantity is off from what was believed, beyond which that is disputed."""


@dataclass(frozen=True)
class Information:
    """What whitened data say of the unknowns.

    Attributes:
        gram: XᵀX.
        score: Xᵀy.
        count: number of rows.
        shared: log density with every unknown at 0 [nat], which all hypotheses share.
    """

    gram: Float[np.ndarray, "unknown unknown"]
    score: Float[np.ndarray, " unknown"]
    count: float
    shared: float = 0.0

    def plus(self, other: Information) -> Information:
        """Of independent data taken together."""
        return Information(
            self.gram + other.gram,
            self.score + other.score,
            self.count + other.count,
            self.shared + other.shared,
        )

    def weighed(self, share: float) -> Information:
        """Of which only a share is worth anything."""
        return Information(
            share * self.gram, share * self.score, share * self.count, share * self.shared
        )


@dataclass(frozen=True)
class Posterior:
    """Mean and covariance of the unknowns under one hypothesis, and its log evidence [nat].

    The evidence is relative to that of nothing free.
    """

    mean: Float[np.ndarray, " unknown"]
    covariance: Float[np.ndarray, "unknown unknown"]
    log_evidence: float


def information(
    columns: Float[np.ndarray, "row unknown"], left: Float[np.ndarray, " row"]
) -> Information:
    """Of whitened rows: what is left by the file, and its change with each unknown."""
    return Information(columns.T @ columns, columns.T @ left, float(left.shape[0]))


def posterior(
    data: Information,
    sigma: Float[np.ndarray, " unknown"],
    mean: Float[np.ndarray, " unknown"] | None = None,
) -> Posterior:
    """Posterior and evidence under one hypothesis.

    Args:
        data: what the rows say.
        sigma: prior standard deviation of each unknown, 0 where it is known.
        mean: prior mean of each unknown; None for 0.
    """
    centre = np.zeros(sigma.size) if mean is None else mean
    score = data.score - data.gram @ centre
    shifted = float(centre @ data.score - 0.5 * centre @ data.gram @ centre)
    free = np.flatnonzero(sigma)
    size = sigma[free]
    scaled = size[:, None] * data.gram[np.ix_(free, free)] * size
    factor = np.linalg.cholesky(np.eye(free.size) + scaled)
    inverse = np.linalg.inv(factor)
    whitened = inverse @ (size * score[free])
    spread = size[:, None] * inverse.T
    found, covariance = centre.copy(), np.zeros((sigma.size, sigma.size))
    found[free] += spread @ whitened
    covariance[np.ix_(free, free)] = spread @ spread.T
    determinant = float(np.sum(np.log(np.diagonal(factor))))
    return Posterior(found, covariance, 0.5 * float(whitened @ whitened) - determinant + shifted)


def disputed(
    found: Posterior,
    sigma: Float[np.ndarray, " unknown"],
    mean: Float[np.ndarray, " unknown"],
    ordinary: Bool[np.ndarray, " unknown"],
) -> Posterior:
    """A posterior that is less sure where the data had to bend what was believed.

    Prior m ± σ and posterior θ ± s of one quantity disagree by z = (θ − m)/√(σ² − s²) deviations.
    Beyond `BENT` neither prior nor data are as good as they say. What both say together is known
    less well by Birge's ratio (Physical Review 40, 1932), and so is all that hangs on it,

        P + (z² − 1) P_S P_SS⁻¹ P_Sᵀ,

    with S what is disputed, and the mean of its z².

    Args:
        found: the posterior.
        sigma: prior standard deviation of each unknown, 0 where it is known.
        mean: prior mean of each.
        ordinary: which are believed to be off by no more than is ordinary.
    """
    spread = np.diagonal(found.covariance)
    told = ordinary & (spread < sigma**2)
    room = np.sqrt(np.where(told, sigma**2 - spread, np.inf))
    off = (found.mean - mean) / room
    bent = np.flatnonzero(np.abs(off) > BENT)
    if bent.size == 0:
        return found
    size = np.sqrt(spread[bent])
    inner = found.covariance[np.ix_(bent, bent)] / np.outer(size, size)
    across = found.covariance[:, bent] / size
    more = np.mean(off[bent] ** 2) - 1.0
    wider = across @ np.linalg.pinv(inner, rcond=1e-9, hermitian=True) @ across.T
    return replace(found, covariance=found.covariance + more * wider)


def gained(
    found: Float[np.ndarray, "*base unknown"],
    covariance: Float[np.ndarray, "*same unknown unknown"],
    before: Float[np.ndarray, " chosen"],
    chosen: Int[np.ndarray, " chosen"],
    after: Float[np.ndarray, " chosen"],
    mean: Float[np.ndarray, " chosen"],
) -> Float[np.ndarray, "*base"]:
    """By how much the evidence grows if a few unknowns have another prior.

    It is the mean of the priors' ratio over the posterior (Dickey, Annals of Mathematical
    Statistics 42, 1971), a Gaussian integral over the few.

    Args:
        found: mean of a posterior, or of several, under the prior of mean 0 and deviations
            `before`.
        covariance: of each of them, or one of all.
        before: deviations of the chosen unknowns, none of them 0.
        chosen: places of the unknowns.
        after: their other deviations.
        mean: and their other means.
    """
    size = covariance[..., chosen[:, None], chosen]
    unit = np.sqrt(np.diagonal(size, axis1=-2, axis2=-1))
    square = unit[..., :, None] * unit[..., None, :]
    inverse = np.linalg.inv(size / square)
    known, there = inverse / square, found[..., chosen]
    told = known + np.diag(after**-2 - before**-2)
    pulled = np.einsum("...ij,...j->...i", known, there)
    held = np.sum(pulled * there, axis=-1) + mean**2 @ after**-2
    pulled = pulled + after**-2 * mean
    moved = np.linalg.solve(told, pulled[..., None])[..., 0]
    exponent = np.sum(pulled * moved, axis=-1) - held
    # In units of the posterior both determinants are of the order of one.
    logs = np.linalg.slogdet(told * square)[1] - np.linalg.slogdet(inverse)[1]
    return np.asarray(0.5 * (exponent - logs) - np.sum(np.log(after / before)))
