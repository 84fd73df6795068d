"""Reconstruction of a log beside the truth that its simulator wrote."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs_sysid import aircraft_file, frames
from gcs_sysid.reconstruct import measurements
from gcs_sysid.reconstruct.airborne import airborne
from gcs_sysid.reconstruct.reconstruction import Reconstruction, reconstruct
from gcs_sysid.sources.registry import open_recording


@dataclass(frozen=True)
class Compared:
    """Errors (reconstructed less true) and stated deviations by quantity, SI and radians."""

    states: Reconstruction
    errors: dict[str, np.ndarray]
    deviations: dict[str, np.ndarray]
    seconds: float

    def rms(self, name: str) -> float:
        return float(np.sqrt(np.mean(self.errors[name] ** 2)))

    def stated(self, name: str) -> float:
        return float(np.sqrt(np.mean(self.deviations[name] ** 2)))

    def coverage(self, name: str) -> float:
        """Share of samples within two deviations."""
        return float(np.mean(np.abs(self.errors[name]) < 2.0 * self.deviations[name]))


def reconstructed(log: Path, aircraft: Path) -> Reconstruction:
    """The wing-borne part of a log."""
    recording, believed = open_recording(log), aircraft_file.load(aircraft)
    intervals = airborne(recording, believed)
    data = measurements.select(recording, believed, (intervals[0][0], intervals[-1][1]))
    return reconstruct(data, believed)


def compare(log: Path, aircraft: Path, truth: Path) -> Compared:
    """Reconstructs a log and compares it, sample by sample."""
    begun = clock.perf_counter()
    states = reconstructed(log, aircraft)
    seconds = clock.perf_counter() - begun
    with np.load(truth) as file:
        columns = {str(name): file["rows"][:, i] for i, name in enumerate(file["cols"])}
        offset = (int(file["t0_us"]) - open_recording(log).epoch_us) * 1e-6
    known = columns["t"] + offset
    inside = (states.time >= known[0]) & (states.time <= known[-1])

    def true(name: str) -> np.ndarray:
        values = columns[name].astype(float)
        if name in ("phi", "theta", "psi"):
            values = np.unwrap(values)
        return np.interp(states.time, known, values)

    flow = np.sqrt(np.diagonal(states.flow_covariance, axis1=1, axis2=2))
    errors = {
        "V": states.airspeed - true("V"),
        "alpha": states.alpha - true("alpha"),
        "beta": states.beta - true("beta"),
    }
    deviations = {name: flow[:, index] for index, name in enumerate(errors)}
    steady, gust = states.deviation("wind"), states.deviation("gust")
    for index, axis in enumerate(("north", "east", "down")):
        errors[f"wind_{axis}"] = states.wind[:, index] - true(f"wind_{axis}")
        # Their errors are correlated; the root of the sum of squares is an upper bound of neither.
        deviations[f"wind_{axis}"] = np.hypot(steady[:, index], gust[:, index])
    for index, name in enumerate(("phi", "theta", "psi")):
        errors[name] = frames.wrap(states.euler[:, index] - true(name))
        deviations[name] = states.deviation("attitude")[:, index]
    return Compared(
        states,
        {name: values[inside] for name, values in errors.items()},
        {name: values[inside] for name, values in deviations.items()},
        seconds,
    )
