"""What is foretold of causes, held against what searches with them reached."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from gcs_sysid.diagnose.aided.ranking import NONE_NEEDED, Needed, rank
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information
from gcs_sysid.estimate.settling import Settled
from gcs_sysid.estimate.weighed import Weighed
from gcs_sysid.offline import promised
from gcs_sysid.offline.promised import Reached, likelier, overrated, reached
from gcs_sysid.offline.question import Answer
from gcs_sysid.reconstruct.causal import Told
from tests.diagnose.aided.made_unknowns import EVERY, listed, told

MASS, LAST = EVERY[0], EVERY[-1]


def end(
    causes: tuple[Candidate, ...], information: Information, left: float, share: float = 1.0
) -> Reached:
    """The end of a search of a flight whose rows count for a share of what they seem to."""
    heard = Told(np.eye(1), np.zeros(1), information.count)
    one = Mock(spec=Weighed, settled=Mock(spec=Settled, left=left), told=heard)
    weighed = information.weighed(share)
    return reached(Answer(causes, [one], weighed, weighed), listed())


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_a_promise_that_is_kept_is_believed(share: float) -> None:
    """About both ends the flights say the same, and nothing is left to gain at either."""
    information = told({"mass": 0.12})
    standing = end((), information, 0.0)
    (found,) = overrated(standing, [end((MASS,), information, 0.0, share)])
    assert (found.extra, found.missing) == ((MASS,), ())
    assert found.by == pytest.approx(0.0, abs=1e-9)


def test_what_steps_promised_and_did_not_gain_is_taken_off() -> None:
    information = told({"mass": 0.12})
    standing, stuck = end((MASS,), information, 6.0), end((LAST,), information, 50.0)
    (found,) = overrated(standing, [stuck])
    assert (found.extra, found.missing) == ((LAST,), (MASS,))
    assert found.by == pytest.approx(44.0)
    # Where rows count for half, so do steps.
    halved = end((MASS,), information, 6.0, 0.5)
    assert overrated(halved, [stuck])[0].by == pytest.approx(22.0)


def test_a_search_that_reached_more_than_was_foretold_counts_for_that() -> None:
    information = told({"mass": 0.12})
    higher = replace(information, shared=information.shared + 9.0)
    standing = end((MASS,), information, 0.0)
    ends = [end((), higher, 0.0), end((), information, 3.0)]
    # Of two searches with the same causes the better one says what they are worth.
    assert min(one.by for one in overrated(standing, ends)) == pytest.approx(-9.0)
    assert len(overrated(standing, ends)) == 1
    assert overrated(standing, [standing]) == ()


def test_the_same_cause_at_another_place_is_no_other(monkeypatch) -> None:
    information = told({"mass": 0.12})
    elsewhere = replace(MASS, at=0.1)
    monkeypatch.setattr(promised, "_density", lambda *_: 0.0)
    assert overrated(end((MASS,), information, 0.0), [end((elsewhere,), information, 9.0)]) == ()
    (found,) = overrated(end((MASS,), information, 0.0), [end((elsewhere, LAST), information, 9.0)])
    assert (found.extra, found.missing) == ((LAST,), ())


def test_a_cause_whose_search_stood_still_does_not_stay() -> None:
    information = told({"mass": 0.12, "thrust": 0.2})
    best = rank(information, listed(), EVERY)[0]
    stands = end((), information, 0.0)
    known = overrated(stands, [end(best.causes, information, 200.0)])
    after = rank(information, listed(), EVERY, Needed(overrated=known))[0]
    assert best.causes
    assert not set(best.causes) <= set(after.causes)


def test_the_likelier_end_is_that_which_needs_no_promise() -> None:
    information = told({"mass": 0.12})
    higher = replace(information, shared=information.shared + 20.0)
    rested, promising = end((), information, 2.0), end((), higher, 30.0)
    assert likelier(rested, promising, EVERY, NONE_NEEDED)
    assert not likelier(promising, rested, EVERY, NONE_NEEDED)
    assert likelier(end((), higher, 2.0), rested, EVERY, NONE_NEEDED)
