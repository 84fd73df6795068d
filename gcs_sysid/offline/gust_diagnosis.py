"""A diagnosis of flights in gusts: causes weighed inside the aided filter.

What the flow angles are the filter knows together with the gusts, from what the aircraft felt, so
that neither vanes nor calm air are needed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gcs_sysid.aircraft import Aircraft, StreamTiming
from gcs_sysid.diagnose.aided import extended, verdict
from gcs_sysid.diagnose.aided.cause import Candidate
from gcs_sysid.diagnose.aided.ranking import Estimate, Ranked
from gcs_sysid.diagnose.aided.unlisted import Missing
from gcs_sysid.diagnose.aided.verdict import Verdict
from gcs_sysid.estimate.surface_delay import Delay
from gcs_sysid.offline import advice, departed, investigation, summary
from gcs_sysid.offline.flight import SERVO_STREAM, Flight, Progress
from gcs_sysid.offline.investigation import Investigation
from gcs_sysid.offline.tested import Tested
from gcs_sysid.reconstruct.segments import split

LISTED = 12
"""Sets of causes that the document lists."""


def diagnosed(
    under: Tested,
    aircraft: Aircraft,
    flights: Sequence[Flight],
    progress: Progress,
    *,
    apart: bool,
) -> tuple[dict[str, Any], dict[str, np.ndarray], Aircraft]:
    """The document, the residuals sample by sample, and the extended aircraft.

    Args:
        under: the simulation under test.
        aircraft: its aircraft, less controls that the logs lack.
        flights: as they were read.
        progress: told what is being done.
        apart: whether the last flight only judges.

    Raises:
        RefusedError: the filter lost the aircraft.
    """
    fitted, held_out = _parts(flights, apart=apart)
    aircraft, file = (_as_found(one, under.delay) for one in (aircraft, under.aircraft))
    found = investigation.investigate(aircraft, flights, fitted, held_out, progress)
    answer = verdict.judge(
        found.ranked, verdict.would_show(found.information, found.unknowns, found.candidates)
    )
    best = answer.best
    gained = found.gained(best.causes)
    answer = verdict.sustained(answer, gained)
    strained = verdict.strained(found.unknowns, best)
    missing = None
    if answer.answer in ("no_effect", "insufficient_data"):
        missing = found.missing
    if missing is not None:
        answer = replace(answer, answer="unlisted_effect")
    elif strained and answer.answer == "no_effect":
        answer = replace(answer, answer="insufficient_data")
    named = best if answer.answer in ("effect", "ambiguous") else None
    corrections = {} if named is None else wrong(found, named)
    better = extended.corrected(file, corrections, found.quantities.directions, _limits(named))
    progress("comparing before and after", 0.95)
    corrected = extended.corrected(
        aircraft, corrections, found.quantities.directions, _limits(named)
    )
    table = departed.table(found, aircraft, corrected)
    document = {
        **summary.header("diagnose", aircraft, "file"),
        "simulation": under.source,
        "flights": summary.flights_document(flights),
        **_verdict(answer, missing),
        "ranking": [_ranked(item) for item in found.ranked[:LISTED]],
        "discrepancy": departed.discrepancy(table),
        "gain": departed.gain(table, found, held_out, named is not None, gained),
        "detectable": _detectable(found),
        "strained": strained,
        "used": "every measurement, inside the aided filter",
        "maneuvers": summary.maneuvers(flights, held_out),
        "reconstruction": summary.reconstruction(flights[0]),
        "compatibility": summary.compatibility(flights[0]),
        "warnings": [*_warnings(flights, found, corrections), *_strained(strained)],
    }
    return document, table, better


def _as_found(aircraft: Aircraft, delay: Delay | None) -> Aircraft:
    """The aircraft with the surfaces' delay that an identified model was found with."""
    if delay is None:
        return aircraft
    timing = StreamTiming(delay.value, delay.deviation or None)
    return replace(aircraft, streams={**aircraft.streams, SERVO_STREAM: timing})


def _parts(flights: Sequence[Flight], *, apart: bool) -> tuple[tuple[bool, ...], tuple[int, ...]]:
    """Which flights are fitted, and the maneuvers that only judge: the last flight's, or some."""
    if apart:
        kept = (True,) * (len(flights) - 1)
        return (*kept, False), tuple(item.id for item in flights[-1].segments)
    _, held_out = split([item for one in flights for item in one.segments])
    return (True,) * len(flights), tuple(held_out)


def wrong(found: Investigation, best: Ranked) -> dict[str, tuple[float, float]]:
    """Quantities that the causes free: value and one standard deviation."""
    values = {}
    for candidate in best.causes:
        for name in candidate.frees:
            posterior = best.posterior
            values[name] = found.unknowns.along(name, posterior.mean, posterior.covariance)
    return values


def _limits(best: Ranked | None) -> dict[str, float]:
    """Rate limits found [rad/s], by control."""
    if best is None:
        return {}
    return {
        candidate.about: estimates[0].value
        for candidate, estimates in _pairs(best)
        if candidate.cause.where == "rate_limit"
    }


def _verdict(answer: Verdict, missing: Missing | None) -> dict[str, Any]:
    """The answer and what belongs to it, in the keys of the interface."""
    best = answer.best
    rivals = [name for item in answer.indistinguishable for name in item.names]
    named = answer.answer in ("effect", "ambiguous")
    return {
        "verdict": answer.answer,
        "cause": best.names[0] if named else "unlisted" if missing else "none",
        "probability": best.probability,
        "explanation": [_explained(one, own) for one, own in _pairs(best)] if named else [],
        "indistinguishable": list(dict.fromkeys(rivals)),
        "separating_maneuver": _separating(answer),
        "effects": list(best.names) if named else ["unlisted"] if missing else [],
        "unlisted": None
        if missing is None
        else {
            "coefficient": missing.coefficient,
            "depends_on": list(dict.fromkeys(missing.variables)),
            "log_bayes_factor": missing.log_bayes_factor,
        },
    }


def _pairs(item: Ranked) -> list[tuple[Candidate, tuple[Estimate, ...]]]:
    return list(zip(item.causes, item.estimates, strict=True))


def _explained(candidate: Candidate, estimates: Sequence[Estimate]) -> str:
    """The cause's line for an engineer, with its numbers."""
    first = estimates[0]
    values = {estimate.name: estimate.value for estimate in estimates}
    change = 100.0 * (first.value - first.nominal)
    return candidate.cause.explanation.format(**values, change=change, about=candidate.about)


def _separating(answer: Verdict) -> str | None:
    """What to fly where causes cannot be told apart."""
    if answer.answer != "ambiguous":
        return None
    causes = {one.cause.name: one.cause for item in answer.indistinguishable for one in item.causes}
    return "; ".join(cause.shown_by for cause in causes.values())


def _ranked(item: Ranked) -> dict[str, Any]:
    parameters: dict[str, Any] = {}
    for candidate, estimates in _pairs(item):
        for estimate in estimates:
            entry: dict[str, Any] = {
                "value": estimate.value,
                "sd": estimate.deviation,
                "unit": estimate.unit,
            }
            if candidate.about:
                entry[candidate.cause.about] = candidate.about
            name = estimate.name
            parameters[name if name not in parameters else f"{name} {candidate.label}"] = entry
    return {
        "causes": list(item.names) or ["none"],
        "probability": item.probability,
        "log_bayes_factor": item.log_bayes_factor,
        "parameters": parameters,
    }


def _detectable(found: Investigation) -> dict[str, dict[str, Any]]:
    """How well these flights would know each cause's parameters, were it the only one."""
    listed: dict[str, dict[str, Any]] = {}
    deviations = verdict.deviations(found.information, found.unknowns, found.candidates)
    for candidate, spread in zip(found.candidates, deviations, strict=True):
        if candidate.cause.about == "derivative":
            continue
        listed[candidate.label] = {
            parameter.name: {
                "sd": deviation,
                "matters": parameter.matters * found.unknowns.sizes[parameter.per],
                "unit": parameter.unit,
            }
            for parameter, deviation in zip(candidate.cause.parameters, spread, strict=True)
            if not parameter.expected
        }
    return {name: entry for name, entry in listed.items() if entry}


def _warnings(
    flights: Sequence[Flight], found: Investigation, corrections: Mapping[str, Any]
) -> list[str]:
    listed = [text for one in flights for text in (*one.warnings, *advice.flight_warnings(one))]
    listed += found.notes
    listed += [
        f"{name} is no part of an aircraft file: aircraft-extended.toml does not hold it"
        for name in corrections
        if name in extended.OUTSIDE
    ]
    return list(dict.fromkeys(listed))


def _strained(strained: Mapping[str, float]) -> list[str]:
    return [
        f"{name} had to go {abs(bent):.1f} of its sigmas from the file: it is wrong, or something "
        "that no cause here stands for is"
        for name, bent in strained.items()
    ]
