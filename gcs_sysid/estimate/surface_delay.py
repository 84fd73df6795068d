"""How late the surfaces follow the recorded servo commands, found before anything is fitted.

Twenty milliseconds uncorrected make false damping of τω², 40 % of a typical pitch-damping term. The
delay is the one at which the moment equations, linear in flow angles, rates and deflections, leave
least: profile likelihood over a grid, on as many samples as are independent of each other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import MOMENTS
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.reconstruct import rates

GRID = np.arange(-0.06, 0.2601, 0.01)
PRIOR_SIGMA = 0.1
"""One standard deviation of a delay that nobody stated [s]."""
LEAST_EVIDENCE = 5.0
"""Rise of the log-likelihood over its value at the worst delay below which the flight cannot tell."""
MOTION: Mapping[str, tuple[str, ...]] = {
    "Cl": ("beta", "phat", "rhat"),
    "Cm": ("alpha", "qhat"),
    "Cn": ("beta", "phat", "rhat"),
}


@dataclass(frozen=True)
class Delay:
    """A delay [s], one standard deviation, and whether the flight determined it."""

    value: float
    deviation: float
    found: bool


def surface_delay(
    samples: Samples,
    controls: Callable[[float], Mapping[str, Float[np.ndarray, " sample"]]],
    *,
    stated: float = 0.0,
    stated_sigma: float | None = None,
) -> Delay:
    """Delay of the surfaces beyond what the aircraft file already has in its servos.

    Args:
        samples: measured moments of one flight, with any assumed delay; the controls in it are unused.
        controls: deflections on the samples' times for a given delay.
        stated: delay that the file gives to the servo stream [s].
        stated_sigma: its standard deviation.

    Returns:
        The posterior of the delay; with a flight that cannot tell, what was stated.
    """
    sigma = PRIOR_SIGMA if stated_sigma is None else stated_sigma
    left = {name: np.zeros(GRID.size) for name in MOMENTS}
    residuals = {}
    fixed = {
        name: np.stack([np.ones_like(samples.time), *(samples.regressors[k] for k in keys)], 1)
        for name, keys in MOTION.items()
    }
    smoothed = {
        name: rates.smooth(samples.time, columns, samples.smoothing).value
        for name, columns in fixed.items()
    }
    best = {name: np.inf for name in MOMENTS}
    for index, delay in enumerate(GRID):
        deflections = np.stack(list(controls(float(delay)).values()), axis=1)
        moved = rates.smooth(samples.time, deflections, samples.smoothing).value
        for name in MOMENTS:
            columns = np.concatenate([smoothed[name], moved], axis=1)
            weight = np.median(samples.noise[name]) / samples.noise[name]
            target = samples.measured[name] * weight
            weighted = columns * weight[:, None]
            solution = np.linalg.lstsq(weighted, target, rcond=None)[0]
            residual = target - weighted @ solution
            left[name][index] = np.log(residual @ residual)
            if left[name][index] < best[name]:
                best[name] = left[name][index]
                residuals[name] = residual
    score = sum(
        -0.5 * _independent(residuals[name]) * (left[name] - best[name]) for name in MOMENTS
    )
    if float(np.ptp(score)) < LEAST_EVIDENCE:
        return Delay(stated, sigma, found=False)
    posterior = score - 0.5 * ((GRID - stated) / sigma) ** 2
    return _moments(posterior)


def _independent(residual: Float[np.ndarray, " sample"]) -> float:
    """Number of independent samples in a coloured residual, N / (1 + 2 Σ ρ_k).

    The sum ends at the first negative correlation (Geyer 1992, initial positive sequence).
    """
    count = residual.size
    spectrum = np.abs(np.fft.rfft(residual - residual.mean(), 2 * count)) ** 2
    correlation = np.fft.irfft(spectrum)[: count // 10]
    correlation = correlation / correlation[0]
    end = int(np.argmax(correlation < 0.0)) or correlation.size
    return count / (1.0 + 2.0 * float(np.sum(correlation[1:end])))


def _moments(score: Float[np.ndarray, " delay"]) -> Delay:
    """Peak and width of a log-density known on the grid, by the parabola around its peak."""
    best = int(np.clip(np.argmax(score), 1, GRID.size - 2))
    left, middle, right = score[best - 1 : best + 2]
    spacing = GRID[1] - GRID[0]
    bend = (left - 2.0 * middle + right) / spacing**2
    if bend >= 0.0:
        return Delay(float(GRID[int(np.argmax(score))]), float(np.ptp(GRID)) / 4.0, found=False)
    offset = np.clip(-0.5 * (right - left) / spacing / bend, -spacing, spacing)
    return Delay(float(GRID[best] + offset), float(1.0 / np.sqrt(-bend)), found=True)
