"""Sizes from which flights name a cause, against evidence worked out at just these sizes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.diagnose.aided import power
from gcs_sysid.diagnose.aided.ranking import shares
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information, posterior
from gcs_sysid.diagnose.verdict import NAMED, RIVAL
from tests.diagnose.aided.made_unknowns import EVERY, listed, told

FLIGHTS = told({}, clear=8.0)


def evidence(data: Information, name: str, size: float, candidate: Candidate) -> float:
    """Against nothing being wrong, of flights that show one quantity of a size and no noise."""
    every = listed()
    size_of = np.where(np.array(every.names) == name, size, 0.0)
    shown = replace(data, score=data.gram @ size_of)
    with_it = posterior(shown, *every.freed((candidate,))).log_evidence
    return with_it - posterior(shown, *every.freed(())).log_evidence


def test_it_is_named_where_its_evidence_is_enough() -> None:
    found = power.of_flights(FLIGHTS, listed(), EVERY)
    for candidate, (one,) in zip(EVERY, found, strict=True):
        (name,) = candidate.frees
        assert evidence(FLIGHTS, name, one.named, candidate) == pytest.approx(NAMED)
        assert evidence(FLIGHTS, name, -one.named, candidate) == pytest.approx(NAMED)


def test_it_is_alone_where_its_rival_is_left_behind() -> None:
    """Centre of gravity and mass do nearly the same there."""
    noisy = told({}, alike=True, clear=8.0).plus(FLIGHTS.weighed(0.01))
    found = power.of_flights(noisy, listed(), EVERY)
    mass, (cg,) = found[0][0], found[1]
    assert mass.rival == EVERY[1]
    assert cg.rival == EVERY[0]
    assert cg.named < cg.alone < np.inf
    prior = shares(EVERY)
    ahead = evidence(noisy, "cg.x", cg.alone, EVERY[1]) - evidence(
        noisy, "cg.x", cg.alone, EVERY[0]
    )
    ahead += np.log(prior["cg_shift"] / prior["mass"])
    assert ahead == pytest.approx(RIVAL)


def test_what_flights_do_not_tell_apart_is_alone_at_no_size() -> None:
    found = power.of_flights(told({}, alike=True), listed(), EVERY)
    assert np.isinf(found[1][0].alone)
    assert found[1][0].rival == EVERY[0]
    assert found[1][0].named < np.inf


def test_blind_flights_name_nothing_at_any_size() -> None:
    blind = FLIGHTS.weighed(0.0)
    assert all(np.isinf(one.named) for (one,) in power.of_flights(blind, listed(), EVERY))


def test_of_an_effect_that_is_expected_somewhere_it_is_the_size_in_that_direction() -> None:
    """Evidence is then no even function of the size."""
    shift = EVERY[1]
    (parameter,) = shift.cause.parameters
    expected = replace(parameter, expected=0.05)
    one = Candidate(replace(shift.cause, parameters=(expected,)))
    ((found,),) = power.of_flights(FLIGHTS, listed(), [one])
    assert evidence(FLIGHTS, "cg.x", found.named, one) == pytest.approx(NAMED)
    assert evidence(FLIGHTS, "cg.x", -found.named, one) < NAMED - 0.1
