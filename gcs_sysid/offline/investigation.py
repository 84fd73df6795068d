"""From flights and a simulation to a ranking of causes: what is asked of them, in what order.

Every flight is settled under the simulation's own beliefs; its innovations and their sensitivities
then weigh all causes at once, by linear algebra. What that favours is put to the test: the flights
are settled again with it set free, and everything is weighed about that point, until the favourite
stays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.diagnose.aided import gain, other_names, quantities, unlisted
from gcs_sysid.diagnose.aided.quantities import Quantities
from gcs_sysid.diagnose.aided.ranking import (
    NONE_NEEDED,
    RIGHT,
    Needed,
    density,
    rank,
    with_a_right_file,
)
from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.aided.unlisted import MissingTerm
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information
from gcs_sysid.diagnose.hypothesis import Ranked
from gcs_sysid.diagnose.verdict import INCREDIBLE
from gcs_sysid.estimate.settling import Settled
from gcs_sysid.estimate.weighed import SETS
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.offline.flight import Flight, Progress
from gcs_sysid.offline.leads import RestlessError
from gcs_sysid.offline.question import (
    FIRST_SETS,
    REFUTED,
    UNLISTED,
    Answer,
    Asked,
    Telling,
    Trial,
)
from gcs_sysid.offline.settled import Subject
from gcs_sysid.reconstruct import causal

ROUNDS = 6
"""Times that favourites are put to the test."""
RESIZED = 3
"""Times that the same causes are tried with the sizes of servos' changes moved on."""
ROUGHLY = 0.03
"""Share within which such a size is right enough to weigh other causes about it."""
AT_ONCE = 2
"""So many causes more are set free at most where the search without them found no rest."""
WORTH = 30.0
"""A file that is right but for more causes is looked into where it has less evidence by so much at
most, about a point that was found with the file as loose as it seemed [nat]."""
Kept = Callable[[tuple[Ranked, ...]], None]
"""Takes sets of causes as they are ranked so far, the most probable first."""


def unkept(_ranked: tuple[Ranked, ...]) -> None:
    """For those who want the end only."""


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
    reached = dict[str, float]()
    question = asked.question()
    every = question.every
    steps = len(flights) * (1 + ROUNDS)

    def telling(doing: str, turn: int) -> Telling:
        return lambda text, number: progress(
            f"{doing}: {text}", (len(flights) * turn + number) / steps
        )

    def weighed(answer: Answer, needed: Needed = NONE_NEEDED) -> tuple[Ranked, ...]:
        found = rank(answer.information, question.listed, every, needed)
        kept(found)
        return found

    flying = telling("flying the simulation along", 0)
    question, begun = question.begun(flying)
    leads = question.leads(begun)
    flying("working out how errors show", len(flights) - 1)
    relations = question.relations(begun)
    # Where a cause stands out at once, what is left to gain without it is of no use.
    standing = question.answered(flying, (), begun, relations, sets=1)
    ranked = weighed(standing)
    roughly = bool(ranked[0].causes)
    if not roughly:
        standing = question.rested(flying, standing)
        ranked = weighed(standing)
    tested: set[frozenset[Candidate]] = {frozenset()}
    needed, farthest, right, overshot = NONE_NEEDED, 0.0, False, False
    for turn in range(1, ROUNDS + 1):
        listed = question.listed
        best = _strongest_first(standing, ranked[0], listed, needed, tested)
        # What is only part of the favourite is on the way to it, and not to be searched to the end.
        sets = SETS if best is ranked[0] else FIRST_SETS
        sizes = _sizes(listed, best, reached, overshot=overshot)
        again = frozenset(best.causes) in tested and sizes is None
        if again:
            if right:
                break
            other = _with_a_right_file(standing, best, listed, every, needed)
            if other is None:
                break
            best, right = other, True
            sizes = _sizes(listed, best, reached, overshot=overshot)
        accuracy = min(best.accuracy, RIGHT) if right else best.accuracy
        asking, acting = question, _acting(listed, best.causes)
        if sizes is not None or acting != question.listed.acting.keys():
            given = (asked.flown, reached if sizes is None else sizes, acting)
            asking = question.with_servos(quantities.build(aircraft, *given))
        asking = asking.at_delays_of(best.causes)
        foretold = listed.alone(best.causes, best.posterior.mean)
        near = standing if asking is question else None
        asked_for = [Trial(best.causes, standing.settled, foretold, near)]
        twin = other_names.renamed(best.causes, foretold, listed, every)
        if twin is not None and not (
            frozenset(twin.causes) in tested or set(needed.causes) - set(twin.causes)
        ):
            # Not from where they stood: what goes by the one name there would keep it.
            renamed = question.at(standing.settled, twin.values)
            asked_for.append(Trial(twin.causes, renamed, None, near))
        trying = telling("trying", turn)
        trials = asking.tried(trying, asked_for, standing.relations, every, accuracy, sets)
        trial = max(trials, key=lambda one: one.log_likelihood)
        won = trial.log_likelihood - trials[0].log_likelihood
        # Weighed about a wrong size, lags of three servos explained what a delay of 0.067 s in the
        # place of one of 0.1 s left over, by 340 nats.
        for _ in range(0 if overshot else RESIZED):
            found = _found(asking.listed, trial, accuracy)
            own = _freed(asking.listed, trial.causes, found)
            acting = _acting(listed, trial.causes)
            nearer = quantities.servo_sizes(own, sizes or reached, ROUGHLY, acting)
            if nearer is None:
                break
            there = quantities.build(aircraft, asked.flown, nearer, acting)
            there = question.with_servos(there).at_delays_of(trial.causes)
            going_on = [Trial(trial.causes, trial.settled, None, None)]
            by = trial.relations
            further = there.tried(trying, going_on, by, every, accuracy, sets)[0]
            if further.log_likelihood < trial.log_likelihood:
                break
            trial, asking, sizes = further, there, nearer
        lost = standing.log_likelihood - trial.log_likelihood
        if lost > REFUTED and any((sizes or reached)[name] != reached[name] for name in reached):
            # Reckoned with other sizes of the same servos it says nothing of the causes.
            overshot = True
            continue
        tested |= {frozenset(one.causes) for one in asked_for}
        calmer = trial.left < standing.left and lost <= REFUTED and not standing.ended
        if again and not (calmer or _likelier(trial, standing, listed, every, needed)):
            break
        off = listed.farthest(trial.causes, _found(asking.listed, trial, accuracy))
        if off >= INCREDIBLE:
            # It stands in for what is in no catalogue, which is to be looked for without it.
            farthest = off
            break
        if twin is not None and won > REFUTED:
            needed = Needed((twin.other,), won)
        more = all(cause in trial.causes for cause in standing.causes)
        if lost > REFUTED and not more:
            needed = Needed(standing.causes, lost)
        else:
            standing, question, reached = trial, asking, sizes or reached
        ranked = weighed(standing, needed)
    if roughly and not standing.causes:
        standing = question.rested(flying, standing)
        ranked = weighed(standing, needed)
    information, apart, done = standing.information, standing.apart, standing.each
    listed = question.listed
    ranked = tuple(_doubted(one, reached, listed) for one in ranked)
    progress("looking for what no cause stands for", (steps - 1) / steps)
    missing, gained = question.missing(standing)
    plain = ranked
    ranked, probability = unlisted.weighed(plain, missing)
    if missing is not None and unlisted.named(missing, probability, ranked):
        wider = asked.question(reached, missing).as_late_as(question)
        begun = question.carried(standing.settled, wider, missing)
        with_it = wider.answered(
            telling(f"trying {missing.coefficient} {missing.key}", ROUNDS),
            (UNLISTED,),
            begun,
            wider.relations(begun),
            causes=(UNLISTED,),
        )
        settled_with, settled_gain = wider.found(with_it, missing)
        own = gain.gained(information, apart, listed, plain[0].causes) if apart.count else 0.0
        won = (settled_gain - own) * apart.count if apart.count else 0.0
        ranked, probability = unlisted.weighed(plain, missing, won)
        if unlisted.named(missing, probability, ranked):
            missing, gained = settled_with, settled_gain
            question, done = wider, with_it.each
    # Only now: what finds no rest with the catalogue alone may find it with the missing term.
    for subject, last, stood_out in zip(question.subjects, done, leads, strict=True):
        if last.settled.restless:
            raise RestlessError(subject.one.recording.source, stood_out)
    return Investigation(
        quantities=question.quantities,
        unknowns=listed,
        candidates=every,
        information=information,
        apart=apart,
        ranked=ranked,
        missing=missing,
        unlisted=probability,
        missing_gain=gained,
        model=question.model,
        subjects=question.subjects,
        settled=tuple(last.settled for last in done),
        farthest=farthest,
        notes=tuple(
            f"{one.one.recording.source}: the filter had not quite settled after its last turn"
            for one, last in zip(question.subjects, done, strict=True)
            if not last.settled.ended
        ),
    )


def _strongest_first(
    standing: Answer,
    best: Ranked,
    listed: Unknowns,
    needed: Needed,
    tested: AbstractSet[frozenset[Candidate]],
) -> Ranked:
    """The favourite, or with many causes more than were free what explains most with one more.

    Where a search ended far from rest, all that is seen from there is a long way off, and causes
    that are not there make up for what a large one overshoots. Late commands in ArduPlane's flight
    came with an elevator's lag and an inertia that are not there; the search with all of them
    stood still 5 000 nats below where that with what is there ends.
    """
    known = set(standing.causes)
    if standing.ended or len(set(best.causes) - known) <= AT_ONCE:
        return best
    found = rank(standing.information, listed, best.causes, needed, {best.accuracy: 1.0})
    near = (one for one in found if len(set(one.causes) - known) <= 1)
    return next((one for one in near if frozenset(one.causes) not in tested), best)


def _with_a_right_file(
    standing: Answer,
    best: Ranked,
    listed: Unknowns,
    every: Sequence[Candidate],
    needed: Needed,
) -> Ranked | None:
    """Causes to be tried with a file that is right in all else; None where that is no question.

    Derivatives that are as free as a loose file leaves them take part of what is wrong upon
    themselves: two causes in a file that is 10 % wrong, or five in one that is right. Which of both
    it is a search with either must tell. Where a search finds no rest with the file as loose as it
    seems, its aerodynamics may have gone where they stand in for what is wrong.
    """
    if not best.causes or best.accuracy <= RIGHT:
        return None
    told = standing.information
    other = with_a_right_file(told, listed, every, needed)
    if other.causes and density(told, other) > density(told, best) - WORTH:
        return other
    return None if standing.ended else best


def _likelier(
    trial: Answer,
    standing: Answer,
    listed: Unknowns,
    every: Sequence[Candidate],
    needed: Needed,
) -> bool:
    """Whether flights are more probable with the best set of causes about one end than the other.

    Each measurement counts for as much in either.
    """
    count = min(trial.information.count, standing.information.count)
    there, here = (
        one.information.weighed(count / one.information.count) for one in (trial, standing)
    )
    best = (density(told, rank(told, listed, every, needed)[0]) for told in (there, here))
    return next(best) > next(best)


def _found(listed: Unknowns, trial: Answer, accuracy: float) -> Float[np.ndarray, " unknown"]:
    """What flights say of all unknowns where they were searched with causes set free."""
    return listed.as_accurate(accuracy).estimated(trial.information, trial.causes).mean


def _acting(listed: Unknowns, causes: Sequence[Candidate]) -> set[str]:
    """Lags and delays that causes free, of which it is known what more of them does."""
    freed = {name for one in causes for name in one.frees}
    return {name for name in freed if f"{quantities.MORE}{name}" in listed.names}


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


def _sizes(
    listed: Unknowns, best: Ranked, reached: Mapping[str, float], *, overshot: bool
) -> dict[str, float] | None:
    """With which sizes of servos' changes to reckon from now on; None where those are near enough.

    Args:
        listed: all unknowns.
        best: the favourite.
        reached: with which was reckoned so far.
        overshot: whether the flight was far less likely with sizes moved on from there, so that
            these stay. What is wrong beside a lag can make it seem longer wherever it is taken.
    """
    own = _freed(listed, best.causes, best.posterior.mean)
    sizes = quantities.servo_sizes(own, reached, acting=listed.acting)
    if sizes is None or not overshot:
        return sizes
    kept = {**sizes, **reached}
    return kept if kept.keys() > reached.keys() else None


def _freed(
    listed: Unknowns, causes: Sequence[Candidate], values: Float[np.ndarray, " unknown"]
) -> dict[str, float]:
    """Values of the quantities that causes free, with what is ordinarily off in the same way."""
    found = {}
    for name in (name for candidate in causes for name in candidate.frees):
        parts = [name, *([listed.beside[name]] if name in listed.beside else [])]
        found[name] = float(sum(values[listed.names.index(each)] for each in parts))
    return found
