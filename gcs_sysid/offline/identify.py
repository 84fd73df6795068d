"""`identify`: from recorded flights to coefficients, a model and a summary.

Two fits are made. The first leaves the held-out maneuvers out and is what the scores and the
samples table show; the second, on all maneuvers, is the model that is kept. Both are made on the
coefficients measured with kinematic states or, if that is asked for and possible, inside the aided
filter, which tells a gust from a motion.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from gcs_sysid import aircraft_file, regressors
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import RefusedError, UsageError
from gcs_sysid.estimate import equation_error, innovation_spectrum, stepwise, verdict
from gcs_sysid.estimate.file_prior import file_prior
from gcs_sysid.estimate.filter_error import Fit
from gcs_sysid.estimate.inside_filter import Derivatives
from gcs_sysid.estimate.lacking import Lacking
from gcs_sysid.estimate.result import AeroModel, Prior
from gcs_sysid.offline import (
    advice,
    aided_fit,
    aided_summary,
    documents,
    flight,
    learned,
    linear_models,
    maneuver_choice,
    model_store,
    parquet_file,
    samples_table,
    summary,
    unused_keys,
)
from gcs_sysid.offline.aided_fit import AidedFlights, UnsettledError
from gcs_sysid.offline.flight import Flight, Progress
from gcs_sysid.offline.model_store import StoredModel
from gcs_sysid.reconstruct.segments import split

Method = Literal["auto", "filter-error", "equation-error"]
Body = Literal["file", "flight"]
ASKED, CALM = "asked for", "calm air, in which least squares does as well in seconds"
ROUNDS = 3
"""Times that flights are fitted once more inside the filter, with the terms that they asked for."""
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
    method: Method = "equation-error",
    body: Body = "file",
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
        method: by least squares on coefficients measured with kinematic states, or inside the aided
            filter; by itself the second where gusts would spoil the first.
        body: whether mass, inertia and thrust are taken as the file has them or, inside the filter,
            found with the aerodynamics from what the file says of them and how sure it is.

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
    believed = file_prior(described) if prior == "file" else None
    kept, held_out = split([item for one in flights for item in one.segments])
    asked = _Asked(believed, kept, held_out, method, body, by_data=stepwise)
    found = _fitted(flights, described, asked, progress)
    scored = learned.beside(found.scored, found.flights, kept)
    found = found._replace(
        scored=scored, final=learned.after_all(found.final, scored, found.flights)
    )
    table = samples_table.table(found.flights, found.scored, held_out)
    delay = sum(one.delay.value for one in found.flights) / len(flights)
    provenance = summary.flights_document(found.flights)
    sensing = [one.sensing for one in found.fits]
    stored = StoredModel(
        *(found.final, found.aircraft, delay, provenance),
        inside_filter=bool(found.fits),
        sensing=innovation_spectrum.usual(sensing) if sensing else None,
    )
    model_store.save(out / "model", stored)
    parquet_file.write(out / "samples.parquet", table)
    document = _document(found, described, table, held_out, prior)
    progress("finding the modes", 1.0)
    document["modes"] = _modes(stored, document["trim"]["V"], found.flights)
    done = clock.perf_counter()
    document["timing"] = {
        "read_s": sum(one.read_seconds for one in flights),
        "reconstruct_s": sum(one.reconstruct_seconds for one in flights),
        "fit_s": done - fitting,
        "total_s": done - started,
    }
    documents.write_json(out / "summary.json", document)
    return documents.plain(document)


def _modes(stored: StoredModel, airspeed: float, flights: Sequence[Flight]) -> dict[str, Any]:
    """Where the flights were: at their trim's airspeed, in their air."""
    height = float(np.mean([np.mean(one.reconstruction.height) for one in flights]))
    density = float(np.mean([np.mean(one.reconstruction.density) for one in flights]))
    return linear_models.modes(stored, airspeed, height, density)


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
            progress(text, 0.5 * (index + share) / len(logs))

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


class _Asked(NamedTuple):
    """How flights are to be fitted.

    Attributes:
        prior: what is believed of the derivatives; None for nothing.
        kept: ids of the maneuvers to learn from.
        held_out: ids of those that judge.
        method: by which.
        body: whether mass, inertia and thrust are found too.
        by_data: whether terms are chosen by the data.
    """

    prior: Mapping[str, Prior] | None
    kept: Sequence[int]
    held_out: Sequence[int]
    method: Method
    body: Body
    by_data: bool


class _Found(NamedTuple):
    """Models, and the flights with the states that they were made from.

    `aircraft` is the one that goes with the final model. `derivatives` and `fits` are those inside
    the filter, none where coefficients were fitted; `reason` says why not, and `refused` whether
    the filter was asked and found no end. `lacking` are terms that it asks for.
    """

    flights: Sequence[Flight]
    scored: AeroModel
    final: AeroModel
    aircraft: Aircraft
    derivatives: Derivatives | None
    fits: Sequence[Fit]
    reason: str | None
    refused: bool
    lacking: Sequence[Lacking]
    notes: Sequence[str]


def _fitted(
    flights: Sequence[Flight], aircraft: Aircraft, asked: _Asked, progress: Progress
) -> _Found:
    def share(text: str, done: float) -> None:
        progress(text, 0.5 + 0.5 * done)

    usual = regressors.default_structure(aircraft)
    structure = usual
    if asked.by_data:
        samples = [one.samples for one in flights]
        structure = stepwise.choose(samples, aircraft, usual, [one.pieces() for one in flights])
    scored = _fit(flights, aircraft, structure, asked.kept, asked.prior)
    reason = _spared(flights, scored, asked.method) or _unfit(flights)
    tried, asked_for = reason is None, ()
    if tried:
        try:
            inside = _inside(flights, aircraft, usual, asked, share)
            return _Found(
                *(inside.flights, inside.scored, inside.final, inside.aircraft),
                *(inside.derivatives, inside.fits, None, False, inside.lacking, inside.notes),
            )
        except UnsettledError as error:
            reason, asked_for = str(error), error.lacking
    share("fitting the model", 1.0)
    final = _fit(flights, aircraft, structure, None, asked.prior)
    return _Found(flights, scored, final, aircraft, None, (), reason, tried, asked_for, ())


def _inside(
    flights: Sequence[Flight],
    aircraft: Aircraft,
    usual: Mapping[str, Sequence[str]],
    asked: _Asked,
    progress: Progress,
) -> AidedFlights:
    """Fitted inside the filter; where terms are chosen by the data, with those that it asks for."""

    def fitted(structure: Mapping[str, Sequence[str]]) -> AidedFlights:
        return aided_fit.identify(
            *(flights, aircraft, structure, asked.prior, asked.held_out, progress),
            body=asked.body == "flight",
        )

    structure = dict(usual)
    found = fitted(structure)
    for _ in range(ROUNDS if asked.by_data else 0):
        if not found.lacking:
            break
        for one in found.lacking:
            structure[one.coefficient] = (*structure[one.coefficient], one.key)
        try:
            more = fitted(structure)
        except UnsettledError as error:
            return replace(_settled(found), notes=(*found.notes, _left_out(str(error))))
        if more.unsettled and not found.unsettled:
            return replace(found, notes=(*found.notes, _left_out(more.unsettled)))
        found = more
    return _settled(found)


def _left_out(reason: str) -> str:
    return f"terms that the flight asks for were not taken in: {reason}"


def _settled(found: AidedFlights) -> AidedFlights:
    """The same, or an error where a search did not end: with what may have kept it from that."""
    if found.unsettled:
        raise UnsettledError(found.unsettled, found.lacking)
    return found


def _spared(flights: Sequence[Flight], fitted: AeroModel, method: Method) -> str | None:
    """Why the aided filter is not needed; None where it is.

    It is in gusts, and where least squares blames them: an airspeed that lags looks like gusts.
    """
    if method == "equation-error":
        return ASKED
    needed = any(advice.gusty(one) for one in flights) or verdict.blurred(fitted.fits.values())
    return CALM if method == "auto" and not needed else None


def _unfit(flights: Sequence[Flight]) -> str | None:
    """Why the aided filter cannot read these flights; None where it can."""
    for one in flights:
        for name, why in one.samples.refused.items():
            return f"{one.recording.source}: {name} refused: {why}"
    return None


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
    made: _Found,
    aircraft: Aircraft,
    table: Mapping[str, Any],
    held_out: Sequence[int],
    prior: str,
) -> dict[str, Any]:
    flights, model = made.flights, made.final
    refused = {name: reason for one in flights for name, reason in one.samples.refused.items()}
    found = summary.derivatives(model, aircraft)
    document = {
        **summary.header("identify", aircraft, prior),
        "flights": summary.flights_document(flights),
        "coefficients": summary.scores(table, table["held_out"], refused),
        "derivatives": found,
        "method": aided_summary.method(made.fits, made.reason, refused=made.refused),
        "lacking": aided_summary.lacking(made.lacking),
        "mass_properties": aided_summary.body(made.derivatives, aircraft),
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
    if made.fits:
        aided_summary.put_reconstruction(document["reconstruction"], made.fits[0], flights[0])
    elif made.reason not in (ASKED, CALM):
        # Before all others: it decides what the rest is worth.
        document["warnings"].insert(0, f"not fitted inside the filter: {made.reason}")
    document["warnings"] += made.notes
    if not held_out:
        document["warnings"].append(
            "no maneuver could be held out: the flight has too few, so nothing is scored"
        )
    return document
