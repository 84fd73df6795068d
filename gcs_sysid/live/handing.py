"""Things handed to a thread of its own, which may be slow: of those that wait the newest counts."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Generic, TypeVar

Thing = TypeVar("Thing")

LAST_S = 2.0
"""The last one is waited for so long [s]; whoever is held up longer does not hold up the rest."""


class Slot(Generic[Thing]):
    """Room for one thing; a newer one takes its place."""

    def __init__(self) -> None:
        self._news = threading.Condition()
        self._newest: Thing | None = None
        self._closed = False

    def put(self, thing: Thing) -> None:
        """Never waits."""
        with self._news:
            self._newest = thing
            self._news.notify()

    def close(self) -> None:
        """No more will come; the one inside can still be taken."""
        with self._news:
            self._closed = True
            self._news.notify()

    def take(self) -> Thing | None:
        """Waits for one; None when no more will come."""
        with self._news:
            self._news.wait_for(lambda: self._closed or self._newest is not None)
            found, self._newest = self._newest, None
            return found


@contextmanager
def handed_on(
    take: Callable[[Thing], None], name: str
) -> Generator[Callable[[Thing], None], None, None]:
    """Yields what hands a thing to `take`, or drops the one that waits for it.

    Args:
        take: runs in a thread of its own; must not raise.
        name: of that thread.
    """
    slot: Slot[Thing] = Slot()

    def follow() -> None:
        while (thing := slot.take()) is not None:
            take(thing)

    thread = threading.Thread(target=follow, name=name, daemon=True)
    thread.start()
    try:
        yield slot.put
    finally:
        slot.close()
        thread.join(LAST_S)
