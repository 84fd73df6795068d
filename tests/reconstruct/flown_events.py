"""Inputs as somebody wrote them down while they were flown, and how well the finder finds them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gcs_sysid.reconstruct.segments import INPUTS, Segment

CONTROL = {"ele": "elevator", "ail": "aileron", "rud": "rudder", "thr": "throttle"}
KIND = {"doublet": "doublet", "3211": "multistep"}


@dataclass(frozen=True)
class Event:
    """An input as the one who flew it wrote it down."""

    kind: str
    controls: frozenset[str]
    start: float
    end: float

    def is_(self, found: Segment) -> bool:
        """Whether a maneuver is this input: kind, controls, and half of the shorter one shared."""
        shared = min(self.end, found.end) - max(self.start, found.start)
        shorter = min(self.end - self.start, found.duration)
        same = found.kind == self.kind and set(found.controls) == self.controls
        return same and shared > 0.5 * shorter


def events(path: Path) -> list[Event]:
    """Inputs of an events file; times are of the vehicle's boot clock [s]."""
    result, name, start, throttle = [], "", 0.0, []
    for entry in json.loads(path.read_text())["events"]:
        time = 1e-3 * entry["t_boot_ms"]
        if entry["kind"] == "exc_start":
            name, start = entry["name"].split("_"), time
        elif entry["kind"] == "exc_end":
            controls = frozenset(CONTROL[word] for word in name if word in CONTROL)
            kind = "multisine" if name[0] == "multisine" else KIND[name[1]]
            kind = "throttle" if controls == {"throttle"} else kind
            result.append(Event(kind, controls, start, time))
        elif entry["kind"] == "fbwa_throttle":
            throttle.append(time)
    # Three throttle steps flown by hand in a stabilised mode are a throttle input as well.
    return [*result, Event("throttle", frozenset({"throttle"}), throttle[0], throttle[-1] + 2.0)]


def recall_and_precision(flown: Sequence[Event], found: Sequence[Segment]) -> tuple[float, float]:
    """Share of the inputs flown that were found, and of the inputs claimed that were flown."""
    claimed = [item for item in found if item.kind in INPUTS]
    matched = [event for event in flown if any(event.is_(item) for item in claimed)]
    right = [item for item in claimed if any(event.is_(item) for event in flown)]
    return len(matched) / len(flown), len(right) / max(1, len(claimed))
