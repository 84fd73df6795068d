"""The order in which causes are put to the test, with made-up answers in the place of flights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from gcs_sysid.diagnose.aided import other_names
from gcs_sysid.diagnose.aided.ranking import ACCURACIES, NONE_NEEDED, RIGHT, Needed, rank
from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information, Posterior
from gcs_sysid.diagnose.hypothesis import Ranked
from gcs_sysid.estimate.settling import Settled
from gcs_sysid.estimate.weighed import Relation, Weighed
from gcs_sysid.offline import inquiry, investigation, promised, question, servo_sizes
from gcs_sysid.offline.flight import Flight
from gcs_sysid.offline.inquiry import Inquiry
from gcs_sysid.offline.leads import Lead, RestlessError
from gcs_sysid.offline.question import Answer, Trial
from gcs_sysid.reconstruct.causal import Told
from tests.diagnose.aided.made_unknowns import EVERY, listed, told
from tests.offline.made_aircraft import small


def at_rest(information: Information, likelihood: float = 0.0, left: float = 0.0) -> Weighed:
    """A flight at the end of its search, or where so much was left to gain."""
    done = Mock(spec=Settled, log_likelihood=(likelihood,), ended=left < 30.0, left=left)
    heard = Told(np.eye(1), np.zeros(1), information.count)
    return Mock(spec=Weighed, settled=done, by=Mock(spec=Relation), told=heard)


class Question(question.Question):
    """Two favourites one after the other; who wants to know of the second is stopped."""

    listed, every = listed(), EVERY
    __setattr__ = object.__setattr__

    def __init__(self) -> None:
        self.turns = 0

    def begun(self, _telling: object) -> tuple[Question, None]:
        return self, None

    def relations(self, _begun: None) -> None:
        """None are needed."""

    leads = relations

    def at_delays_of(self, _causes: object) -> Question:
        return self

    def answered(self, *_given: object, **_named: object) -> Answer:
        information = told({"cg.x": -0.1})
        return Answer((), [at_rest(information)], information, information.weighed(0.5))

    def tried(self, _telling: object, asked: Sequence[Trial], *_given: object) -> list[Answer]:
        self.turns += 1
        if self.turns == 2:
            raise KeyboardInterrupt
        information = told({"cg.x": -0.1, "mass": 0.12})
        each = [at_rest(information)]
        return [Answer(one.causes, each, information, information) for one in asked]


class Asked(question.Asked):
    """Stands for what flights are asked."""

    flown = ()

    def question(self) -> Question:
        return Question()


def asked_of(monkeypatch, one: Question) -> None:
    """Whatever flights are asked is this."""
    asked = Mock(spec=question.Asked, flown=(), flights=(None,), aircraft=None)
    asked.question.return_value = one
    monkeypatch.setattr(investigation, "Asked", lambda *_: asked)


def test_a_delay_is_reckoned_with_whole() -> None:
    """What of it is ordinary and what the cause has on top: the size is that of both."""
    name, own = "mass", "departures.mass"
    every = replace(listed(), beside={name: own})
    mean = np.zeros(len(every.names))
    mean[[every.names.index(name), every.names.index(own)]] = 0.05, 0.04
    assert servo_sizes.freed(every, EVERY[:1], mean) == {name: pytest.approx(0.09)}
    assert servo_sizes.freed(listed(), EVERY[:1], mean) == {name: pytest.approx(0.05)}


def test_what_is_known_is_handed_on_before_it_is_put_to_the_test(monkeypatch) -> None:
    monkeypatch.setattr(investigation, "Asked", Asked)
    kept: list[tuple[Ranked, ...]] = []
    unread = Flight.__new__(Flight)
    with pytest.raises(KeyboardInterrupt):
        investigation.investigate(
            small(), (unread,), (True,), (), lambda _text, _share: None, kept=kept.append
        )
    first, second = kept
    assert first[0].names == ("cg_shift",)
    assert set(second[0].names) == {"mass", "cg_shift"}


class Restless(Question):
    """Searches that end as they are told, with the accuracies that they were asked at.

    Ends are log-likelihoods, and what is left to gain.
    """

    def __init__(self, *ends: tuple[float, float]) -> None:
        super().__init__()
        self.ends, self.accuracies = list(ends), list[float]()

    def tried(self, _telling, asked, _relations, _every, accuracy, _sets, *_) -> list[Answer]:
        if not self.ends:
            raise KeyboardInterrupt
        likelihood, left = self.ends.pop(0)
        self.accuracies.append(accuracy)
        information = replace(told({"mass": 0.12}), shared=likelihood)
        (one,) = asked
        each = [at_rest(information, likelihood, left)]
        return [Answer(one.causes, each, information, information)]

    def missing(self, standing: Answer) -> None:
        """Here the search is over."""
        raise Over(standing)


class Over(Exception):  # noqa: N818 - no error
    """What stands when all trials are done."""


@pytest.mark.parametrize(
    ("ends", "behind", "accuracies", "stands"),
    [
        # A search that came to rest is not done again, where a file that is right cannot be.
        ([(0.0, 2.0)], 40.0, [1.0], 0.0),
        # If it might be, it is searched with, and stands if the flights are more probable so.
        ([(0.0, 2.0), (12.0, 3.0)], 20.0, [1.0, RIGHT], 12.0),
        ([(0.0, 2.0), (-12.0, 3.0)], 20.0, [1.0, RIGHT], 0.0),
        # Without rest the file is taken as right, unless that is far less likely or no nearer to
        # rest.
        ([(0.0, 70.0), (-50.0, 2.0)], 40.0, [1.0, RIGHT], -50.0),
        ([(0.0, 70.0), (20.0, 35.0)], 40.0, [1.0, RIGHT], 20.0),
        ([(0.0, 70.0), (-150.0, 2.0)], 40.0, [1.0, RIGHT], 0.0),
        ([(0.0, 70.0), (-20.0, 80.0)], 40.0, [1.0, RIGHT], 0.0),
    ],
)
def test_when_the_file_is_tried_as_right(
    monkeypatch,
    ends: list[tuple[float, float]],
    behind: float,
    accuracies: list[float],
    stands: float,
) -> None:
    asking = Restless(*ends)

    def believed(accuracy: float, evidence: float) -> Ranked:
        found = Posterior(np.zeros(7), np.eye(7), evidence)
        return Ranked((EVERY[0],), *(0.1, 1.0, 9.0), ((),), found, accuracy)

    loose, right = believed(1.0, 0.0), believed(RIGHT, np.log(ACCURACIES[1.0]) - behind)
    right = replace(right, prior=right.prior / ACCURACIES[RIGHT])
    asked_of(monkeypatch, asking)
    for one in (inquiry, promised):
        monkeypatch.setattr(one, "rank", lambda *_: (loose,))
    monkeypatch.setattr(inquiry, "with_a_right_file", lambda *_: right)
    unread = Flight.__new__(Flight)
    with pytest.raises(Over) as over:
        investigation.investigate(small(), (unread,), (True,), (), lambda _text, _share: None)
    assert asking.accuracies == accuracies
    assert over.value.args[0].log_likelihood == stands


@pytest.mark.parametrize("left", [200.0, 2.0])
def test_of_many_causes_the_strongest_is_set_free_first_far_from_rest(left: float) -> None:
    information = told({"mass": 0.3, "cg.x": 0.1, "airspeed": 0.08})
    done = Mock(spec=Settled, log_likelihood=(0.0,), ended=left < 30.0, left=left)
    each = [Mock(spec=Weighed, settled=done, by=Mock(spec=Relation))]
    standing = Answer((), each, information, information)
    best = replace(rank(information, listed(), EVERY)[0], causes=EVERY)

    def first(tested: set[frozenset[Candidate]], known: tuple[Candidate, ...] = ()) -> Ranked:
        there = replace(standing, causes=known)
        return inquiry._strongest_first(there, best, listed(), NONE_NEEDED, tested)

    if done.ended:
        assert first(set()) is best
        return
    # Alone, mass explains most; then what explains most beside it.
    assert first(set()).causes == (EVERY[0],)
    assert first({frozenset(EVERY[:1])}).causes != (EVERY[0],)
    # One is known already: two more are no long way.
    assert first(set(), EVERY[:1]) is best


def test_two_causes_of_one_servo_are_known_as_such() -> None:
    """Lag and limit of a rudder are, lags of two controls are not."""
    lag, limit, other = (
        Candidate(CAUSES[name], about)
        for name, about in (
            ("actuator_lag", "rudder"),
            ("actuator_rate_limit", "rudder"),
            ("actuator_lag", "elevator"),
        )
    )
    assert servo_sizes.of_one_servo((lag, limit, other))
    assert not servo_sizes.of_one_servo((lag, other))
    assert not servo_sizes.of_one_servo((limit, other))


def test_what_is_of_another_servo_is_set_free_with_it(monkeypatch) -> None:
    """Mass and airspeed stand for a lag and a limit of one servo, at rest."""
    information = told({"mass": 0.3, "cg.x": 0.1, "airspeed": 0.08})
    both = {EVERY[0], EVERY[2]}
    monkeypatch.setattr(servo_sizes, "of_one_servo", lambda causes: both <= set(causes))
    each = [Mock(spec=Weighed, settled=Mock(spec=Settled, ended=True))]
    standing = Answer((), each, information, information)
    best = replace(rank(information, listed(), EVERY)[0], causes=EVERY)

    def first(tested: set[frozenset[Candidate]], known: tuple[Candidate, ...] = ()) -> Ranked:
        there = replace(standing, causes=known)
        return inquiry._strongest_first(there, best, listed(), NONE_NEEDED, tested)

    begun = first(set())
    assert len(both & set(begun.causes)) == 1
    # What was tried is not tried again; what stands already crowds nothing.
    assert first({frozenset(begun.causes)}).causes != begun.causes
    assert first(set(), EVERY[:1]) is best


LAGGING, ROLLING = {"lag.elevator": 0.1}, {"lag.elevator": 0.1, "lag.aileron": 0.1}


@pytest.mark.parametrize(
    ("sizes", "ends", "stands"),
    [
        # Moved on it is far less likely, and the size before stays; or it is not.
        ((LAGGING, {"lag.elevator": 0.2}, {"lag.elevator": 0.4}), (0.0, -150.0), 0.0),
        ((LAGGING, {"lag.elevator": 0.2}, None), (0.0, -50.0), -50.0),
        # Another servo's first size moves none on: all is as with causes that move nothing.
        ((LAGGING, ROLLING, None), (0.0, -150.0), -150.0),
    ],
)
def test_sizes_of_servos_are_not_moved_on_where_the_flight_is_far_less_likely(
    monkeypatch,
    sizes: tuple[dict[str, float] | None, ...],
    ends: tuple[float, float],
    stands: float,
) -> None:
    """What is wrong beside a lag makes it seem longer at every size with which it is reckoned."""
    asking = Restless(*((likelihood, 2.0) for likelihood in ends))
    monkeypatch.setattr(Restless, "with_servos", lambda self, _found: self, raising=False)
    monkeypatch.setattr(inquiry.quantities, "build", lambda *_: None)
    wanted = iter(sizes)
    found = Posterior(np.zeros(7), np.eye(7), 0.0)
    best = Ranked((EVERY[0],), *(0.1, 1.0, 9.0), ((),), found, RIGHT)
    asked_of(monkeypatch, asking)
    monkeypatch.setattr(
        *(inquiry.quantities, "servo_sizes"),
        lambda _values, _before, *within, **_: None if within else next(wanted),
    )
    monkeypatch.setattr(inquiry, "rank", lambda *_: (best,))
    with pytest.raises(Over) as over:
        investigation.investigate(small(), (Flight.__new__(Flight),), (True,), (), lambda *_: None)
    assert over.value.args[0].log_likelihood == stands


@pytest.mark.parametrize(("ends", "stands"), [((0.0, 40.0, 45.0), 45.0), ((0.0, -5.0), 0.0)])
def test_servos_are_tried_where_they_are_before_other_causes_are_weighed(
    monkeypatch, ends: tuple[float, ...], stands: float
) -> None:
    """As long as sizes move, and the flight grows more probable by it."""
    asking = Restless(*((likelihood, 2.0) for likelihood in ends))
    built: list[object] = []
    nearer = iter(({"lag.elevator": 0.15}, {"lag.elevator": 0.2}, None))
    monkeypatch.setattr(Restless, "with_servos", lambda self, _found: self, raising=False)
    monkeypatch.setattr(inquiry.quantities, "build", lambda *given: built.append(given[2]))
    monkeypatch.setattr(
        *(inquiry.quantities, "servo_sizes"),
        lambda _values, _before, *within, **_: next(nearer) if within else None,
    )
    best = Ranked(
        (EVERY[0],), *(0.1, 1.0, 9.0), ((),), Posterior(np.zeros(7), np.eye(7), 0.0), RIGHT
    )
    asked_of(monkeypatch, asking)
    monkeypatch.setattr(inquiry, "rank", lambda *_: (best,))
    with pytest.raises(Over) as over:
        investigation.investigate(small(), (Flight.__new__(Flight),), (True,), (), lambda *_: None)
    assert over.value.args[0].log_likelihood == stands
    assert built == [{"lag.elevator": 0.15}, {"lag.elevator": 0.2}][: len(ends) - 1]


def test_what_moved_sizes_win_is_not_won_by_the_other_name(monkeypatch) -> None:
    """Both names end alike; the first then gains thousands where its servo is."""

    class Named(Restless):
        """One end for each that is tried."""

        def tried(self, telling, asked, *given: object) -> list[Answer]:
            return [super(Named, self).tried(telling, [each], *given)[0] for each in asked]

    asking = Named((5.0, 2.0), (0.0, 2.0), (3400.0, 2.0))
    nearer = iter(({"lag.elevator": 0.15}, None))
    for name, stub in (("with_servos", lambda self, _: self), ("at", lambda *_: [])):
        monkeypatch.setattr(Named, name, stub, raising=False)
    monkeypatch.setattr(inquiry.quantities, "build", lambda *_: None)
    monkeypatch.setattr(
        *(inquiry.quantities, "servo_sizes"),
        lambda _values, _before, *within, **_: next(nearer) if within else None,
    )
    twin = other_names.Renamed((EVERY[1],), EVERY[1], np.zeros(7))
    monkeypatch.setattr(inquiry.other_names, "renamed", lambda *_: twin)
    best = Ranked(
        (EVERY[0],), *(0.1, 1.0, 9.0), ((),), Posterior(np.zeros(7), np.eye(7), 0.0), RIGHT
    )
    asked_for: list[Needed] = []

    def ranked(_told, _listed, _every, needed: Needed) -> tuple[Ranked, ...]:
        asked_for.append(needed)
        return (best,)

    asked_of(monkeypatch, asking)
    monkeypatch.setattr(inquiry, "rank", ranked)
    with pytest.raises(Over) as over:
        investigation.investigate(small(), (Flight.__new__(Flight),), (True,), (), lambda *_: None)
    assert over.value.args[0].log_likelihood == 3400.0
    assert len(asked_for) > 1
    assert set(asked_for) == {NONE_NEEDED}


@pytest.mark.parametrize(("likelihood", "stands"), [(250.0, 0.0), (150.0, 100.0)])
def test_causes_far_behind_a_missing_term_do_not_stand(
    monkeypatch, likelihood: float, stands: float
) -> None:
    """Flights stay where they are without them: there the term is weighed, and named or not."""

    class Behind(Restless):
        """Its searches ask for what else there is."""

        def tried(self, *given) -> list[Answer]:
            given[-1]()
            return super().tried(*given)

    asking = Behind((100.0, 60.0))
    monkeypatch.setattr(Inquiry, "_without_a_cause", lambda *_: likelihood)
    asked_of(monkeypatch, asking)
    best = Ranked(
        (EVERY[0],), *(0.1, 1.0, 9.0), ((),), Posterior(np.zeros(7), np.eye(7), 0.0), RIGHT
    )
    monkeypatch.setattr(inquiry, "rank", lambda *_: (best,))
    monkeypatch.setattr(inquiry, "_with_a_right_file", lambda *_: None)
    with pytest.raises(Over) as over:
        investigation.investigate(small(), (Flight.__new__(Flight),), (True,), (), lambda *_: None)
    assert over.value.args[0].log_likelihood == stands


@pytest.mark.parametrize(("outdone", "named", "times"), [(1, 0, 2), (1, 1, 1), (0, 0, 1)])
def test_a_favourite_left_for_a_term_that_is_none_is_searched_to_its_end(
    monkeypatch, outdone: int, named: int, times: int
) -> None:
    last = Mock(spec=Weighed)
    last.settled.restless = True
    subject = Mock()
    subject.one.recording.source = "left.tlog"
    told = Mock(named=bool(named), question=Mock(subjects=(subject,)), each=[last])
    searched = Mock(return_value=told)
    monkeypatch.setattr(investigation, "_searched", searched)
    found = Mock(spec=Inquiry, outdone=bool(outdone), leads=[[]])
    monkeypatch.setattr(investigation, "Inquiry", lambda *_: found)
    with pytest.raises(RestlessError):
        investigation.investigate(small(), (Flight.__new__(Flight),), (True,), (), lambda *_: None)
    assert searched.call_count == times


def test_a_search_without_rest_is_refused_with_what_stood_out(monkeypatch) -> None:
    late = Lead("sensors.surface_delay", 0.034, 0.01, "s")
    subject = Mock()
    subject.one.recording.source = "shaken.tlog"

    class Built(investigation.Investigation):
        """Of nothing."""

        def __init__(self, **_given: object) -> None:
            pass

    class Ended(Restless):
        subjects, quantities, model = (subject,), None, None

        def __init__(self, *, restless: bool) -> None:
            super().__init__((0.0, 600.0))
            self.restless = restless

        def leads(self, _begun: None) -> list[list[Lead]]:
            return [[late]]

        def tried(self, *given: object) -> list[Answer]:
            (answer,) = super().tried(*given)
            answer.each[0].settled.restless = self.restless
            return [answer]

        def missing(self, _standing: Answer) -> tuple[None, float]:
            return None, 0.0

    def investigated(asking: Ended) -> object:
        asked_of(monkeypatch, asking)
        unread = Flight.__new__(Flight)
        return investigation.investigate(small(), (unread,), (True,), (), lambda *_: None)

    found = Posterior(np.zeros(7), np.eye(7), 0.0)
    best = Ranked((EVERY[0],), *(0.1, 1.0, 9.0), ((),), found, RIGHT)
    monkeypatch.setattr(inquiry, "rank", lambda *_: (best,))
    monkeypatch.setattr(inquiry, "_with_a_right_file", lambda *_: None)
    monkeypatch.setattr(investigation, "Investigation", Built)
    assert isinstance(investigated(Ended(restless=False)), Built)
    with pytest.raises(RestlessError) as refusal:
        investigated(Ended(restless=True))
    assert refusal.value.where == "shaken.tlog"
    assert refusal.value.leads == (late,)
