"""Which of the machine's cores a test's process has.

Programs of two workers that each use both cores get in each other's way; with a core each the
whole suite took 6 % less time (by hand). What is to run as users run it is given all of them back.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

WORKER = "PYTEST_XDIST_WORKER"
EVERY = frozenset(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else frozenset()
"""What the process had before a worker was given one; empty where a system offers no choice."""


def one_each() -> None:
    """Gives a worker, and all that it starts, one core; to be called before JAX looks for them."""
    worker = os.environ.get(WORKER, "").removeprefix("gw")
    if worker and EVERY:
        os.sched_setaffinity(0, {sorted(EVERY)[int(worker) % len(EVERY)]})


@contextmanager
def every_one() -> Iterator[None]:
    """What is started here has all cores, as it would have them without a worker around it."""
    if not EVERY:
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, EVERY)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
