"""What tells two causes apart, and what a maneuver is worth for it.

Two causes move the coefficients along d and e (`estimate.suspects`, `estimate.traces`), while each
derivative of the file is off by its sigma s as well. Of what flights know of all terms, J, there is

    A = J − J (J + S⁻²)⁻¹ J,    S = diag(s),

left for something beside such errors, and of that the size of the first is worth

    λ = dᵀ A d − (dᵀ A e)² / (eᵀ A e)

where the size of the second is as unknown: of what d does, the part that neither e nor ordinary
errors of the file can do as well. 1/√λ is one standard deviation of that size. Worth is
½ log(λ′/λ).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.estimate.suspects import Direction
from gcs_sysid.maneuvers import information
from gcs_sysid.maneuvers.knowledge import Knowledge
from gcs_sysid.maneuvers.target import Target


@dataclass(frozen=True)
class Pair:
    """Two causes beside ordinary errors of the file.

    Attributes:
        first: direction of the one.
        second: direction of the other.
        ordinary: sigma of each derivative of the file, by coefficient and regressor.
    """

    first: Direction
    second: Direction
    ordinary: Direction


@dataclass(frozen=True)
class Separation(Target):
    """Asks which of two causes it is.

    Attributes:
        pair: of causes.
        unit: of the first one's size.
    """

    pair: Pair
    unit: str

    def variances(self, model: AeroModel, known: Knowledge) -> tuple[float, ...]:
        """Of the size of the first, see the module."""
        return (1.0 / max(apart(model, known, self.pair), 1e-300),)

    def stated(self, model: AeroModel, known: Knowledge) -> tuple[float, ...]:
        """The same: mass and inertia are among the causes."""
        return self.variances(model, known)

    def slope(
        self, model: AeroModel, known: Knowledge
    ) -> tuple[float, Float[np.ndarray, "unknown unknown"]]:
        """½ log λ, and how it grows with information: λ is the least of a quadratic form in it.

        At the size t of the second and the errors x of the file that make it least,
        r = d − t e − x and λ = rᵀ J r + xᵀ S⁻² x, so that dλ = rᵀ dJ r; what J itself leaves of
        what is told of all unknowns (`knowledge`) is the least over the others in the same way.
        """
        seen = _seen(model, known, self.pair)
        told = known.believed + known.added.information
        share = seen.shared / seen.other if seen.other > 0.0 else 0.0
        left = max(seen.own - share * seen.shared, 1e-300)
        found = np.zeros(told.shape)
        for name, rests in seen.rests.items():
            own = np.zeros(len(told), dtype=bool)
            own[known.places[name]] = True
            rest = rests[0] - share * rests[1]
            whole = np.zeros(len(told))
            whole[own] = rest
            whole[~own] = -np.linalg.solve(told[np.ix_(~own, ~own)], told[np.ix_(~own, own)] @ rest)
            found += np.outer(whole, whole) / (2.0 * left)
        return 0.5 * float(np.log(left)), found


def separation(model: AeroModel, words: str, pair: Pair, unit: str = "1") -> Separation:
    """The question which of two causes it is.

    Args:
        model: identified so far.
        words: the causes, for people.
        pair: likewise.
        unit: of the first one's size.
    """
    moved = {name for name, _ in (*pair.first, *pair.second)}
    questions: Mapping[str, tuple[Float[np.ndarray, "term term"], ...]] = {
        name: () for name in model.fits if name in moved
    }
    return Separation(questions, words, {}, pair, unit)


def apart(model: AeroModel, known: Knowledge, pair: Pair) -> float:
    """λ of the module: what is known of the first's size whatever the second's."""
    seen = _seen(model, known, pair)
    return seen.own - seen.shared**2 / seen.other if seen.other > 0.0 else seen.own


class _Seen(NamedTuple):
    """dᵀ A d, eᵀ A e, dᵀ A e, and of d and e what errors of the file cannot do, by coefficient."""

    own: float
    other: float
    shared: float
    rests: dict[str, tuple[np.ndarray, np.ndarray]]


def _seen(model: AeroModel, known: Knowledge, pair: Pair) -> _Seen:
    own = other = shared = 0.0
    rests = {}
    for name, fit in model.fits.items():
        one, two, sigma = (
            np.array([each.get((name, key), 0.0) for key in fit.keys])
            for each in (pair.first, pair.second, pair.ordinary)
        )
        if not (one.any() or two.any()):
            continue
        # By noise only: mass, inertia and what was believed before are among the causes.
        told = information.seen(fit) + known.of(name).information
        rests[name] = _rest(told, sigma, one), _rest(told, sigma, two)
        own += float(one @ told @ rests[name][0])
        other += float(two @ told @ rests[name][1])
        shared += float(one @ told @ rests[name][1])
    return _Seen(own, other, shared, rests)


def _rest(
    told: Float[np.ndarray, "term term"],
    sigma: Float[np.ndarray, " term"],
    direction: Float[np.ndarray, " term"],
) -> Float[np.ndarray, " term"]:
    """That of which J is left, A d = J (d − x): x is what the file's errors can do of d.

    What has no sigma is not off by itself.
    """
    free = sigma > 0.0
    inner = told[np.ix_(free, free)] + np.diag(sigma[free] ** -2.0)
    left = direction.copy()
    left[free] -= np.linalg.solve(inner, told[free] @ direction)
    return left
