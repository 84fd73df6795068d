"""From flights and a simulation to a ranking of causes: the whole inference in one place.

Every flight is settled under the simulation's own beliefs; its innovations and their sensitivities
then weigh all causes at once, by linear algebra. What that favours is put to the test: the flights
are settled again with it set free, and everything is weighed about that point, until the favourite
stays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.diagnose.aided import beliefs, gain, other_names, quantities, unknowns, unlisted
from gcs_sysid.diagnose.aided.quantities import MISSING, Flown, Quantities
from gcs_sysid.diagnose.aided.ranking import NONE_NEEDED, Needed, likeliest_accuracy, rank
from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.aided.unlisted import MissingTerm
from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate, Cause, Parameter
from gcs_sysid.diagnose.evidence import Information, posterior
from gcs_sysid.diagnose.hypothesis import Ranked
from gcs_sysid.diagnose.unlisted import terms
from gcs_sysid.diagnose.verdict import INCREDIBLE
from gcs_sysid.estimate import weighed
from gcs_sysid.estimate.settling import Beliefs, Settled
from gcs_sysid.estimate.weighed import Relation, Weighed
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.offline import settled
from gcs_sysid.offline.flight import Flight, Progress
from gcs_sysid.offline.settled import Subject

ROUNDS = 3
"""Favourites that are put to the test."""
REFUTED = 100.0
"""Where flights settle with a favourite at so much less than with the one before it [nat], more
than what searches leave undone, all that does without the one before has so much less evidence:
linear evidence takes one cause for another whose trace at held gains is nearly the same."""
FIRST_SETS = 2
"""Times that instruments are used in each of two trials before the one that is far behind is left:
each takes half a minute."""
Telling = Callable[[str, int], None]
"""Is told what is being done, and with which flight."""
_MISSING = Candidate(
    Cause(
        name="unlisted",
        parameters=(
            Parameter("value", MISSING, nominal=0.0, sigma=1.0, matters=0.0, unit="1", per=MISSING),
        ),
        explanation="",
        shown_by="",
    )
)
"""A missing term as a cause, once it is known which."""


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

    def gained(self, causes: Sequence[Candidate]) -> float:
        """Log predictive density per measurement that causes gain on what took no part."""
        return gain.gained(self.information, self.apart, self.believed, causes)

    def as_it_is(self, causes: Sequence[Candidate]) -> float:
        """Log predictive density per measurement of what took no part.

        With the file as it is in what these causes are about.
        """
        held = self.believed.as_it_is(causes)
        total = gain.foretold(self.information, self.apart, held, ())
        return total / max(self.apart.count, 1.0)


def investigate(
    aircraft: Aircraft,
    flights: Sequence[Flight],
    fitted: Sequence[bool],
    held_out: Sequence[int],
    progress: Progress,
) -> Investigation:
    """Ranks all sets of causes.

    Args:
        aircraft: the simulation, less controls that the logs lack.
        flights: of that aircraft.
        fitted: which flights take part.
        held_out: maneuvers that take none.
        progress: told what is being done.

    Raises:
        RefusedError: the filter lost the aircraft, or its search found no rest.
    """
    asked = _Asked(aircraft, flights, fitted, held_out)
    reached = dict[str, float]()
    question = asked.question()
    listed, every = question.listed, question.every
    steps = len(flights) * (1 + ROUNDS)

    def telling(doing: str, turn: int) -> Telling:
        return lambda text, number: progress(
            f"{doing}: {text}", (len(flights) * turn + number) / steps
        )

    flying = telling("flying the simulation along", 0)
    question, begun = question.begun(flying)
    flying("working out how errors show", len(flights) - 1)
    relations = question.relations(begun)
    # Where a cause stands out at once, what is left to gain without it is of no use.
    standing = question.tested(flying, (), begun, relations, sets=1)
    ranked = rank(standing.information, listed, every)
    roughly = bool(ranked[0].causes)
    if not roughly:
        standing = question.rested(flying, standing, relations)
        ranked = rank(standing.information, listed, every)
    tested: set[frozenset[Candidate]] = {frozenset()}
    needed, farthest = NONE_NEEDED, 0.0
    for turn in range(1, ROUNDS + 1):
        best = ranked[0]
        sizes = quantities.servo_sizes(_freed(listed, best), reached)
        if frozenset(best.causes) in tested and sizes is None:
            break
        asking = question
        if sizes is not None:
            asking = question.with_servos(quantities.build(aircraft, asked.flown, sizes))
        foretold = listed.alone(best.causes, best.posterior.mean)
        near = standing if asking is question else None
        asked_for = [_Trial(best.causes, standing.settled, foretold, near)]
        twin = other_names.renamed(best.causes, foretold, listed, every)
        if twin is not None and frozenset(twin.causes) not in tested:
            # Not from where they stood: what goes by the one name there would keep it.
            renamed = question.at(standing.settled, twin.values)
            asked_for.append(_Trial(twin.causes, renamed, None, near))
        trying = telling("trying", turn)
        trials = asking.tried(trying, asked_for, relations, every, best.accuracy)
        tested |= {frozenset(one.causes) for one in asked_for}
        trial = max(trials, key=lambda one: one.log_likelihood)
        off = listed.farthest(trial.causes, _found(listed, trial, best.accuracy))
        if off >= INCREDIBLE:
            # It stands in for what is in no catalogue, which is to be looked for without it.
            farthest = off
            break
        won = trial.log_likelihood - trials[0].log_likelihood
        if twin is not None and won > REFUTED:
            needed = Needed((twin.other,), won)
        lost = standing.log_likelihood - trial.log_likelihood
        more = all(cause in trial.causes for cause in standing.causes)
        if lost > REFUTED and not more:
            needed = Needed(standing.causes, lost)
        else:
            standing, question, reached = trial, asking, sizes or reached
        ranked = rank(standing.information, listed, every, needed)
    if roughly and not standing.causes:
        standing = question.rested(flying, standing, relations)
        ranked = rank(standing.information, listed, every, needed)
    information, apart, done = standing.information, standing.apart, standing.each
    ranked = tuple(_doubted(one, reached) for one in ranked)
    progress("looking for what no cause stands for", (steps - 1) / steps)
    missing, gained = question.missing(standing)
    ranked, probability = unlisted.weighed(ranked, missing)
    if missing is not None and unlisted.named(missing, probability, ranked):
        wider = asked.question(reached, missing).as_late_as(question)
        begun = question.carried(standing.settled, wider, missing)
        with_it = wider.tested(
            telling(f"trying {missing.coefficient} {missing.key}", ROUNDS),
            (_MISSING,),
            begun,
            wider.relations(begun),
            causes=(_MISSING,),
        )
        missing, gained = wider.found(with_it, missing)
        question, done = wider, with_it.each
    # Only now: what finds no rest with the catalogue alone may find it with the missing term.
    for subject, last in zip(question.subjects, done, strict=True):
        settled.rested(subject, last.settled)
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


@dataclass(frozen=True)
class _Asked:
    """What an investigation is given, see `investigate`."""

    aircraft: Aircraft
    flights: Sequence[Flight]
    fitted: Sequence[bool]
    held_out: Sequence[int]

    @cached_property
    def flown(self) -> Flown:
        return settled.flown(self.flights, self.aircraft)

    def question(
        self, reached: Mapping[str, float] | None = None, missing: MissingTerm | None = None
    ) -> _Question:
        """All that may be wrong, and with a missing term that one too."""
        found = quantities.build(self.aircraft, self.flown, reached)
        if missing is not None:
            found = quantities.with_term(
                found, missing.coefficient, missing.key, sigma=missing.sigma
            )
        every = quantities.candidates(CAUSES, found)
        subjects = tuple(
            settled.prepare(one, found, self.held_out, apart=not part)
            for one, part in zip(self.flights, self.fitted, strict=True)
        )
        vanes = "vanes" in found.has
        names = quantities.names(subjects[0].first.means)
        flow = {
            name: np.concatenate([one.samples.regressors[name] for one in self.flights])
            for name in self.flights[0].samples.regressors
        }
        listed = unknowns.of_flights(
            names,
            beliefs.ordinary(names, found.aircraft, vanes=vanes),
            found.directions,
            unknowns.tolerated(every, found.directions, found.sizes),
            found.sizes,
            len(self.flights),
            beliefs.negligible(names, found.aircraft, flow),
            found.least,
            found.either,
        )
        before = tuple(settled.believed(one, found, vanes=vanes) for one in subjects)
        return _Question(found, every, subjects, names, listed, before, settled.model_of(found))


@dataclass(frozen=True)
class _Tested:
    """Flights searched and weighed with causes set free.

    Attributes:
        causes: which.
        each: flights.
        information: of what was fitted, of all flights.
        apart: of what took no part.
    """

    causes: tuple[Candidate, ...]
    each: Sequence[Weighed]
    information: Information
    apart: Information

    @property
    def settled(self) -> list[Settled]:
        """Where the flights ended."""
        return [one.settled for one in self.each]

    @property
    def log_likelihood(self) -> float:
        """Of what was fitted."""
        return sum(one.log_likelihood[-1] for one in self.settled)

    @property
    def ended(self) -> bool:
        """Whether every flight came to rest."""
        return all(one.ended for one in self.settled)


@dataclass(frozen=True)
class _Trial:
    """Causes that are to be set free.

    Attributes:
        causes: which.
        start: where the flights begin.
        moved: departures of all unknowns to begin with; None for those of there.
        near: where the same question was answered nearby; None where none was.
    """

    causes: Sequence[Candidate]
    start: Sequence[Settled]
    moved: Float[np.ndarray, " unknown"] | None
    near: _Tested | None


@dataclass(frozen=True)
class _Question:
    """What is asked of flights.

    Attributes:
        quantities: what causes set free.
        every: all causes.
        subjects: the flights.
        names: of the model's parameters.
        listed: all unknowns.
        before: beliefs about each flight.
        model: the aircraft with all terms.
    """

    quantities: Quantities
    every: tuple[Candidate, ...]
    subjects: tuple[Subject, ...]
    names: tuple[str, ...]
    listed: Unknowns
    before: tuple[Beliefs, ...]
    model: FlightModel

    def with_servos(self, found: Quantities) -> _Question:
        """The same of servos that are reckoned with otherwise."""
        subjects = tuple(settled.with_servos(one, found) for one in self.subjects)
        return replace(self, quantities=found, subjects=subjects)

    def as_late_as(self, other: _Question) -> _Question:
        """The same with surfaces looked up about the delays of another question."""
        subjects = tuple(
            settled.with_servos(replace(one, late=its.late), self.quantities)
            for one, its in zip(self.subjects, other.subjects, strict=True)
        )
        return replace(self, subjects=subjects)

    def begun(self, telling: Telling) -> tuple[_Question, list[Settled]]:
        """Flights settled by turns under the simulation's own beliefs, and the question there."""
        begun = [
            settled.begin(self.model, one, own, _about(telling, number))
            for number, (one, own) in enumerate(zip(self.subjects, self.before, strict=True))
        ]
        subjects = tuple(
            settled.with_delay(one, self.quantities, done)
            for one, done in zip(self.subjects, begun, strict=True)
        )
        return replace(self, subjects=subjects), begun

    def relations(self, done: Sequence[Settled]) -> list[Relation]:
        """How errors of all unknowns move the scores of each flight."""
        return [
            settled.relation(self.model, one, own, last)
            for one, own, last in zip(self.subjects, self.before, done, strict=True)
        ]

    def tested(
        self,
        telling: Telling,
        named: Sequence[Candidate],
        start: Sequence[Settled],
        relations: Sequence[Relation],
        *,
        causes: Sequence[Candidate] = (),
        accuracy: float = 1.0,
        moved: Float[np.ndarray, " unknown"] | None = None,
        near: _Tested | None = None,
        sets: int = weighed.SETS,
    ) -> _Tested:
        """Every flight searched with causes set free, and what all say there.

        Args:
            telling: told about every flight's steps.
            named: the causes that are put to the test.
            start: where the flights were settled before.
            relations: how errors show in each of them.
            causes: what is set free, `named` at all their places.
            accuracy: of the file's aerodynamics, in its sigmas: where it is good, what it cannot
                have wrong is not to move in the cause's stead.
            moved: departures of all unknowns to begin with; None where they were before.
            near: where the same question was answered before, nearby.
            sets: times that instruments are used at most in each flight.
        """
        each, listed = [], self.listed.as_accurate(accuracy)
        for number, (one, own) in enumerate(zip(self.subjects, self.before, strict=True)):
            each.append(
                settled.weigh(
                    self.model,
                    one,
                    _with(own, listed, number, causes) if causes else own,
                    start[number],
                    relations[number],
                    _about(telling, number),
                    moved=None if moved is None else self.listed.in_flight(number, moved),
                    asked=None if near is None else near.each[number].asked,
                    sets=sets,
                )
            )
        return _Tested(tuple(named), each, *_summed(self.listed, self.before, each))

    def tried(
        self,
        telling: Telling,
        trials: Sequence[_Trial],
        relations: Sequence[Relation],
        every: Sequence[Candidate],
        accuracy: float,
    ) -> list[_Tested]:
        """Flights searched with each of some sets of causes set free.

        One that is far behind after `FIRST_SETS` is left there.
        """

        def searched(trial: _Trial, sets: int) -> _Tested:
            names = " and ".join(each.label for each in trial.causes)
            return self.tested(
                lambda text, number: telling(f"{names}, {text}", number),
                *(trial.causes, trial.start, relations),
                causes=wherever(trial.causes, every),
                accuracy=accuracy,
                moved=trial.moved,
                near=trial.near,
                sets=sets,
            )

        if len(trials) == 1:
            return [searched(trials[0], weighed.SETS)]
        begun = [searched(trial, FIRST_SETS) for trial in trials]
        hopeless = max(one.log_likelihood for one in begun) - REFUTED
        return [
            one
            if one.ended or one.log_likelihood < hopeless
            else searched(_Trial(one.causes, one.settled, None, one), weighed.SETS)
            for one in begun
        ]

    def rested(self, telling: Telling, found: _Tested, relations: Sequence[Relation]) -> _Tested:
        """Flights searched on without any cause, unless all have come to rest."""
        if found.ended:
            return found
        return self.tested(telling, (), found.settled, relations, near=found)

    def at(self, done: Sequence[Settled], values: Float[np.ndarray, " unknown"]) -> list[Settled]:
        """Where flights were settled, but for the parameters: those of these departures."""
        return [
            replace(one, values=own.mean + self.listed.in_flight(number, values))
            for number, (one, own) in enumerate(zip(done, self.before, strict=True))
        ]

    def missing(self, found: _Tested) -> tuple[MissingTerm | None, float]:
        """A term that nothing listed stands for, and what it gains on what took no part."""
        products = terms(self.quantities.aircraft.control_names)
        more = unlisted.names(products)
        listed = self.listed.with_more(more)
        wide = [
            settled.with_terms(self.model, one, last, self.names, products)
            for one, last in zip(self.subjects, found.each, strict=True)
        ]
        stretched = [settled.stretched(own, len(more)) for own in self.before]
        fitted, apart = _summed(listed, stretched, wide)
        samples = self.subjects[0].one.samples
        sigma = unlisted.sizes(products, samples.regressors, samples.measured)
        missing = unlisted.strongest(fitted, apart, listed, products, sigma)
        if missing is None:
            return None, float(np.nan)
        index = more.index(f"missing.{missing.coefficient}.{missing.key}")
        accurate = listed.as_accurate(missing.accuracy)
        return missing, unlisted.gained(fitted, apart, accurate, index, sigma)

    def carried(
        self, done: Sequence[Settled], wider: _Question, missing: MissingTerm
    ) -> list[Settled]:
        """Where flights were settled, as where a question with one more term begins."""
        places = [wider.names.index(name) for name in self.names]
        (term,) = wider.quantities.directions[MISSING]
        carried = []
        for one in done:
            values = np.zeros(len(wider.names))
            values[places] = one.values
            values[wider.names.index(term)] += missing.value
            carried.append(replace(one, values=values))
        return carried

    def found(self, tested: _Tested, missing: MissingTerm) -> tuple[MissingTerm, float]:
        """The missing term with flights settled with it, and what it gains."""
        information = tested.information
        accuracy = likeliest_accuracy(information, self.listed, (_MISSING,))
        accurate = self.listed.as_accurate(accuracy)
        under = posterior(information, *accurate.freed((_MISSING,)))
        value, deviation = accurate.along((MISSING,), under.mean, under.covariance)[MISSING]
        gained = gain.gained(information, tested.apart, accurate, (_MISSING,))
        return replace(missing, value=value, deviation=deviation, accuracy=accuracy), gained


def _found(listed: Unknowns, trial: _Tested, accuracy: float) -> Float[np.ndarray, " unknown"]:
    """What flights say of all unknowns where they were searched with causes set free."""
    given = listed.as_accurate(accuracy).freed(trial.causes)
    return posterior(trial.information, *given).mean


def _about(telling: Telling, number: int) -> Callable[[str], None]:
    """Told of one flight."""
    return lambda text: telling(text, number)


def _summed(
    listed: Unknowns, before: Sequence[Beliefs], each: Sequence[Weighed]
) -> tuple[Information, Information]:
    """What all flights say of all unknowns by what was fitted, and by what was not."""
    parts = [
        settled.told(listed, number, own, one)
        for number, (own, one) in enumerate(zip(before, each, strict=True))
    ]
    fitted, apart = parts[0]
    for more, others in parts[1:]:
        fitted, apart = fitted.plus(more), apart.plus(others)
    return fitted, apart


def wherever(causes: Sequence[Candidate], every: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """The causes, at all places where they may be: about a wrong place the right one looks bad.

    Not where only one place can be free, since each is all of the effect.
    """
    found = []
    for one in causes:
        free = one.cause.where and not any(each.expected for each in one.cause.parameters)
        same = [each for each in every if (each.cause, each.about) == (one.cause, one.about)]
        found += same if free else [one]
    return tuple(found)


def _doubted(one: Ranked, reached: Mapping[str, float]) -> Ranked:
    """As sure of lag and play as the size allows at which their change was taken."""
    estimates = tuple(
        tuple(
            replace(
                item,
                deviation=float(
                    np.hypot(item.deviation, quantities.servo_doubt(name, item.value, reached))
                ),
            )
            for name, item in zip(candidate.frees, found, strict=True)
        )
        if len(candidate.frees) == len(found)
        else found
        for candidate, found in zip(one.causes, one.estimates, strict=True)
    )
    return replace(one, estimates=estimates)


def _freed(listed: Unknowns, best: Ranked) -> dict[str, float]:
    """Values of the quantities that causes free."""
    values = best.posterior.mean
    return {
        name: float(values[listed.names.index(name)])
        for candidate in best.causes
        for name in candidate.frees
    }


def _with(own: Beliefs, listed: Unknowns, number: int, causes: Sequence[Candidate]) -> Beliefs:
    """Beliefs about a flight with causes set free.

    What is ordinarily off in servos and the like is weighed, and not looked for: to first order.
    """
    places = listed.own[number]
    sigma, mean = listed.freed(causes)
    ordinary = np.diag(sigma[places] ** 2)
    quantities_free = listed.alone(causes, sigma)[listed.parameters :]
    along = listed.directions[places] * quantities_free
    centre = own.mean + listed.directions[places] @ mean[listed.parameters :]
    return replace(own, mean=centre, covariance=ordinary + along @ along.T)
