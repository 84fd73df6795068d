"""A question that is asked of flights, and what they answer with causes set free.

Every flight is searched under beliefs about all that may be wrong, from where it was settled
before, and weighed where the search ends.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.diagnose.aided import (
    beliefs,
    gain,
    other_names,
    quantities,
    unknowns,
    unlisted,
)
from gcs_sysid.diagnose.aided.quantities import MISSING, Flown, Quantities
from gcs_sysid.diagnose.aided.ranking import likeliest_accuracy
from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.aided.unlisted import MissingTerm
from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate, Cause, Parameter
from gcs_sysid.diagnose.evidence import Information, posterior
from gcs_sysid.diagnose.unlisted import terms
from gcs_sysid.estimate import weighed
from gcs_sysid.estimate.settling import Beliefs, Settled
from gcs_sysid.estimate.weighed import Relation, Weighed
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.offline import leads, settled
from gcs_sysid.offline.flight import Flight
from gcs_sysid.offline.leads import Lead
from gcs_sysid.offline.settled import Subject

REFUTED = 100.0
"""Where flights settle with a favourite at so much less than with the one before it [nat], more
than what searches leave undone, all that does without the one before has so much less evidence:
linear evidence takes one cause for another whose trace at held gains is nearly the same."""
FIRST_SETS = 2
"""Times that instruments are used in a trial before it is seen whether it goes on: each takes half
a minute."""
Telling = Callable[[str, int], None]
"""Is told what is being done, and with which flight."""
UNLISTED = Candidate(
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
class Asked:
    """What questions are asked of.

    Attributes:
        aircraft: the simulation, less controls that the logs lack.
        flights: of that aircraft.
        fitted: which flights take part.
        held_out: maneuvers that take none.
    """

    aircraft: Aircraft
    flights: Sequence[Flight]
    fitted: Sequence[bool]
    held_out: Sequence[int]

    @cached_property
    def flown(self) -> Flown:
        """What of the flights decides which quantities there are."""
        return settled.flown(self.flights, self.aircraft)

    def question(
        self, reached: Mapping[str, float] | None = None, missing: MissingTerm | None = None
    ) -> Question:
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
            found.beside,
        )
        before = tuple(settled.believed(one, found, vanes=vanes) for one in subjects)
        return Question(found, every, subjects, names, listed, before, settled.model_of(found))


@dataclass(frozen=True)
class Answer:
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
    def relations(self) -> list[Relation]:
        """How errors of all unknowns were taken to move the scores of each flight."""
        return [one.by for one in self.each]

    @property
    def log_likelihood(self) -> float:
        """Of what was fitted."""
        return sum((one.log_likelihood[-1] for one in self.settled), 0.0)

    @property
    def left(self) -> float:
        """What steps would still gain [nat]."""
        return sum((one.left for one in self.settled), 0.0)

    @property
    def ended(self) -> bool:
        """Whether every flight came to rest."""
        return all(one.ended for one in self.settled)

    @property
    def moved(self) -> bool:
        """Whether a search ended elsewhere than where `relations` were worked out."""
        return any(one.moved for one in self.each)


@dataclass(frozen=True)
class Trial:
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
    near: Answer | None


@dataclass(frozen=True)
class Question:
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

    def with_servos(self, found: Quantities) -> Question:
        """The same of servos that are reckoned with otherwise."""
        subjects = tuple(settled.with_servos(one, found) for one in self.subjects)
        listed = replace(self.listed, acting=found.acting)
        return replace(self, quantities=found, subjects=subjects, listed=listed)

    def at_delays_of(self, causes: Sequence[Candidate]) -> Question:
        """The same with surfaces looked up where causes that delay them leave them.

        Looked up about the ordinary delay as well, one that a cause sets free is made of two
        pieces: of 0.1 s of a flight 0.049 were the one and 0.052 the other, throttles were half as
        late as surfaces, and three quarters of the thrust were named beside it.
        """
        if not any(name in self.listed.beside for each in causes for name in each.frees):
            return self
        return replace(
            self, subjects=tuple(settled.undelayed(one, self.quantities) for one in self.subjects)
        )

    def as_late_as(self, other: Question) -> Question:
        """The same with surfaces looked up about the delays of another question."""
        subjects = tuple(
            settled.with_servos(replace(one, late=its.late), self.quantities)
            for one, its in zip(self.subjects, other.subjects, strict=True)
        )
        return replace(self, subjects=subjects)

    def begun(
        self, telling: Telling, causes: Sequence[Candidate] = ()
    ) -> tuple[Question, list[Settled]]:
        """Flights settled by turns under the simulation's own beliefs, and the question there.

        Args:
            telling: told about every turn.
            causes: lags that are set free and begun with at the size that is reckoned with.

        Raises:
            RefusedError: the filter lost the aircraft, or cannot tell it from the air.
        """
        begun = []
        acting = np.array([self.listed.acting.get(name, 0.0) for name in self.listed.names])
        for number, (one, own) in enumerate(zip(self.subjects, self.before, strict=True)):
            if causes:
                one = settled.departed(one, self.listed.in_flight(number, acting))
                own = with_free(own, self.listed, number, causes)
            begun.append(settled.begin(self.model, one, own, _about(telling, number)))
        subjects = tuple(
            settled.with_delay(one, self.quantities, done)
            for one, done in zip(self.subjects, begun, strict=True)
        )
        return replace(self, subjects=subjects), begun

    def leads(self, begun: Sequence[Settled]) -> list[list[Lead]]:
        """What stands out of each flight where it was begun."""
        return [
            leads.standing_out(self.names, own, one)
            for own, one in zip(self.before, begun, strict=True)
        ]

    def relations(self, done: Sequence[Settled]) -> list[Relation]:
        """How errors of all unknowns move the scores of each flight."""
        return [
            settled.relation(self.model, one, own, last)
            for one, own, last in zip(self.subjects, self.before, done, strict=True)
        ]

    def answered(
        self,
        telling: Telling,
        named: Sequence[Candidate],
        start: Sequence[Settled],
        relations: Sequence[Relation],
        *,
        causes: Sequence[Candidate] = (),
        accuracy: float = 1.0,
        moved: Float[np.ndarray, " unknown"] | None = None,
        near: Answer | None = None,
        sets: int = weighed.SETS,
    ) -> Answer:
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
            begun = [start[number].values - own.mean]
            again = None if near is None else near.each[number].asked_again(relations[number])
            if moved is not None:
                foretold = self.listed.in_flight(number, moved)
                # Where it was before may be nearer than what linear evidence foretells.
                begun = [foretold, *begun] if one.fitted.any() else [foretold]
            each.append(
                settled.weigh(
                    self.model,
                    one,
                    with_free(own, listed, number, causes) if causes else own,
                    start[number],
                    relations[number],
                    _about(telling, number),
                    first=[
                        own.mean + other_names.gathered(causes, place, listed, number)
                        for place in begun
                    ],
                    asked=again,
                    sets=sets,
                )
            )
        return Answer(tuple(named), each, *_summed(self.listed, self.before, each))

    def searched(
        self,
        telling: Telling,
        trial: Trial,
        relations: Sequence[Relation],
        every: Sequence[Candidate],
        accuracy: float,
        sets: int,
    ) -> Answer:
        """Flights searched with one set of causes set free; arguments as for `tried`."""
        names = " and ".join(each.label for each in trial.causes)
        return self.answered(
            lambda text, number: telling(f"{names}, {text}", number),
            *(trial.causes, trial.start, relations),
            causes=wherever(trial.causes, every),
            accuracy=accuracy,
            moved=trial.moved,
            near=trial.near,
            sets=sets,
        )

    def tried(
        self,
        telling: Telling,
        trials: Sequence[Trial],
        relations: Sequence[Relation],
        every: Sequence[Candidate],
        accuracy: float,
        sets: int,
        rival: Callable[[], float] = lambda: -np.inf,
    ) -> list[Answer]:
        """Flights searched with each of some sets of causes set free.

        One that is far behind after `FIRST_SETS` is left there. One that has not come to rest by
        then goes on by how errors move the scores where it is: taken from where nothing was set
        free, steps promised 200 nats for half an hour and gained none.

        Args:
            telling: told about every step.
            trials: what is set free.
            relations: how errors show in each flight where nothing was tried yet.
            every: all causes.
            accuracy: of the file's aerodynamics, in its sigmas.
            sets: times that instruments are used at most in one that goes on.
            rival: log-likelihood with something else set free, that they may be far behind as well;
                asked for only where one would go on.
        """

        def gone_on(one: Answer) -> Answer:
            telling("working out how errors show there", len(one.each) - 1)
            going_on = Trial(one.causes, one.settled, None, one)
            by = self.relations(one.settled)
            return self.searched(telling, going_on, by, every, accuracy, sets)

        begun = [
            self.searched(telling, trial, relations, every, accuracy, FIRST_SETS)
            for trial in trials
        ]
        hopeless = max(one.log_likelihood for one in begun) - REFUTED

        def goes_on(trial: Trial, one: Answer) -> bool:
            # Of the same question at the same point nothing else would be worked out.
            known = trial.near is not None and not one.moved
            return not (one.ended or one.log_likelihood < hopeless or known)

        going_on = [goes_on(*pair) for pair in zip(trials, begun, strict=True)]
        outdone = rival() - REFUTED if any(going_on) else -np.inf
        return [
            gone_on(one) if more and one.log_likelihood > outdone else one
            for one, more in zip(begun, going_on, strict=True)
        ]

    def rested(self, telling: Telling, found: Answer) -> Answer:
        """Flights searched on without any cause, unless all have come to rest."""
        if found.ended:
            return found
        return self.answered(telling, (), found.settled, found.relations, near=found)

    def at(self, done: Sequence[Settled], values: Float[np.ndarray, " unknown"]) -> list[Settled]:
        """Where flights were settled, but for the parameters: those of these departures."""
        return [
            replace(one, values=own.mean + self.listed.in_flight(number, values))
            for number, (one, own) in enumerate(zip(done, self.before, strict=True))
        ]

    def missing(self, found: Answer) -> tuple[MissingTerm | None, float]:
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
        self, done: Sequence[Settled], wider: Question, missing: MissingTerm
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

    def found(self, answer: Answer, missing: MissingTerm) -> tuple[MissingTerm, float]:
        """The missing term with flights settled with it, and what it gains."""
        information = answer.information
        accuracy = likeliest_accuracy(information, self.listed, (UNLISTED,))
        accurate = self.listed.as_accurate(accuracy)
        under = posterior(information, *accurate.freed((UNLISTED,)))
        value, deviation = accurate.along((MISSING,), under.mean, under.covariance)[MISSING]
        gained = gain.gained(information, answer.apart, accurate, (UNLISTED,))
        return replace(missing, value=value, deviation=deviation, accuracy=accuracy), gained


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


def with_free(own: Beliefs, listed: Unknowns, number: int, causes: Sequence[Candidate]) -> Beliefs:
    """Beliefs about a flight with causes set free, and what goes by another name for one held.

    What is ordinarily off in servos and the like is weighed, and not looked for: to first order.
    """
    places = listed.own[number]
    sigma, mean = listed.freed(causes)
    held = other_names.unnamed(causes, listed, number)
    ordinary = np.diag(np.where(held, 0.0, sigma[places]) ** 2)
    quantities_free = listed.alone(causes, sigma)[listed.parameters :]
    along = listed.directions[places] * quantities_free
    centre = own.mean + listed.directions[places] @ mean[listed.parameters :]
    return replace(own, mean=centre, covariance=ordinary + along @ along.T)
