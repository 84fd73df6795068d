"""What maneuvers since a fit have told of all its coefficients together.

A filter that has no vanes knows a side force by the sideslip only as well as it knows the sideslip,
and so what it learns of yaw. Errors of the sensors last for a flight: what they leave unknown, a
second maneuver does not take away. Both are asked about together, and left out at the end:

    I_c = J_cc − J_co (J_oo + Σ_o⁻¹)⁻¹ J_oc

is what is told of the terms of one coefficient, c, whatever all others and the errors, o, are; Σ_o
is what is known of these before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Added:
    """Rows added to a fit: to that of one coefficient, or to all of them together.

    Attributes:
        information: of the terms; of all coefficients together, behind them that of the errors.
        samples: rows of a fit that these are, at its rate.
    """

    information: Float[np.ndarray, "term term"]
    samples: float

    def with_more(self, other: Added, *, share: float = 1.0) -> Added:
        """These and those of a maneuver flown at a share of its amplitude."""
        return Added(self.information + share**2 * other.information, self.samples + other.samples)

    def smaller(self, share: float) -> Added:
        """Those of the same maneuver at a share of its amplitude: as the square of it."""
        return Added(share**2 * self.information, self.samples)


@dataclass(frozen=True)
class Knowledge:
    """What was added to all fits of a model since they were made.

    Attributes:
        places: of each coefficient's terms among all.
        believed: Σ⁻¹ of the module, the fits' own and that of the errors.
        added: since.
    """

    places: Mapping[str, slice]
    believed: Float[np.ndarray, "unknown unknown"]
    added: Added

    def with_more(self, more: Added, *, share: float = 1.0) -> Knowledge:
        """What is known once a maneuver was flown at a share of its amplitude."""
        return replace(self, added=self.added.with_more(more, share=share))

    def covariance(self) -> Float[np.ndarray, "unknown unknown"]:
        """Of all terms and errors together, by noise and what was known of the errors."""
        told = self.believed + self.added.information
        size = np.diagonal(told) ** -0.5
        return np.linalg.inv(told * np.outer(size, size)) * np.outer(size, size)

    def of(self, name: str) -> Added:
        """What was added to one coefficient's fit."""
        own = np.zeros(len(self.believed), dtype=bool)
        own[self.places[name]] = True
        told = self.added.information
        across = told[np.ix_(own, ~own)]
        inner = told[np.ix_(~own, ~own)] + self.believed[np.ix_(~own, ~own)]
        left = told[np.ix_(own, own)] - across @ np.linalg.solve(inner, across.T)
        return Added(0.5 * (left + left.T), self.added.samples)
