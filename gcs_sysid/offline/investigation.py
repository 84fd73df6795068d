"""From flights and a simulation to a ranking of causes: the whole inference in one place.

Every flight is settled under the simulation's own beliefs; its innovations and their sensitivities
then weigh all causes at once, by linear algebra. What that favours is put to the test: the flights
are settled again with it set free, and everything is weighed about that point, until the favourite
stays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.diagnose.aided import beliefs, gain, quantities, unknowns, unlisted
from gcs_sysid.diagnose.aided.quantities import Quantities
from gcs_sysid.diagnose.aided.ranking import rank
from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.aided.unlisted import MissingTerm
from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information
from gcs_sysid.diagnose.hypothesis import Ranked
from gcs_sysid.diagnose.unlisted import terms
from gcs_sysid.estimate.settling import Beliefs, Settled
from gcs_sysid.offline import settled
from gcs_sysid.offline.flight import Flight, Progress
from gcs_sysid.offline.settled import Subject
from gcs_sysid.reconstruct.aided_smoother import FlightModel

ROUNDS = 3
"""Favourites that are put to the test."""


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
        model: the aircraft with all terms.
        subjects: the flights.
        settled: where each of them settled.
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
    """
    flown, reached = settled.flown(flights, aircraft), dict[str, float]()
    found = quantities.build(aircraft, flown)
    every = quantities.candidates(CAUSES, found)
    subjects = [
        settled.prepare(one, found, held_out, apart=not part)
        for one, part in zip(flights, fitted, strict=True)
    ]
    vanes = "vanes" in found.has
    before = [settled.believed(one, found, vanes=vanes) for one in subjects]
    names = quantities.names(subjects[0].first.means)
    ordinary = beliefs.ordinary(names, found.aircraft, vanes=vanes)
    usual = unknowns.tolerated(every, found.directions, found.sizes)
    flow = {
        name: np.concatenate([one.samples.regressors[name] for one in flights])
        for name in flights[0].samples.regressors
    }
    listed = unknowns.of_flights(
        *(names, ordinary, found.directions, usual, found.sizes, len(flights)),
        beliefs.negligible(names, found.aircraft, flow),
    )
    model = settled.model_of(found)
    steps = len(flights) * (1 + ROUNDS)
    done: list[Settled] = []
    for number, (one, own) in enumerate(zip(subjects, before, strict=True)):

        def told(text: str, number: int = number) -> None:
            progress(f"flying the simulation along: {text}", number / steps)

        done.append(settled.settle(model, one, own, told))
    information, apart = _summed(listed, before, done)
    ranked = rank(information, listed, every)
    tested: list[tuple[Candidate, ...]] = [()]
    for turn in range(1, ROUNDS + 1):
        best = ranked[0]
        sizes = quantities.servo_sizes(_freed(listed, best), reached)
        if best.causes in tested and sizes is None:
            break
        if sizes is not None:
            reached = sizes
            found = quantities.build(aircraft, flown, reached)
            subjects = [settled.with_servos(one, found) for one in subjects]
        tested.append(best.causes)
        words = " and ".join(candidate.label for candidate in best.causes)

        def trying(text: str, turn: int = turn, words: str = words) -> None:
            progress(f"trying {words}: {text}", len(flights) * turn / steps)

        done = [
            settled.settle(
                model,
                one,
                _with(own, listed, number, best.causes),
                trying,
                start=last,
                moved=listed.in_flight(number, listed.alone(best.causes, best.posterior.mean)),
            )
            for number, (one, own, last) in enumerate(zip(subjects, before, done, strict=True))
        ]
        information, apart = _summed(listed, before, done)
        ranked = rank(information, listed, every)
    ranked = tuple(_doubted(one, reached) for one in ranked)
    progress("looking for what no cause stands for", (steps - 1) / steps)
    missing, gain_of_it = _missing(model, names, found, listed, before, done, subjects)
    ranked, probability = unlisted.weighed(ranked, missing)
    return Investigation(
        quantities=found,
        unknowns=listed,
        candidates=every,
        information=information,
        apart=apart,
        ranked=ranked,
        missing=missing,
        unlisted=probability,
        missing_gain=gain_of_it,
        model=model,
        subjects=tuple(subjects),
        settled=tuple(done),
        notes=tuple(
            f"{one.one.recording.source}: the filter had not quite settled after its last turn"
            for one, last in zip(subjects, done, strict=True)
            if not last.ended
        ),
    )


def _summed(
    listed: Unknowns, before: Sequence[Beliefs], done: Sequence[Settled]
) -> tuple[Information, Information]:
    """What all flights say by what was fitted, and by what was not."""
    parts = [
        settled.told(listed, number, own, one)
        for number, (own, one) in enumerate(zip(before, done, strict=True))
    ]
    fitted, apart = parts[0]
    for more, others in parts[1:]:
        fitted, apart = fitted.plus(more), apart.plus(others)
    return fitted, apart


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
    sigma, mean = listed.freed(causes)
    quantities_free = listed.alone(causes, sigma)[listed.parameters :]
    places = listed.own[number]
    along = listed.directions[places] * quantities_free
    centre = own.mean + listed.directions[places] @ mean[listed.parameters :]
    return replace(own, mean=centre, covariance=own.covariance + along @ along.T)


def _missing(
    model: FlightModel,
    names: Sequence[str],
    found: Quantities,
    known: Unknowns,
    before: Sequence[Beliefs],
    done: Sequence[Settled],
    subjects: Sequence[Subject],
) -> tuple[MissingTerm | None, float]:
    """A term that nothing in the catalogue stands for, and what it gains on what took no part."""
    products = terms(found.aircraft.control_names)
    more = unlisted.names(products)
    listed = known.with_more(more)
    wide = [
        settled.with_terms(model, one, last, names, products)
        for one, last in zip(subjects, done, strict=True)
    ]
    stretched = [settled.stretched(own, len(more)) for own in before]
    fitted, apart = _summed(listed, stretched, wide)
    samples = subjects[0].one.samples
    sigma = unlisted.sizes(products, samples.regressors, samples.measured)
    missing = unlisted.strongest(fitted, apart, listed, products, sigma)
    if missing is None:
        return None, float(np.nan)
    index = more.index(f"missing.{missing.coefficient}.{missing.key}")
    accurate = listed.as_accurate(missing.accuracy)
    return missing, unlisted.gained(fitted, apart, accurate, index, sigma)
