"""Maneuvers flown as legs on a map: what another program needs to draw them."""

from __future__ import annotations

import json
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_FAREWELL_S = 2.0
_LOOK_S = 0.5
_POINTS = 600
_LEARNED = 0.9


@dataclass(frozen=True)
class Leg:
    """A maneuver that was flown: where, on what, and what it taught."""

    number: int
    words: str
    track: tuple[tuple[float, float], ...]
    done: bool


class Legs:
    """Follows the live document in a thread of its own; finished legs wait in a queue.

    Args:
        folder: what `listen` writes.
        place: where the aircraft is [deg]; None while it is not known.
        flown: takes finished legs.
    """

    def __init__(
        self,
        folder: Path,
        place: Callable[[], tuple[float, float] | None],
        flown: queue.SimpleQueue[Leg],
    ) -> None:
        self._folder, self._place, self._flown = folder, place, flown
        self._track: list[tuple[float, float]] = []
        self._last: dict[str, Any] | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._follow, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends it."""
        self._stop.set()
        self._thread.join(_FAREWELL_S)

    def look(self, maneuver: dict[str, Any] | None) -> None:
        """Takes note of the maneuver in progress, or of none."""
        last = self._last
        if last is not None and (maneuver is None or maneuver["number"] != last["number"]):
            words = f"leg {last['number']}: {', '.join(last['controls'])}, "
            words += f"{last['seconds']:.0f} s, {100.0 * last['learned']:.0f} % learned"
            stop = f" ({last['stop']})" if last["stop"] else ""
            done = last["learned"] >= _LEARNED
            self._flown.put(Leg(last["number"], words + stop, tuple(self._track), done))
            self._track = []
        self._last = maneuver
        place = self._place()
        if maneuver is not None and place is not None:
            self._track.append(place)
            # A leg of ten minutes is drawn with half the points.
            self._track = self._track[::2] if len(self._track) > _POINTS else self._track

    def _follow(self) -> None:
        while not self._stop.wait(_LOOK_S):
            try:
                text = (self._folder / "live.json").read_text(encoding="utf-8")
                self.look(json.loads(text).get("maneuver"))
            except (OSError, ValueError):
                continue
