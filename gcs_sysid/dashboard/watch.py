"""The live document of a folder and its newest past, read as often as it changes.

The page is served by a process of its own that reads `live.json`. Whatever clients do to it, the
one that listens to the aircraft neither waits for it nor knows of it.
"""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections import deque
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import Any

LIVE = "live.json"
LOOK_S = 0.2
STALE_S = 3.0
"""Coefficients older than this make a gap in their histories, as on the page."""
KEPT = 900
"""Points of the time histories that are kept: a quarter of an hour."""
SHOWN = ("V", "alpha", "beta", "roll", "pitch", "yaw")


class Watch:
    """Newest live document and time histories.

    Args:
        folder: where listening writes.

    Attributes:
        version: rises with every new document.
        document: the newest; None before the first.
        ended: whether those who follow are to be let go.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / LIVE
        self._stamp: tuple[int, int] | None = None
        self._read_at = 0.0
        self.version = 0
        self.ended = False
        self.document: dict[str, Any] | None = None
        self.history: deque[dict[str, Any]] = deque(maxlen=KEPT)

    def look(self) -> bool:
        """Reads the document if it is a new one; says whether it was."""
        try:
            status = self._path.stat()
            stamp = (status.st_mtime_ns, status.st_ino)
            if stamp == self._stamp:
                return False
            found = json.loads(self._path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return False
        if not isinstance(found, dict) or found.get("command") != "listen":
            return False
        self._stamp, self._read_at = stamp, time.monotonic()
        self.document = found
        self.version += 1
        self.history.append(point(found))
        return True

    @property
    def age_s(self) -> float | None:
        """Time since the newest document was read [s]; None before the first."""
        return None if self.document is None else time.monotonic() - self._read_at

    async def watching(self) -> None:
        """Looks again and again."""
        while True:
            self.look()
            await asyncio.sleep(LOOK_S)

    async def news(self, seen: int = -1) -> AsyncIterator[tuple[int, dict[str, Any]]]:
        """Every document from now on that is newer than version `seen`; the slow miss some."""
        while not self.ended:
            if self.version != seen and self.document is not None:
                seen = self.version
                yield seen, self.document
            await asyncio.sleep(LOOK_S)


def point(document: Mapping[str, Any]) -> dict[str, Any]:
    """What the time histories need of a document: [value, standard deviation] by name."""
    values = {
        **{name: document["state"][name] for name in SHOWN if name in document.get("state", {})},
        **{
            name: item
            for name, item in document.get("coefficients", {}).items()
            if not (item.get("age_s") or 0.0) > STALE_S
        },
    }
    return {
        "t_us": document.get("written_us") or document.get("time_us"),
        "age_s": document.get("state_age_s"),
        **{name: [number(item.get("value")), number(item.get("sd"))]
           for name, item in values.items()},
    }  # fmt: skip


def number(value: Any) -> float | None:
    """A finite number, or None."""
    good = isinstance(value, int | float) and math.isfinite(value)
    return float(value) if good else None
