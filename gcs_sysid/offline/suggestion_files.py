"""What a suggestion leaves beside its documents: one CSV a maneuver, and the motions to draw."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gcs_sysid.maneuvers.axes import THROTTLE
from gcs_sysid.maneuvers.design import Maneuver
from gcs_sysid.maneuvers.flown import STEP
from gcs_sysid.offline import suggestion_entries

CHANNELS = ("airspeed", "alpha", "beta", "load_factor", "bank", "height")
"""Motions that are kept for drawing."""
INPUTS = 4
"""Most inputs of one maneuver that are drawn."""


def csv(item: Maneuver, names: tuple[str, ...]) -> str:
    """Time [s] and one column a control [deg; throttle 0 to 1].

    To be added to trim and to what the autopilot commands.
    """
    inputs = suggestion_entries.moved(item, names)
    columns = [
        item.added[:, names.index(name)] * (1.0 if name == THROTTLE else np.degrees(1.0))
        for name in inputs
    ]
    rows = [",".join(("t", *inputs))]
    for when, *values in zip(item.time, *columns, strict=True):
        rows.append(",".join((f"{when:.3f}", *(f"{value + 0.0:.4f}" for value in values))))
    return "\n".join(rows) + "\n"


def motions(kept: Sequence[Maneuver], names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Inputs and motions of every maneuver: the mean in calm air, and the range of all drawn."""
    parts = [_part(number, item, names) for number, item in enumerate(kept)]
    columns = parts[0] if parts else ("maneuver", "t")
    return {
        name: np.concatenate([part[name] for part in parts]) if parts else np.zeros(0)
        for name in columns
    }


def _part(number: int, item: Maneuver, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    count = item.flown.alpha.shape[1]
    part: dict[str, np.ndarray] = {
        "maneuver": np.full(count, number),
        "t": STEP * np.arange(count),
    }
    inputs = suggestion_entries.moved(item, names)
    for place in range(INPUTS):
        column = np.full(count, np.nan)
        if place < len(inputs):
            column[: item.time.size] = item.added[:, names.index(inputs[place])]
        part[f"input_{place}"] = column
    for name in CHANNELS:
        values = getattr(item.flown, name)
        part[name] = values[0]
        part[f"{name}_low"], part[f"{name}_high"] = values.min(axis=0), values.max(axis=0)
    return part
