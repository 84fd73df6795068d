"""What went wrong in the program itself while it listens: counted and told, and never an end.

A recording must outlast every error in what is made of it.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

TOLD_US = 30_000_000
"""A failure is told so long after it happened last [µs]."""

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Failure:
    """One part that failed.

    Attributes:
        what: the part, and what is done about it.
        why: its last error.
        count: how often.
        first_us: the first time, of those not longer than `TOLD_US` apart [µs since 1970].
        last_us: the last time.
    """

    what: str
    why: str
    count: int
    first_us: int
    last_us: int

    @property
    def words(self) -> str:
        """For people."""
        often = "once" if self.count == 1 else f"{self.count} times"
        return f"{self.what}: failed {often} ({self.why})"


class Failures:
    """Counts failures by part, from any thread; memory does not grow.

    Args:
        clock_us: the ground station's clock [µs since 1970].
    """

    def __init__(self, clock_us: Callable[[], int]) -> None:
        self._clock_us = clock_us
        self._seen: dict[str, Failure] = {}
        self._noting = threading.Lock()
        self.count = 0

    def note(self, what: str, error: Exception) -> None:
        """Counts a failure of the part `what`; a log gets the first of each."""
        now = self._clock_us()
        why = f"{type(error).__name__}: {' '.join(str(error).split())[:100]}"
        with self._noting:
            self.count += 1
            before = self._seen.get(what, Failure(what, why, 0, now, now))
            first = before.first_us if now - before.last_us <= TOLD_US else now
            new = replace(before, why=why, count=before.count + 1, first_us=first, last_us=now)
            self._seen[what] = new
        if new.count == 1:
            _LOG.warning("%s failed, listening goes on: %s", what, why)

    def told(self) -> list[Failure]:
        """Those of the last half minute."""
        now = self._clock_us()
        with self._noting:
            return [one for one in self._seen.values() if now - one.last_us <= TOLD_US]
