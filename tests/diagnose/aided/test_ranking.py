"""How good a file is, is told by the flight: what that does to the weighing of causes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from gcs_sysid.diagnose.aided import unknowns
from gcs_sysid.diagnose.aided.ranking import (
    ACCURACIES,
    LAG,
    NONE_NEEDED,
    RIGHT,
    Needed,
    Overrated,
    density,
    likeliest_accuracy,
    rank,
    with_a_right_file,
)
from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import information
from gcs_sysid.diagnose.hypothesis import Ranked
from gcs_sysid.estimate import scoring

COUNT, STATED, SEEN = 15, 0.1, 0.02
"""Derivatives of an aircraft, what its file says they may be off by, and how well a flight knows
them, all relative."""
NAMES = tuple(f"aerodynamics.CZ.{index}" for index in range(COUNT))
TOGETHER = {"mass": dict.fromkeys(NAMES, -1.0), "thrust": {"departures.thrust": 1.0}}
"""A heavier aircraft has forces that are all smaller by one factor."""
EVERY = tuple(Candidate(CAUSES[name]) for name in ("mass", "thrust_scale"))


def listed() -> unknowns.Unknowns:
    names = (*NAMES, "departures.thrust")
    ordinary = np.array([STATED] * COUNT + [0.02])
    usual = dict.fromkeys(TOGETHER, 1e-3)
    return unknowns.of_flights(
        names, ordinary, TOGETHER, usual, {"": 1.0}, 1, np.zeros(ordinary.size)
    )


def ranked(off: np.ndarray, mass: float, seed: int) -> tuple[Ranked, ...]:
    """What a flight says where the file is off and the mass is."""
    every = listed()
    columns = np.eye(COUNT + 1)[:COUNT] / SEEN
    wide = columns @ np.concatenate([np.eye(COUNT + 1), every.directions], axis=1)
    noise = np.random.default_rng(seed).standard_normal(COUNT)
    return rank(information(wide, columns[:, :COUNT] @ (off - mass) + noise), every, EVERY)


@pytest.mark.parametrize("seed", range(5))
def test_a_file_that_is_right_in_all_else_makes_the_cause_sure(seed: int) -> None:
    best = ranked(np.zeros(COUNT), 0.08, seed)[0]
    assert best.names == ("mass",)
    assert best.log_bayes_factor > 5.0
    assert best.accuracy < 0.5
    [[estimate]] = best.estimates
    assert abs(estimate.value - 1.08) < 4.0 * estimate.deviation
    # As well as fifteen derivatives seen to 2 % can know it, not as fifteen stated to 10 % do.
    assert estimate.deviation < 2.0 * SEEN / np.sqrt(COUNT)


@pytest.mark.parametrize("seed", range(5))
def test_a_file_that_is_off_as_it_says_accuses_nobody(seed: int) -> None:
    off = np.random.default_rng(100 + seed).normal(0.0, STATED, COUNT)
    best = ranked(off - off.mean(), 0.0, seed)[0]
    assert best.causes == ()
    assert best.accuracy == pytest.approx(1.0, abs=0.5)


@pytest.mark.parametrize("seed", range(5))
def test_a_file_that_is_worse_than_it_says_is_found_out(seed: int) -> None:
    off = np.random.default_rng(200 + seed).normal(0.0, 4.0 * STATED, COUNT)
    assert ranked(off - off.mean(), 0.0, seed)[0].accuracy > 1.0


@pytest.mark.parametrize("seed", range(3))
def test_two_causes_do_not_make_a_good_file_look_bad(seed: int) -> None:
    """By one of them alone the file would seem to be off as it says."""
    names = ("mass", "thrust_scale", "drag_increase")
    half = {name: -1.0 for name in NAMES[: COUNT // 2]}
    directions = {**TOGETHER, "term.CX.1": half}
    usual = dict.fromkeys(directions, 1e-3)
    sizes = {"": 1.0, "CX0": 0.2}
    ordinary = np.array([STATED] * COUNT + [0.02])
    every = unknowns.of_flights(
        (*NAMES, "departures.thrust"), ordinary, directions, usual, sizes, 1, np.zeros(COUNT + 1)
    )
    columns = np.eye(COUNT + 1)[:COUNT] / SEEN
    wide = columns @ np.concatenate([np.eye(COUNT + 1), every.directions], axis=1)
    off = np.where(np.arange(COUNT) < COUNT // 2, -0.3, 0.0) - 0.2
    noise = np.random.default_rng(seed).standard_normal(COUNT)
    data = information(wide, columns[:, :COUNT] @ off + noise)
    best = rank(data, every, [Candidate(CAUSES[name]) for name in names])[0]
    assert set(best.names) == {"mass", "drag_increase"}
    assert best.accuracy <= 0.25


def test_probabilities_are_those_of_evidence_averaged_over_accuracies() -> None:
    found = ranked(np.zeros(COUNT), 0.03, 3)
    assert sum(one.probability for one in found) == pytest.approx(1.0)
    none = next(one for one in found if not one.causes)
    for one in found:
        odds = one.prior / none.prior * np.exp(one.log_bayes_factor)
        assert one.probability / none.probability == pytest.approx(odds)


THIRDS = {
    "mass": dict.fromkeys(NAMES, -1.0),
    "term.CX.1": dict.fromkeys(NAMES[: COUNT // 3], -1.0),
    "thrust": dict.fromkeys(NAMES[COUNT // 3 : 2 * COUNT // 3], 1.0),
    "airspeed": {NAMES[-1]: 1.0, NAMES[-2]: -1.0},
}
"""Four causes that are not alike."""
FOUR = ("mass", "drag_increase", "thrust_scale", "airspeed_scale")


def several(
    sizes: dict[str, float], least: dict[str, float], seed: int, needed: Needed = NONE_NEEDED
) -> tuple[Ranked, ...]:
    """What a flight says where several quantities are off, and some cannot be less than so much."""
    usual = dict.fromkeys(THIRDS, 1e-3)
    every = unknowns.of_flights(
        *(NAMES, np.full(COUNT, STATED), THIRDS, usual, {"": 1.0, "CX0": 0.2}),
        *(1, np.zeros(COUNT), least),
    )
    columns = np.eye(COUNT) / SEEN
    wide = columns @ np.concatenate([np.eye(COUNT), every.directions], axis=1)
    wrong = np.array([sizes.get(name, 0.0) for name in every.names])
    noise = np.random.default_rng(seed).standard_normal(COUNT)
    data = information(wide, wide @ wrong + noise)
    return rank(data, every, [Candidate(CAUSES[name]) for name in FOUR], needed)


@pytest.mark.parametrize("seed", range(3))
def test_as_many_causes_are_named_as_there_are(seed: int) -> None:
    off = {"mass": 0.25, "term.CX.1": -0.3, "thrust": 0.4, "airspeed": 0.2}
    quantity = dict(zip(FOUR, off, strict=True))
    for count in (1, 2, 3, 4):
        there = FOUR[:count]
        best = several({quantity[name]: off[quantity[name]] for name in there}, {}, seed)[0]
        assert set(best.names) == set(there)


@pytest.mark.parametrize("seed", range(3))
def test_a_file_may_be_loose_or_right_but_for_more_causes(seed: int) -> None:
    """Derivatives off by as much as their sigmas are what a right file needs several causes for."""
    every = listed()
    columns = np.eye(COUNT + 1)[:COUNT] / SEEN
    wide = columns @ np.concatenate([np.eye(COUNT + 1), every.directions], axis=1)
    random = np.random.default_rng(300 + seed)
    off = random.normal(0.0, STATED, COUNT)
    data = information(wide, columns[:, :COUNT] @ (off - 0.3) + random.standard_normal(COUNT))
    best, right = rank(data, every, EVERY)[0], with_a_right_file(data, every, EVERY)
    assert right.accuracy <= RIGHT < best.accuracy
    assert density(data, right) < density(data, best) - 30.0
    # Where the rest of the file is right, both are the same.
    data = information(wide, columns[:, :COUNT] @ np.full(COUNT, -0.3))
    assert with_a_right_file(data, every, EVERY).causes == rank(data, every, EVERY)[0].causes


def test_a_density_is_that_of_the_flight() -> None:
    """By the Gaussian's own density, whatever the point about which the flight was weighed."""
    every, random = listed(), np.random.default_rng(5)
    columns = np.eye(COUNT + 1)[:COUNT] / SEEN
    wide = columns @ np.concatenate([np.eye(COUNT + 1), every.directions], axis=1)
    seen = columns[:, :COUNT] @ np.full(COUNT, -0.3) + random.standard_normal(COUNT)
    nothing = float(multivariate_normal(np.zeros(COUNT)).logpdf(seen))
    data = replace(information(wide, seen), shared=nothing)
    best = rank(data, every, EVERY)[0]
    sigma, mean = every.as_accurate(best.accuracy).freed(best.causes)
    covariance = np.eye(COUNT) + wide * sigma**2 @ wide.T
    expected = multivariate_normal(wide @ mean, covariance).logpdf(seen)
    expected += np.log(best.prior * ACCURACIES[best.accuracy])
    assert density(data, best) == pytest.approx(expected)


BREAK, LOSS = 0.1155, 0.8
"""A bend between two places where one is tried, and what is lost beyond it."""


@pytest.mark.parametrize("seed", range(4))
def test_how_much_is_lost_hangs_on_where_it_begins(seed: int) -> None:
    """About the nearest place that is tried the loss comes out wrong by many of its deviations."""
    places = CAUSES["stall"].places
    names = tuple(f"aerodynamics.CZ.max(0, alpha - {at:.4g})" for at in places)
    directions = {f"stall.{at:.4g}": {name: 1.0} for at, name in zip(places, names, strict=True)}
    usual = dict.fromkeys(directions, 1e-3)
    held = np.zeros(len(places))
    every = unknowns.of_flights(
        *(("aerodynamics.CZ.alpha", *names), np.array([0.1, *held]), directions, usual),
        *({"": 1.0}, 1, np.array([0.0, *held])),
    )
    random = np.random.default_rng(seed)
    alpha = random.uniform(-0.02, 0.16, 400)
    columns = np.stack([alpha, *(np.maximum(alpha - at, 0.0) for at in places)], axis=1) / 5e-4
    wide = columns @ np.concatenate([np.eye(len(places) + 1), every.directions], axis=1)
    seen = LOSS * np.maximum(alpha - BREAK, 0.0) / 5e-4 + random.standard_normal(alpha.size)
    stalls = [Candidate(CAUSES["stall"], at=at) for at in places]
    [[begins, loss]] = rank(information(wide, seen), every, stalls)[0].estimates
    assert abs(begins.value - BREAK) < 2.5 * begins.deviation
    assert abs(loss.value - LOSS) < 2.5 * loss.deviation
    assert loss.deviation < 0.1


def test_what_cannot_be_is_not_named() -> None:
    off = {"thrust": -0.4}
    free, held = several(off, {}, 1), several(off, {"thrust": -0.05}, 1)
    assert free[0].names == ("thrust_scale",)
    assert "thrust_scale" not in held[0].names
    # Where it is possible the limit says so much: that it is what is believed anyway.
    other = several({"thrust": 0.4}, {"thrust": 0.0}, 1)[0]
    bare = several({"thrust": 0.4}, {}, 1)[0]
    assert other.log_bayes_factor - bare.log_bayes_factor == pytest.approx(np.log(2.0), abs=1e-6)


def test_sets_without_what_is_needed_have_less_evidence() -> None:
    """And those with it are looked for, though without it others explained more."""
    off = {"mass": 0.25, "thrust": 0.4}
    needed = Needed((Candidate(CAUSES["airspeed_scale"]),), 200.0)
    free, held = several(off, {}, 1), several(off, {}, 1, needed)
    assert set(free[0].names) == {"mass", "thrust_scale"}
    assert set(held[0].names) == {"mass", "thrust_scale", "airspeed_scale"}
    before = {one.names: one.log_bayes_factor for one in free}
    for one in held:
        if one.names in before:
            lower = 0.0 if "airspeed_scale" in one.names else 200.0
            assert one.log_bayes_factor == pytest.approx(before[one.names] - lower)
    assert sum(one.probability for one in held) == pytest.approx(1.0)


def test_a_set_of_a_size_that_nobody_believes_is_nowhere_named() -> None:
    """Nor with another cause beside it; all else is weighed as before."""
    off = {"mass": 0.25, "thrust": 0.4}
    never = (Candidate(CAUSES["thrust_scale"]), Candidate(CAUSES["mass"]))
    free, held = several(off, {}, 1), several(off, {}, 1, Needed(incredible=never))
    assert set(free[0].names) == {"mass", "thrust_scale"}
    assert not {"mass", "thrust_scale"} <= set(held[0].names)
    assert all(one.probability == 0.0 for one in held if {"mass", "thrust_scale"} <= set(one.names))
    before = {one.names: one.log_bayes_factor for one in free}
    for one in held:
        if one.names in before and not {"mass", "thrust_scale"} <= set(one.names):
            assert one.log_bayes_factor == pytest.approx(before[one.names])


def test_what_a_search_did_not_keep_is_no_evidence() -> None:
    """Of sets that differ from where flights stand as the search did; of others that hold it."""
    mass, thrust = Candidate(CAUSES["mass"]), Candidate(CAUSES["thrust_scale"])
    bent = (Overrated((thrust,), (mass,), 30.0), Overrated((), (mass,), -5.0))
    off = {"mass": 0.25, "thrust": 0.4}
    free, held = several(off, {}, 1), several(off, {}, 1, Needed(overrated=bent))
    before = {one.names: one.log_bayes_factor for one in free}
    seen = set()
    for one in held:
        if one.names in before:
            lower = 30.0 if "thrust_scale" in one.names else 0.0 if "mass" in one.names else -5.0
            assert one.log_bayes_factor == pytest.approx(before[one.names] - lower)
            seen.add(lower)
    assert seen == {30.0, 0.0, -5.0}
    assert sum(one.probability for one in held) == pytest.approx(1.0)


@pytest.mark.parametrize(("off", "low", "high"), [(0.0, 0.0, 0.25), (STATED, 0.5, 2.0)])
def test_how_good_the_file_is_with_a_cause_apart(off: float, low: float, high: float) -> None:
    """A heavier aircraft is no reason to call the rest of the file wrong, where it may be one."""
    every, random = listed(), np.random.default_rng(3)
    columns = np.eye(COUNT + 1)[:COUNT] / SEEN
    wide = columns @ np.concatenate([np.eye(COUNT + 1), every.directions], axis=1)
    wrong = random.normal(0.0, 1.0, COUNT) * off - 0.3
    told = information(wide, columns[:, :COUNT] @ wrong + random.standard_normal(COUNT))
    assert low <= likeliest_accuracy(told, every, EVERY[:1]) <= high
    assert likeliest_accuracy(told, every, ()) > 2.0


def test_what_hangs_on_the_lag_of_the_moments_is_not_known_better_than_it_can_be_timed() -> None:
    """A size that moves by a fifth with ten milliseconds of lag is never known to a thousandth."""
    names = ("departures.thrust", LAG)
    every = unknowns.of_flights(
        names,
        np.array([0.02, 0.01]),
        {"thrust": {"departures.thrust": 1.0}},
        {"thrust": 1e-3},
        {"": 1.0},
        1,
        np.zeros(2),
    )

    def deviation(rows: list[list[float]]) -> float:
        columns = np.array(rows) / 1e-4
        wide = columns @ np.concatenate([np.eye(2), every.directions], axis=1)
        told = information(wide, columns @ np.array([-0.3, 0.0]))
        [[estimate]] = rank(told, every, EVERY[1:])[0].estimates
        return estimate.deviation

    alone, leaning = [[1.0, 0.0], [0.0, 1.0]], [[1.0, 20.0], [0.0, 1.0]]
    assert deviation(alone) < 1e-3
    assert deviation(leaning) == pytest.approx(20.0 * scoring.TIMING, rel=0.05)


def test_late_commands_are_late_where_early_ones_would_explain_more_alone() -> None:
    """Beside a mass that is off; where early ones are tried the size would be of the wrong sign."""
    late, early = (f"skew.SERVO_OUTPUT_RAW.{at:.4g}" for at in (0.07, -0.07))
    names = ("departures.actuators.0", "departures.actuators.1", "departures.mass")
    directions = {
        late: {names[0]: 1.0},
        early: {names[1]: 1.0},
        "mass": {names[2]: 1.0},
    }
    usual = dict.fromkeys(directions, 1e-4)
    every = unknowns.of_flights(names, np.zeros(3), directions, usual, {"": 1.0}, 1, np.zeros(3))
    # By unit of each: what late commands do, what early ones do, a mass that is too large.
    columns = 2000.0 * np.array([[1.0, 1.0, 0.0], [0.0, 1.0, -1.0], [0.0, 0.0, 3.0]])
    wide = columns @ np.concatenate([np.eye(3), every.directions], axis=1)
    truth = np.zeros(len(every.names))
    truth[[every.names.index(late), every.names.index("mass")]] = 0.05, -0.05
    data = information(wide, wide @ truth)
    skews = [Candidate(CAUSES["time_skew"], "SERVO_OUTPUT_RAW", at) for at in (0.07, -0.07)]
    found = rank(data, every, [*skews, Candidate(CAUSES["mass"])])
    best = found[0]
    assert set(best.causes) == {skews[0], Candidate(CAUSES["mass"])}
    sizes = {one.name: one.value for each in best.estimates for one in each}
    assert sizes == {
        "delay": pytest.approx(0.05, abs=1e-3),
        "mass_ratio": pytest.approx(0.95, abs=1e-3),
    }
