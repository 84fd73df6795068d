"""Gaussian processes in a run: learned beside the polynomial, told in the summary, kept on disk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Shaped

from gcs_sysid.aircraft import COEFFICIENTS, Aircraft
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.estimate.stepwise import MOTION
from gcs_sysid.gp import confidence, fitting
from gcs_sysid.gp.aerodynamics import LearnedModel
from gcs_sysid.gp.confidence import Flown
from gcs_sysid.gp.dependent import Kernel, Points
from gcs_sysid.gp.fitting import Data, Effort, Fitted
from gcs_sysid.gp.inducing import Basis
from gcs_sysid.gp.local import Shape, Store, built
from gcs_sysid.gp.posterior import Posterior
from gcs_sysid.gp.refresh import Settings
from gcs_sysid.gp.samples import Scaling
from gcs_sysid.offline import samples_table
from gcs_sysid.offline.flight import Flight

EFFORT = Effort(settings=Settings(starts=1, steps=30))
"""One start: whatever it finds is judged on what it has not seen."""


def beside(
    model: AeroModel, flights: Sequence[Flight], kept: Sequence[int] | None
) -> AeroModel | LearnedModel:
    """The polynomial with Gaussian processes of what it leaves, as far as these earned their place.

    Args:
        model: polynomial, fitted to the same maneuvers.
        flights: measured coefficients.
        kept: ids of the maneuvers to learn from; None for all.
    """
    data = samples(model, flights, kept)
    found = fitting.fit(data, EFFORT)
    if not (found.use_global.any() or found.use_local.any()):
        return model
    return LearnedModel(model.fits, model.controls, found, inputs(model), outputs(model))


def after_all(model: AeroModel, judged: AeroModel, flights: Sequence[Flight]) -> AeroModel:
    """A polynomial of all maneuvers with the processes that were judged on some, after all."""
    if not isinstance(judged, LearnedModel):
        return model
    data = samples(model, flights, None)
    found = fitting.more(judged.process, data, EFFORT)
    return LearnedModel(model.fits, model.controls, found, judged.inputs, judged.outputs)


def inputs(model: AeroModel) -> tuple[str, ...]:
    """What the processes are functions of: flow angles, rates and controls."""
    return (*MOTION, *model.controls)


def outputs(model: AeroModel) -> tuple[str, ...]:
    """What they are of: every coefficient that the flights gave."""
    return tuple(name for name in COEFFICIENTS if name in model.fits)


def samples(model: AeroModel, flights: Sequence[Flight], kept: Sequence[int] | None) -> Data:
    """What the polynomial leaves at the samples of some maneuvers.

    A coefficient that one flight could not measure is missing there, and only there.
    """
    parts = [_part(index, model, flight, kept) for index, flight in enumerate(flights)]
    stacked = [np.concatenate(part) for part in zip(*parts, strict=True)]
    step = float(np.median(np.diff(flights[0].samples.time)))
    return Data(*stacked, step=step)


def _part(
    index: int, model: AeroModel, flight: Flight, kept: Sequence[int] | None
) -> tuple[np.ndarray, ...]:
    piece = flight.pieces(kept)
    used: Bool[np.ndarray, " sample"] = piece >= 0
    values = {name: np.asarray(each)[used] for name, each in flight.samples.regressors.items()}
    names, kinds = inputs(model), outputs(model)
    predicted = model.predict(values, measured=True)
    missing = np.full(int(used.sum()), np.nan)
    left, variance = [], []
    for name in kinds:
        measured = flight.samples.measured.get(name)
        left.append(missing if measured is None else measured[used] - predicted[name].mean)
        noise = flight.samples.noise.get(name)
        variance.append(
            np.full(missing.size, np.inf)
            if noise is None
            else noise[used] ** 2 * model.fits[name].calibration
        )
    uncertain = flight.samples.regressor_variance
    spread = [uncertain[name][used] if name in uncertain else 0.0 * missing for name in names]
    spread = [np.nan_to_num(each) for each in spread]
    slopes = np.zeros((missing.size, len(kinds), len(names)))
    for row, kind in enumerate(kinds):
        for column, name in enumerate(names):
            if name in uncertain and name in model.depends_on(kind):
                slopes[:, row, column] = model.derivative(kind, name, values).mean
    return (
        np.stack([values[name] for name in names], axis=1),
        np.stack(left, axis=1),
        np.stack(variance, axis=1),
        np.stack(spread, axis=1),
        slopes,
        piece[used] + 1_000_000 * index,
    )


def told(model: AeroModel) -> dict[str, Any]:
    """What the processes found, for `summary.json`: which parts were kept, and what for."""
    if not isinstance(model, LearnedModel):
        return {
            "kept": False,
            "reason": "maneuvers left out were foretold no better with Gaussian processes than "
            "by the polynomial alone",
        }
    process = model.process
    return {
        "kept": True,
        "inputs": list(model.inputs),
        "points": int(process.posterior.weights.shape[0]),
        "coefficients": {
            name: {
                "global": bool(process.use_global[row]),
                "local": bool(process.use_local[row]),
                "gain_global_nats": float(process.gain.global_part[row]),
                "gain_local_nats": float(process.gain.local_part[row]),
                "independent_samples": float(process.gain.samples[row]),
                "discrepancy_sd": float(np.sqrt(process.discrepancy[row])),
            }
            for row, name in enumerate(model.outputs)
        },
    }


def confidence_map(
    model: AeroModel, aircraft: Aircraft, table: Mapping[str, Shaped[np.ndarray, " sample"]]
) -> dict[str, Any]:
    """The confidence map of `summary.json`, over the aircraft file's envelope.

    Without an envelope in the file it is over what the flights visited.
    """
    used = np.asarray(table["maneuver"]) >= 0
    values = {
        name: column[used]
        for name, column in samples_table.regressors(table, model.controls).items()
    }
    limits = aircraft.envelope
    visited = {name: np.percentile(values[name], (0.5, 99.5)) for name in ("alpha", "beta")}
    alpha, beta = (
        (visited["alpha"], visited["beta"]) if limits is None else (limits.alpha, limits.beta)
    )
    flown = Flown(
        values=values,
        measured={name: np.asarray(table[f"{name}_measured"])[used] for name in model.fits},
        step=float(np.median(np.diff(np.asarray(table["t"])))),
    )
    found = confidence.over_envelope(
        model, flown, alpha=(alpha[0], alpha[1]), beta=(beta[0], beta[1])
    )
    return confidence.document(found)


def arrays(model: LearnedModel) -> dict[str, np.ndarray]:
    """Everything of the processes that is an array, by name, for the model's file."""
    process = model.process
    groups = {
        "scaling": process.scaling,
        "kernel": process.base.kernel,
        "points": process.base.points,
    }
    out = {
        f"{group}.{name}": np.asarray(value)
        for group, one in groups.items()
        for name, value in one._asdict().items()
    }
    base, whole = process.base, process.posterior
    out |= {
        "noise": np.asarray(base.noise),
        "repeats": np.asarray(base.repeats),
        "factor": np.asarray(base.factor),
        "weights": np.asarray(whole.weights),
        "reduction": np.asarray(whole.reduction),
        "use_global": process.use_global,
        "use_local": process.use_local,
        "discrepancy": process.discrepancy,
        "gain.global_part": process.gain.global_part,
        "gain.local_part": process.gain.local_part,
        "gain.samples": process.gain.samples,
    }
    if process.local is not None:
        for group, one in (("shape", process.local.shape), ("store", process.local.store)):
            out |= {f"{group}.{name}": value for name, value in one._asdict().items()}
    return {f"process.{name}": value for name, value in out.items()}


def from_arrays(
    model: AeroModel, entry: Mapping[str, Any], stored: Mapping[str, np.ndarray]
) -> LearnedModel:
    """The model that `arrays` was made of.

    Raises:
        KeyError: an array is missing.
        ValueError: arrays and names do not fit each other.
    """

    def of(kind: Any, group: str) -> Any:
        return kind(**{name: stored[f"process.{group}.{name}"] for name in kind._fields})

    def one(name: str) -> np.ndarray:
        return stored[f"process.{name}"]

    kernel, points = of(Kernel, "kernel"), of(Points, "points")
    local = None
    if "process.store.inputs" in stored:
        local = built(of(Shape, "shape"), of(Store, "store"))
    process = Fitted(
        scaling=of(Scaling, "scaling"),
        base=Basis(kernel, one("noise"), one("repeats"), points, one("factor")),
        posterior=Posterior(kernel, points, one("weights"), one("reduction")),
        local=local,
        use_global=one("use_global").astype(bool),
        use_local=one("use_local").astype(bool),
        discrepancy=one("discrepancy"),
        gain=fitting.Gain(
            *(one(f"gain.{name}") for name in ("global_part", "local_part", "samples"))
        ),
    )
    names, kinds = tuple(entry["inputs"]), tuple(entry["outputs"])
    if process.scaling.centre.shape != (len(names),) or process.use_global.shape != (len(kinds),):
        raise ValueError("the learned model's arrays do not fit its inputs and outputs")
    return LearnedModel(model.fits, model.controls, process, names, kinds)
