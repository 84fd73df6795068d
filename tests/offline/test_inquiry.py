"""Searches that are begun anew, or left for something that nothing listed stands for."""

from __future__ import annotations

from unittest.mock import Mock

import numpy as np
import pytest

from gcs_sysid.diagnose.aided.unlisted import MissingTerm
from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.hypothesis import Ranked
from gcs_sysid.errors import RefusedError
from gcs_sysid.estimate.settling import Settled
from gcs_sysid.offline.inquiry import Inquiry
from gcs_sysid.offline.question import FIRST_SETS, UNLISTED, Answer, Asked, Question

LAG = Candidate(CAUSES["actuator_lag"], "elevator", None)
LOST = RefusedError("flight.tlog", "the simulation lost the aircraft", fix="look")


def answer(likelihood: float) -> Answer:
    return Mock(spec=Answer, log_likelihood=likelihood, causes=(LAG,), each=[None])


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
