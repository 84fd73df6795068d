"""Modes of a linear model by name, with intervals.

Which mode is which is told by participation (Pérez-Arriaga, Verghese & Schweppe, *IEEE Trans. Power
App. Syst.* 101, 1982, p. 3117): the share of each state in an eigenvalue, whatever its unit. A pair
of eigenvalues is described by its sum and product, which stay smooth where an oscillation becomes
two real roots:

    λ² + 2 ζ ω λ + ω² = (λ − λ₁)(λ − λ₂)

First-order standard deviations come from ∂λ = yᴴ ∂A x / yᴴ x.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from scipy import linalg

from gcs_sysid.model.linear import LATERAL, STATES, Linear

REAL = 1e-9
"""An imaginary part below this share of an eigenvalue is rounding."""


@dataclass(frozen=True)
class Uncertain:
    """A number and one standard deviation of it; NaN where it has no meaning."""

    value: float
    deviation: float


@dataclass(frozen=True)
class Mode:
    """One mode: a root or a pair.

    Attributes:
        name: `short period`, `phugoid`, `roll`, `dutch roll`, `spiral`; `roll and spiral` where
            the two have joined in an oscillation, `third oscillation` where a root each of short
            period and phugoid have.
        roots: eigenvalues [1/s].
        root_deviations: of their real and imaginary parts.
        frequency: undamped natural, of a pair [rad/s]; NaN for a pair of which one root diverges.
        damping: ratio of a pair; above 1 the roots are real.
        time_constants: −1/real part of each real root, or of an oscillation once; negative where
            it diverges, infinite where it stays [s].
    """

    name: str
    roots: tuple[complex, ...]
    root_deviations: tuple[tuple[float, float], ...]
    frequency: Uncertain
    damping: Uncertain
    time_constants: tuple[Uncertain, ...]

    @property
    def oscillates(self) -> bool:
        """Whether the roots are a complex pair."""
        return abs(self.roots[0].imag) > REAL * abs(self.roots[0])

    @property
    def stable(self) -> bool:
        """Whether every root decays."""
        return all(root.real < 0.0 for root in self.roots)


def modes(linear: Linear) -> tuple[Mode, ...]:
    """All modes of a linear model, those of pitch first, each motion's fastest first."""
    return named(linear.mean.A, linear.slopes.A, linear.covariance)


def named(
    dynamics: Float[np.ndarray, "state state"],
    slopes: Float[np.ndarray, "state state value"],
    covariance: Float[np.ndarray, "value value"],
) -> tuple[Mode, ...]:
    """Modes of a matrix over the states of `linear.STATES`.

    None where a motion is as much of pitch as of roll and yaw, so that the usual names say nothing.

    Args:
        dynamics: the matrix.
        slopes: its derivatives by uncertain values.
        covariance: of these values.
    """
    roots, left, right = linalg.eig(dynamics, left=True, right=True)
    scale = np.einsum("ik,ik->k", left.conj(), right)
    share = np.abs(left.conj() * right / scale)
    share /= share.sum(axis=0)
    moved = np.einsum("ik,ijv,jk->kv", left.conj(), slopes, right, optimize=True) / scale[:, None]
    found = [
        _Root(complex(root), row, part)
        for root, row, part in zip(roots, moved, share.T, strict=True)
    ]
    groups = _grouped(found)
    lateral = [name in LATERAL for name in STATES]
    groups.sort(
        key=lambda group: -sum(float(root.share[lateral].sum()) for root in group) / len(group)
    )
    sideways, count = [], 0
    while groups and count + len(groups[0]) <= len(LATERAL):
        sideways.append(groups.pop(0))
        count += len(sideways[-1])
    if count < len(LATERAL):
        return ()
    labelled = [*_longitudinal(groups), *_lateral(sideways)]
    return tuple(_mode(name, group, covariance) for name, group in labelled)


@dataclass(frozen=True)
class _Root:
    """An eigenvalue, its derivatives, and the share of each state in it."""

    value: complex
    slope: Complex[np.ndarray, " value"]
    share: Float[np.ndarray, " state"]

    @property
    def oscillates(self) -> bool:
        return abs(self.value.imag) > REAL * abs(self.value)

    def part(self, *names: str) -> float:
        """Share of some states."""
        return float(sum(self.share[list(STATES).index(name)] for name in names))


Group = tuple[_Root, ...]


def _grouped(roots: Sequence[_Root]) -> list[Group]:
    """Real roots alone, complex ones with their conjugates, fastest first."""
    groups: list[Group] = []
    for root in roots:
        if not root.oscillates:
            groups.append((root,))
        elif root.value.imag > 0.0:
            partner = min(roots, key=lambda other: abs(other.value - root.value.conjugate()))
            groups.append((root, partner))
    return sorted(groups, key=lambda group: -abs(group[0].value))


def _longitudinal(groups: Sequence[Group]) -> list[tuple[str, Group]]:
    """Short period and phugoid are the faster and slower half, real roots paired."""
    flat = [root for group in sorted(groups, key=lambda g: -abs(g[0].value)) for root in group]
    fast, slow = tuple(flat[:2]), tuple(flat[2:4])
    if fast[0].oscillates == fast[1].oscillates:
        return [("short period", fast), ("phugoid", slow)]
    # A root each of short period and phugoid have met, as with the centre of gravity far aft.
    return [
        ("short period root", (flat[0],)),
        ("third oscillation", (flat[1], flat[2])),
        ("phugoid root", (flat[3],)),
    ]


def _lateral(groups: Sequence[Group]) -> list[tuple[str, Group]]:
    """Dutch roll is the oscillation, or the pair of roots, that is least of a rolling."""
    order = sorted(groups, key=lambda group: -abs(group[0].value))
    pairs = [group for group in order if len(group) == 2]
    single = [group[0] for group in order if len(group) == 1]
    if len(pairs) == 2:
        yawing = max(pairs, key=lambda group: group[0].part("beta", "r"))
        other = pairs[0] if yawing is pairs[1] else pairs[1]
        return [("dutch roll", yawing), ("roll and spiral", other)]
    if pairs:
        fast, slow = single
        return [("roll", (fast,)), ("dutch roll", pairs[0]), ("spiral", (slow,))]
    rolling = max(single, key=lambda root: root.part("p"))
    spiral = min((one for one in single if one is not rolling), key=lambda one: abs(one.value))
    yawing = tuple(one for one in single if one is not rolling and one is not spiral)
    return [("roll", (rolling,)), ("dutch roll", yawing), ("spiral", (spiral,))]


def _mode(name: str, group: Group, covariance: Float[np.ndarray, "value value"]) -> Mode:
    def deviation(slope: Float[np.ndarray, " value"]) -> float:
        return float(np.sqrt(max(slope @ covariance @ slope, 0.0)))

    def time_constant(root: _Root) -> Uncertain:
        size = root.value.real
        if size == 0.0:
            return Uncertain(float("inf"), float("nan"))
        return Uncertain(-1.0 / size, deviation(root.slope.real) / size**2)

    nothing = Uncertain(float("nan"), float("nan"))
    frequency = damping = nothing
    if len(group) == 2:
        first, second = group
        product = (first.value * second.value).real
        if product > 0.0:
            omega = float(np.sqrt(product))
            turned = (first.slope * second.value + first.value * second.slope).real / (2.0 * omega)
            total = (first.value + second.value).real
            ratio = -total / (2.0 * omega)
            bent = -(first.slope + second.slope).real / (2.0 * omega) - ratio * turned / omega
            frequency = Uncertain(omega, deviation(turned))
            damping = Uncertain(ratio, deviation(bent))
    each = group[:1] if group[0].oscillates else group
    return Mode(
        name=name,
        roots=tuple(complex(root.value) for root in group),
        root_deviations=tuple(
            (deviation(root.slope.real), deviation(root.slope.imag)) for root in group
        ),
        frequency=frequency,
        damping=damping,
        time_constants=tuple(time_constant(root) for root in each),
    )
