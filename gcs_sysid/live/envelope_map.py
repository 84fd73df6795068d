"""Where the flight has been, and how well the coefficients are known there.

Seconds of flight are counted in cells of angle of attack and sideslip, of angle of attack and each
longitudinal control, and of airspeed. A cell is known where one standard deviation of a coefficient
is below `LEVEL` of the coefficient's spread over the flight so far; everything else stands at its
mean over the flight. Memory does not grow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from gcs_sysid import regressors
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.gp.confidence import LEVEL, SHORTEST
from gcs_sysid.live.flying import slowest
from gcs_sysid.live.regression import Solution

CELLS = 8
FRESH_S = 5.0
"""The map is computed anew so often [s of flight]: every cell costs, and it fills slowly."""
USUAL_ALPHA = (-0.10, 0.25)
USUAL_BETA = (-0.25, 0.25)
"""Limits for files without an envelope [rad]."""
FASTEST = 3.0
"""The same for airspeed, over the slowest."""
Values = Mapping[str, Float[np.ndarray, " cell"]]
Deviation = Callable[[Values], Values]
"""From regressors to one standard deviation of each coefficient that is known at all."""


class EnvelopeMap:
    """Cells filling as the aircraft flies.

    Args:
        aircraft: its envelope and controls.
    """

    def __init__(self, aircraft: Aircraft) -> None:
        limits = _limits(aircraft)
        pitch = [name for name in aircraft.control_names if _turns_nose(name)][:1]
        self.planes = [("alpha", "beta"), *(("alpha", name) for name in pitch)]
        self._edges = {name: np.linspace(*limits[name], CELLS + 1) for name in limits}
        self._seconds = {plane: np.zeros((CELLS, CELLS)) for plane in self.planes}
        self._speeds = np.zeros(CELLS)
        self._count = 0
        self._sums: dict[str, np.ndarray] = {}
        self._told: tuple[str, float, dict[str, Any]] = ("", -np.inf, {})

    def take(self, samples: Samples, kept: slice) -> None:
        """Counts the rows `kept` of a window."""
        values = {name: value[kept] for name, value in samples.regressors.items()}
        step = float(np.median(np.diff(samples.time)))
        for plane, seconds in self._seconds.items():
            bins = [self._edges[name] for name in plane]
            seconds += step * np.histogram2d(*(values[name] for name in plane), bins=bins)[0]
        self._speeds += step * np.histogram(values["V"], bins=self._edges["V"])[0]
        self._count += values["alpha"].size
        measured = {name: value[kept] for name, value in samples.measured.items()}
        for name, column in (*values.items(), *measured.items()):
            part = np.array([column.sum(), column @ column])
            self._sums[name] = self._sums.get(name, np.zeros(2)) + part

    def lately(self, by: str, now: float, deviation: Deviation) -> dict[str, Any]:
        """The `document` by something, no older than `FRESH_S`."""
        known_by, told_at, _ = self._told
        if by != known_by or not 0.0 <= now - told_at < FRESH_S:
            self._told = (by, now, {"by": by, **self.document(deviation)})
        return self._told[2]

    def document(self, deviation: Deviation) -> dict[str, Any]:
        """Edges, seconds, and the coefficients' deviations over their spread, plane by plane."""
        return {
            "level": LEVEL,
            "least_s": SHORTEST,
            "speed": {
                "edges": _rounded(self._edges["V"]),
                "seconds": _rounded(self._speeds),
            },
            "planes": [
                {
                    "x": plane[0],
                    "y": plane[1],
                    "x_edges": _rounded(self._edges[plane[0]]),
                    "y_edges": _rounded(self._edges[plane[1]]),
                    "seconds": _rounded(self._seconds[plane]),
                    "share_of_spread": self._shares(plane, deviation),
                }
                for plane in self.planes
            ],
        }

    def _shares(self, plane: tuple[str, str], deviation: Deviation) -> dict[str, list[list[float]]]:
        if not self._count:
            return {}
        middles = [0.5 * (self._edges[name][1:] + self._edges[name][:-1]) for name in plane]
        grid = np.meshgrid(*middles, indexing="ij")
        here = {name: np.full(CELLS**2, sums[0] / self._count) for name, sums in self._sums.items()}
        here |= {name: values.ravel() for name, values in zip(plane, grid, strict=True)}
        return {
            name: _rounded((one / self._spread(name)).reshape(CELLS, CELLS))
            for name, one in deviation(here).items()
            if name in self._sums
        }

    def _spread(self, name: str) -> float:
        total, square = self._sums[name]
        variance = square / self._count - (total / self._count) ** 2
        return float(max(np.sqrt(max(variance, 0.0)), 1e-9))


def of_first_model(found: Mapping[str, Solution], controls: Sequence[str]) -> Deviation:
    """By the first model, which is a polynomial: as sure outside as inside of what was flown."""

    def deviation(here: Values) -> Values:
        out = {}
        for name, one in found.items():
            parsed = [regressors.parse(key, controls=controls) for key in one.keys]
            columns = np.stack([regressors.evaluate(each, here) for each in parsed])
            variance = np.einsum("ic,ij,jc->c", columns, one.covariance, columns)
            out[name] = np.sqrt(np.maximum(variance, 0.0))
        return out

    return deviation


def _turns_nose(name: str) -> bool:
    return regressors.control_kind(name) == "longitudinal" and "flap" not in name


def _limits(aircraft: Aircraft) -> dict[str, tuple[float, float]]:
    flown = aircraft.envelope
    low = slowest(aircraft)
    limits = {
        "alpha": USUAL_ALPHA if flown is None else flown.alpha,
        "beta": USUAL_BETA if flown is None else flown.beta,
        "V": (low, FASTEST * low) if flown is None else flown.airspeed,
    }
    travel = {servo.surface: servo.deflection for servo in aircraft.servos}
    for control in aircraft.controls:
        ends = [
            sum(gain * pick(travel[name]) for name, gain in control.mix.items() if name in travel)
            for pick in (min, max)
        ]
        limits[control.name] = (min(ends), max(ends)) if min(ends) < max(ends) else (-0.5, 0.5)
    return limits


def _rounded(values: Float[np.ndarray, ...]) -> Any:
    """As lists of four digits: a document is written every second."""
    return np.round(values, 4).tolist()
