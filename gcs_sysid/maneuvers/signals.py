"""Test inputs of unit amplitude, over time.

References:
    Multisine, phases optimised for a low peak: Morelli, *Multiple Input Design for Real-Time
    Parameter Estimation in the Frequency Domain*, IFAC 2003; first guess Schroeder 1970.
    3-2-1-1: Hamel & Jategaonkar, J. Aircraft 33 (1996) 9.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy import optimize

STEPS = (3.0, 2.0, 1.0, 1.0)
POINTS = 20
"""Points a period of the fastest line at which the peak is looked for."""
NORM = 8
"""The p-norm that stands for the peak while the phases are optimised: it has a gradient."""


def multisine(
    lines: Sequence[int], duration: float, time: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " sample"]:
    """Sum of equal harmonics of 1/duration, phases chosen for the lowest peak, peak one.

    It starts and ends at zero. Inputs with disjoint lines are orthogonal over the duration.

    Args:
        lines: harmonics, each positive.
        duration: of one period [s].
        time: [s]; zero outside of one period.
    """
    harmonic = np.array(lines, dtype=float)
    grid = np.arange(POINTS * int(harmonic.max())) / (POINTS * harmonic.max())
    phases = _optimised(harmonic, grid)
    shape = _sum(harmonic, phases, grid)
    # The first rising zero becomes the beginning: a jump would ask more of the servo than is meant.
    rising = np.flatnonzero((shape <= 0.0) & (np.roll(shape, -1) > 0.0))[0]
    start = optimize.brentq(
        lambda at: float(_sum(harmonic, phases, np.array([at]))[0]),
        grid[rising],
        grid[rising] + grid[1],
    )
    inside = (time >= 0.0) & (time <= duration)
    value = _sum(harmonic, phases, start + time / duration) / np.abs(shape).max()
    return np.where(inside, value, 0.0)


def relative_peak(shape: Float[np.ndarray, " sample"]) -> float:
    """Peak over that of a sine of the same power: 1 for a single sine."""
    return float((shape.max() - shape.min()) / (2.0 * np.sqrt(2.0) * np.sqrt(np.mean(shape**2))))


def _optimised(
    harmonic: Float[np.ndarray, " line"], grid: Float[np.ndarray, " point"]
) -> Float[np.ndarray, " line"]:
    count = harmonic.size
    first = -np.pi * np.arange(count) ** 2 / count

    def size(phases: np.ndarray) -> tuple[float, np.ndarray]:
        shape = _sum(harmonic, phases, grid)
        total = np.mean(np.abs(shape) ** NORM)
        slope = np.abs(shape) ** (NORM - 1) * np.sign(shape)
        angle = 2.0 * np.pi * harmonic[:, None] * grid + phases[:, None]
        gradient = NORM * np.mean(slope * np.cos(angle), axis=1)
        return float(total), gradient

    return optimize.minimize(size, first, jac=True, method="L-BFGS-B").x


def _sum(
    harmonic: Float[np.ndarray, " line"],
    phases: Float[np.ndarray, " line"],
    period: Float[np.ndarray, " point"],
) -> Float[np.ndarray, " point"]:
    return np.sin(2.0 * np.pi * harmonic[:, None] * period + phases[:, None]).sum(axis=0)


def doublet(duration: float, time: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " sample"]:
    """Up for half the duration, down for the other half."""
    return steps((1.0, 1.0), duration, time)


def multistep(duration: float, time: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " sample"]:
    """3-2-1-1: up, down, up, down, for that share of the duration each."""
    return steps(STEPS, duration, time)


def steps(
    shares: Sequence[float], duration: float, time: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " sample"]:
    """Plateaus of alternating sign."""
    ends = duration * np.cumsum(shares) / np.sum(shares)
    which = np.searchsorted(ends, time, side="right")
    value = np.where(which % 2 == 0, 1.0, -1.0)
    return np.where((time >= 0.0) & (time < duration), value, 0.0)


def interleaved(first: int, last: int, count: int) -> tuple[tuple[int, ...], ...]:
    """The lines from `first` to `last` dealt out to so many inputs."""
    return tuple(tuple(range(first + index, last + 1, count)) for index in range(count))
