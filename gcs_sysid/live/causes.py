"""Likely causes of a departure, from what the first model and the aircraft file differ by.

A cause moves the derivatives along one direction d, see `estimate.suspects`. With δ the difference
of the derivatives, Σ its covariance (of the flight's estimate and of the file's values) and τ the
size that such a cause has, the evidence for it against none is that of one regression coefficient
(Kass & Raftery 1995, section 3),

    log B = m² / 2(k + τ⁻²) − log(1 + k τ²) / 2,   m = dᵀ Σ⁻¹ δ,   k = dᵀ Σ⁻¹ d.

A first look while flying: noise of the flow, lags and delays are not in it. `diagnose` decides.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid import regressors
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate.suspects import Suspect, suspects
from gcs_sysid.live.regression import Solution

TOLD = 3.0
"""Log Bayes factor from which a cause is told: twenty to one."""
MOST = 3
LEAST = 0.02
"""And from which probability, among all that were looked for."""
MATTERS = 0.2
"""And from which share of its usual size: a small one may be sure, and is no cause."""
FARTHEST = 3.0
"""And up to how many times its usual size: what needs more is something else in its disguise, such
as slopes that noise of the flow pulls toward zero."""
LEFT = 2.0
"""And where no more than this many times the expected square of the differences is left: what a
cause does not explain is not its doing."""


@dataclass(frozen=True)
class Likely:
    """A suspect with what the flight says of it.

    Attributes:
        suspect: which.
        probability: among all suspects and none.
        log_bayes_factor: against none.
        size: of it.
        deviation: one standard deviation of the size.
    """

    suspect: Suspect
    probability: float
    log_bayes_factor: float
    size: float
    deviation: float


def likely(aircraft: Aircraft, found: Mapping[str, Solution]) -> list[Likely]:
    """Causes that explain the difference between flight and file, the likeliest first.

    Args:
        aircraft: its file, with aerodynamics.
        found: derivatives of the flight alone, without the file as prior.
    """
    parts = _differences(aircraft, found)
    if not parts:
        return []
    judged = [_judged(suspect, parts) for suspect in suspects(aircraft)]
    judged = [one for one in judged if one is not None]
    evidence = np.array([0.0, *(one[1] for one in judged)])
    share = np.exp(evidence - evidence.max())
    share /= share.sum()
    told = [
        Likely(suspect, float(share[index + 1]), log_bayes, size, deviation)
        for index, (suspect, log_bayes, size, deviation) in enumerate(judged)
        if log_bayes > TOLD
        and share[index + 1] >= LEAST
        and MATTERS * suspect.sigma < abs(size) <= FARTHEST * suspect.sigma
        and explained(parts, suspect, size)
    ]
    return sorted(told, key=lambda one: -one.log_bayes_factor)[:MOST]


def explained(parts: Mapping[str, _Part], suspect: Suspect, size: float) -> bool:
    """Whether the coefficients that a cause moves are as the file has them, but for that cause."""
    square, count = 0.0, 0
    for name, part in parts.items():
        moved = np.array([suspect.moves.get((name, key), 0.0) for key in part.keys])
        if not moved.any():
            continue
        left = part.apart - size * moved
        square += float(left @ part.information @ left)
        count += len(part.keys)
    return square <= LEFT * count


@dataclass(frozen=True)
class _Part:
    """Difference of one coefficient's derivatives and its information."""

    keys: tuple[str, ...]
    apart: Float[np.ndarray, " term"]
    information: Float[np.ndarray, "term term"]


def _differences(aircraft: Aircraft, found: Mapping[str, Solution]) -> dict[str, _Part]:
    parts = {}
    for name, solution in found.items():
        model = aircraft.aerodynamics.get(name)
        if model is None or not model.terms or model.tables:
            continue
        terms = {
            regressors.parse(key, controls=aircraft.control_names).key: term
            for key, term in model.terms.items()
        }
        believed = np.array([terms[key].value if key in terms else 0.0 for key in solution.keys])
        sigma = np.array([terms[key].sigma if key in terms else 0.0 for key in solution.keys])
        covariance = solution.covariance + np.diag(sigma**2)
        information = np.linalg.pinv(covariance, hermitian=True)
        parts[name] = _Part(solution.keys, solution.value - believed, information)
    return parts


def _judged(
    suspect: Suspect, parts: Mapping[str, _Part]
) -> tuple[Suspect, float, float, float] | None:
    along = known = 0.0
    for name, part in parts.items():
        moved = np.array([suspect.moves.get((name, key), 0.0) for key in part.keys])
        along += float(moved @ part.information @ part.apart)
        known += float(moved @ part.information @ moved)
    if not known > 0.0:
        return None
    total = known + suspect.sigma**-2
    log_bayes = 0.5 * along**2 / total - 0.5 * np.log1p(known * suspect.sigma**2)
    return suspect, float(log_bayes), along / total, total**-0.5
