"""From flights and a simulation to a ranking of causes, and to what none of them stands for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.diagnose.aided import gain, quantities, unlisted
from gcs_sysid.diagnose.aided.quantities import Quantities
from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.aided.unlisted import MissingTerm
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information
from gcs_sysid.diagnose.hypothesis import Ranked
from gcs_sysid.estimate.settling import Settled
from gcs_sysid.estimate.weighed import Weighed
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.offline.flight import Flight, Progress
from gcs_sysid.offline.inquiry import ROUNDS, Inquiry, Kept, unkept
from gcs_sysid.offline.leads import RestlessError
from gcs_sysid.offline.question import Asked, Question
from gcs_sysid.offline.settled import Subject
from gcs_sysid.reconstruct import causal


@dataclass(frozen=True)
class Investigation:
    """What flights say of all causes.

    Attributes:
        quantities: what causes set free.
        unknowns: names and ordinary sigmas.
        candidates: every cause that was weighed.
        information: of what was fitted.
        apart: of what took no part.
        ranked: sets of causes, the most probable first.
        missing: the term that the flights ask for most and nothing in the catalogue stands for;
            None where what took no part does not ask for it.
        unlisted: probability that one is missing.
        missing_gain: log predictive density per measurement that it gains on what took no part.
        model: the aircraft with all terms, a missing one that is to be named among them.
        subjects: the flights.
        settled: where each of them settled under that model.
        farthest: by how many of its causes' sigmas the most extreme size was off of a favourite
            that was not believed; 0 where none was.
        notes: what the engineer should know.
    """

    quantities: Quantities
    unknowns: Unknowns
    candidates: tuple[Candidate, ...]
    information: Information
    apart: Information
    ranked: tuple[Ranked, ...]
    missing: MissingTerm | None
    unlisted: float
    missing_gain: float
    model: FlightModel
    subjects: tuple[Subject, ...]
    settled: tuple[Settled, ...]
    farthest: float
    notes: tuple[str, ...]

    @property
    def believed(self) -> Unknowns:
        """The unknowns with the file as accurate as the most probable set has it."""
        return self.unknowns.as_accurate(self.ranked[0].accuracy)

    def gained(self, causes: Sequence[Candidate], alike: Sequence[Candidate]) -> float:
        """Log predictive density per measurement that causes gain on what took no part."""
        return gain.gained(self.information, self.apart, self.believed, causes, alike)

    def against(self, causes: Sequence[Candidate], alike: Sequence[Candidate]) -> float:
        """By how much what took no part speaks against causes [nat]."""
        return gain.against(self.information, self.apart, self.believed, causes, alike)

    def gained_deviation(self, corrections: Mapping[str, tuple[float, float]]) -> float:
        """One sigma of what corrections gain, per measurement; nan where nothing took no part."""
        values = np.zeros(len(self.unknowns.names))
        for name, (value, _) in corrections.items():
            values[self.unknowns.names.index(name)] = value
        variance, count = 0.0, 0.0
        for number, done in enumerate(self.settled):
            moved = self.unknowns.in_flight(number, values)
            variance += gain.scattered(done.last.blocks, done.apart, moved, causal.BLOCK)
            count += done.last.apart.count
        return float(np.sqrt(variance)) / count if count else float(np.nan)

    def as_it_is(self, causes: Sequence[Candidate]) -> float:
        """Log predictive density per measurement of what took no part, with the file as it is."""
        held = self.believed.as_accurate(0.0).as_it_is(causes)
        total = gain.foretold(self.information, self.apart, held, ())
        return total / max(self.apart.count, 1.0)


def investigate(
    aircraft: Aircraft,
    flights: Sequence[Flight],
    fitted: Sequence[bool],
    held_out: Sequence[int],
    progress: Progress,
    *,
    kept: Kept = unkept,
) -> Investigation:
    """Ranks all sets of causes.

    Args:
        aircraft: the simulation, less controls that the logs lack.
        flights: of that aircraft.
        fitted: which flights take part.
        held_out: maneuvers that take none.
        progress: told what is being done.
        kept: takes every ranking on the way, for who may have to stop before the end.

    Raises:
        RefusedError: the filter lost the aircraft.
        RestlessError: its search found no rest.
    """
    asked = Asked(aircraft, flights, fitted, held_out)
    inquiry = Inquiry(asked, progress, kept)
    lacking = _searched(inquiry, progress)
    if inquiry.outdone and not lacking.named:
        # What it was left for is nothing after all: the favourite is searched to its end.
        lacking = _searched(inquiry, progress)
    question, done = lacking.question, lacking.each
    # Only now: what finds no rest with the catalogue alone may find it with the missing term.
    for subject, last, stood_out in zip(question.subjects, done, inquiry.leads, strict=True):
        if last.settled.restless:
            raise RestlessError(subject.one.recording.source, stood_out)
    return Investigation(
        quantities=question.quantities,
        unknowns=inquiry.question.listed,
        candidates=inquiry.every,
        information=inquiry.standing.information,
        apart=inquiry.standing.apart,
        ranked=lacking.ranked,
        missing=lacking.missing,
        unlisted=lacking.probability,
        missing_gain=lacking.gained,
        model=question.model,
        subjects=question.subjects,
        settled=tuple(last.settled for last in done),
        farthest=inquiry.farthest,
        notes=tuple(
            f"{one.one.recording.source}: the filter had not quite settled after its last turn"
            for one, last in zip(question.subjects, done, strict=True)
            if not last.settled.ended
        ),
    )


class _Lacking(NamedTuple):
    """What no cause stands for.

    Attributes:
        named: whether a term is to be named.
        missing: the term that the flights ask for most; None where there is none.
        gained: log predictive density per measurement by it.
        probability: that one is missing.
        ranked: sets of causes, with what that leaves them.
        question: that was asked last: with the term, where it is to be named.
        each: flights as they answered it.
    """

    named: bool
    missing: MissingTerm | None
    gained: float
    probability: float
    ranked: tuple[Ranked, ...]
    question: Question
    each: Sequence[Weighed]


def _searched(inquiry: Inquiry, progress: Progress) -> _Lacking:
    """Favourites put to the test, and what none of them stands for."""
    inquiry.search()
    listed, reached = inquiry.question.listed, inquiry.reached
    ranked = tuple(_doubted(one, reached, listed) for one in inquiry.ranked)
    progress("looking for what no cause stands for", (inquiry.steps - 1) / inquiry.steps)
    return _lacking(inquiry, ranked)


def _lacking(inquiry: Inquiry, plain: tuple[Ranked, ...]) -> _Lacking:
    """Whether the flights ask for a term that nothing listed stands for.

    One that is to be named is set free, and the flights are searched with it.

    Args:
        inquiry: that has ended.
        plain: sets of causes as it has them.
    """
    question, standing = inquiry.question, inquiry.standing
    missing, gained = inquiry.missing()
    ranked, probability = unlisted.weighed(plain, missing)
    found = _Lacking(False, missing, gained, probability, ranked, question, standing.each)
    if missing is None or not unlisted.named(missing, probability, ranked):
        return found
    wider, with_it = inquiry.with_term(missing, ROUNDS)
    settled_with, settled_gain = wider.found(with_it, missing)
    count, listed = standing.apart.count, question.listed
    won = 0.0
    if count:
        own = gain.gained(standing.information, standing.apart, listed, plain[0].causes)
        won = (settled_gain - own) * count
    ranked, probability = unlisted.weighed(plain, missing, won)
    if not unlisted.named(missing, probability, ranked):
        return found._replace(ranked=ranked, probability=probability)
    return _Lacking(True, settled_with, settled_gain, probability, ranked, wider, with_it.each)


def _doubted(one: Ranked, reached: Mapping[str, float], listed: Unknowns) -> Ranked:
    """As sure of lag and play as the size allows at which their change was taken."""
    estimates = tuple(
        tuple(
            replace(
                item,
                deviation=float(
                    np.hypot(
                        item.deviation,
                        quantities.servo_doubt(name, item.value, reached, listed.acting),
                    )
                ),
            )
            for name, item in zip(candidate.frees, found, strict=True)
        )
        if len(candidate.frees) == len(found)
        else found
        for candidate, found in zip(one.causes, one.estimates, strict=True)
    )
    return replace(one, estimates=estimates)
