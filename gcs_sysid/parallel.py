"""Work that does not wait for other work, on the processor's cores side by side.

Compiled programs leave the interpreter to others while they run, so that threads are enough. What
runs here already goes on alone: cores are busy, and a thread that waits for its own pool waits for
ever. Results come in the order of what was given, and do not depend on how many threads there are.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache, partial
from typing import TypeVar

_HERE = threading.local()
Made = TypeVar("Made")


def each(function: Callable[..., Made], *given: Iterable[object]) -> list[Made]:
    """`function` of every set of arguments: one of each of `given`, in their order."""
    return list(ahead(function, *given, by=None))


def ahead(
    function: Callable[..., Made], *given: Iterable[object], by: int | None = 2
) -> Iterator[Made]:
    """Like `each`, as they are asked for, and no more than so many for each core ahead of that.

    Args:
        function: what is to be done; its result should be ready, not on its way.
        given: arguments, as for `each`; all as long.
        by: None for no limit.
    """
    calls: Iterator[tuple[object, ...]] = zip(*given, strict=True)
    if _cores() == 1 or getattr(_HERE, "busy", False):
        for arguments in calls:
            yield function(*arguments)
        return
    waiting: deque[Future[Made]] = deque()
    try:
        for arguments in calls:
            waiting.append(_pool().submit(partial(_alone, function), *arguments))
            if by is not None and len(waiting) > by * _cores():
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        # The program ends only when its threads do: whoever stops it must not wait for the rest.
        for one in waiting:
            one.cancel()


def _alone(function: Callable[..., Made], *arguments: object) -> Made:
    _HERE.busy = True
    return function(*arguments)


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(_cores(), thread_name_prefix="side-by-side")


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
