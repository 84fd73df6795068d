"""Memory that is free goes back to the system.

The C library keeps what a thread has freed for that thread's next use. A learning takes some
megabytes for seconds, minutes after the one before and in the midst of what the flight keeps, so
that it is seldom given the same ones again: the process grew by 5 to 24 MB at every learning. Given
back, it grows by 1 to 7 MB (`tests/benchmarks/soak_live.py`).
"""

from __future__ import annotations

import ctypes
import logging

_LOG = logging.getLogger(__name__)


def give_back() -> None:
    """Gives the system what is free, where the C library is glibc."""
    try:
        ctypes.CDLL("libc.so.6").malloc_trim(0)
    except (OSError, AttributeError) as error:
        # Other libraries do so by themselves, or cannot be asked.
        _LOG.info("freed memory is not given back: %s", error)
