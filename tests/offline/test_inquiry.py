"""A favourite whose search stands still is begun anew where the file has all else."""

from __future__ import annotations

from unittest.mock import Mock

import pytest

from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.errors import RefusedError
from gcs_sysid.estimate.settling import Settled
from gcs_sysid.offline.inquiry import Inquiry
from gcs_sysid.offline.question import Answer, Question

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
