"""What tells two causes apart, and what a maneuver is worth for it.

Two causes move the derivatives along d and e (`estimate.suspects`). Of what flights know of the
derivatives, I, that of the size of the first is worth

    λ = dᵀ I d − (dᵀ I e)² / (eᵀ I e)

where the size of the second is as unknown: of what d does, the part that e cannot do as well. 1/√λ
is one standard deviation of that size. Worth is ½ log(λ′/λ).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.estimate.suspects import Direction
from gcs_sysid.maneuvers import information
from gcs_sysid.maneuvers.information import Knowledge
from gcs_sysid.maneuvers.target import Target


@dataclass(frozen=True)
class Separation(Target):
    """Asks which of two causes it is.

    Attributes:
        first: direction of the one.
        second: direction of the other.
    """

    first: Direction
    second: Direction

    def variances(self, model: AeroModel, known: Knowledge) -> tuple[float, ...]:
        """Of the size of the first, see the module."""
        return (1.0 / max(apart(model, known, self.first, self.second), 1e-300),)


def separation(
    model: AeroModel, names: tuple[str, str], first: Direction, second: Direction
) -> Separation:
    """The question which of two causes it is.

    Args:
        model: identified so far.
        names: of the causes, for people.
        first: direction of the one.
        second: direction of the other.
    """
    moved = {name for name, _ in (*first, *second)}
    questions: Mapping[str, tuple[Float[np.ndarray, "term term"], ...]] = {
        name: () for name in model.fits if name in moved
    }
    return Separation(questions, f"{names[0]} or {names[1]}", {}, first, second)


def apart(model: AeroModel, known: Knowledge, first: Direction, second: Direction) -> float:
    """λ of the module: what is known of the first's size whatever the second's."""
    own = other = shared = 0.0
    for name, fit in model.fits.items():
        one, two = (
            np.array([each.get((name, key), 0.0) for key in fit.keys]) for each in (first, second)
        )
        if not (one.any() or two.any()):
            continue
        # By noise only: mass, inertia and what was believed before are among the causes.
        total = information.seen(fit) + known[name].information
        own += float(one @ total @ one)
        other += float(two @ total @ two)
        shared += float(one @ total @ two)
    return own - shared**2 / other if other > 0.0 else own
