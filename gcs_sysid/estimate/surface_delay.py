"""How late the surfaces follow the recorded servo commands, found before anything is fitted.

Twenty milliseconds uncorrected make false damping of τω², 40 % of a typical pitch-damping term. The
delay is the one at which the moment equations, linear in flow angles, rates and deflections, leave
least: profile likelihood over a grid, on as many samples as are independent of each other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.reconstruct import rates

GRID = np.arange(-0.06, 0.2601, 0.01)
PRIOR_SIGMA = 0.1
"""One standard deviation of a delay that nobody stated [s]."""
LEAST_EVIDENCE = 5.0
"""Rise of the log-likelihood over that of the worst delay; with less the flight cannot tell."""
USELESS = 0.03
"""A delay less certain than this [s] is no better than what was stated."""
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
    rows: Bool[np.ndarray, " sample"],
    *,
    stated: float = 0.0,
    stated_sigma: float | None = None,
) -> Delay:
    """Delay of the surfaces beyond what the aircraft file already has in its servos.

    The three axes are asked apart. Where they disagree by more than their own uncertainty,
    something else than a delay is at work (an autopilot that answers gusts makes the surface seem
    early), and the standard deviation grows by that disagreement (Birge 1932).

    Args:
        samples: measured moments of one flight, with any assumed delay; the controls in it are
            unused.
        controls: deflections on the samples' times for a given delay.
        rows: samples to use: best those of deliberate inputs, which gusts do not steer.
        stated: delay that the file gives to the servo stream [s].
        stated_sigma: its standard deviation.

    Returns:
        The posterior of the delay; with a flight that cannot tell, what was stated.
    """
    sigma = PRIOR_SIGMA if stated_sigma is None else stated_sigma
    left, independent = _profiles(samples, controls, rows)
    axes = [
        peak
        for name in left
        if (peak := _peak(-0.5 * independent[name] * (left[name] - left[name].min()))) is not None
    ]
    if not axes:
        return Delay(stated, sigma, found=False)
    values, deviations = (np.array(item) for item in zip(*axes, strict=True))
    weight = 1.0 / deviations**2
    mean = float(weight @ values / weight.sum())
    scatter = float(weight @ (values - mean) ** 2 / max(values.size - 1, 1))
    deviation = float(np.sqrt(max(1.0, scatter) / weight.sum()))
    if deviation > USELESS:
        return Delay(stated, sigma, found=False)
    share = sigma**2 / (sigma**2 + deviation**2)
    return Delay(stated + share * (mean - stated), float(np.sqrt(share)) * deviation, found=True)


def _profiles(
    samples: Samples,
    controls: Callable[[float], Mapping[str, Float[np.ndarray, " sample"]]],
    rows: Bool[np.ndarray, " sample"],
) -> tuple[dict[str, Float[np.ndarray, " delay"]], dict[str, float]]:
    """Logarithm of what each moment equation leaves, over the delays; its independent samples."""
    fixed = {
        name: rates.smooth(
            samples.time,
            np.stack([np.ones_like(samples.time), *(samples.regressors[k] for k in keys)], 1),
            samples.smoothing,
        ).value[rows]
        for name, keys in MOTION.items()
        if name in samples.measured
    }
    left = {name: np.full(GRID.size, np.inf) for name in fixed}
    best: dict[str, np.ndarray] = {}
    for index, delay in enumerate(GRID):
        deflections = np.stack(list(controls(float(delay)).values()), axis=1)
        moved = rates.smooth(samples.time, deflections, samples.smoothing).value[rows]
        for name in fixed:
            weight = np.median(samples.noise[name][rows]) / samples.noise[name][rows]
            columns = np.concatenate([fixed[name], moved], axis=1) * weight[:, None]
            target = samples.measured[name][rows] * weight
            solution = np.linalg.lstsq(columns, target, rcond=None)[0]
            residual = target - columns @ solution
            size = np.log(residual @ residual)
            if size < left[name].min():
                best[name] = residual
            left[name][index] = size
    return left, {name: _independent(best[name]) for name in fixed}


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


def _peak(score: Float[np.ndarray, " delay"]) -> tuple[float, float] | None:
    """Place and width of a log-likelihood's peak; None where it is flat or at the grid's edge."""
    best = int(np.argmax(score))
    if best in (0, GRID.size - 1) or float(np.ptp(score)) < LEAST_EVIDENCE:
        return None
    left, middle, right = score[best - 1 : best + 2]
    spacing = GRID[1] - GRID[0]
    bend = (left - 2.0 * middle + right) / spacing**2
    offset = -0.5 * (right - left) / spacing / bend
    return float(GRID[best] + offset), float(1.0 / np.sqrt(-bend))
