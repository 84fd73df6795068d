"""Fewer points for drawing, without losing what an eye would have seen.

A line of many samples on a screen shows, in every column of pixels, the lowest and the highest
value that fall into it. Keeping just those samples draws the same picture (Jugel, Jerzak,
Hackenbroich and Markl 2014, "M4: a visualization-oriented time series data aggregation", PVLDB
7(10)); averaging or taking every n-th sample would hide the spikes that a residual is looked at
for. Kept values are samples, never means. Zoomed in beyond the kept density the curve is coarse.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int


def extreme_indices(
    columns: Sequence[Float[np.ndarray, " sample"]], *, bins: int
) -> Int[np.ndarray, " kept"]:
    """Indices of the samples to draw: in each bin every column's minimum and maximum.

    The samples are cut into bins of equal count. Kept are, per bin, the extremes of each column and
    one sample that is not a number where there is one (so a gap stays a gap), and the first and
    last sample of all.

    Args:
        columns: values on one common index; not-a-number where there is none.
        bins: number of bins; with no more than 2·bins samples everything is kept.

    Returns:
        Increasing indices, at most bins·(3·len(columns)) + 2.

    Raises:
        ValueError: without columns or with fewer than one bin.
    """
    if not columns or bins < 1:
        raise ValueError(f"`columns` must not be empty and `bins` positive, got bins={bins}")
    count = columns[0].size
    if count <= 2 * bins:
        return np.arange(count)
    kept = [np.array([0, count - 1])]
    for column in columns:
        kept.extend(_bin_extremes(column, width=-(-count // bins)))
    return np.unique(np.concatenate(kept))


def _bin_extremes(
    column: Float[np.ndarray, " sample"], *, width: int
) -> tuple[Int[np.ndarray, " low"], Int[np.ndarray, " high"], Int[np.ndarray, " gap"]]:
    rows = -(-column.size // width)
    padded = np.full(rows * width, np.nan)
    padded[: column.size] = column
    table = padded.reshape(rows, width)
    start = np.arange(rows) * width
    missing = ~np.isfinite(table)
    some = ~missing.all(axis=1)
    low = start + np.where(missing, np.inf, table).argmin(axis=1)
    high = start + np.where(missing, -np.inf, table).argmax(axis=1)
    gap = start + missing.argmax(axis=1)
    gap = gap[missing.any(axis=1) & (gap < column.size)]
    return low[some], high[some], gap


def holes(
    time: Float[np.ndarray, " sample"], *, steps: float = 5.0
) -> Bool[np.ndarray, " interval"]:
    """Which intervals between neighbouring samples are longer than `steps` median intervals [s]."""
    interval = np.diff(time)
    if interval.size == 0:
        return np.zeros(0, dtype=bool)
    return (interval > steps * np.median(interval)) | (interval < 0.0)


def broken_at_holes(
    time: Float[np.ndarray, " sample"], columns: Sequence[Float[np.ndarray, " sample"]]
) -> tuple[Float[np.ndarray, " point"], tuple[Float[np.ndarray, " point"], ...]]:
    """The same samples with a not-a-number row inside every hole, so that no line crosses it."""
    where = np.flatnonzero(holes(time)) + 1
    filled = np.insert(time, where, time[where - 1])
    return filled, tuple(np.insert(column, where, np.nan) for column in columns)


def thin_cloud(
    x: Float[np.ndarray, " sample"], y: Float[np.ndarray, " sample"], *, cells: int
) -> Int[np.ndarray, " kept"]:
    """One sample of every occupied cell of a `cells` by `cells` grid over the data, first come.

    The outline of a cloud and its holes stay; how densely samples lie inside a cell does not.
    """
    valid = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if valid.size == 0:
        return valid
    column = _cell(x[valid], cells)
    row = _cell(y[valid], cells)
    _, first = np.unique(row * cells + column, return_index=True)
    return valid[np.sort(first)]


def _cell(values: Float[np.ndarray, " sample"], cells: int) -> Int[np.ndarray, " sample"]:
    low, high = float(values.min()), float(values.max())
    if high <= low:
        return np.zeros(values.size, dtype=int)
    return np.minimum(((values - low) / (high - low) * cells).astype(int), cells - 1)


def limits(
    *columns: Float[np.ndarray, " _"], around: tuple[float, ...] = ()
) -> tuple[float, float]:
    """A range to show: the central 99 % of the values, opened by a quarter, not beyond the data.

    A single wild sample then cannot flatten a whole curve against the axis; what lies outside is
    cut off. The range is never empty.

    Args:
        columns: values; what is not a number does not count.
        around: values that must be inside in any case.
    """
    values = np.concatenate([np.ravel(column) for column in columns]) if columns else np.zeros(0)
    values = values[np.isfinite(values)]
    low, high = _central(values) if values.size else (np.inf, -np.inf)
    low, high = min((low, *around)), max((high, *around))
    if not low <= high:
        return -1.0, 1.0
    margin = 0.04 * (high - low) or 0.1 * abs(high) or 1.0
    return low - margin, high + margin


def _central(values: Float[np.ndarray, " sample"]) -> tuple[float, float]:
    low, high = np.quantile(values, (0.005, 0.995))
    open_by = 0.25 * (high - low)
    return float(max(values.min(), low - open_by)), float(min(values.max(), high + open_by))
