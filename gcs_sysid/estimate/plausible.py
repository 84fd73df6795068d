"""How large an aerodynamic derivative can be on anything that flies.

Not a belief about one aircraft but an order of magnitude for all: about three times the largest
values in published sets of small and full-size aircraft (Roskam, *Airplane Flight Dynamics*, 1995,
appendix B; the Ultra Stick, Aerosonde, Zagi and X8 models). It bounds only what errors of the
regressors may hide; without it a direction that gusts fill would be unknown without limit and would
make every derivative that moves with it look unknown too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from gcs_sysid import regressors

CONTROL = {"CX": 0.5, "CY": 1.0, "CZ": 3.0, "Cl": 0.8, "Cm": 5.0, "Cn": 0.5}
SIZE: dict[str, dict[str, float]] = {
    "alpha": {"CX": 5.0, "CY": 2.0, "CZ": 20.0, "Cl": 0.5, "Cm": 10.0, "Cn": 0.5},
    "beta": {"CX": 1.0, "CY": 3.0, "CZ": 2.0, "Cl": 0.5, "Cm": 2.0, "Cn": 1.0},
    "phat": {"CX": 1.0, "CY": 1.5, "CZ": 3.0, "Cl": 2.0, "Cm": 5.0, "Cn": 0.7},
    "qhat": {"CX": 10.0, "CY": 3.0, "CZ": 50.0, "Cl": 5.0, "Cm": 150.0, "Cn": 2.0},
    "rhat": {"CX": 1.0, "CY": 2.0, "CZ": 3.0, "Cl": 1.0, "Cm": 5.0, "Cn": 1.5},
    "alphadot_hat": {"CX": 5.0, "CY": 1.0, "CZ": 20.0, "Cl": 1.0, "Cm": 60.0, "Cn": 1.0},
}
"""Largest size by variable and coefficient, per rad or per unit of a dimensionless rate."""
PER_RADIAN = 10.0
"""Each further factor of an angle raises the bound by this: angles of flight are tenths of one."""


def sizes(
    coefficient: str, keys: Sequence[str], controls: Sequence[str]
) -> Float[np.ndarray, " term"]:
    """Bound of each term; infinite for the constant and for variables without a common size."""
    return np.array([_size(coefficient, key, controls) for key in keys])


def _size(coefficient: str, key: str, controls: Sequence[str]) -> float:
    factors = regressors.parse(key, controls=controls).factors
    if not factors:
        return math.inf
    bounds = [
        CONTROL[coefficient]
        if factor.variable in controls
        else SIZE.get(factor.variable, {}).get(coefficient, math.inf)
        for factor in factors
    ]
    degree = sum(factor.exponent for factor in factors)
    return max(bounds) * PER_RADIAN ** (degree - 1)
