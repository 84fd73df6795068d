"""`diagnose`: what a simulation gets wrong, the cause, the extended aircraft file, the gain."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import COEFFICIENTS, Aircraft
from gcs_sysid.diagnose import extended, gain, investigation, problem, ranking, verdict
from gcs_sysid.diagnose.catalogue import of_coefficients
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.gain import Score
from gcs_sysid.diagnose.hypothesis import Ranked
from gcs_sysid.diagnose.investigation import Investigation
from gcs_sysid.diagnose.observed import Observed
from gcs_sysid.diagnose.problem import Problem
from gcs_sysid.diagnose.unlisted import Missing
from gcs_sysid.diagnose.verdict import NAMED, Verdict
from gcs_sysid.errors import RefusedError, StoppedError, UsageError
from gcs_sysid.offline import (
    advice,
    documents,
    file_changes,
    flight,
    gust_diagnosis,
    maneuver_choice,
    parquet_file,
    summary,
    tested,
)
from gcs_sysid.offline import diagnosis_entries as entries
from gcs_sysid.offline.flight import SERVO_STREAM, Flight, Progress
from gcs_sysid.offline.identify import FLIGHT_IDS
from gcs_sysid.offline.inquiry import Kept
from gcs_sysid.offline.leads import Lead, RestlessError
from gcs_sysid.offline.observed import observed
from gcs_sysid.offline.tested import Tested

Method = Literal["filter", "coefficients"]
SHORTEST = 15.0
"""Less flight [s] than this is not diagnosed."""
ABSOLUTE = {"": 1.0}
"""None of the causes that coefficients know has a size that is a share of something."""
EXTENDED = "aircraft-extended.toml"
PATCH = "aircraft-extended.patch"
READING = 0.3
"""Share of the time that reading and reconstruction take."""


def run(
    logs: Sequence[Path],
    *,
    aircraft: Path | None,
    model: Path | None,
    holdout: Path | None,
    vehicle: int | None,
    segments: Path | None,
    out: Path,
    progress: Progress,
    method: Method,
    columns: Path | None = None,
    can: Path | None = None,
) -> dict[str, Any]:
    """Diagnoses; writes `diagnosis.json`, `residuals.parquet`, the extended file and its patch.

    Args:
        logs: flights of the same aircraft.
        aircraft: aircraft file whose aerodynamics are tested.
        model: identified model to test instead.
        holdout: flight to measure the gain on; without one, maneuvers of `logs` that take no part.
        vehicle: which vehicle of the logs.
        segments: maneuvers to use; for a single log.
        out: directory for the results.
        progress: told what is being done.
        method: weigh all causes inside the aided filter, or in seconds four of them by what
            coefficients tell in calm air; these also where a log has no servo positions.
        columns: what the columns of tables are.
        can: a CAN log of the same flight; for a single log. Servos are part of what is tested, so
            surfaces follow commands, whatever the bus measured of them.

    Raises:
        InputError: a log or the simulation cannot be used.
        UsageError: no simulation or two are given, or a segments file or CAN log with several logs.
        StoppedError: the keyboard stopped it, and `diagnosis.json` has what was known by then.
    """
    started = clock.perf_counter()
    if segments is not None and len(logs) > 1:
        raise UsageError("--segments goes with one LOG; give each log its own run, or leave it out")
    if can is not None and (len(logs) > 1 or holdout is not None):
        raise UsageError("--can goes with one LOG; give each log its own run, or leave it out")
    under = tested.load(aircraft, model)
    read = [*logs, *([] if holdout is None else [holdout])]
    flights = []
    for index, log in enumerate(read):

        def part(text: str, share: float, index: int = index) -> None:
            progress(text, READING * (index + share) / len(read))

        chosen = segments if index < len(logs) else None
        one = flight.read(
            log,
            under.aircraft,
            vehicle=vehicle,
            segments=maneuver_choice.chooser(chosen, under.aircraft),
            delay=under.delay,
            progress=part,
            columns=columns,
            can=can,
        )
        numbered = tuple(replace(item, id=item.id + FLIGHT_IDS * index) for item in one.segments)
        flights.append(replace(one, segments=numbered))
    known: list[tuple[Ranked, ...]] = []
    try:
        document, table, better = _diagnosed(
            under, flights, progress, apart=holdout is not None, method=method, kept=known.append
        )
    except KeyboardInterrupt as stop:
        if not known:
            raise
        path = out / "diagnosis.json"
        documents.write_json(path, _unfinished(under, flights, known[-1]))
        raise StoppedError(f"stopped; what was known by then is in {path}") from stop
    parquet_file.write(out / "residuals.parquet", table)
    aircraft_file.save(better, out / EXTENDED)
    changes = file_changes.lines(under.aircraft, better, source=under.source, to=EXTENDED)
    documents.write_text(out / PATCH, "".join(f"{line}\n" for line in changes))
    document |= {"complete": True, "changes": changes}
    document["warnings"] += under.left_out(EXTENDED)
    document["timing"] = {
        "read_s": sum(one.read_seconds for one in flights),
        "reconstruct_s": sum(one.reconstruct_seconds for one in flights),
        "total_s": clock.perf_counter() - started,
    }
    documents.write_json(out / "diagnosis.json", document)
    return documents.plain(document)


def _unfinished(
    under: Tested, flights: Sequence[Flight], ranked: tuple[Ranked, ...]
) -> dict[str, Any]:
    """What may be said of a ranking that was still to be put to the test: who leads, no more."""
    nobody = Verdict("insufficient_data", ranked[0], (), ranked, {})
    return {
        **summary.header("diagnose", under.aircraft, "file"),
        "complete": False,
        "simulation": under.source,
        "flights": summary.flights_document(flights),
        **entries.verdict(nobody, under.aircraft, None),
        "ranking": entries.ranking(ranked),
        "alternatives": entries.alternatives(ranked),
        "maneuvers": summary.maneuvers(flights, ()),
        "warnings": [
            "stopped before the end: the ranking is as it stood by then, not put to the test on "
            "what took no part; run it again to be told a cause",
            *(text for one in flights for text in one.warnings),
        ],
    }


@dataclass(frozen=True)
class _Part:
    """Flights with the maneuvers of them that count."""

    seen: tuple[Observed, ...]
    problems: tuple[Problem, ...]
    maneuvers: tuple[int, ...]


def _parts(flights: Sequence[Flight], aircraft: Aircraft, *, apart: bool) -> tuple[_Part, _Part]:
    """What is fitted, and what it is judged by."""
    seen = tuple(observed(one, aircraft) for one in flights)
    built = [problem.build(aircraft, one, number=i) for i, one in enumerate(seen)]
    common = set.intersection(*(set(one.usable) for one in built))
    if not common:
        raise RefusedError(
            flights[0].recording.source,
            "no coefficient of the simulation was measured in every flight",
            fix="diagnose the flights one by one, or record what is missing",
        )
    problems = tuple(replace(one, usable=tuple(sorted(common))) for one in built)
    fitted, judged = maneuver_choice.shared_out(flights, apart=apart)
    if apart:
        return _Part(seen[:-1], problems[:-1], fitted), _Part(seen[-1:], problems[-1:], judged)
    return _Part(seen, problems, fitted), _Part(seen, problems, judged)


def _diagnosed(
    under: Tested,
    flights: Sequence[Flight],
    progress: Progress,
    *,
    apart: bool,
    method: Method,
    kept: Kept,
) -> tuple[dict[str, Any], dict[str, np.ndarray], Aircraft]:
    """The document, the residuals sample by sample, and the extended aircraft."""
    absent = {name for one in flights for name in one.absent}
    aircraft = flight.without_controls(under.aircraft, absent)
    fitted_ids, _ = maneuver_choice.shared_out(flights, apart=apart)
    seconds = sum(
        item.duration for one in flights for item in one.segments if item.id in fitted_ids
    )
    if seconds < SHORTEST:
        raise RefusedError(
            flights[0].recording.source,
            f"only {seconds:.0f} s of maneuvers take part, too little to know the noise from",
            fix=f"give {SHORTEST:.0f} s or more, or several logs",
        )
    notes: tuple[str, ...] = ()
    leads: tuple[Lead, ...] = ()
    followed = True
    if method == "filter" and all(SERVO_STREAM in one.recording.streams for one in flights):

        def told(text: str, share: float) -> None:
            progress(text, READING + (1.0 - READING) * share)

        try:
            return gust_diagnosis.diagnosed(
                *(under, aircraft, flights, told), apart=apart, kept=kept
            )
        except RefusedError as lost:
            # A simulation that far from the flight has no small cause to be named.
            followed, notes = False, (str(lost),)
            if isinstance(lost, RestlessError):
                leads = lost.leads
    elif method == "filter":
        notes = ("without servo positions only four causes are weighed, by coefficients",)
    fit, judged = _parts(flights, aircraft, apart=apart)
    every = of_coefficients(aircraft.control_names)
    credible = investigation.credible(fit.seen)
    trusted = credible and investigation.trusted(fit.seen)
    fitted = investigation.investigate(fit.problems, every, fit.maneuvers, coefficients=trusted)
    final = fitted
    if not apart:
        whole = (*fit.maneuvers, *judged.maneuvers)
        final = investigation.investigate(fit.problems, every, whole, coefficients=trusted)
    deviations = ranking.deviations(final.information, final.columns, every)
    answer = verdict.judge(final.ranked, verdict.would_show(every, deviations, ABSOLUTE))
    same = next(item for item in fitted.ranked if item.causes == answer.best.causes)
    if trusted:
        before, after = investigation.scores(fitted, judged.problems, judged.maneuvers, same)
    else:
        before, after = _airspeed_scores(fit, judged)
        if "airspeed_scale" not in same.names:
            after = before
    if trusted:
        gained = before.nlpd - after.nlpd
        # Where nothing took no part, nobody is accused.
        answer = verdict.sustained(answer, gained if np.isfinite(gained) else 0.0)
    if not (credible and followed):
        answer = replace(answer, answer="insufficient_data", indistinguishable=())
    columns = final.columns
    strained = verdict.strained(columns.names, columns.sigma, answer.best) if trusted else {}
    if strained and answer.answer == "no_effect":
        answer = replace(answer, answer="insufficient_data")
    missing = None
    if trusted and followed and answer.answer in ("no_effect", "insufficient_data"):
        missing = _missing(aircraft, fit, judged, fitted, every)
    if missing is not None:
        answer = replace(answer, answer="unlisted_effect")
    named = answer.best if answer.answer in ("effect", "ambiguous") else None
    corrections = {} if named is None else wrong(final, named)
    if not corrections:
        # The file stays as it is.
        after = before
    document = {
        **summary.header("diagnose", aircraft, "file"),
        "simulation": under.source,
        "flights": summary.flights_document(flights),
        **entries.verdict(answer, aircraft, missing),
        "ranking": entries.ranking(answer.ranked),
        "discrepancy": _discrepancy(final, fit.problems, corrections)
        if trusted
        else {"airspeed": {"before": 0.01 * before.error, "after": 0.01 * after.error}},
        "gain": {
            "holdout_nlpd_before": before.nlpd,
            "holdout_nlpd_after": after.nlpd,
            "holdout_error_before": before.error,
            "holdout_error_after": after.error,
        },
        "detectable": entries.detectable(every, deviations, ABSOLUTE),
        "strained": strained,
        "followed": followed,
        "stands_out": entries.stands_out(leads, aircraft.control_names),
        "used": "coefficients and kinematics" if trusted else "kinematics",
        "maneuvers": summary.maneuvers(flights, judged.maneuvers),
        "reconstruction": summary.reconstruction(flights[0]),
        "compatibility": summary.compatibility(flights[0]),
        "warnings": [
            *notes,
            *_warnings(flights, credible=credible, trusted=trusted),
            *entries.strained(strained, aircraft.control_names),
        ],
    }
    built = (*fit.problems, *judged.problems) if apart else fit.problems
    table = _table(flights, built, corrections)
    return document, table, extended.corrected(under.aircraft, corrections)


def _airspeed_scores(fit: _Part, judged: _Part) -> tuple[Score, Score]:
    """Gain in predicting airspeed, where that is all that may be judged."""

    def rows(part: _Part) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return (
            np.concatenate([one.indicated for one in part.seen]),
            np.concatenate([one.through_air for one in part.seen]),
            np.concatenate([np.isin(one.piece, part.maneuvers) for one in part.seen]),
        )

    indicated, through_air, fitted = rows(fit)
    others, through, held_out = rows(judged)
    return gain.airspeed_scores(
        np.concatenate([indicated, others]),
        np.concatenate([through_air, through]),
        np.concatenate([fitted, np.zeros_like(held_out)]),
        np.concatenate([np.zeros_like(fitted), held_out]),
    )


def _missing(
    aircraft: Aircraft,
    fit: _Part,
    judged: _Part,
    fitted: Investigation,
    every: Sequence[Candidate],
) -> Missing | None:
    """A term that nothing in the catalogue stands for, if maneuvers not fitted ask for it too."""
    found = investigation.missing_term(aircraft, fit.seen, fit.problems, fit.maneuvers, fitted)
    if found.log_bayes_factor < NAMED:
        return None
    again = investigation.investigate(
        judged.problems, every, judged.maneuvers, coefficients=True, noise=fitted.noise
    )
    asked = investigation.missing_term(
        aircraft, judged.seen, judged.problems, judged.maneuvers, again
    )
    same = (asked.coefficient, asked.variables) == (found.coefficient, found.variables)
    return found if same and asked.log_bayes_factor > 0.0 else None


def wrong(found: Investigation, best: Ranked) -> dict[str, tuple[float, float]]:
    """Quantities that the causes free: value and one standard deviation."""
    values = {}
    for candidate in best.causes:
        for name in candidate.frees:
            index = found.columns.names.index(name)
            deviation = float(np.sqrt(best.posterior.covariance[index, index]))
            values[name] = (float(best.posterior.mean[index]), deviation)
    return values


def _discrepancy(
    found: Investigation,
    problems: Sequence[Problem],
    corrections: Mapping[str, tuple[float, float]],
) -> dict[str, dict[str, float]]:
    """RMS of measured less predicted over the spread of measured, before and after."""
    wrongs = np.zeros(len(found.columns.names))
    for name, (value, _) in corrections.items():
        wrongs[found.columns.names.index(name)] = value
    left, measured = found.data.left, found.data.measured
    after = left - found.data.columns @ wrongs
    return {
        COEFFICIENTS[row]: {
            "before": float(np.sqrt(np.mean(left[:, place] ** 2)) / measured[:, place].std()),
            "after": float(np.sqrt(np.mean(after[:, place] ** 2)) / measured[:, place].std()),
        }
        for place, row in enumerate(problems[0].usable)
    }


def _warnings(flights: Sequence[Flight], *, credible: bool, trusted: bool) -> list[str]:
    listed = [text for one in flights for text in (*one.warnings, *advice.flight_warnings(one))]
    if not credible:
        listed.append(
            "airspeed, vanes and speed over ground cannot be reconciled, or gusts are too strong "
            "for it: nothing built on this reconstruction accuses anybody. Fly in calm air"
        )
    elif not trusted:
        listed.append(
            "gusts and no flow vanes: the flow angles are not known well enough for coefficients "
            "to accuse anybody; only what airspeed and speed over ground say was used. Leave "
            "--method coefficients out, or fly in calm air"
        )
    return list(dict.fromkeys(listed))


def _table(
    flights: Sequence[Flight],
    problems: Sequence[Problem],
    corrections: Mapping[str, tuple[float, float]],
) -> dict[str, np.ndarray]:
    """Measured less predicted, sample by sample, before and after the cause."""
    parts = []
    for number, (one, built) in enumerate(zip(flights, problems, strict=True)):
        after = built.left.copy()
        for name, (value, _) in corrections.items():
            after -= value * built.columns.values[:, :, built.columns.names.index(name)]
        part = {
            "time_us": one.recording.time_us(built.time),
            "t": built.time,
            "flight": np.full(built.time.size, number),
            "maneuver": built.piece,
        }
        for row, name in enumerate(COEFFICIENTS):
            good = row in built.usable
            for label, values in (("before", built.left), ("after", after)):
                column = values[:, row] if good else np.full(built.time.size, np.nan)
                part[f"{name}_{label}"] = column
            part[f"{name}_measured"] = built.measured[:, row]
        parts.append(part)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
