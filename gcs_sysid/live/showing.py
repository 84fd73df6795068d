"""Shows documents in a thread of its own: whoever looks can neither hold up nor end a recording."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from typing import Any

Show = Callable[[Mapping[str, Any]], None]

LAST_S = 2.0
"""The last document is waited for so long [s]; a terminal that is held up does not get it."""

_LOG = logging.getLogger(__name__)


class Slot:
    """Room for one document; a newer one takes its place."""

    def __init__(self) -> None:
        self._news = threading.Condition()
        self._newest: Mapping[str, Any] | None = None
        self._closed = False

    def put(self, document: Mapping[str, Any]) -> None:
        """Never waits."""
        with self._news:
            self._newest = document
            self._news.notify()

    def close(self) -> None:
        """No more will come; the one inside can still be taken."""
        with self._news:
            self._closed = True
            self._news.notify()

    def take(self) -> Mapping[str, Any] | None:
        """Waits for a document; None when no more will come."""
        with self._news:
            self._news.wait_for(lambda: self._closed or self._newest is not None)
            found, self._newest = self._newest, None
            return found


@contextmanager
def shown(show: Show) -> Generator[Show, None, None]:
    """Yields what hands a document to `show`, or drops the one that waits for it.

    When `show` fails, that is logged, and nothing is shown any more.
    """
    slot = Slot()

    def follow() -> None:
        try:
            while (document := slot.take()) is not None:
                show(document)
        except Exception as error:  # noqa: BLE001 - a display may fail in any way
            _LOG.warning("display failed, listening goes on without: %s", error)

    thread = threading.Thread(target=follow, name="show", daemon=True)
    thread.start()
    try:
        yield slot.put
    finally:
        slot.close()
        thread.join(LAST_S)
