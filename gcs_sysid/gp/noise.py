"""How much a sample is worth: its noise, what uncertain inputs add to it, how long errors last."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

LONGEST = 3.0
"""Errors further apart than this [s] are taken as independent."""


def with_inputs(
    variance: Float[np.ndarray, "sample output"],
    slopes: Float[np.ndarray, "sample output input"],
    input_variance: Float[np.ndarray, "sample input"],
) -> Float[np.ndarray, "sample output"]:
    """Variance of a value whose inputs are uncertain too: σ² + Σ (∂f/∂x_k)² var(x_k).

    References:
        A. McHutchon, C. E. Rasmussen, "Gaussian process training with input noise", NIPS 24, 2011.
    """
    return variance + np.einsum("sok,sk->so", slopes**2, input_variance)


def repeats(
    residual: Float[np.ndarray, " sample"], piece: Int[np.ndarray, " sample"], step: float
) -> float:
    """Samples that say the same: 1 + 2 Σ ρ_k over the lags before the correlation is lost.

    Args:
        residual: of a model, in the order of time.
        piece: stretch of flight of each sample.
        step: sample interval [s].
    """
    centred = residual - residual.mean()
    power = float(np.mean(centred**2))
    if power == 0.0:
        return 1.0
    total = 1.0
    for lag in range(1, max(int(LONGEST / step), 1) + 1):
        same = piece[lag:] == piece[:-lag]
        if not same.any():
            break
        correlation = float(np.mean((centred[lag:] * centred[:-lag])[same])) / power
        if correlation <= 0.0:
            break
        total += 2.0 * correlation
    return total
