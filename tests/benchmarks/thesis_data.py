"""Flights of the thesis's comparison: samples as identified, and the truth at the same instants."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np  # noqa: E402 - after the number of threads
import pyarrow.parquet as pq  # noqa: E402

from gcs_sysid import aircraft_file  # noqa: E402 - needs the path above
from gcs_sysid.aircraft import COEFFICIENTS, Aircraft  # noqa: E402
from gcs_sysid.cli import entry  # noqa: E402
from gcs_sysid.gp import fitting  # noqa: E402
from gcs_sysid.gp.fitting import Data, Effort, Fitted  # noqa: E402
from gcs_sysid.gp.learning import Structure  # noqa: E402
from gcs_sysid.gp.refresh import Settings  # noqa: E402

EFFORT = Effort(
    settings=Settings(
        structure=Structure(latents=2), points=250, rows=600, scaffold=25, starts=2, steps=60
    ),
    always=True,
)
Row = tuple[object, ...]
MOTION = ("alpha", "beta", "phat", "qhat", "rhat")
Table = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Flight:
    """One flight's samples inside maneuvers.

    Attributes:
        table: as `identify` or `predict` left it.
        true_inputs: what the aerodynamics felt, at the same instants.
        true_values: the coefficients that flew.
    """

    table: Table
    true_inputs: np.ndarray
    true_values: np.ndarray

    def inputs(self, names: Sequence[str]) -> np.ndarray:
        """Regressors as reconstructed."""
        return np.stack([self.table[name] for name in names], axis=1)

    def lasting(self, names: Sequence[str]) -> np.ndarray:
        """Mean over the flight of the variance of each regressor's error that lasts all of it."""
        columns = [self.table.get(f"{name}_lasting_sd", np.zeros(1)) for name in names]
        return np.array([np.mean(column**2) for column in columns])

    @property
    def measured(self) -> np.ndarray:
        """Measured coefficients."""
        return np.stack([self.table[f"{name}_measured"] for name in COEFFICIENTS], axis=1)

    @property
    def noise(self) -> np.ndarray:
        """One standard deviation of the noise of each."""
        return np.stack([self.table[f"{name}_measured_sd"] for name in COEFFICIENTS], axis=1)


def run(*arguments: str | Path) -> None:
    """A command of the program, quietly."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        status = entry.main([str(argument) for argument in arguments])
    if status:
        raise SystemExit(f"{' '.join(map(str, arguments))}: ended with {status}")


def load(table: Path, truth: Path, aircraft: Path) -> Flight:
    """Reads a table of samples and the truth of its flight."""
    whole = pq.read_table(table)
    columns = {
        name: column.to_numpy()
        for name, column in zip(whole.column_names, whole.columns, strict=True)
    }
    used = columns["maneuver"] >= 0
    columns = {name: column[used] for name, column in columns.items()}
    described = aircraft_file.load(aircraft)
    with np.load(truth) as stored:
        time = (columns["time_us"] - int(stored["t0_us"])) * 1e-6
        ticks = dict(zip(stored["cols"].tolist(), stored["rows"].T.astype(float), strict=True))
    at = {name: np.interp(time, ticks["t"], column) for name, column in ticks.items()}
    return Flight(
        columns,
        np.stack([_felt(at, described)[name] for name in names(described)], axis=1),
        np.stack([at[name] for name in COEFFICIENTS], axis=1),
    )


def names(aircraft: Aircraft) -> tuple[str, ...]:
    """Inputs of the processes."""
    return (*MOTION, *aircraft.control_names)


def _felt(at: Table, aircraft: Aircraft) -> Table:
    shape = aircraft.geometry
    return {
        **at,
        "phat": at["p_air"] * shape.wing_span / (2.0 * at["V"]),
        "qhat": at["q_air"] * shape.mean_chord / (2.0 * at["V"]),
        "rhat": at["r_air"] * shape.wing_span / (2.0 * at["V"]),
    }


def data(flight: Flight, inputs: Sequence[str], *, truth: bool = False) -> Data:
    """Samples for a process of zero mean, by their regressors as reconstructed or as they were."""
    values = flight.measured
    count = values.shape[0]
    table = flight.table
    spread = np.zeros((count, len(inputs)))
    if not truth:
        for column, name in enumerate(inputs):
            if f"{name}_sd" in table:
                spread[:, column] = table[f"{name}_sd"] ** 2 - table[f"{name}_lasting_sd"] ** 2
    where = flight.true_inputs if truth else flight.inputs(inputs)
    return Data(
        inputs=where,
        values=values - values.mean(axis=0),
        variance=flight.noise**2,
        input_variance=spread,
        slopes=np.zeros((count, values.shape[1], len(inputs))),
        piece=table["maneuver"],
        step=float(np.median(np.diff(table["t"]))),
    )


def learned(
    flight: Flight, inputs: Sequence[str], effort: Effort, *, truth: bool = False
) -> Fitted:
    """Processes without any prior structure."""
    return fitting.fit(data(flight, inputs, truth=truth), effort)


def error(found: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """100·std(found − wanted)/std(wanted) of each column."""
    return 100.0 * np.std(found - wanted, axis=0) / np.std(wanted, axis=0)


def nlpd(found: np.ndarray, deviation: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Mean negative log density of each column [nat]."""
    ratio = (wanted - found) / deviation
    return np.mean(0.5 * ratio**2 + np.log(deviation) + 0.5 * np.log(2.0 * np.pi), axis=0)


def coverage(found: np.ndarray, deviation: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Share inside 95 % intervals of each column."""
    return np.mean(np.abs(wanted - found) < 1.959964 * deviation, axis=0)


def rounded(values: np.ndarray) -> list[str]:
    """Percentages as they are read."""
    return [f"{value:.1f}" for value in values]


def means(cells: Sequence[np.ndarray] | Sequence[Sequence[float]]) -> list[str]:
    """Of each coefficient, of the cells of forces, and of those of moments; one row a flight."""
    each = np.array(cells)
    return rounded(np.array([*each.mean(axis=0), each[:, :3].mean(), each[:, 3:].mean()]))


def with_structure(effort: Effort, *, latents: int, local: bool, seed: int = 0) -> Effort:
    """The same effort on processes with so many shared ones, with or without a local part."""
    settings = replace(effort.settings, structure=Structure(latents=latents), seed=seed)
    return replace(effort, settings=settings, local=local)
