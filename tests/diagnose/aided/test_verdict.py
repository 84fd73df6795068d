"""Rankings of made-up information, and what may be said of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from gcs_sysid.diagnose import verdict
from gcs_sysid.diagnose.aided import gain
from gcs_sysid.diagnose.aided.ranking import deviations, rank
from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information, Posterior, information
from gcs_sysid.diagnose.hypothesis import Estimate, Ranked
from tests.diagnose.aided.made_unknowns import EVERY, listed, told

SERVOS = (("actuator_lag", "rudder"), ("actuator_rate_limit", "rudder"))
STALL = CAUSES["stall"]


def judged(found: Information) -> tuple[verdict.Verdict, tuple[Ranked, ...]]:
    ranked = rank(found, listed(), EVERY)
    shown = verdict.would_show(EVERY, deviations(found, listed(), EVERY), listed().sizes)
    return verdict.judge(ranked, shown), ranked


def test_a_cause_is_named_with_its_size() -> None:
    answer, ranked = judged(told({"cg.x": -0.1}))
    assert answer.answer == "effect"
    assert answer.best.names == ("cg_shift",)
    [[estimate]] = answer.best.estimates
    assert estimate.value == pytest.approx(-0.1, abs=4.0 * estimate.deviation)
    assert sum(item.probability for item in ranked) == pytest.approx(1.0)


def test_the_size_takes_in_what_ordinary_errors_explain() -> None:
    """Half a cause and half an ordinary error of the same number are one departure."""
    answer, _ = judged(told({"mass": 0.09, "departures.mass": 0.01}))
    assert answer.best.names == ("mass",)
    [[estimate]] = answer.best.estimates
    assert estimate.value == pytest.approx(1.10, abs=4.0 * estimate.deviation)
    assert estimate.deviation < 0.01


def test_two_at_once_are_both_named() -> None:
    answer, _ = judged(told({"mass": 0.12, "cg.x": 0.08}))
    assert answer.answer == "effect"
    assert set(answer.best.names) == {"mass", "cg_shift"}


def some(names: tuple[str, ...], probability: float, evidence: float) -> Ranked:
    """A set of causes by what the verdict asks of it."""
    every = (*EVERY, *(Candidate(CAUSES[name], about) for name, about in SERVOS), Candidate(STALL))
    causes = tuple(one for one in every if one.cause.name in names)
    return Ranked(causes, 0.1, probability, evidence, (), Posterior(np.zeros(1), np.eye(1), 0.0))


def test_of_causes_that_act_together_those_that_are_sure_are_named() -> None:
    three = some(("mass", "cg_shift", "airspeed_scale"), 0.5, 41.0)
    two = some(("mass", "cg_shift"), 0.3, 40.0)
    other = some(("mass",), 0.1, 30.0)
    nothing = some((), 0.1, 0.0)
    answer = verdict.judge((three, two, other, nothing), (True,))
    assert answer.answer == "effect"
    assert set(answer.best.names) == {"mass", "cg_shift"}
    assert answer.best.probability == pytest.approx(0.8)
    assert {one.cause.name: share for one, share in answer.perhaps.items()} == {
        "airspeed_scale": pytest.approx(0.5)
    }
    assert [item.probability for item in answer.ranked] == pytest.approx([0.8, 0.1, 0.1])


def test_a_perhaps_has_the_size_of_the_most_probable_set_with_it() -> None:
    """Beside what is named, whatever else is in it."""

    def sized(one: Ranked, *values: float) -> Ranked:
        return replace(one, estimates=tuple((Estimate("x", v, 0.1, "1", 0.0),) for v in values))

    likely = sized(some(("mass", "cg_shift"), 0.5, 41.0), 5.0, 6.0)
    less = sized(some(("mass", "cg_shift", "airspeed_scale"), 0.3, 40.0), 7.0, 8.0, 9.0)
    bare = sized(some(("mass",), 0.2, 40.5), 4.0)
    answer = verdict.judge((likely, less, bare), (True,))
    assert answer.best.names == ("mass",)
    found = {one.cause.name: size.value for one, (size,) in answer.sizes.items()}
    assert found == {"cg_shift": 6.0, "airspeed_scale": 9.0}


def test_where_something_else_is_at_work_and_nobody_knows_what_nothing_is_named() -> None:
    """Mass with one thing or another beside it, and not alone."""
    first, second = (
        some(("mass", "cg_shift"), 0.5, 41.0),
        some(("mass", "airspeed_scale"), 0.4, 40.0),
    )
    answer = verdict.judge((first, second, some(("mass",), 0.1, 30.0)), (True,))
    assert answer.answer == "ambiguous"
    assert answer.indistinguishable == (first, second)
    assert [one.cause.name for one in answer.sure] == ["mass"]


def test_of_many_things_at_work_those_are_named_that_are_sure() -> None:
    """Two are in all sets, and beside them two of five, nobody knows which."""
    names = ("mass", "cg_shift", "inertia", "stall", "propwash", "heading_bias", "gyro_scale")
    every = [Candidate(CAUSES[name]) for name in names]
    sure, others = every[:2], every[2:]
    size = Estimate("size", 1.1, 0.01, "1", 1.0)

    def together(*causes: Candidate, evidence: float) -> Ranked:
        chosen, found = (*sure, *causes), Posterior(np.zeros(1), np.eye(1), 0.0)
        return Ranked(chosen, 0.1, 0.15, evidence, ((size,),) * len(chosen), found)

    sets = [
        together(one, other, evidence=40.0)
        for one, other in zip(others, [*others[1:], others[0]], strict=True)
    ]
    bare = together(evidence=30.0)
    answer = verdict.judge((*sets, bare), (True,))
    assert answer.answer == "effect"
    assert answer.best.names == ("mass", "cg_shift")
    assert answer.best.estimates == ((size,), (size,))
    assert answer.best.probability == pytest.approx(0.9)
    assert set(answer.perhaps) == set(others)
    # Of few it may be one or the other.
    assert verdict.judge((*sets[:2], bare), (True,)).answer == "ambiguous"


def test_nobody_is_named_for_a_size_that_may_be_none() -> None:
    both = some(("mass", "actuator_lag"), 0.9, 41.0)
    sizes = {"mass": Estimate("mass_ratio", 1.12, 0.01, "1", 1.0)}
    sizes["actuator_lag"] = Estimate("time_constant", -0.043, 0.043, "s", 0.0)
    both = replace(both, estimates=tuple((sizes[name],) for name in both.names))
    answer = verdict.judge((both, some((), 0.05, 0.0)), ())
    assert (answer.answer, answer.best.names) == ("effect", ("mass",))
    assert [one.cause.name for one in answer.perhaps] == ["actuator_lag"]
    assert list(answer.sizes.values()) == [(sizes["actuator_lag"],)]
    alone = some(("actuator_lag",), 0.9, 41.0)
    alone = replace(alone, estimates=((sizes["actuator_lag"],),))
    assert verdict.judge((alone, some((), 0.05, 0.0)), ()).answer == "insufficient_data"


def test_where_something_begins_is_no_size() -> None:
    place = Estimate("alpha_break", 0.12, 0.004, "rad", 0.0)
    loss = Estimate("slope_loss", 0.1, 0.2, "1", 0.0)
    stalls = replace(some(("stall",), 0.9, 41.0), estimates=((place, loss),))
    assert verdict.judge((stalls,), ()).answer == "insufficient_data"
    stalls = replace(stalls, estimates=((place, replace(loss, value=0.6)),))
    assert verdict.judge((stalls,), ()).answer == "effect"
    limit = Estimate("rate_limit", 1.0, 0.9, "rad/s", 0.0)
    limited = replace(some(("actuator_rate_limit",), 0.9, 41.0), estimates=((limit,),))
    assert verdict.judge((limited,), ()).answer == "effect"


def test_what_explains_nothing_is_no_rival_however_usual_it_is() -> None:
    """A rare cause at 20 to 1, and a usual one without evidence, a posterior odd of six apart."""
    rare = replace(some(("mass",), 0.6, 3.1), prior=0.01)
    usual = replace(some(("cg_shift",), 0.1, 0.0), prior=0.04)
    nothing = some((), 0.3, 0.0)
    assert verdict.judge((rare, nothing, usual), (True,)).answer == "effect"
    close = replace(usual, log_bayes_factor=1.0)
    assert verdict.judge((rare, nothing, close), (True,)).answer == "ambiguous"


def test_a_cause_more_has_to_be_worth_its_prior() -> None:
    """Where the set without it has 20 times less evidence too."""
    both = replace(some(("mass", "cg_shift"), 0.6, 20.0), prior=0.001)
    alone = replace(some(("mass",), 0.4, 16.0), prior=0.02)
    answer = verdict.judge((both, alone, some((), 0.0, 0.0)), (True,))
    assert answer.best.names == ("mass",)
    assert set(answer.perhaps) == {EVERY[1]}


def test_nothing_wrong_is_called_so() -> None:
    answer, ranked = judged(told({}))
    assert answer.answer == "no_effect"
    assert ranked[0].causes == ()


def test_causes_with_one_signature_cannot_be_told_apart() -> None:
    answer, _ = judged(told({"mass": 0.1}, alike=True))
    assert answer.answer == "ambiguous"
    assert {name for item in answer.indistinguishable for name in item.names} >= {
        "mass",
        "cg_shift",
    }


@pytest.mark.parametrize("alike", [False, True])
def test_an_accusation_that_foretells_nothing_better_is_dropped(alike: bool) -> None:
    answer, _ = judged(told({"mass": 0.1}, alike=alike))
    assert answer.answer == ("ambiguous" if alike else "effect")
    assert verdict.sustained(answer, 0.01, 0.9 * verdict.NAMED) == answer
    assert verdict.sustained(answer, float("nan")) == answer
    assert verdict.sustained(answer, 0.01, verdict.NAMED).answer == "insufficient_data"
    dropped = verdict.sustained(answer, -0.01)
    assert dropped.answer == "insufficient_data"
    assert dropped.indistinguishable == ()


def test_a_size_that_nobody_would_believe_accuses_nobody() -> None:
    answer, _ = judged(told({"cg.x": -0.1}))
    assert answer.answer == "effect"
    assert verdict.credible(answer, 3.9) == answer
    dropped = verdict.credible(answer, 4.6)
    assert dropped.answer == "insufficient_data"
    assert dropped.indistinguishable == ()
    silent, _ = judged(told({}))
    assert verdict.credible(silent, 4.6) == silent


def test_silence_needs_nothing_to_be_foretold_better() -> None:
    answer, _ = judged(told({}))
    assert verdict.sustained(answer, 0.0) == answer


def test_a_flight_that_shows_nothing_is_no_proof_of_nothing() -> None:
    found = told({})
    faint = found.weighed(1e-6)
    assert judged(found)[0].answer == "no_effect"
    assert judged(faint)[0].answer == "insufficient_data"


def test_a_true_cause_foretells_what_took_no_part_and_a_wrong_one_does_not() -> None:
    fitted, apart = told({"cg.x": -0.1}), told({"cg.x": -0.1}).weighed(0.5)
    mass, cg, _ = EVERY
    assert gain.gained(fitted, apart, listed(), (cg,)) > 0.0
    assert gain.gained(fitted, apart, listed(), (mass,)) < gain.gained(
        fitted, apart, listed(), (cg,)
    )
    nothing = Information(0.0 * apart.gram, 0.0 * apart.score, 0.0)
    assert np.isnan(gain.gained(fitted, nothing, listed(), (cg,)))


def test_a_gain_is_over_the_file_and_not_over_what_flights_teach_of_it() -> None:
    """Of a mass that the lift slope, which the file knows to 0.5, can stand in for."""
    columns = 30.0 * np.random.default_rng(11).standard_normal((300, 4))
    columns[:, 0] = columns[:, 1]
    wide = columns @ np.concatenate([np.eye(4), listed().directions], axis=1)
    noise = np.random.default_rng(12).standard_normal(300)
    found, mass = information(wide, 0.12 * columns[:, 1] + noise), EVERY[:1]
    assert abs(gain.against(found, found, listed(), mass)) < verdict.NAMED
    assert found.count * gain.gained(found, found, listed(), mass) > 100.0


def test_what_took_no_part_may_speak_against_a_cause() -> None:
    """A mass that was there when the flight was fitted, and not in what took no part."""
    mass = EVERY[:1]
    fitted, apart = told({"mass": 0.12}), told({})
    assert gain.against(fitted, apart, listed(), mass) > verdict.NAMED
    assert gain.against(fitted, told({"mass": 0.12}), listed(), mass) < 0.0


def test_what_is_foretold_is_the_density_of_what_took_no_part_given_the_rest() -> None:
    """Against normal densities written out: y = X θ + e, one before the other and both."""
    every, random = listed(), np.random.default_rng(4)
    sigma = every.alone((), every.freed(())[0])
    rows = random.standard_normal((60, sigma.size)) / np.where(sigma > 0.0, 2.0 * sigma, 1.0)
    seen = rows @ (sigma * random.standard_normal(sigma.size)) + random.standard_normal(60)

    def density(chosen: slice) -> float:
        own = rows[chosen]
        covariance = np.eye(len(own)) + (own * sigma**2) @ own.T
        return float(multivariate_normal.logpdf(seen[chosen], cov=covariance))

    def of(chosen: slice) -> Information:
        own, left = rows[chosen], seen[chosen]
        shared = float(norm.logpdf(left).sum())
        return Information(own.T @ own, own.T @ left, float(len(left)), shared)

    found = gain.foretold(of(slice(0, 40)), of(slice(40, 60)), every, ())
    assert found == pytest.approx(density(slice(0, 60)) - density(slice(0, 40)))


def test_what_a_correction_gains_scatters_as_is_said() -> None:
    """By the slopes of one flight, what many flights scatter by; every third block took no part."""
    random = np.random.default_rng(7)
    rows, true, length = random.standard_normal((240, 2)), np.array([0.3, -0.2]), 10
    apart = np.repeat(np.arange(24) % 3 == 0, length)[:236]
    gained, foretold = [], []
    for _ in range(800):
        noise = random.standard_normal(240)
        seen = rows @ true + noise
        gained.append(0.5 * float(np.sum((seen**2 - noise**2)[:236][apart])))
        blocks = (rows * noise[:, None]).reshape(24, length, 2).sum(axis=1)
        foretold.append(gain.scattered(blocks, apart, true, length))
    assert np.mean(foretold) == pytest.approx(np.var(gained), rel=0.1)
    # Slopes of blocks that are partly of either kind count by the part.
    assert gain.scattered(np.ones((1, 2)), np.arange(10) < 5, true, length) == pytest.approx(0.0025)


def test_only_values_of_the_file_are_called_strained() -> None:
    """A clean flight was denied its verdict over the bias of its own gyro."""
    every = listed()
    mean = np.zeros(len(every.names))
    mean[every.names.index("aerodynamics.CZ.alpha")] = -1.75
    mean[every.names.index("sensors.gyro_bias.0 #0")] = 0.05
    best = Ranked((), 0.5, 0.9, 0.0, (), Posterior(mean, np.eye(mean.size), 0.0))
    assert verdict.strained(every.names, every.sigma, best) == {"CZ.alpha": -3.5}
    calm = replace(best, posterior=Posterior(0.1 * mean, np.eye(mean.size), 0.0))
    assert verdict.strained(every.names, every.sigma, calm) == {}


def test_a_cause_gains_over_a_file_that_has_no_other_name_for_it() -> None:
    """Mass and a centre of gravity that do the same: ordinary errors of the one are the other's."""
    fitted, apart = (told({"mass": 0.12}, alike=True, clear=each) for each in (9.0, 8.0))
    mass, cg, _ = EVERY
    over_its_own = gain.gained(fitted, apart, listed(), (mass,))
    over_both = gain.gained(fitted, apart, listed(), (mass,), (cg,))
    assert over_both > 10.0 * abs(over_its_own)
    assert over_both > 0.0
