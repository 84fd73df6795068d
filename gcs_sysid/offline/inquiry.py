"""Which causes are put to the test, one set after the other, until the favourite stays.

Every flight is settled under the simulation's own beliefs; its innovations and their sensitivities
then weigh all causes at once, by linear algebra. What that favours is put to the test: the flights
are settled again with it set free, and everything is weighed about that point.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gcs_sysid.diagnose.aided import other_names, quantities
from gcs_sysid.diagnose.aided.other_names import Renamed
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
from gcs_sysid.diagnose.hypothesis import Ranked
from gcs_sysid.diagnose.verdict import INCREDIBLE
from gcs_sysid.errors import RefusedError
from gcs_sysid.estimate.settling import QUIET
from gcs_sysid.estimate.weighed import SETS
from gcs_sysid.offline import servo_sizes
from gcs_sysid.offline.flight import Progress
from gcs_sysid.offline.promised import Reached, likelier, overrated, reached
from gcs_sysid.offline.question import (
    FIRST_SETS,
    REFUTED,
    UNLISTED,
    Answer,
    Asked,
    Question,
    Telling,
    Trial,
)

ROUNDS = 6
"""Times that favourites are put to the test."""
RESIZED = 3
"""Times that the same causes are tried with the sizes of servos' changes moved on."""
ROUGHLY = 0.03
"""Share within which such a size is right enough to weigh other causes about it."""
ABOUT = 0.1
"""Share within which it is right enough to search to the end with."""
AT_ONCE = 2
"""So many causes more are set free at most where the search without them found no rest."""
WORTH = 30.0
"""A file that is right but for more causes is looked into where it has less evidence by so much at
most, about a point that was found with the file as loose as it seemed [nat]."""
Kept = Callable[[tuple[Ranked, ...]], None]
"""Takes sets of causes as they are ranked so far, the most probable first."""


def unkept(_ranked: tuple[Ranked, ...]) -> None:
    """For those who want the end only."""


class _Favourite(NamedTuple):
    """Causes that are to be set free.

    Attributes:
        best: the causes, and with which accuracy of the file.
        accuracy: of the file's aerodynamics, in its sigmas.
        sizes: of servos' changes that are new to be reckoned with; None where those are near.
        again: whether the same causes were tried before.
        sets: times that instruments are used at most in a search with them.
    """

    best: Ranked
    accuracy: float
    sizes: dict[str, float] | None
    again: bool
    sets: int


class _Tried(NamedTuple):
    """What was tried for a favourite.

    Attributes:
        trial: flights searched with the likelier of its names.
        question: that was asked.
        sizes: of servos' changes with which it was.
        twin: the favourite by its other name, where that was tried as well.
        won: by how much it is likelier than by the first name [nat].
        sets: of causes that were tried.
    """

    trial: Answer
    question: Question
    sizes: dict[str, float]
    twin: Renamed | None
    won: float
    sets: list[frozenset[Candidate]]


class _AskedFor(NamedTuple):
    """What nothing listed stands for, as flights have it where they stand.

    Attributes:
        standing: where that is.
        missing: the term that they ask for most; None where there is none.
        gained: log predictive density per measurement by it.
    """

    standing: Answer
    missing: MissingTerm | None
    gained: float


class _TermTried(NamedTuple):
    """Flights searched with a missing term, as far as that went.

    Attributes:
        missing: the term.
        question: with it among the model's.
        answer: flights where the search was left.
    """

    missing: MissingTerm
    question: Question
    answer: Answer


class Inquiry:
    """Flights, and where they stand with the causes that were put to the test so far.

    Args:
        asked: what questions are asked of.
        progress: told what is being done.
        kept: takes every ranking on the way.

    Attributes:
        question: as it is asked now.
        every: all causes.
        leads: what stood out of each flight where it was begun.
        standing: flights where the likeliest trial ended.
        ranked: sets of causes weighed there, the most probable first.
        reached: sizes of servos' changes with which was reckoned.
        farthest: by how many of its sigmas the size of a favourite was off that was not believed;
            0 where none was.
        outdone: whether a favourite was left for a term that nothing listed stands for.
    """

    def __init__(self, asked: Asked, progress: Progress, kept: Kept) -> None:
        self._asked, self._kept, self._progress = asked, kept, progress
        self._flights = len(asked.flights)
        self.question = asked.question()
        self.every = self.question.every
        self.reached = dict[str, float]()
        self.farthest = 0.0
        self._tested: set[frozenset[Candidate]] = {frozenset()}
        self._needed = NONE_NEEDED
        # A file that is right in all else was tried; sizes moved on lost the flight.
        self._right = self._overshot = False
        # Causes, and sizes of servos' changes beside which others were less likely.
        self._at_rest: list[tuple[frozenset[Candidate], dict[str, float]]] = []
        self._searched = list[Reached]()
        self.outdone = False
        self._asked_for: _AskedFor | None = None
        self._term_tried: _TermTried | None = None
        self._begin()

    def _begin(self) -> None:
        flying = self.telling("flying the simulation along", 0)
        self.question, begun = self.question.begun(flying)
        self.leads = self.question.leads(begun)
        flying("working out how errors show", self._flights - 1)
        relations = self.question.relations(begun)
        # Where a cause stands out at once, what is left to gain without it is of no use.
        self.standing = self.question.answered(flying, (), begun, relations, sets=1)
        self._weigh()
        self._roughly = bool(self.ranked[0].causes)
        if not self._roughly:
            self._rest()

    def search(self) -> None:
        """Puts favourites to the test until one stays, or is left for a missing term.

        Searched again, none is left for one.
        """
        again = self.outdone
        for turn in range(1, ROUNDS + 1):
            favourite = self._favourite()
            if favourite is None or not self._put_to_the_test(favourite, turn):
                break
        if self.outdone and not again:
            return
        if self._roughly and not self.standing.causes:
            self._rest()

    def missing(self) -> tuple[MissingTerm | None, float]:
        """The term that flights ask for most where they stand, and what it gains.

        On what took no part, log predictive density per measurement.
        """
        if self._asked_for is None or self._asked_for.standing is not self.standing:
            self._asked_for = _AskedFor(self.standing, *self.question.missing(self.standing))
        return self._asked_for.missing, self._asked_for.gained

    def with_term(
        self, missing: MissingTerm, turn: int, sets: int = SETS
    ) -> tuple[Question, Answer]:
        """Flights searched with a missing term set free, on from where that was left before.

        Args:
            missing: as `missing` has it.
            turn: of the `ROUNDS`.
            sets: times that instruments are used at most.
        """
        telling = self.telling(f"trying {missing.coefficient} {missing.key}", turn)
        if self._term_tried is None or self._term_tried.missing is not missing:
            wider = self._asked.question(self.reached, missing).as_late_as(self.question)
            start, near = self.question.carried(self.standing.settled, wider, missing), None
            relations = wider.relations(start)
        else:
            _, wider, near = self._term_tried
            start, relations = near.settled, near.relations
        if near is None or not near.ended:
            near = wider.answered(
                *(telling, (UNLISTED,), start, relations),
                causes=(UNLISTED,),
                near=near,
                sets=sets,
            )
        self._term_tried = _TermTried(missing, wider, near)
        return wider, near

    def _without_a_cause(self, turn: int) -> float:
        """Log-likelihood with the term that flights ask for, where causes are far behind it.

        By evidence where the flights stand; −∞ where none is. A yawing moment by aileron times
        angle of attack was searched to the end under the names of an inertia and of an aileron that
        bends, in a third of all the time, and neither was believed then.
        """
        if self.outdone:
            return -np.inf
        missing, _ = self.missing()
        if missing is None or missing.log_bayes_factor < self.ranked[0].log_bayes_factor + REFUTED:
            return -np.inf
        return self.with_term(missing, turn, FIRST_SETS)[1].log_likelihood

    def telling(self, doing: str, turn: int) -> Telling:
        """Tells of a flight in one of the `ROUNDS`."""
        steps = self.steps
        return lambda text, number: self._progress(
            f"{doing}: {text}", (self._flights * turn + number) / steps
        )

    @property
    def steps(self) -> int:
        """Of which progress is told."""
        return self._flights * (1 + ROUNDS)

    def _weigh(self) -> None:
        told = self.standing.information
        here = reached(self.standing, self.question.listed)
        self._needed = self._needed._replace(overrated=overrated(here, self._searched))
        self.ranked = rank(told, self.question.listed, self.every, self._needed)
        self._kept(self.ranked)

    def _rest(self) -> None:
        """Flights searched on without any cause."""
        flying = self.telling("flying the simulation along", 0)
        self.standing = self.question.rested(flying, self.standing)
        self._searched.append(reached(self.standing, self.question.listed))
        self._weigh()

    def _favourite(self) -> _Favourite | None:
        """What is to be tried next; None where the favourite stays."""
        listed = self.question.listed
        best = _strongest_first(self.standing, self.ranked[0], listed, self._needed, self._tested)
        # What is only part of the favourite is on the way to it, and not to be searched to the end.
        sets = SETS if best is self.ranked[0] else FIRST_SETS
        sizes = self._sizes(best)
        again = frozenset(best.causes) in self._tested and sizes is None
        if again:
            if self._right:
                return None
            other = _with_a_right_file(self.standing, best, listed, self.every, self._needed)
            if other is None:
                return None
            best, self._right = other, True
            sizes = self._sizes(best)
        accuracy = min(best.accuracy, RIGHT) if self._right else best.accuracy
        return _Favourite(best, accuracy, sizes, again, sets)

    def _sizes(self, best: Ranked) -> dict[str, float] | None:
        """With which sizes to reckon from now on; None where those are near enough."""
        if (frozenset(best.causes), self.reached) in self._at_rest:
            return None
        return servo_sizes.wanted(self.question.listed, best, self.reached, overshot=self._overshot)

    def _put_to_the_test(self, favourite: _Favourite, turn: int) -> bool:
        """Whether there is more to try after it."""
        listed, standing = self.question.listed, self.standing
        tried = self._tried(favourite, turn)
        if tried is None:
            self.outdone = True
            return False
        trial = tried.trial
        lost = standing.log_likelihood - trial.log_likelihood
        if lost > REFUTED and any(tried.sizes[name] != self.reached[name] for name in self.reached):
            # Reckoned with other sizes of the same servos it says nothing of the causes.
            self._overshot = True
            return True
        self._tested |= set(tried.sets)
        if trial.ended or favourite.sets == SETS:
            self._searched.append(reached(trial, tried.question.listed))
        calmer = trial.left < standing.left and lost <= REFUTED and not standing.ended
        if favourite.again and not (
            calmer
            or likelier(
                *(reached(trial, listed), reached(standing, listed)), self.every, self._needed
            )
        ):
            return False
        found = _found(tried.question.listed, trial, favourite.accuracy)
        off = listed.farthest(trial.causes, found)
        if off >= INCREDIBLE:
            return self._without_what_is_incredible(trial, off)
        if tried.twin is not None and tried.won > REFUTED:
            self._needed = self._needed._replace(causes=(tried.twin.other,), missed=tried.won)
        more = all(cause in trial.causes for cause in standing.causes)
        if lost > REFUTED and not more:
            self._needed = self._needed._replace(causes=standing.causes, missed=lost)
        else:
            self.standing, self.question, self.reached = trial, tried.question, tried.sizes
        self._weigh()
        return True

    def _without_what_is_incredible(self, trial: Answer, off: float) -> bool:
        """Whether there is more to try after causes of a size that nobody believes.

        One stands in for what is in no catalogue, which is to be looked for without it. Of several,
        one may stand in for what another does at a size at which it was not reckoned with: a rudder
        that lags by 0.2 s was taken for a slower lag with a limit of its rate.
        """
        if len(trial.causes) == 1 or self._needed.incredible:
            self.farthest = off
            return False
        self._needed = self._needed._replace(incredible=tuple(trial.causes))
        self._weigh()
        return True

    def _tried(self, favourite: _Favourite, turn: int) -> _Tried | None:
        """Flights searched with a favourite, by either name, at the sizes that it turns out at.

        None where they are far likelier with a term that nothing listed stands for.
        """
        best, accuracy, sizes, _, sets = favourite
        listed, standing = self.question.listed, self.standing
        asking, acting = self.question, servo_sizes.acting(listed, best.causes)
        if sizes is not None or acting != listed.acting.keys():
            asking = self._reckoned(self.reached if sizes is None else sizes, acting)
        asking = asking.at_delays_of(best.causes)
        foretold = listed.alone(best.causes, best.posterior.mean)
        telling = self.telling("trying", turn)
        near = standing if asking is self.question else None
        asking, trial, sizes = self._about_its_size(
            *(asking, Trial(best.causes, standing.settled, foretold, near)),
            *(self.reached if sizes is None else sizes, telling, accuracy),
        )
        near = standing if asking is self.question else None
        asked_for = [trial]
        twin = other_names.renamed(best.causes, foretold, listed, self.every)
        if twin is not None and not (
            frozenset(twin.causes) in self._tested or set(self._needed.causes) - set(twin.causes)
        ):
            # Not from where they stood: what goes by the one name there would keep it.
            renamed = self.question.at(standing.settled, twin.values)
            asked_for.append(Trial(twin.causes, renamed, None, near))
        rivals = [-np.inf]

        def rival() -> float:
            rivals.append(self._without_a_cause(turn))
            return rivals[-1]

        trials = asking.tried(
            telling, asked_for, standing.relations, self.every, accuracy, sets, rival
        )
        trial = max(trials, key=lambda one: one.log_likelihood)
        won = trial.log_likelihood - trials[0].log_likelihood
        if trial.log_likelihood < rivals[-1] - REFUTED:
            return None
        if servo_sizes.acting(listed, trial.causes) and trial.left > QUIET and not trial.ended:
            asking, trial = self._begun_anew(asking, trial, telling, accuracy, sets)
        moved_on = self._where_it_is(asking, trial, sizes, telling, accuracy, sets)
        return _Tried(*moved_on, twin, won, [frozenset(one.causes) for one in asked_for])

    def _about_its_size(
        self,
        asking: Question,
        trial: Trial,
        sizes: dict[str, float],
        telling: Telling,
        accuracy: float,
    ) -> tuple[Question, Trial, dict[str, float]]:
        """The same trial with servos' changes moved on to about their size, begun there.

        A first set of instruments tells that size. Gone into to its end with half of a lag, a
        search makes up for the other half by all else, which the next one has to take back.
        """
        acting = servo_sizes.acting(self.question.listed, trial.causes)
        if self._overshot or not acting:
            return asking, trial, sizes
        by, every = self.standing.relations, self.every
        near = asking.searched(telling, trial, by, every, accuracy, 1)
        if near.log_likelihood >= self.standing.log_likelihood:
            near, asking, sizes, _ = self._moved_on(
                *(asking, near, sizes, accuracy, ABOUT),
                lambda there, one, _: there.searched(telling, one, by, every, accuracy, 1),
            )
        return asking, Trial(trial.causes, near.settled, None, near), sizes

    def _begun_anew(
        self, asking: Question, trial: Answer, telling: Telling, accuracy: float, sets: int
    ) -> tuple[Question, Answer]:
        """Lags and delays whose search stands still, begun where the file has all else.

        What is likelier stands.

        A servo that lags by as long as what it controls takes to answer is made up for by inertia
        and derivatives where flights are settled without it. Steps from there, as many as 2 700
        nats were promised to, gained none: the way leads over less likely flights.
        """
        telling("stands still, begun anew with it", len(trial.each) - 1)
        try:
            there, begun = asking.begun(telling, trial.causes)
        except RefusedError:
            return asking, trial
        there = there.at_delays_of(trial.causes)
        going_on = [Trial(trial.causes, begun, None, None)]
        by = there.relations(begun)
        (anew,) = there.tried(telling, going_on, by, self.every, accuracy, sets)
        if anew.log_likelihood < trial.log_likelihood:
            return asking, trial
        return there, anew

    def _where_it_is(
        self,
        asking: Question,
        trial: Answer,
        sizes: dict[str, float],
        telling: Telling,
        accuracy: float,
        sets: int,
    ) -> tuple[Answer, Question, dict[str, float]]:
        """The same causes with servos' changes at sizes moved on, as long as it gains.

        Weighed about a wrong size, lags of three servos explained what a delay of 0.067 s in the
        place of one of 0.1 s left over, by 340 nats.
        """

        def searched(there: Question, one: Trial, near: Answer) -> Answer:
            by, rival = near.relations, near.log_likelihood + REFUTED
            # Only what is likelier before long goes on.
            return there.tried(telling, [one], by, self.every, accuracy, sets, lambda: rival)[0]

        if self._overshot:
            return trial, asking, sizes
        near, asking, sizes, refused = self._moved_on(
            asking, trial, sizes, accuracy, ROUGHLY, searched
        )
        if refused:
            self._at_rest.append((frozenset(trial.causes), sizes))
        return near, asking, sizes

    def _moved_on(
        self,
        asking: Question,
        near: Answer,
        sizes: dict[str, float],
        accuracy: float,
        within: float,
        searched: Callable[[Question, Trial, Answer], Answer],
    ) -> tuple[Answer, Question, dict[str, float], bool]:
        """Servos' changes at the sizes that they turn out at, as long as flights get likelier.

        And whether others were less likely.

        Args:
            asking: the question.
            near: flights searched with the causes.
            sizes: with which was reckoned there.
            accuracy: of the file's aerodynamics, in its sigmas.
            within: share within which a size is right enough.
            searched: flights searched at other sizes, from where they were.
        """
        acting = servo_sizes.acting(self.question.listed, near.causes)
        for _ in range(RESIZED):
            own = servo_sizes.freed(
                asking.listed, near.causes, _found(asking.listed, near, accuracy)
            )
            nearer = quantities.servo_sizes(own, sizes, within, acting, asking.listed.least)
            if nearer is None:
                break
            there = self._reckoned(nearer, acting).at_delays_of(near.causes)
            further = searched(there, Trial(near.causes, near.settled, None, None), near)
            if further.log_likelihood < near.log_likelihood:
                return near, asking, sizes, True
            near, asking, sizes = further, there, nearer
        return near, asking, sizes, False

    def _reckoned(self, sizes: Mapping[str, float], acting: AbstractSet[str]) -> Question:
        """The question with servos' changes of these sizes."""
        asked = self._asked
        return self.question.with_servos(
            quantities.build(asked.aircraft, asked.flown, sizes, acting)
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
    stood still 5 000 nats below where that with what is there ends. Of several new causes of one
    servo, too, the strongest comes first: a lag far from the size that it was reckoned with looks
    like a slower one and a limit of its rate.
    """
    known = set(standing.causes)
    crowded = servo_sizes.of_one_servo(set(best.causes) - known)
    if not crowded and (standing.ended or len(set(best.causes) - known) <= AT_ONCE):
        return best
    found = rank(standing.information, listed, best.causes, needed, {best.accuracy: 1.0})
    near = (
        one
        for one in found
        if not servo_sizes.of_one_servo(set(one.causes) - known)
        and (crowded or len(set(one.causes) - known) <= 1)
    )
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


def _found(listed: Unknowns, trial: Answer, accuracy: float) -> Float[np.ndarray, " unknown"]:
    """What flights say of all unknowns where they were searched with causes set free."""
    return listed.as_accurate(accuracy).estimated(trial.information, trial.causes).mean
