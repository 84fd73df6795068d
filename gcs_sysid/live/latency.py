"""How long a packet takes from its arrival until the state holds it, over the newest updates."""

from __future__ import annotations

import numpy as np

from gcs_sysid.live.ring import Ring

NEWEST = 4096
"""Updates that the percentiles look at: 80 s at 50 Hz."""


class Latency:
    """Percentiles of the newest durations [s]."""

    def __init__(self) -> None:
        self._ring = Ring(NEWEST, 1)

    def add(self, seconds: float) -> None:
        """Takes note of one duration."""
        self._ring.add(np.array([seconds]))

    def percentiles(self) -> dict[str, float | None]:
        """Median and 99th percentile [ms]; None before the first."""
        rows = self._ring.rows()
        if not rows.size:
            return {"p50_ms": None, "p99_ms": None}
        half, most = np.percentile(rows, [50.0, 99.0])
        return {"p50_ms": round(1e3 * float(half), 3), "p99_ms": round(1e3 * float(most), 3)}
