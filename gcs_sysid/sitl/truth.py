"""What really happened in a flight, kept row by row, and the file it goes to."""

from __future__ import annotations

import json
from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.errors import UsageError
from gcs_sysid.sitl.autopilot import PERIOD
from gcs_sysid.sitl.flight import Flight
from gcs_sysid.sitl.jsbsim_aircraft import State
from gcs_sysid.sitl.telemetry import TICK_RATE
from gcs_sysid.sitl.vehicle import Vehicle

_STATE_COLUMNS = (
    *("V", "qbar", "alpha", "beta", "p", "q", "r", "p_air", "q_air", "r_air"),
    *("v_north", "v_east", "v_down", "wind_north", "wind_east", "wind_down"),
)
_ATTITUDE_COLUMNS = ("phi", "theta", "psi")


@dataclass(frozen=True)
class Truth:
    """What really happened, one row a tick: SI, rad, `t` in s after `t0_us`.

    `p q r` are inertial, `p_air …` what the aerodynamics feel, `wind_*` with gusts, `V` true
    airspeed; controls are where the surfaces stood, `mass`, where fuel is burnt, what is left.
    """

    columns: tuple[str, ...]
    rows: Float[np.ndarray, "tick column"]
    t0_us: int

    def column(self, name: str) -> Float[np.ndarray, " tick"]:
        """One column."""
        return self.rows[:, self.columns.index(name)]


class Witness:
    """Sees a flight tick by tick.

    Args:
        flight: that is seen.
    """

    def __init__(self, flight: Flight) -> None:
        self._epoch_us = flight.epoch_us
        self._columns: tuple[str, ...] = (
            "t",
            *_STATE_COLUMNS,
            "thrust",
            *COEFFICIENTS,
            *flight.flown.control_names,
            *_ATTITUDE_COLUMNS,
            *(("mass",) if flight.fuel else ()),
        )
        self._burns = flight.fuel is not None
        # Plain numbers: an hour is 45 MB.
        self._values = array("d")

    def see(self, tick: int, state: State, vehicle: Vehicle) -> None:
        """Keep the present instant."""
        self._values.append(tick * PERIOD)
        self._values.extend(getattr(state, name) for name in _STATE_COLUMNS)
        self._values.append(vehicle.thrust())
        self._values.extend(getattr(state, name) for name in COEFFICIENTS)
        self._values.extend(vehicle.controls().values())
        self._values.extend(getattr(state, name) for name in _ATTITUDE_COLUMNS)
        if self._burns:
            self._values.append(vehicle.mass())

    def truth(self) -> Truth:
        """What has been seen so far."""
        rows = np.array(self._values).reshape(-1, len(self._columns))
        return Truth(self._columns, rows, self._epoch_us)


def save(
    truth: Truth,
    path: Path,
    *,
    rate: int = TICK_RATE,
    told: Mapping[str, Any] | None = None,
) -> None:
    """Write the truth as .npz: `rows`, `cols`, `t0_us`; single precision below the full rate.

    Args:
        truth: of a flight.
        path: .npz to write.
        rate: rows a second.
        told: written as JSON beside it where there is something: what is hidden, and how large.

    Raises:
        UsageError: `rate`, in rows a second, does not divide the full one.
    """
    if TICK_RATE % rate:
        raise UsageError(f"truth at {rate} Hz: `rate` must divide {TICK_RATE}")
    rows = truth.rows[:: TICK_RATE // rate]
    if rate < TICK_RATE:
        rows = rows.astype(np.float32)
    with path.open("wb") as file:
        np.savez_compressed(
            file, rows=rows, cols=np.array(truth.columns), t0_us=np.array(truth.t0_us)
        )
    if told:
        beside(path).write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


def beside(path: Path) -> Path:
    """Where it is told what is hidden in a flight whose truth is written to `path`."""
    return path.with_suffix(".json")
