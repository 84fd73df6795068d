"""Many sines at once, their phases chosen so that the sum stays small.

References:
    Morelli, *Multiple Input Design for Real-Time Parameter Estimation in the Frequency Domain*,
    IFAC 2003; first guess of the phases: Schroeder, IEEE Trans. Information Theory 16 (1970) 85.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from jaxtyping import Complex, Float
from scipy import optimize

POINTS = 20
"""Points a period of the fastest line at which the peak is looked for."""
STARTS = 12
"""Random phases that are tried too where Schroeder's lead into a valley that is not deep enough."""
ENOUGH = 1.08
"""Relative peak factor at which the search ends."""
NORMS = (8, 24, 64)
"""The p-norms that stand for the peak while the phases are optimised, one after the other: unlike
the peak they have a gradient."""


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
    phases, start, peak = _designed(tuple(lines))
    harmonic = np.array(lines, dtype=float)
    inside = (time >= 0.0) & (time <= duration)
    return np.where(inside, _sum(harmonic, phases, start + time / duration) / peak, 0.0)


def relative_peak(shape: Float[np.ndarray, " sample"]) -> float:
    """Peak over that of a sine of the same power: 1 for a single sine."""
    return float((shape.max() - shape.min()) / (2.0 * np.sqrt(2.0) * np.sqrt(np.mean(shape**2))))


def interleaved(first: int, last: int, count: int) -> tuple[tuple[int, ...], ...]:
    """The lines from `first` to `last` dealt out to so many inputs."""
    return tuple(tuple(range(first + index, last + 1, count)) for index in range(count))


def phased(
    harmonic: Float[np.ndarray, " line"], answers: Complex[np.ndarray, "output line"]
) -> tuple[Float[np.ndarray, " line"], float]:
    """Phases of lines at which the largest of several outputs stays lowest, and that peak.

    Line k with phase φ adds Im(r e^{i(2π k t + φ)}) to an output that answers it with r.

    Args:
        harmonic: of one period, each positive.
        answers: of every output to each line, its amplitude in it.
    """
    grid = _grid(harmonic)
    phases = _optimised(harmonic, answers, grid)
    angle = 2.0 * np.pi * harmonic[:, None] * grid
    turned = answers * np.exp(1j * phases)
    shapes = turned.real @ np.sin(angle) + turned.imag @ np.cos(angle)
    return phases, float(np.abs(shapes).max())


def _grid(harmonic: Float[np.ndarray, " line"]) -> Float[np.ndarray, " point"]:
    """Instants of one period."""
    return np.arange(POINTS * int(harmonic.max())) / (POINTS * harmonic.max())


@lru_cache(maxsize=256)
def _designed(lines: tuple[int, ...]) -> tuple[np.ndarray, float, float]:
    """Phases, the share of the period at which the sum rises through zero, and its peak."""
    harmonic = np.array(lines, dtype=float)
    grid = _grid(harmonic)
    phases = _optimised(harmonic, np.ones((1, harmonic.size), dtype=complex), grid)
    shape = _sum(harmonic, phases, grid)
    # The first rising zero becomes the beginning: a jump would ask more of the servo than is meant.
    rising = np.flatnonzero((shape <= 0.0) & (np.roll(shape, -1) > 0.0))[0]
    start = optimize.brentq(
        lambda at: float(_sum(harmonic, phases, np.array([at]))[0]),
        grid[rising],
        grid[rising] + grid[1],
    )
    return phases, float(start), float(np.abs(shape).max())


def _optimised(
    harmonic: Float[np.ndarray, " line"],
    answers: Complex[np.ndarray, "output line"],
    grid: Float[np.ndarray, " point"],
) -> Float[np.ndarray, " line"]:
    count = harmonic.size
    generator = np.random.default_rng(count)
    starts = [-np.pi * np.arange(count) ** 2 / count]
    starts += list(generator.uniform(-np.pi, np.pi, (STARTS, count)))
    angle = 2.0 * np.pi * harmonic[:, None] * grid
    # sin(a + φ) = cos φ sin a + sin φ cos a: products with what stays cost less than the sines.
    across, along = np.sin(angle), np.cos(angle)

    def shapes(phases: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        turned = answers * np.exp(1j * phases)
        return turned, turned.real @ across + turned.imag @ along

    def size(phases: np.ndarray, norm: int) -> tuple[float, np.ndarray]:
        turned, shape = shapes(phases)
        peak = np.abs(shape).max()
        powers = np.abs(shape / peak) ** (norm - 1)
        mean = np.mean(powers * np.abs(shape / peak))
        # The norm itself, not its power: of the order of the peak whatever the exponent.
        value = peak * mean ** (1.0 / norm)
        slope = mean ** (1.0 / norm - 1.0) * powers * np.sign(shape)
        each = turned.real * (slope @ along.T) - turned.imag * (slope @ across.T)
        return float(value), each.sum(axis=0) / shape.size

    sine = float(np.sqrt(np.sum(np.abs(answers) ** 2, axis=1).max()))
    best, lowest = starts[0], np.inf
    for start in starts:
        phases = start
        for norm in NORMS:
            phases = optimize.minimize(size, phases, (norm,), jac=True, method="L-BFGS-B").x
        peak = float(np.abs(shapes(phases)[1]).max())
        if peak < lowest:
            best, lowest = phases, peak
        if lowest <= ENOUGH * sine:
            break
    return best


def _sum(
    harmonic: Float[np.ndarray, " line"],
    phases: Float[np.ndarray, " line"],
    period: Float[np.ndarray, " point"],
) -> Float[np.ndarray, " point"]:
    return np.sin(2.0 * np.pi * harmonic[:, None] * period + phases[:, None]).sum(axis=0)
