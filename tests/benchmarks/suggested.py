"""What a suggestion says to fly, as legs of a simulated flight."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from gcs_sysid.sitl.inputs import THROTTLE, TestInput
from gcs_sysid.sitl.plan import Leg

STEP = 0.02
"""Between samples of an input [s]."""
SETTLE, AFTER = 5.0, 3.0
"""Straight and level before a run, and hands off after it [s]."""
TURN = 14.0
"""To turn round [s]."""


class Run(NamedTuple):
    """One input: the airspeed it is flown at [m/s], how long [s], and its samples by control."""

    airspeed: float
    duration: float
    columns: Mapping[str, Float[np.ndarray, " sample"]]


def columns(path: Path, *, share: float = 1.0) -> dict[str, Float[np.ndarray, " sample"]]:
    """Samples of a maneuver's CSV by control [rad], and of the throttle (0 to 1)."""
    head, *rows = path.read_text(encoding="utf-8").splitlines()
    values = share * np.array([[float(cell) for cell in row.split(",")] for row in rows])
    return {
        name: values[:, place] * (1.0 if name == THROTTLE else math.radians(1.0))
        for place, name in enumerate(head.split(","))
        if name != "t"
    }


def sortie(document: Mapping[str, Any], folder: Path) -> list[Run]:
    """Every run of a suggestion's sortie, careful ones too, from the files in its folder."""
    entries = {item["name"]: item for item in document["maneuvers"]}
    return [
        Run(
            entries[step["maneuver"]]["entry"]["airspeed"],
            entries[step["maneuver"]]["duration_s"],
            columns(folder / entries[step["maneuver"]]["csv"], share=step["share"]),
        )
        for step in document["sortie"]["steps"]
    ]


def legs(runs: Sequence[Run], height: float) -> list[Leg]:
    """Two runs a leg, legs out and back, at a height [m]."""
    found: list[Leg] = []
    for place in range(0, len(runs), 2):
        heading = math.radians(0.0 if place % 4 == 0 else 170.0)
        if place:
            found.append(Leg("turn", TURN, runs[place].airspeed, height, heading))
        for run in runs[place : place + 2]:
            inputs = tuple(
                TestInput(
                    name,
                    "samples",
                    SETTLE,
                    STEP * values.size,
                    1.0,
                    values=tuple(map(float, values)),
                )
                for name, values in run.columns.items()
                if np.abs(values).max() > 0.0
            )
            length = SETTLE + run.duration + AFTER
            found.append(Leg("run", length, run.airspeed, height, heading, inputs=inputs))
    return found
