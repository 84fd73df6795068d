"""`predict`: coefficients of a flight that the model has not seen."""

from __future__ import annotations

import time as clock
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.estimate.surface_delay import Delay
from gcs_sysid.gp import aerodynamics
from gcs_sysid.offline import (
    advice,
    aided_fit,
    documents,
    flight,
    maneuver_choice,
    model_store,
    parquet_file,
    samples_table,
    summary,
)
from gcs_sysid.offline.aided_fit import UnsettledError
from gcs_sysid.offline.flight import Flight, Progress

Method = Literal["auto", "filter-error", "kinematic"]
ASKED, CALM = "asked for", "calm air, in which kinematics know the flow"
LITTLE = 0.02
"""Share of a flight outside what the model was made from that is not worth a warning."""
OUTSIDE = "the model was made from kinematic states, and goes with them"


def run(
    log: Path,
    model_dir: Path,
    *,
    vehicle: int | None,
    segments: Path | None,
    out: Path,
    progress: Progress,
    columns: Path | None = None,
    can: Path | None = None,
    method: Method = "auto",
) -> dict[str, Any]:
    """Predicts a flight and writes `predictions.parquet` and `summary.json` to `out`.

    With kinematic states the surfaces' delay is the one found when the model was made; everything
    else of the flight is reconstructed anew. `columns` says what the columns are where the log is a
    table, `can` is a CAN log of the same flight; surfaces whose position it measured have no delay.
    `method` says whether states are those of kinematics, or those of the filter that holds the
    model; by itself the second in gusts, if the model was made that way.

    Raises:
        InputError: the log or the model cannot be used.
    """
    started = clock.perf_counter()
    stored = model_store.load(model_dir)
    one = flight.read(
        log,
        stored.aircraft,
        vehicle=vehicle,
        segments=maneuver_choice.chooser(segments, stored.aircraft),
        delay=Delay(stored.surface_delay, 0.0, found=True),
        progress=progress,
        columns=columns,
        can=can,
        measured=True,
    )
    one, reason = _with_states(one, stored, method, progress)
    everything = [item.id for item in one.segments]
    table = samples_table.table([one], stored.model, everything, unseen=True)
    parquet_file.write(out / "predictions.parquet", table)
    refused = {
        **{
            name: "the model has no such coefficient: the flights it was made from refused it"
            for name in set(one.samples.measured) - set(stored.model.fits)
        },
        **one.samples.refused,
    }
    document = {
        **summary.header("predict", stored.aircraft, "model"),
        "flights": summary.flights_document([one]),
        "model": {"flights": stored.provenance},
        "method": {"name": "filter_error" if reason is None else "kinematic", "reason": reason},
        "coefficients": summary.scores(table, table["maneuver"] >= 0, refused),
        "derivatives": summary.derivatives(stored.model, stored.aircraft),
        "reconstruction": summary.reconstruction(one),
        "compatibility": summary.compatibility(one),
        "maneuvers": summary.maneuvers([one], everything),
        "envelope": summary.envelope(table, stored.model.controls),
        "trim": summary.trim(table, stored.model.controls),
        "limits": summary.limits(stored.aircraft),
        "warnings": [*advice.warnings([one], stored.model), *_beyond(table, stored)],
        "cannot_tell": [],
    }
    document["timing"] = {
        "read_s": one.read_seconds,
        "reconstruct_s": one.reconstruct_seconds,
        "total_s": clock.perf_counter() - started,
    }
    documents.write_json(out / "summary.json", document)
    return documents.plain(document)


def _with_states(
    one: Flight, stored: model_store.StoredModel, method: Method, progress: Progress
) -> tuple[Flight, str | None]:
    """The flight with the states asked for, and why these are not the filter's, if so."""
    if method == "kinematic":
        return one, ASKED
    if method == "auto" and not stored.inside_filter:
        return one, OUTSIDE
    if method == "auto" and not advice.gusty(one):
        return one, CALM
    known = set(one.samples.measured) & set(stored.model.fits)
    if lacking := [name for name in COEFFICIENTS if name not in known]:
        return one, f"{', '.join(lacking)} refused"
    try:
        return aided_fit.seen_by(one, stored.model, progress).flight, None
    except UnsettledError as error:
        return one, str(error)


def _beyond(table: dict[str, np.ndarray], stored: model_store.StoredModel) -> list[str]:
    """Regressors that left the range the model was fitted on, and processes that were not told."""
    out = []
    used = table["maneuver"] >= 0
    ranges: dict[str, tuple[float, float]] = {}
    for fit in stored.model.fits.values():
        for key, low, high in zip(fit.keys, fit.lowest, fit.highest, strict=True):
            if key in table:
                ranges[key] = (float(low), float(high))
    for key, (low, high) in ranges.items():
        values = table[key][used]
        share = float(np.mean((values < low) | (values > high)))
        if share > LITTLE:
            out.append(
                f"{key} is outside the range the model was fitted on for {100.0 * share:.0f} % of "
                "this flight: the prediction extrapolates there"
            )
    values = {name: table[name][used] for name in stored.model.variables if name in table}
    for name, unknown in aerodynamics.untold(stored.model, values).items():
        share = float(np.mean(unknown))
        if share > LITTLE:
            out.append(
                f"{name}: for {100.0 * share:.0f} % of this flight the Gaussian process has no "
                "data near by and returns to the polynomial: the prediction extrapolates there"
            )
    return out
