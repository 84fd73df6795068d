"""How often messages of each type arrive, over the last seconds, in memory that does not grow."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

SPAN_S = 3
"""Whole seconds over which rates are told."""


class Rates:
    """Counts arrivals by second.

    Attributes:
        last: when each type was heard last [s].
    """

    def __init__(self) -> None:
        self._seconds: deque[tuple[int, dict[str, int]]] = deque(maxlen=SPAN_S + 1)
        self._begun: float | None = None
        self.last: dict[str, float] = {}

    def add(self, counts: Mapping[str, int], now: float) -> None:
        """Takes note of so many messages by type at a time [s], which does not fall."""
        second = math.floor(now)
        if self._begun is None:
            self._begun = now
        if not self._seconds or self._seconds[-1][0] != second:
            self._seconds.append((second, {}))
        tally = self._seconds[-1][1]
        for name, count in counts.items():
            tally[name] = tally.get(name, 0) + count
            self.last[name] = now

    def settled(self, now: float) -> bool:
        """Whether it has listened long enough for its rates to mean something."""
        return self._begun is not None and now - self._begun >= SPAN_S + 1

    def rate(self, name: str, now: float) -> float:
        """Messages a second over the last `SPAN_S` whole seconds."""
        second = math.floor(now)
        whole = range(second - SPAN_S, second)
        return sum(tally.get(name, 0) for at, tally in self._seconds if at in whole) / SPAN_S

    def clear(self) -> None:
        """Begins anew."""
        self._seconds.clear()
        self._begun = None
