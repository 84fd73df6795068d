"""`identify`: from recorded flights to coefficients, a model and a summary.

Two fits are made. The first leaves the held-out maneuvers out and is what the scores and the
samples table show; the second, on all maneuvers, is the model that is kept.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from gcs_sysid import aircraft_file, regressors
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import RefusedError, UsageError
from gcs_sysid.estimate import equation_error, stepwise
from gcs_sysid.estimate.result import AeroModel, Prior
from gcs_sysid.offline import (
    advice,
    documents,
    flight,
    learned,
    maneuver_choice,
    model_store,
    samples_table,
    summary,
    unused_keys,
)
from gcs_sysid.offline.flight import Flight, Progress
from gcs_sysid.reconstruct.segments import split

FLIGHT_IDS = 1000
"""Maneuver ids of the second flight start here, those of the third at twice this."""


def run(
    logs: Sequence[Path],
    aircraft: Path,
    *,
    prior: Literal["file", "none"],
    segments: Path | None,
    vehicle: int | None,
    stepwise: bool,
    out: Path,
    progress: Progress,
    columns: Path | None = None,
    can: Path | None = None,
) -> dict[str, Any]:
    """Identifies an aircraft and writes `model/`, `samples.parquet` and `summary.json` to `out`.

    Args:
        logs: recorded flights of the same aircraft.
        aircraft: its file.
        prior: start from the file's aerodynamics, or ignore their values.
        segments: maneuvers to use; for a single log.
        vehicle: which vehicle of the logs.
        stepwise: choose the terms by the data.
        out: directory for the results.
        progress: told what is being done.
        columns: what the columns are of those logs that are tables.
        can: a CAN log of the same flight; for a single log.

    Returns:
        The summary document.

    Raises:
        InputError: a log cannot be used.
        UsageError: a segments file or a CAN log with several logs.
    """
    started = clock.perf_counter()
    if segments is not None and len(logs) > 1:
        raise UsageError("--segments goes with one LOG; give each log its own run, or leave it out")
    if can is not None and len(logs) > 1:
        raise UsageError("--can goes with one LOG; give each log its own run, or leave it out")
    described = aircraft_file.load(aircraft)
    flights = _read(logs, described, segments, vehicle, columns, can, progress)
    described = flight.without_controls(described, {name for one in flights for name in one.absent})
    fitting = clock.perf_counter()
    progress("fitting the model", 0.9)
    believed = file_prior(described) if prior == "file" else None
    structure = _structure(flights, described, by_data=stepwise)
    kept, held_out = split([item for one in flights for item in one.segments])
    scored = _fit(flights, described, structure, kept, believed)
    scored = learned.beside(scored, flights, kept)
    final = _fit(flights, described, structure, None, believed)
    final = learned.after_all(final, scored, flights)
    table = samples_table.table(flights, scored, held_out)
    delay = sum(one.delay.value for one in flights) / len(flights)
    provenance = summary.flights_document(flights)
    model_store.save(out / "model", model_store.StoredModel(final, described, delay, provenance))
    documents.write_table(out / "samples.parquet", table)
    document = _document(flights, described, final, table, held_out, prior)
    done = clock.perf_counter()
    document["timing"] = {
        "read_s": sum(one.read_seconds for one in flights),
        "reconstruct_s": sum(one.reconstruct_seconds for one in flights),
        "fit_s": done - fitting,
        "total_s": done - started,
    }
    documents.write_json(out / "summary.json", document)
    return documents.plain(document)


def _read(
    logs: Sequence[Path],
    aircraft: Aircraft,
    segments: Path | None,
    vehicle: int | None,
    columns: Path | None,
    can: Path | None,
    progress: Progress,
) -> list[Flight]:
    flights = []
    for index, log in enumerate(logs):

        def part(text: str, share: float, index: int = index) -> None:
            progress(text, 0.9 * (index + share) / len(logs))

        one = flight.read(
            log,
            aircraft,
            vehicle=vehicle,
            segments=maneuver_choice.chooser(segments, aircraft),
            delay=None,
            progress=part,
            columns=columns,
            can=can,
            measured=True,
        )
        flights.append(
            replace(
                one,
                segments=tuple(
                    replace(item, id=item.id + FLIGHT_IDS * index) for item in one.segments
                ),
            )
        )
    return flights


def file_prior(aircraft: Aircraft) -> dict[str, Prior]:
    """The file's aerodynamics as values believed beforehand."""
    return {
        name: Prior(
            value={key: item.value for key, item in model.terms.items()},
            sigma={key: item.sigma for key, item in model.terms.items()},
        )
        for name, model in aircraft.aerodynamics.items()
    }


def _structure(
    flights: Sequence[Flight], aircraft: Aircraft, *, by_data: bool
) -> Mapping[str, Sequence[str]]:
    usual = regressors.default_structure(aircraft)
    if not by_data:
        return usual
    samples = [one.samples for one in flights]
    return stepwise.choose(samples, aircraft, usual, [one.pieces() for one in flights])


def _fit(
    flights: Sequence[Flight],
    aircraft: Aircraft,
    structure: Mapping[str, Sequence[str]],
    kept: Sequence[int] | None,
    prior: Mapping[str, Prior] | None,
) -> AeroModel:
    pieces = [one.pieces(kept) for one in flights]
    if not any((piece >= 0).any() for piece in pieces):
        raise RefusedError(
            flights[0].recording.source,
            "no maneuver is left to fit",
            fix="leave at least one maneuver with `held_out` false in the segments file",
        )
    samples = [one.samples for one in flights]
    return equation_error.fit(samples, aircraft, structure, pieces, prior=prior)


def _document(
    flights: Sequence[Flight],
    aircraft: Aircraft,
    model: AeroModel,
    table: Mapping[str, Any],
    held_out: Sequence[int],
    prior: str,
) -> dict[str, Any]:
    refused = {name: reason for one in flights for name, reason in one.samples.refused.items()}
    found = summary.derivatives(model, aircraft)
    document = {
        **summary.header("identify", aircraft, prior),
        "flights": summary.flights_document(flights),
        "coefficients": summary.scores(table, table["held_out"], refused),
        "derivatives": found,
        "reconstruction": summary.reconstruction(flights[0]),
        "compatibility": summary.compatibility(flights[0]),
        "maneuvers": summary.maneuvers(flights, held_out),
        "envelope": summary.envelope(table, aircraft.control_names),
        "trim": summary.trim(table, aircraft.control_names),
        "limits": summary.limits(aircraft),
        "gaussian_process": learned.told(model),
        "confidence": learned.confidence_map(model, aircraft, table),
        "warnings": advice.warnings(flights, model) + unused_keys.warnings(aircraft),
        "cannot_tell": advice.cannot_tell(found, refused, aircraft.control_names),
    }
    if not held_out:
        document["warnings"].append(
            "no maneuver could be held out: the flight has too few, so nothing is scored"
        )
    return document
