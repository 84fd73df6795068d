"""Shows documents in a thread of its own: whoever looks can neither hold up nor end a recording."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from typing import Any

from gcs_sysid.live.handing import handed_on

Show = Callable[[Mapping[str, Any]], None]

_LOG = logging.getLogger(__name__)


@contextmanager
def shown(show: Show) -> Generator[Show, None, None]:
    """Yields what hands a document to `show`, or drops the one that waits for it.

    When `show` fails, that is logged, and nothing is shown any more.
    """
    broken = False

    def attempt(document: Mapping[str, Any]) -> None:
        nonlocal broken
        if broken:
            return
        try:
            show(document)
        except Exception as error:  # noqa: BLE001 - a display may fail in any way
            broken = True
            _LOG.warning("display failed, listening goes on without: %s", error)

    with handed_on(attempt, "show") as put:
        yield put
