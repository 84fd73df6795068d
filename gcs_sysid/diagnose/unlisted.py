"""What nothing in the catalogue explains: which coefficient is off, and with what it goes."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid.diagnose.evidence import Posterior

VARIABLES = ("alpha", "beta", "phat", "qhat", "rhat", "Tc")
PRIOR = 0.05
"""Probability that something unlisted is at work, shared by all terms looked for."""


@dataclass(frozen=True)
class Term:
    """A term that may be missing: of which coefficient, in which variables."""

    coefficient: str
    variables: tuple[str, ...]


@dataclass(frozen=True)
class Missing:
    """A term that the residuals ask for, and the evidence for it [nat]."""

    coefficient: str
    variables: tuple[str, ...]
    log_bayes_factor: float


def terms(controls: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Variables, and products of two, that a missing term may be made of."""
    single = (*VARIABLES, *controls)
    return tuple((name,) for name in single) + tuple(
        itertools.combinations_with_replacement(single, 2)
    )


def values(
    flow: Mapping[str, Float[np.ndarray, " sample"]], product: tuple[str, ...]
) -> Float[np.ndarray, " sample"]:
    """One product at every sample, its mean taken off: an offset is no dependence."""
    found = np.prod([flow[name] for name in product], axis=0)
    return found - found.mean()


def strongest(
    found: Posterior,
    columns: Float[np.ndarray, "row unknown"],
    left: Float[np.ndarray, " row"],
    missing: Float[np.ndarray, "row term"],
    sigma: Float[np.ndarray, " term"],
    names: Sequence[Term],
) -> Missing:
    """The one more term that the whitened rows ask for most.

    With what remains of a column x when everything already free has had its share, v = xᵀx −
    (Xᵀx)ᵀ Σ Xᵀx and s = xᵀ(y − Xθ), one more unknown of prior σ adds ½ σ²s²/(1 + σ²v) −
    ½ log(1 + σ²v) to the log evidence.

    Args:
        found: posterior of the hypothesis that the term is added to.
        columns: its signatures, whitened.
        left: residuals, whitened.
        missing: the terms' columns, whitened.
        sigma: prior standard deviation of each.
        names: of the terms.
    """
    rest = left - columns @ found.mean
    cross = columns.T @ missing
    share = np.sum(missing**2, axis=0) - np.sum(cross * (found.covariance @ cross), axis=0)
    share = np.maximum(share, 0.0) * sigma**2
    pull = sigma**2 * (missing.T @ rest) ** 2
    gain = 0.5 * pull / (1.0 + share) - 0.5 * np.log1p(share)
    best = int(np.argmax(gain))
    term = names[best]
    return Missing(term.coefficient, term.variables, float(gain[best] + np.log(PRIOR / len(names))))
