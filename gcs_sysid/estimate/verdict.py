"""Whether a flight determined a derivative, and if not, why, in words."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gcs_sysid import regressors
from gcs_sysid.estimate.result import CoefficientFit

Answer = Literal["yes", "weak", "no"]

KNOWN = 0.15
"""Relative standard deviation up to which a derivative counts as known."""
WEAK = 0.5
COLLINEAR = 0.9
FEEBLE = 0.05
"""A term that makes up less than this share of its coefficient's variation is hardly excited."""

BLURRED = "gusts: the flow and the rotation that the air felt were not measured well enough"
LAGGING = "the lag of the moments behind the surfaces is not known well enough"
MANY = 1.0 / 3.0
"""Share of all slopes."""


@dataclass(frozen=True)
class Verdict:
    """The answer and its reason; the reason of a `yes` is empty."""

    answer: Answer
    reason: str


def judge(fit: CoefficientFit, index: int, believed: float | None) -> Verdict:
    """Whether the flight alone determined one term.

    The standard deviation of the flight (prior left out) is held against the size of the value, or
    of what is believed where that is larger.
    """
    parts = {name: float(deviation[index]) for name, deviation in fit.deviations.items()}
    spread = float(np.hypot.reduce(list(parts.values())))
    size = max(abs(float(fit.value[index])), abs(believed or 0.0))
    if spread <= KNOWN * size:
        return Verdict("yes", "")
    answer: Answer = "weak" if spread <= WEAK * size else "no"
    return Verdict(answer, _reason(fit, index, parts))


def blurred(fits: Iterable[CoefficientFit]) -> bool:
    """Whether many slopes are not known since the flow was not measured well."""
    unknown = [
        judge(fit, index, None).reason == BLURRED
        for fit in fits
        for index, key in enumerate(fit.keys)
        if key != regressors.CONSTANT
    ]
    return sum(unknown) > MANY * len(unknown)


def _reason(fit: CoefficientFit, index: int, parts: dict[str, float]) -> str:
    key = fit.keys[index]
    largest = max(parts, key=lambda name: parts[name])
    if largest == "regressor":
        return BLURRED
    if largest == "lag":
        return LAGGING
    if largest == "scale":
        return "mass, inertia or thrust are not known well enough"
    partner = collinear_with(fit, index)
    if partner is not None:
        other, correlation = partner
        return f"{key} moved together with {other} (correlation {correlation:+.2f})"
    if key == regressors.CONSTANT:
        still = (fit.highest - fit.lowest <= 1e-9 * np.abs(fit.lowest)) & (fit.lowest != 0.0)
        still[index] = False
        if still.any():
            held = " and ".join(np.array(fit.keys)[still])
            return f"{held} did not move and cannot be told from the constant"
        return "too short a time for a constant in residuals this slow"
    if fit.excitation[index] < FEEBLE:
        return f"{key} hardly moved: {100.0 * fit.excitation[index]:.0f} % of the variation"
    return "too short or too noisy"


def collinear_with(fit: CoefficientFit, index: int) -> tuple[str, float] | None:
    """The regressor that moved most together with this one, if more than `COLLINEAR`."""
    row = np.array(fit.correlation[index])
    row[index] = 0.0
    worst = int(np.argmax(np.abs(row)))
    if abs(row[worst]) < COLLINEAR:
        return None
    return fit.keys[worst], float(row[worst])
