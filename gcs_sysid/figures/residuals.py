"""What the model leaves over: in time, over angle of attack, its distribution, its memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid.figures.data import SIGMAS_95, Axis, Band, Figure, Panel, Rule, Series
from gcs_sysid.figures.reduce import broken_at_holes, extreme_indices, limits, thin_cloud
from gcs_sysid.figures.samples import (
    Samples,
    column,
    end_to_end,
    flight_rows,
    normalised_residual,
    pieces,
    residual,
)

_REACH = 4.5
"""Half width of the histogram, in claimed standard deviations; what lies beyond is counted at its
edge."""


@dataclass(frozen=True)
class Memory:
    """Autocorrelation of a sequence with gaps.

    Attributes:
        lag: s.
        correlation: at each lag; 1 at lag zero.
        bound: 95 % limit of a white sequence of as many samples.
        samples: how many samples went in.
        effective: how many independent ones they are worth.
    """

    lag: Float[np.ndarray, " lag"]
    correlation: Float[np.ndarray, " lag"]
    bound: float
    samples: int
    effective: float


def memory(runs: Sequence[Float[np.ndarray, " _"]], *, interval: float, reach: float) -> Memory:
    """Autocorrelation over several runs without a gap inside, products never crossing a gap.

    r(k) = Σ x(i) x(i+k) / Σ x(i)², both sums over all runs, means of all runs taken off; the
    effective number is N / (1 + 2 Σ r(k)) up to the first lag at which r is no longer above the
    white bound (Bayley and Hammersley 1946, "The effective number of independent observations in
    an autocorrelated time series").

    Args:
        runs: values at equal intervals.
        interval: time between samples [s].
        reach: longest lag [s].
    """
    count = sum(run.size for run in runs)
    mean = sum(float(run.sum()) for run in runs) / count
    lags = int(reach / interval) + 1
    power = np.zeros(lags)
    for run in runs:
        power += _products(run - mean, lags)
    correlation = power / power[0] if power[0] > 0.0 else np.eye(1, lags)[0]
    bound = SIGMAS_95 / float(np.sqrt(count))
    below = np.flatnonzero(correlation <= bound)
    last = int(below[0]) if below.size else lags
    effective = count / (1.0 + 2.0 * float(correlation[1:last].sum()))
    return Memory(np.arange(lags) * interval, correlation, bound, count, effective)


def _products(run: Float[np.ndarray, " sample"], lags: int) -> Float[np.ndarray, " lag"]:
    """Sums of products at each lag, by the transform (zero padded, so nothing wraps)."""
    size = 1 << int(2 * run.size - 1).bit_length()
    spectrum = np.fft.rfft(run, size)
    sums = np.fft.irfft(spectrum * spectrum.conj(), size)[: run.size]
    padded = np.zeros(lags)
    reach = min(lags, run.size)
    padded[:reach] = sums[:reach]
    return padded


def figures(samples: Samples, name: str, *, bins: int) -> tuple[Figure, ...]:
    """The four looks at one coefficient's residual."""
    left = residual(samples, name)
    return (
        _over_time(samples, name, left, bins),
        _over_alpha(samples, name, left),
        _distribution(samples, name),
        _autocorrelation(samples, name, left),
    )


def _over_time(
    samples: Samples, name: str, left: Float[np.ndarray, " sample"], bins: int
) -> Figure:
    clock, begins = end_to_end(samples)
    order = np.concatenate(list(flight_rows(samples).values()))
    time, (value,) = broken_at_holes(clock[order], (left[order],))
    kept = extreme_indices((value,), bins=bins)
    rules = tuple(
        Rule("x", begin, f"flight {number + 1}") for number, begin in enumerate(begins) if number
    )
    return Figure(
        name=f"residual-time-{name}",
        title="Over time",
        caption=f"rms {_rms(left):.2g}",
        x=Axis("flight time", "s", (0.0, float(np.nanmax(clock)))),
        panels=(
            Panel(
                y=Axis(name, "1", limits(left, around=(0.0,))),
                series=(Series("residual", time[kept], value[kept], "measured"),),
                rules=(Rule("y", 0.0, ""), *rules),
            ),
        ),
        size="small",
    )


def _over_alpha(samples: Samples, name: str, left: Float[np.ndarray, " sample"]) -> Figure:
    alpha = np.degrees(column(samples, "alpha"))
    kept = thin_cloud(alpha, left, cells=80)
    centre, mean, half = binned_mean(alpha, left)
    return Figure(
        name=f"residual-alpha-{name}",
        title="Over angle of attack",
        caption=f"means differ by {np.ptp(mean) if mean.size else 0.0:.2g} over the range",
        x=Axis("angle of attack α", "deg", limits(alpha)),
        panels=(
            Panel(
                y=Axis(name, "1", limits(left, around=(0.0,))),
                series=(
                    Series("residual", alpha[kept], left[kept], "fitted", "points"),
                    Series("mean", centre, mean, "measured"),
                ),
                bands=(Band("spread", centre, mean - half, mean + half, "measured"),),
                rules=(Rule("y", 0.0, ""),),
            ),
        ),
        size="small",
    )


def _rms(values: Float[np.ndarray, " sample"]) -> float:
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2)))


def binned_mean(
    x: Float[np.ndarray, " sample"], y: Float[np.ndarray, " sample"], *, groups: int = 12
) -> tuple[Float[np.ndarray, " group"], Float[np.ndarray, " group"], Float[np.ndarray, " group"]]:
    """Median of x, mean and standard deviation of y in `groups` groups of equal count along x."""
    valid = np.isfinite(x) & np.isfinite(y)
    order = np.argsort(x[valid], kind="stable")
    sets = [part for part in np.array_split(order, groups) if part.size]
    return (
        np.array([np.median(x[valid][part]) for part in sets]),
        np.array([np.mean(y[valid][part]) for part in sets]),
        np.array([np.std(y[valid][part]) for part in sets]),
    )


def _distribution(samples: Samples, name: str) -> Figure:
    scored, which = _scored(samples, normalised_residual(samples, name))
    edges = np.linspace(-_REACH, _REACH, 37)
    clipped = np.clip(scored, -_REACH, _REACH)
    density = np.histogram(clipped, edges)[0] / (max(scored.size, 1) * np.diff(edges))
    centre = 0.5 * (edges[1:] + edges[:-1])
    grid = np.linspace(-_REACH, _REACH, 91)
    normal = np.exp(-0.5 * grid**2) / np.sqrt(2.0 * np.pi)
    inside = 100.0 * float(np.mean(np.abs(scored) <= SIGMAS_95)) if scored.size else 0.0
    return Figure(
        name=f"residual-distribution-{name}",
        title="Distribution",
        caption=f"{inside:.0f} % inside ±1.96 (95 % expected), {which}",
        x=Axis("residual / claimed sd", "1", (-_REACH, _REACH)),
        panels=(
            Panel(
                y=Axis("density", "1", (0.0, 1.08 * max(float(density.max()), 0.42))),
                series=(
                    Series("residuals", centre, density, "measured", "bars"),
                    Series("normal", grid, normal, "reference", "dashes"),
                ),
                rules=(Rule("x", -SIGMAS_95, "", "limit"), Rule("x", SIGMAS_95, "", "limit")),
            ),
        ),
        size="small",
    )


def _scored(
    samples: Samples, scored: Float[np.ndarray, " sample"]
) -> tuple[Float[np.ndarray, " scored"], str]:
    """Held-out residuals where there are any, else all, and which they are in words."""
    finite = np.isfinite(scored)
    held_out = finite & np.asarray(samples.get("held_out", np.zeros(finite.size)), dtype=bool)
    if held_out.any():
        return scored[held_out], "held out"
    return scored[finite], "all samples"


def _autocorrelation(samples: Samples, name: str, left: Float[np.ndarray, " sample"]) -> Figure:
    runs = pieces(samples, left)
    steps = np.concatenate([np.diff(column(samples, "t")[rows]) for rows in runs])
    result = memory([left[rows] for rows in runs], interval=float(np.median(steps)), reach=3.0)
    flat = np.full(result.lag.size, result.bound)
    kept = extreme_indices((result.correlation,), bins=150)
    return Figure(
        name=f"residual-memory-{name}",
        title="Autocorrelation",
        caption=f"{result.samples} samples are worth about {result.effective:.0f}",
        x=Axis("lag", "s", (0.0, float(result.lag[-1]))),
        panels=(
            Panel(
                y=Axis("correlation", "1", limits(result.correlation, around=(-0.2, 1.0))),
                series=(Series("r", result.lag[kept], result.correlation[kept], "measured"),),
                bands=(
                    Band(
                        "white, 95 %",
                        result.lag[[0, -1]],
                        -flat[[0, -1]],
                        flat[[0, -1]],
                        "reference",
                    ),
                ),
                rules=(Rule("y", 0.0, ""),),
            ),
        ),
        size="small",
    )
