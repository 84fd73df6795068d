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
from gcs_sysid.diagnose import extended, verdict
from gcs_sysid.diagnose.aided import power, ranking, unlisted
from gcs_sysid.diagnose.aided.quantities import MISSING
from gcs_sysid.diagnose.hypothesis import Ranked
from gcs_sysid.estimate.surface_delay import Delay
from gcs_sysid.offline import (
    departed,
    flown_freely,
    investigation,
    maneuver_choice,
    summary,
)
from gcs_sysid.offline import diagnosis_entries as entries
from gcs_sysid.offline.flight import SERVO_STREAM, Flight, Progress
from gcs_sysid.offline.inquiry import Kept
from gcs_sysid.offline.investigation import Investigation
from gcs_sysid.offline.tested import Tested


def diagnosed(
    under: Tested,
    aircraft: Aircraft,
    flights: Sequence[Flight],
    progress: Progress,
    *,
    apart: bool,
    kept: Kept,
) -> tuple[dict[str, Any], dict[str, np.ndarray], Aircraft]:
    """The document, the residuals sample by sample, and the extended aircraft.

    Args:
        under: the simulation under test.
        aircraft: its aircraft, less controls that the logs lack.
        flights: as they were read.
        progress: told what is being done.
        apart: whether the last flight only judges.
        kept: takes every ranking on the way.

    Raises:
        RefusedError: the filter lost the aircraft, or its search found no rest; then it is a
            `RestlessError`.
    """
    _, held_out = maneuver_choice.shared_out(flights, apart=apart)
    fitted = [not apart or one is not flights[-1] for one in flights]
    aircraft, file = (_as_found(one, under.delay) for one in (aircraft, under.aircraft))
    found = investigation.investigate(*(aircraft, flights, fitted, held_out, progress), kept=kept)
    deviations = ranking.deviations(found.information, found.believed, found.candidates)
    sizes = found.unknowns.sizes
    powers = power.of_flights(found.information, found.believed, found.candidates)
    answer = verdict.judge(found.ranked, verdict.would_show(found.candidates, deviations, sizes))
    best = answer.best
    alike = [one for each in answer.indistinguishable for one in each.causes]
    gained = found.gained(best.causes, alike)
    judged = answer
    answer = verdict.sustained(answer, gained, found.against(best.causes, alike))
    dropped = best if answer is not judged else None
    farthest = max(found.unknowns.farthest(best.causes, best.posterior.mean), found.farthest)
    answer = verdict.credible(answer, farthest)
    strained = verdict.strained(found.unknowns.names, found.unknowns.as_accurate(1.0).of_file, best)
    missing = found.missing
    if missing is not None and not unlisted.named(missing, found.unlisted, found.ranked):
        missing = None
    if missing is not None:
        answer = replace(answer, answer="unlisted_effect", indistinguishable=())
        # Derivatives that stood in for the term.
        strained = {}
    elif strained and answer.answer == "no_effect":
        answer = replace(answer, answer="insufficient_data")
    named = best if answer.answer in ("effect", "ambiguous") else None
    corrections = {} if named is None else wrong(found, named)
    directions = found.quantities.directions
    gained_sd = found.gained_deviation(corrections) if corrections else None
    if missing is not None:
        corrections = {MISSING: (missing.value, missing.deviation)}
        gained, gained_sd = found.missing_gain, None
    better = extended.corrected(file, corrections, directions, _limits(named))
    progress("comparing before and after", 0.95)
    corrected = extended.corrected(aircraft, corrections, directions, _limits(named))
    flown = departed.flown(found, aircraft, corrected)
    table = departed.table(flown)
    gains = departed.gain(
        *(table, held_out),
        before=-found.as_it_is(() if named is None else (*named.causes, *alike)),
        gained=gained if corrections else 0.0,
        gained_sd=gained_sd,
    )
    document = {
        **summary.header("diagnose", aircraft, "file"),
        "simulation": under.source,
        "flights": summary.flights_document(flights),
        **entries.verdict(answer, aircraft, missing, found.unlisted),
        "ranking": entries.ranking(answer.ranked, found.missing, found.unlisted),
        "discrepancy": departed.discrepancy(table),
        "alternatives": entries.alternatives(answer.ranked),
        "gain": {**gains, "free_run": flown_freely.gain(flown, held_out)},
        "detectable": entries.detectable(found.candidates, deviations, sizes, powers),
        "not_asked": entries.not_asked(found.candidates),
        "strained": strained,
        "file_accuracy": best.accuracy if missing is None else missing.accuracy,
        "used": "every measurement, inside the aided filter",
        "maneuvers": summary.maneuvers(flights, held_out),
        "reconstruction": summary.reconstruction(flights[0]),
        "compatibility": summary.compatibility(flights[0]),
        "warnings": [
            *_warnings(flights, found, corrections),
            *departed.paid(gains["channels"]),
            *entries.strained(strained, aircraft.control_names),
            *([] if missing is not None else entries.incredible(farthest)),
            *([] if missing is not None or dropped is None else entries.dropped(dropped)),
        ],
    }
    return document, table, better


def _as_found(aircraft: Aircraft, delay: Delay | None) -> Aircraft:
    """The aircraft with the surfaces' delay that an identified model was found with."""
    if delay is None:
        return aircraft
    timing = StreamTiming(delay.value, delay.deviation or None)
    return replace(aircraft, streams={**aircraft.streams, SERVO_STREAM: timing})


def wrong(found: Investigation, best: Ranked) -> dict[str, tuple[float, float]]:
    """Quantities that the causes free: value and one standard deviation."""
    names = [name for candidate in best.causes for name in candidate.frees]
    return found.unknowns.along(names, best.posterior.mean, best.posterior.covariance)


def _limits(best: Ranked | None) -> dict[str, float]:
    """Rate limits found [rad/s], by control."""
    if best is None:
        return {}
    return {
        candidate.about: estimates[0].value
        for candidate, estimates in entries.pairs(best)
        if candidate.cause.where == "rate_limit"
    }


def _warnings(
    flights: Sequence[Flight], found: Investigation, corrections: Mapping[str, Any]
) -> list[str]:
    # What kinematic states cannot tell limits nothing here.
    listed = [text for one in flights for text in one.warnings]
    listed += found.notes
    listed += [
        f"{name} is no part of an aircraft file: aircraft-extended.toml does not hold it"
        for name in corrections
        if name in extended.OUTSIDE
    ]
    return list(dict.fromkeys(listed))
