"""How tightly the autopilot held the aircraft that a model is from, for `suggest`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.maneuvers import axes, flown_hold
from gcs_sysid.maneuvers.design import Condition
from gcs_sysid.maneuvers.flown_hold import TURNED, Answer, Flight, FlownHold
from gcs_sysid.offline import parquet_file, samples_table


def found(model_dir: Path, model: AeroModel, aircraft: Aircraft) -> FlownHold | None:
    """What the controls answered to in the flights of a model; None where nothing tells."""
    path = samples_table.beside(model_dir)
    if path is None:
        return None
    table = parquet_file.read(path)
    flights = [_flight(table, table["flight"] == one, model) for one in np.unique(table["flight"])]
    return flown_hold.found(aircraft, axes.found(aircraft, model), flights)


def _flight(table: Mapping[str, np.ndarray], rows: np.ndarray, model: AeroModel) -> Flight:
    return Flight(
        table["t"][rows],
        table["qbar"][rows],
        {name: table[name][rows] for name in model.controls},
        np.stack([table[name][rows] for name in TURNED], axis=1),
    )


def described(hold: FlownHold | None, at: Condition) -> dict[str, dict[str, Any]]:
    """By control: whether its hold is the one that flew, and what it answered to."""
    names = at.aircraft.control_names
    if hold is None:
        return {name: _control(None, flies=False) for name in names}
    flies = hold.flies(at.linear, names)
    return {name: _control(hold.answers.get(name), flies=name in flies) for name in names}


def _control(answer: Answer | None, *, flies: bool) -> dict[str, Any]:
    source = "flown" if flies else "assumed"
    if answer is None:
        return {"source": source, "explained": None, "windows": 0, "gain": {}}
    gains = zip(TURNED, answer.gain, answer.deviation, strict=True)
    return {
        "source": source,
        "explained": answer.explained,
        "windows": answer.windows,
        "gain": {name: {"value": value, "sd": sd} for name, value, sd in gains if sd > 0.0},
    }
