"""What is set free when a favourite is put to the test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from unittest.mock import Mock

import numpy as np
import pytest

from gcs_sysid.diagnose.aided.quantities import Quantities
from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information
from gcs_sysid.estimate.intensities import Prior
from gcs_sysid.estimate.settling import Beliefs, Settled
from gcs_sysid.estimate.weighed import Relation, Weighed
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.offline import question, settled
from gcs_sysid.offline.question import Answer, Question, Trial
from gcs_sysid.offline.settled import Subject
from gcs_sysid.reconstruct.causal import Pass, Told
from tests.diagnose.aided import made_unknowns as made
from tests.estimate import made_flight

SILENT = Prior(*[made_flight.unknowns(1.0).log_noise] * 2)


def listed(name: str, about: str = "") -> list[Candidate]:
    cause = CAUSES[name]
    return [Candidate(cause, about, place) for place in cause.places or (None,)]


def test_a_stall_is_tried_wherever_it_may_begin() -> None:
    stalls, mass = listed("stall"), listed("mass")
    found = question.wherever((stalls[3], mass[0]), [*mass, *stalls])
    assert set(found) == {*stalls, *mass}


def test_a_rate_limit_is_tried_where_it_was_found() -> None:
    """Each of its places is all of its effect: two at once would be twice that."""
    limits = [*listed("actuator_rate_limit", "elevator"), *listed("actuator_rate_limit", "aileron")]
    assert question.wherever((limits[1],), limits) == (limits[1],)


@pytest.mark.parametrize("accuracy", [0.1, 1.0, 4.0])
def test_a_favourite_is_tried_with_a_file_as_accurate_as_it_has_it(accuracy: float) -> None:
    """The lift slope by its share; what is no aerodynamics as before, mass by its cause as well."""
    one = made.listed()
    own = Beliefs(np.zeros(4), np.diag(made.ORDINARY**2), SILENT)
    mass = made.EVERY[:1]
    found = question.with_free(own, one.as_accurate(accuracy), 0, mass)
    wanted = made.ORDINARY * [accuracy, 1.0, 1.0, 1.0]
    wanted[1] = np.hypot(wanted[1], mass[0].cause.parameters[0].sigma)
    np.testing.assert_allclose(np.sqrt(np.diagonal(found.covariance)), wanted)


def test_surfaces_that_a_cause_delays_are_looked_up_where_the_file_has_them(monkeypatch) -> None:
    """About the delay they settled with they would be late twice."""
    late, mass = listed("time_skew", "SERVO")[:1], listed("mass")
    looked: list[float] = []

    def look(_subject: Subject, _found: object, at: float) -> Subject:
        looked.append(at)
        return Mock(spec=Subject, late=at)

    monkeypatch.setattr(settled, "_looked_up", look)
    subjects = tuple(Mock(spec=Subject, late=at) for at in (0.05, 0.0))
    every = replace(made.listed(), beside={late[0].frees[0]: "sensors.surface_delay"})
    asked = Question(Mock(spec=Quantities), (), subjects, (), every, (), Mock(spec=FlightModel))
    assert asked.at_delays_of(mass) is asked
    assert [one.late for one in asked.at_delays_of((*mass, *late)).subjects] == [0.0, 0.0]
    assert looked == [0.0]


@pytest.mark.parametrize(("doubt", "share"), [(1.0, 1.0), (2.5, 0.4)])
def test_where_scores_do_not_vanish_a_flight_says_less(doubt: float, share: float) -> None:
    """Two samples that say the same of one parameter: nothing scatters."""
    before = Beliefs(np.zeros(4), np.diag(made.ORDINARY**2), SILENT)
    told = Told(np.diag(np.full(4, 100.0)), np.array([3.0, 0.0, 0.0, 0.0]), 50.0)
    blocks = np.tile([1.0, 1.0, 1.0, 1.0], (5, 1))
    # Rows behind those of the flight are padding.
    rows = np.array([-1.0, -2.0, -4.0, -8.0])
    last = Mock(spec=Pass, told=told, apart=told, blocks=blocks, log_likelihood=rows)
    fitted = np.array([True, False, True])
    values = np.array([0.2, 0.0, 0.0, 0.0])
    done = Mock(spec=Settled, last=last, values=values, fitted=fitted, apart=~fitted)
    found = Mock(spec=Weighed, settled=done, told=told, apart=told, doubt=doubt)
    information, apart = settled.told(made.listed(), 0, before, found)
    np.testing.assert_allclose(np.diagonal(information.gram)[:4], 100.0 * share)
    # Where nothing deviates, by the parabola about where the flight ended.
    away = -3.0 * 0.2 - 0.5 * 100.0 * 0.2**2
    assert information.shared == pytest.approx(share * (-1.0 - 4.0 + away))
    assert apart.shared == pytest.approx(share * (-2.0 + away))


@pytest.mark.parametrize(
    ("ahead", "sets"), [(500.0, [2, 2, 6]), (50.0, [2, 2, 6, 6])], ids=["far", "hardly"]
)
def test_of_two_names_the_one_far_behind_is_left(ahead: float, sets: list[int]) -> None:
    """Both are searched a little; the other to the end, or both where it is not clear."""
    mass, skew = listed("mass"), listed("inertia")

    def reached(causes: list[Candidate], likelihood: float, *, ended: bool) -> Answer:
        at = Mock(spec=Settled, log_likelihood=(likelihood,), ended=ended)
        nothing = Mock(spec=Information)
        return Answer(tuple(causes), [Mock(spec=Weighed, settled=at)], nothing, nothing)

    begun, there = [Mock(spec=Relation)], [Mock(spec=Relation)]
    asked = Mock(spec=Question)
    asked.searched = partial(Question.searched, asked)
    asked.relations.return_value = there
    asked.answered.side_effect = [
        reached(mass, 0.0, ended=False),
        reached(skew, ahead, ended=False),
        *(reached(mass, 10.0, ended=True) for _ in sets[3:]),
        reached(skew, ahead + 10.0, ended=True),
    ]
    trials = [Trial(causes, [], None, None) for causes in (mass, skew)]
    found = Question.tried(asked, lambda *_: None, trials, begun, [*mass, *skew], 1.0, 6)
    assert [call.kwargs["sets"] for call in asked.answered.call_args_list] == sets
    assert found[1].log_likelihood == ahead + 10.0
    assert found[0].log_likelihood == (0.0 if len(sets) == 3 else 10.0)
    assert asked.answered.call_args.kwargs["near"].causes == tuple(skew)
    # By how errors show where each stood when it went on.
    given = [call.args[3] for call in asked.answered.call_args_list]
    assert given == [begun, begun, *[there] * (len(sets) - 2)]


@pytest.mark.parametrize(
    ("rival", "sets"),
    [(500.0, [2]), (50.0, [2, 6]), (-np.inf, [2, 6])],
    ids=["far", "hardly", "no"],
)
def test_causes_far_behind_something_unlisted_are_left(rival: float, sets: list[int]) -> None:
    asked, mass = restless(ends=(0.0, 10.0)), listed("mass")
    trials = [Trial(mass, [], None, None)]
    begun = [Mock(spec=Relation)]
    (found,) = Question.tried(
        asked, lambda *_: None, trials, begun, mass, 1.0, 6, rival=lambda: rival
    )
    assert [call.kwargs["sets"] for call in asked.answered.call_args_list] == sets
    assert found.log_likelihood == (0.0 if len(sets) == 1 else 10.0)


def test_where_a_search_has_ended_nothing_unlisted_is_asked_for() -> None:
    asked, mass = restless(ends=(0.0,)), listed("mass")
    trials = [Trial(mass, [], None, None)]

    def rival() -> float:
        raise AssertionError("asked")

    Question.tried(asked, lambda *_: None, trials, [Mock(spec=Relation)], mass, 1.0, 6, rival=rival)
    asked.answered.assert_called_once()


def restless(*, ends: Sequence[float]) -> Mock:
    """A question whose searches come to these log-likelihoods, the last of them to rest."""
    asked = Mock(spec=Question)
    asked.searched = partial(Question.searched, asked)
    asked.relations.return_value = [Mock(spec=Relation)]
    nothing = Mock(spec=Information)
    asked.answered.side_effect = [
        Answer(
            (),
            [
                Mock(
                    spec=Weighed,
                    settled=Mock(spec=Settled, log_likelihood=(end,), ended=end == ends[-1]),
                )
            ],
            nothing,
            nothing,
        )
        for end in ends
    ]
    return asked
