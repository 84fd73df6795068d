"""How long a packet takes from its arrival until the state holds it: lately, and in all."""

from __future__ import annotations

import math

import numpy as np

from gcs_sysid.live.ring import Ring

NEWEST = 4096
"""Updates that the newest percentiles look at: 80 s at 50 Hz."""
LEAST_S, MOST_S = 1e-6, 1e3
"""Durations that are told apart in the percentiles of all [s]; others count as these."""
STEP = 1.01
"""Ratio of neighbouring bounds of their histogram, and so how exact they are."""
NAMES = ("p50_ms", "p99_ms", "all_p50_ms", "all_p99_ms")
"""Of the newest, then of all."""
_BINS = 1 + round(math.log(MOST_S / LEAST_S) / math.log(STEP))


class Latency:
    """Percentiles of durations [s], of the newest and of all; memory does not grow."""

    def __init__(self) -> None:
        self._ring = Ring(NEWEST, 1)
        self._all = np.zeros(_BINS, dtype=np.int64)

    def add(self, seconds: float) -> None:
        """Takes note of one duration."""
        self._ring.add(np.array([seconds]))
        told = min(max(seconds, LEAST_S), MOST_S)
        self._all[round(math.log(told / LEAST_S) / math.log(STEP))] += 1

    def percentiles(self) -> dict[str, float | None]:
        """Median and 99th percentile [ms], of the newest and of all; None before the first."""
        rows = self._ring.rows()
        if not rows.size:
            return dict.fromkeys(NAMES)
        below = np.cumsum(self._all)
        ranks = np.searchsorted(below, np.array([0.50, 0.99]) * below[-1])
        values = (*np.percentile(rows, [50.0, 99.0]), *(LEAST_S * STEP**ranks))
        return {name: round(1e3 * float(one), 3) for name, one in zip(NAMES, values, strict=True)}
