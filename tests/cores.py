"""Which of the machine's cores a test's process has.

Programs of two workers that each use both cores get in each other's way; with a core each they take
a seventh less time. What is to run as its users run it is given all of them back.
"""

from __future__ import annotations

import os

WORKER = "PYTEST_XDIST_WORKER"


def one_each() -> None:
    """Gives a worker, and all that it starts, one core; to be called before JAX looks for them."""
    worker = os.environ.get(WORKER, "").removeprefix("gw")
    if worker and hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {cores[int(worker) % len(cores)]})


def every_one() -> None:
    """Gives the process all cores, as it would have them without a worker around it."""
    if os.environ.get(WORKER) and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, range(os.cpu_count() or 1))
