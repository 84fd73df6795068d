"""Maneuvers that took no part, flown by the file and by the file put right.

Both begin at the states of the aided filter and meet its wind and gusts, three seconds at a time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gcs_sysid.offline import departed, windows
from gcs_sysid.offline.flight import Flight
from gcs_sysid.offline.windows import CHANNELS, UNITS


def gain(flights: Sequence[Mapping[str, Flight]], held_out: Sequence[int]) -> dict[str, Any]:
    """Root mean square error of each channel before and after, and what is gained.

    Windows that either cannot fly to their end are `lost`, and count in neither.

    Args:
        flights: see `departed.flown`.
        held_out: maneuvers that took no part.

    Returns:
        Windows flown, their length, how many each lost, and by channel the errors, the gain and
        one sigma of it; no channels where there was nothing to fly.
    """
    errors: dict[str, list[np.ndarray]] = {"before": [], "after": []}
    for pair in flights:
        for label, whole in pair.items():
            kept = tuple(item for item in whole.segments if item.id in held_out)
            cut = windows.cut(replace(whole, segments=kept), whole.aircraft)
            if cut.piece.size:
                errors[label].append(windows.fly_freely(whole.aircraft, cut) - cut.measured)
    found = {label: np.concatenate(parts) for label, parts in errors.items() if parts}
    document: dict[str, Any] = {
        "windows": 0,
        "length_s": windows.LENGTH,
        "lost": dict.fromkeys(errors, 0),
        "channels": {},
    }
    if not found:
        return document
    ended = {label: np.isfinite(each).all(axis=(1, 2)) for label, each in found.items()}
    both = ended["before"] & ended["after"]
    document["windows"] = int(both.sum())
    document["lost"] = {label: int((~each).sum()) for label, each in ended.items()}
    if both.sum() > 1:
        count = np.full(int(both.sum()), float(found["before"].shape[1]))
        for index, name in enumerate(CHANNELS):
            squares = {
                label: np.sum(each[both, :, index] ** 2, axis=1) for label, each in found.items()
            }
            scored = departed.left_out(squares, count, 1.0)
            document["channels"][name] = {**scored, "unit": UNITS.get(name, "rad")}
    return document
