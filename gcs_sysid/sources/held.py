"""Slow sensors in fast tables: a value held over many rows is one measurement, not many.

A logger that writes all of its variables at 50 Hz repeats the 10 Hz airspeed five times. Taken as
five measurements, these would count as five independent ones, each at a wrong time.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

FEWEST_CHANGES = 10
"""A sensor that changed less often [times] does not tell how long it holds its values."""
SHORTEST_HOLD = 1.5
"""Values that stay for fewer rows (median) are measured at every row; some just happen to repeat,
as those of a coarse sensor do."""


def hold(values: Float[np.ndarray, "row channel"]) -> float:
    """For how many rows a sensor's values usually stay (median); 1 where that is not known."""
    lengths = _lengths(values)
    return float(np.median(lengths)) if lengths.size > FEWEST_CHANGES else 1.0


def measured_rows(values: Float[np.ndarray, "row channel"]) -> Int[np.ndarray, " kept"]:
    """Rows at which a sensor delivered new values.

    A sensor is seen to hold its values when they usually stay for more than one row, all channels
    at once. Then the first row of each stretch is kept. A stretch of several usual lengths, in
    which it measured the same again, keeps that many rows: a sensor at rest is no silent one.
    """
    usual = hold(values)
    if usual < SHORTEST_HOLD:
        return np.arange(values.shape[0])
    lengths = _lengths(values)
    starts = np.cumsum(lengths) - lengths
    counts = np.maximum(np.round(lengths / usual), 1.0).astype(np.int64)
    within = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.repeat(starts, counts) + np.floor(within * usual).astype(np.int64)


def _lengths(values: Float[np.ndarray, "row channel"]) -> Int[np.ndarray, " stretch"]:
    """Lengths [rows] of the stretches in which no channel changes."""
    changed = np.any(values[1:] != values[:-1], axis=1)
    edges = np.concatenate([[0], np.flatnonzero(changed) + 1, [values.shape[0]]])
    return np.diff(edges)
