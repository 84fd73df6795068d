"""Searches that are begun anew, or left for something that nothing listed stands for."""

from __future__ import annotations

from functools import partial
from unittest.mock import Mock

import numpy as np
import pytest

from gcs_sysid.diagnose.aided import quantities
from gcs_sysid.diagnose.aided.ranking import Needed
from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.aided.unlisted import MissingTerm
from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.hypothesis import Ranked
from gcs_sysid.errors import RefusedError
from gcs_sysid.estimate.settling import Settled
from gcs_sysid.estimate.weighed import Relation
from gcs_sysid.offline import inquiry as module
from gcs_sysid.offline import servo_sizes
from gcs_sysid.offline.inquiry import Inquiry
from gcs_sysid.offline.question import (
    FIRST_SETS,
    REFUTED,
    UNLISTED,
    Answer,
    Asked,
    Question,
    Trial,
)

LAG = Candidate(CAUSES["actuator_lag"], "elevator", None)
LOST = RefusedError("flight.tlog", "the simulation lost the aircraft", fix="look")


def answer(likelihood: float) -> Answer:
    return Mock(
        spec=Answer, log_likelihood=likelihood, causes=(LAG,), each=[None], settled=[Mock(Settled)]
    )


@pytest.mark.parametrize(
    ("ends", "taken"), [(1500.0, True), (-20.0, False), (None, False)], ids=["up", "down", "lost"]
)
def test_the_likelier_of_where_it_stood_and_where_it_ends_is_taken(
    ends: float | None, *, taken: bool
) -> None:
    stood, asking, there = answer(0.0), Mock(spec=Question), Mock(spec=Question)
    begun = [Mock(spec=Settled)]
    there.at_delays_of.return_value = there
    asking.begun.side_effect = LOST if ends is None else [(there, begun)]
    there.tried.return_value = [answer(ends or 0.0)]
    inquiry = Mock(spec=Inquiry, every=(LAG,))
    found = Inquiry._begun_anew(inquiry, asking, stood, lambda *_: None, 1.0, 6)
    assert found == ((there, there.tried.return_value[0]) if taken else (asking, stood))
    assert asking.begun.call_args.args[1] == (LAG,)
    if ends is not None:
        (trial,) = there.tried.call_args.args[1]
        assert (trial.causes, trial.start, trial.moved, trial.near) == ((LAG,), begun, None, None)
        there.relations.assert_called_once_with(begun)


@pytest.mark.parametrize(
    ("found", "likelihoods", "searched", "ends"),
    [
        ((0.2, 0.205), (500.0, 2500.0), 2, 0.2),
        ((0.105,), (500.0,), 1, 0.1),
        ((0.2, 0.2), (500.0, 400.0), 2, 0.1),
        ((0.2,), (-20.0,), 1, 0.1),
    ],
    ids=["moved on", "near enough", "less likely there", "worse than without"],
)
def test_a_lag_is_moved_on_to_about_its_size_before_its_search_is_gone_into(
    monkeypatch: pytest.MonkeyPatch,
    found: tuple[float, ...],
    likelihoods: tuple[float, ...],
    searched: int,
    ends: float,
) -> None:
    """With one set of instruments each, of the standing flights' relations."""
    (name,) = LAG.frees
    sizes = iter(found)
    monkeypatch.setattr(module, "_found", lambda *_: None)
    monkeypatch.setattr(servo_sizes, "freed", lambda *_: {name: next(sizes)})
    asking, relations = Mock(spec=Question), [Mock(spec=Relation)]
    asking.listed = Mock(spec=Unknowns, names=(f"{quantities.MORE}{name}",), least={})
    asking.at_delays_of.return_value = asking
    answers = [answer(likelihood) for likelihood in likelihoods]
    asking.searched.side_effect = answers
    standing = answer(0.0)
    standing.relations = relations
    inquiry = Mock(spec=Inquiry, every=(LAG,), question=asking, standing=standing, _overshot=False)
    inquiry._reckoned.return_value = asking
    inquiry._moved_on = partial(Inquiry._moved_on, inquiry)
    trial = Trial((LAG,), [], np.zeros(1), standing)
    _, going_on, reckoned = Inquiry._about_its_size(
        inquiry, asking, trial, {name: 0.1}, lambda *_: None, 1.0
    )
    assert reckoned == {name: ends}
    assert asking.searched.call_count == searched
    assert all(call.args[2] is relations for call in asking.searched.call_args_list)
    assert {call.args[5] for call in asking.searched.call_args_list} == {1}
    # At another size it is another question: nothing of the one before serves.
    assert all(call.args[1].near is None for call in asking.searched.call_args_list[1:])
    assert going_on.near is answers[1 if ends == 0.2 else 0]
    assert going_on.start is going_on.near.settled


def test_what_is_no_lag_is_tried_as_it_is() -> None:
    inquiry = Mock(
        spec=Inquiry, question=Mock(listed=Mock(spec=Unknowns, names=())), _overshot=False
    )
    asking, trial = Mock(spec=Question), Trial((LAG,), [], None, None)
    sizes = {"actuators.lag.elevator": 0.1}
    found = Inquiry._about_its_size(inquiry, asking, trial, sizes, lambda *_: None, 1.0)
    assert found == (asking, trial, sizes)
    asking.searched.assert_not_called()


def resized(
    monkeypatch: pytest.MonkeyPatch, found: float, likelihood: float
) -> tuple[Mock, Mock, dict[str, float]]:
    """An inquiry, its question, and the sizes after a search that found a lag of 0.1 s so long."""
    (name,) = LAG.frees
    monkeypatch.setattr(module, "_found", lambda *_: None)
    monkeypatch.setattr(servo_sizes, "freed", lambda *_: {name: found})
    asking = Mock(spec=Question)
    asking.listed = Mock(spec=Unknowns, names=(f"{quantities.MORE}{name}",), least={})
    asking.at_delays_of.return_value = asking
    asking.tried.return_value = [answer(likelihood)]
    near = answer(0.0)
    near.relations = [Mock(spec=Relation)]
    inquiry = Mock(spec=Inquiry, every=(LAG,), question=asking, _overshot=False, _at_rest=[])
    inquiry._reckoned.return_value = asking
    inquiry._moved_on = partial(Inquiry._moved_on, inquiry)
    telling = (lambda *_: None, 1.0, 6)
    sizes = Inquiry._where_it_is(inquiry, asking, near, {name: 0.1}, *telling)[2]
    return inquiry, asking, sizes


def test_at_another_size_of_a_lag_only_what_is_likelier_before_long_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _, asking, _ = resized(monkeypatch, 0.2, -5.0)
    assert asking.tried.call_args.args[6]() - REFUTED == 0.0


@pytest.mark.parametrize(
    ("found", "likelihood", "rests"),
    [(0.2, -5.0, True), (0.101, 0.0, False), (0.2, 5.0, False)],
    ids=["less likely", "near enough", "likelier"],
)
def test_a_size_beside_which_another_was_less_likely_is_not_left_for_the_same_causes(
    monkeypatch: pytest.MonkeyPatch, found: float, likelihood: float, *, rests: bool
) -> None:
    """An aileron's fault in ArduPlane's flight was searched twice over so, in two orders."""
    inquiry, _, sizes = resized(monkeypatch, found, likelihood)
    inquiry.reached = sizes
    monkeypatch.setattr(servo_sizes, "wanted", lambda *_, **__: {"other": 0.3})
    other = Candidate(CAUSES["mass"], "", None)
    for causes, stays in [((LAG,), rests), ((LAG, other), False)]:
        best = Mock(spec=Ranked, causes=causes)
        assert (Inquiry._sizes(inquiry, best) is None) == stays
    inquiry.reached = {}
    assert Inquiry._sizes(inquiry, Mock(spec=Ranked, causes=(LAG,))) == {"other": 0.3}


@pytest.mark.parametrize(
    ("number", "before", "goes_on"),
    [(2, (), True), (1, (), False), (2, (LAG,), False)],
    ids=["of two", "alone", "once more"],
)
def test_of_several_causes_that_nobody_believes_together_each_may_be_there(
    number: int, before: tuple[Candidate, ...], *, goes_on: bool
) -> None:
    causes = (LAG, Candidate(CAUSES["actuator_rate_limit"], "elevator", None))[:number]
    inquiry = Mock(spec=Inquiry, farthest=0.0, _needed=Needed((LAG,), 50.0, before))
    trial = Mock(spec=Answer, causes=causes)
    assert Inquiry._without_what_is_incredible(inquiry, trial, 6.4) == goes_on
    assert inquiry.farthest == (0.0 if goes_on else 6.4)
    assert inquiry._needed == Needed((LAG,), 50.0, causes if goes_on else before)
    assert inquiry._weigh.called == goes_on


TERM = MissingTerm("Cn", ("aileron", "alpha"), 950.0, 0.3, 0.01, 0.5, 1.0)
ANOTHER = MissingTerm("Cm", ("alpha", "beta"), 300.0, 0.1, 0.01, 0.5, 1.0)


@pytest.mark.parametrize(
    ("missing", "evidence", "far"),
    [(TERM, 849.0, True), (TERM, 851.0, False), (None, 0.0, False)],
    ids=["far", "near", "none"],
)
def test_a_term_is_tried_where_causes_have_far_less_evidence(
    missing: MissingTerm | None, evidence: float, *, far: bool
) -> None:
    inquiry = Mock(
        spec=Inquiry, ranked=(Mock(spec=Ranked, log_bayes_factor=evidence),), outdone=False
    )
    inquiry.missing.return_value = missing, 0.0
    inquiry.with_term.return_value = Mock(spec=Question), answer(123.0)
    assert Inquiry._without_a_cause(inquiry, 2) == (123.0 if far else -np.inf)
    if far:
        inquiry.with_term.assert_called_once_with(TERM, 2, FIRST_SETS)
    # Once it was left for that, a favourite is not left again.
    inquiry.outdone = True
    assert Inquiry._without_a_cause(inquiry, 3) == -np.inf


@pytest.mark.parametrize("rests", [True, False])
def test_a_search_with_a_term_goes_on_where_it_was_left(*, rests: bool) -> None:
    """At first from where flights stand; then from its own end, if it has found no rest."""
    wider, relations = Mock(spec=Question), [None]
    wider.as_late_as.return_value = wider
    wider.relations.return_value = relations
    first, second = (
        Mock(spec=Answer, ended=ended, settled=[Mock(spec=Settled)], relations=relations)
        for ended in (rests, True)
    )
    wider.answered.side_effect = [first, second]
    inquiry = Mock(spec=Inquiry, reached={}, _term_tried=None)
    inquiry._asked = Mock(spec=Asked)
    inquiry._asked.question.return_value = wider
    inquiry.standing, inquiry.question = answer(0.0), Mock(spec=Question)
    start = inquiry.question.carried.return_value = [Mock(spec=Settled)]
    found = [Inquiry.with_term(inquiry, TERM, 1, sets) for sets in (FIRST_SETS, 6)]
    assert found == [(wider, first), (wider, first if rests else second)]
    calls = wider.answered.call_args_list
    assert [call.kwargs["sets"] for call in calls] == ([FIRST_SETS] if rests else [FIRST_SETS, 6])
    assert [call.args[1] for call in calls] == [(UNLISTED,)] * len(calls)
    assert calls[0].args[2] is start
    if not rests:
        assert (calls[1].args[2], calls[1].kwargs["near"]) == (first.settled, first)
    # One that was asked for elsewhere is another search.
    wider.answered.side_effect = [second]
    Inquiry.with_term(inquiry, ANOTHER, 1)
    assert wider.answered.call_args.args[2] is start
