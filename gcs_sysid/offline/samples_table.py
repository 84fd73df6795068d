"""The table of samples: `samples.parquet` of `identify`, `predictions.parquet` of `predict`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.errors import InputError
from gcs_sysid.estimate import traces
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.offline import parquet_file
from gcs_sysid.offline.flight import Flight
from gcs_sysid.regressors import VARIABLES

ABSENT = {"alphadot_hat": 0.0, "h_over_b": 10.0}
"""Regressors that the table does not have, as they are in steady flight aloft."""


def table(
    flights: Sequence[Flight],
    model: AeroModel,
    held_out: Sequence[int],
    *,
    unseen: bool = False,
) -> dict[str, np.ndarray]:
    """All flights, one row a sample.

    Columns are `time_us` (log clock), the flow as the aerodynamics feel it (`V` m/s, `qbar` Pa,
    `alpha`, `beta` rad, `phat`, `qhat`, `rhat`), inertial rates, one column a control [rad], for
    each coefficient the measured value and one standard deviation of its noise, and the model's
    value with one standard deviation of the coefficient itself; then attitude, wind, bands and
    maneuver. `alpha_sd` and `beta_sd` are all of the angles' uncertainty, `alpha_lasting_sd` and
    `beta_lasting_sd` the part of it that lasts all flight.

    Args:
        flights: what to tabulate.
        model: whose values to set beside the measured ones.
        held_out: ids of maneuvers that took no part in the fit of `model`.
        unseen: whether `model` was made from other flights. Errors of the flow angles that last a
            flight, a vane's bias above all, are then not those of the fit, and count.
    """
    parts = [_one(index, flight, model, held_out, unseen) for index, flight in enumerate(flights)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _one(
    index: int, flight: Flight, model: AeroModel, held_out: Sequence[int], unseen: bool
) -> dict[str, np.ndarray]:
    samples, states = flight.samples, flight.reconstruction
    flow_deviation = np.sqrt(np.einsum("sii->si", states.flow_covariance))
    piece = flight.pieces()
    columns: dict[str, np.ndarray] = {
        "time_us": flight.recording.time_us(samples.time),
        "V": states.airspeed,
        **{
            name: samples.regressors[name]
            for name in ("qbar", "alpha", "beta", "phat", "qhat", "rhat")
        },
        **dict(zip("pqr", states.rate.T, strict=True)),
        **{name: samples.regressors[name] for name in model.controls},
    }
    predicted = model.predict(samples.regressors, measured=True)
    missing = np.full(samples.time.size, np.nan)
    for name in COEFFICIENTS:
        known = name in predicted
        columns[f"{name}_measured"] = samples.measured.get(name, missing)
        noise = samples.noise.get(name, missing)
        columns[f"{name}_measured_sd"] = (
            noise * np.sqrt(model.fits[name].calibration) if known else noise
        )
        columns[name] = predicted[name].mean if known else missing
        columns[f"{name}_sd"] = predicted[name].deviation if known else missing
        if known and unseen:
            columns[f"{name}_sd"] = np.hypot(
                columns[f"{name}_sd"], _flow_error(samples, model, name)
            )
    columns["region"] = model.region(samples.regressors)
    columns["flight"] = np.full(samples.time.size, index)
    columns["t"] = samples.time
    columns |= dict(zip(("phi", "theta", "psi"), states.euler.T, strict=True))
    columns |= dict(zip(("V_sd", "alpha_sd", "beta_sd"), flow_deviation.T, strict=True))
    for name in ("alpha", "beta"):
        lasting = np.sqrt(samples.regressor_lasting.get(name, np.zeros(samples.time.size)))
        columns[f"{name}_sd"] = np.hypot(columns[f"{name}_sd"], lasting)
        columns[f"{name}_lasting_sd"] = lasting
    columns |= dict(zip(("wind_north", "wind_east", "wind_down"), states.wind.T, strict=True))
    columns["thrust_coefficient"] = samples.regressors["Tc"]
    columns["maneuver"] = piece
    columns["held_out"] = np.isin(piece, np.asarray(list(held_out), dtype=int))
    return columns


def regressors(
    table: Mapping[str, np.ndarray], controls: Sequence[str]
) -> dict[str, Float[np.ndarray, " sample"]]:
    """Columns of the table under the names that regressors have; what it lacks is `ABSENT`."""
    count = np.asarray(table["t"]).size
    out = {name: np.full(count, value) for name, value in ABSENT.items()}
    out["Tc"] = np.asarray(table["thrust_coefficient"], dtype=float)
    names = (*VARIABLES, *controls)
    return out | {name: np.asarray(table[name], dtype=float) for name in names if name in table}


def beside(model_dir: Path) -> Path | None:
    """The samples that `identify` writes beside a model; None where they are not there."""
    paths = (folder / "samples.parquet" for folder in (model_dir, model_dir.parent))
    return next((path for path in paths if path.is_file()), None)


def flown(model_dir: Path, model: AeroModel) -> dict[str, np.ndarray]:
    """Every variable along the flights of a model, and what `traces` needs beside it.

    Raises:
        InputError: the samples that `identify` writes beside the model are not there.
    """
    path = beside(model_dir)
    if path is None:
        raise InputError(
            str(model_dir),
            "has no samples.parquet beside it, without which nobody knows what its flights say of "
            "these causes",
            fix="give the folder that identify wrote, or identify again",
        )
    table = parquet_file.read(path)
    found = regressors(table, model.controls)
    each = np.unique(table["flight"])
    parts = [
        traces.values(
            {name: column[table["flight"] == one] for name, column in found.items()},
            model.controls,
            table["t"][table["flight"] == one],
        )
        for one in each
    ]
    return found | {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _flow_error(samples: Samples, model: AeroModel, name: str) -> Float[np.ndarray, " sample"]:
    """One standard deviation that the errors of the flow angles give a predicted coefficient."""
    total = np.zeros(samples.time.size)
    for variable in ("alpha", "beta"):
        slope = model.derivative(name, variable, samples.regressors).mean
        total += slope**2 * samples.regressor_variance[variable]
    return np.sqrt(total)
