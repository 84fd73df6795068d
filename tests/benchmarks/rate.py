"""How many messages a reader takes in a second of processor time."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path


def best(read: Callable[[Path], int], path: Path, rounds: int) -> tuple[int, float]:
    """Messages, and the best rate of some rounds [1/CPU s]: other programs only slow it down."""
    shortest = float("inf")
    count = 0
    for _ in range(rounds):
        begin = time.process_time()
        count = read(path)
        shortest = min(shortest, time.process_time() - begin)
    return count, count / shortest
