"""One vector for several flights: what is shared, what is each flight's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp

from gcs_sysid.diagnose.aided import unknowns, unlisted
from gcs_sysid.diagnose.aided.beliefs import NEGLIGIBLE
from gcs_sysid.diagnose.aided.ranking import ACCURACIES, rank
from gcs_sysid.diagnose.aided.unknowns import of_flight, of_flights
from gcs_sysid.diagnose.aided.unlisted import MissingTerm
from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import information, posterior
from gcs_sysid.diagnose.hypothesis import PRIOR_OF_UNLISTED
from gcs_sysid.diagnose.unlisted import terms as unlisted_terms
from gcs_sysid.diagnose.verdict import NAMED
from gcs_sysid.estimate.lacking import SIZE
from tests.diagnose.aided.made_unknowns import (
    EVERY,
    ORDINARY,
    PARAMETERS,
    QUANTITIES,
    USUAL,
    listed,
    told,
)


def test_flights_share_the_aircraft_and_own_their_gyros() -> None:
    two = listed(2)
    assert two.names[:5] == (
        *PARAMETERS[:3],
        "sensors.gyro_bias.0 #0",
        "sensors.gyro_bias.0 #1",
    )
    first, second = two.own
    assert list(first) == [0, 1, 2, 3]
    assert list(second) == [0, 1, 2, 4]
    np.testing.assert_array_equal(two.sigma[5:], list(USUAL.values()))


def test_two_flights_know_what_their_rows_together_know() -> None:
    random = np.random.default_rng(2)
    halves = [random.standard_normal((30, len(PARAMETERS))) for _ in range(2)]
    left = [random.standard_normal(30) for _ in range(2)]
    two = listed(2)
    parts = [
        of_flight(two, number, rows.T @ rows, rows.T @ rest, float(rest.size))
        for number, (rows, rest) in enumerate(zip(halves, left, strict=True))
    ]
    found = posterior(parts[0].plus(parts[1]), two.of_file)
    whole = np.zeros((60, two.parameters))
    whole[:30, two.own[0]], whole[30:, two.own[1]] = halves
    dense = posterior(information(whole, np.concatenate(left)), two.sigma[: two.parameters])
    assert found.log_evidence == pytest.approx(dense.log_evidence, rel=1e-9)
    np.testing.assert_allclose(found.mean[: two.parameters], dense.mean, atol=1e-12)


def test_a_quantity_moves_the_parameters_of_every_flight() -> None:
    two = listed(2)
    values = np.zeros(len(two.names))
    values[two.names.index("cg.x")] = -0.5
    for number in range(2):
        np.testing.assert_allclose(two.in_flight(number, values), [0.0, 0.0, -0.1, 0.0])
    moved, deviation = two.along(("cg.x",), values, np.eye(values.size))["cg.x"]
    assert moved == pytest.approx(-0.5)
    assert deviation == pytest.approx(np.hypot(1.0, 1.0 / 0.2))


def test_quantities_that_move_the_same_are_told_apart() -> None:
    """A control's effect, and what it loses with pressure, which moves the effect as well."""
    effect, loss = {"cg": 0.2}, {"cg": -0.3, "mass": 0.004}
    names = ("mass", "cg")
    two = unknowns.of_flights(
        *(names, np.ones(2), {"effect": effect, "loss": loss}, {"effect": 0.0, "loss": 0.0}),
        *({"": 1.0}, 1, np.zeros(2)),
    )
    values = np.zeros(len(two.names))
    values[two.names.index("effect")], values[two.names.index("loss")] = -0.1, -0.35
    found = two.along(("effect", "loss"), values, np.eye(values.size))
    assert found["effect"][0] == pytest.approx(-0.1)
    assert found["loss"][0] == pytest.approx(-0.35)
    together = two.along(("effect",), values, np.eye(values.size))
    assert together["effect"][0] == pytest.approx(-0.1 + 0.35 * 0.3 / 0.2)


def test_what_is_ordinarily_off_in_the_same_way_is_part_of_the_size() -> None:
    """Commands a tenth of a second early: a third of it was left to the ordinary delay."""
    two = unknowns.of_flights(
        *(("actuators.0", "delay"), np.array([0.0, 0.01])),
        *({"skew": {"actuators.0": 1.0}}, {"skew": 0.002}, {"": 1.0}, 1, np.zeros(2)),
        beside={"skew": "delay"},
    )
    values = np.array([0.0, -0.035, -0.065])
    covariance = np.array([[0.0, 0.0, 0.0], [0.0, 4.0, -4.0], [0.0, -4.0, 5.0]])
    moved, deviation = two.along(("skew",), values, covariance)["skew"]
    assert moved == pytest.approx(-0.1)
    assert deviation == pytest.approx(1.0)


def test_what_causes_free_is_ordinarily_off_by_a_twentieth_of_what_matters() -> None:
    usual = unknowns.tolerated(EVERY, {**QUANTITIES, "lag.rudder": {}}, {"": 1.0})
    matters = {"mass": 0.06, "cg.x": 0.03, "airspeed": 0.03}
    assert usual == pytest.approx(
        {name: 0.05 * size for name, size in matters.items()} | {"lag.rudder": 0.0}
    )
    two = of_flights(
        PARAMETERS, ORDINARY, QUANTITIES, {**usual}, {"": 1.0}, 2, np.zeros(ORDINARY.size)
    )
    np.testing.assert_allclose(two.sigma[5:], [usual[name] for name in QUANTITIES])
    np.testing.assert_array_equal(two.of_file[5:], 0.0)
    sigma, _ = two.freed(EVERY[:1])
    assert sigma[5] > usual["mass"]
    np.testing.assert_array_equal(two.alone(EVERY[:1], sigma)[6:], 0.0)


def test_more_parameters_are_the_last_of_the_models() -> None:
    flights = 2
    few = listed(flights)
    added = ("missing.Cm.beta", "missing.Cm.rhat")
    many = few.with_more(added)
    assert many.names[few.parameters : many.parameters] == added
    assert many.names[many.parameters :] == few.names[few.parameters :]
    for number in range(flights):
        own = [many.names[place] for place in many.own[number]]
        assert own == [*(few.names[place] for place in few.own[number]), *added]
    values = np.zeros(len(many.names))
    values[many.names.index("cg.x")] = -0.5
    np.testing.assert_allclose(many.in_flight(1, values), [0.0, 0.0, -0.1, 0.0, 0.0, 0.0])


def test_no_file_is_better_than_anybody_sees() -> None:
    known = replace(listed(), negligible=np.array([0.03, *np.zeros(len(listed().names) - 1)]))
    assert known.names[0].startswith("aerodynamics.")
    for share in (0.05, 1.0, 4.0):
        found = known.as_accurate(share)
        assert found.sigma[0] == pytest.approx(np.hypot(share * 0.5, 0.03))
        np.testing.assert_array_equal(found.sigma[1:], known.sigma[1:])


def test_a_missing_term_is_found_by_its_evidence() -> None:
    """Its gain is the difference of two full evidences, of one with it at large and one with it
    negligible, averaged over terms and accuracies."""
    terms = unlisted_terms(())[:2]
    names = unlisted.names(terms)
    every = listed().with_more(names)
    random = np.random.default_rng(4)
    columns = random.standard_normal((200, every.parameters))
    wide = columns @ np.concatenate([np.eye(every.parameters), every.directions], axis=1)
    hidden = every.names.index(f"missing.CZ.{'*'.join(terms[1])}")
    left = 0.8 * columns[:, hidden] + random.standard_normal(200)
    data, sigma = information(wide, left), np.full(len(names), 0.7)
    best = unlisted.strongest(data, data.weighed(0.0), every, terms, sigma)
    assert best is not None
    assert (best.coefficient, best.variables) == ("CZ", terms[1])
    assert best.value == pytest.approx(0.8, abs=4.0 * best.deviation)
    places = every.names.index(names[0]) + np.arange(len(names))

    def evidence(place: int, share: float, size: float) -> float:
        freed = every.as_accurate(share).sigma.copy()
        freed[place] = size
        return posterior(data, freed).log_evidence

    def having(place: int, share: float) -> float:
        small = 0.7 * NEGLIGIBLE / SIZE
        nothing, negligible, large = (evidence(place, share, size) for size in (0.0, small, 0.7))
        return large - negligible + nothing + np.log(ACCURACIES[share])

    each = [[having(place, share) for share in ACCURACIES] for place in places]
    nothing = [evidence(places[0], share, 0.0) + np.log(ACCURACIES[share]) for share in ACCURACIES]
    expected = logsumexp(each) - np.log(len(names)) - logsumexp(nothing)
    assert best.log_bayes_factor == pytest.approx(expected, rel=1e-9)
    accurate = every.as_accurate(best.accuracy).sigma
    freed = accurate.copy()
    freed[hidden] = 0.7
    for seed in range(6):
        elsewhere = information(wide, np.random.default_rng(seed).standard_normal(200))
        kept = unlisted.strongest(data, elsewhere, every, terms, sigma)
        alone = posterior(elsewhere, freed).log_evidence
        alone -= posterior(elsewhere, accurate).log_evidence
        assert (kept is None) == (alone <= 0.0)


@pytest.mark.parametrize(("share", "named"), [(0.02, False), (0.15, True)])
def test_a_term_is_missing_where_it_matters_however_well_it_is_seen(
    share: float, named: bool
) -> None:
    """Of that at six deviations two flights were accused: a side force with the angle of attack.

    It was not there; gusts whose field lies a little otherwise do that.
    """
    terms = unlisted_terms(())
    names = unlisted.names(terms)
    every = listed().with_more(names)
    random = np.random.default_rng(5)
    # A term that moves its coefficient by all its spread has the size 1.
    columns = random.standard_normal((400, every.parameters)) / 0.05
    wide = columns @ np.concatenate([np.eye(every.parameters), every.directions], axis=1)
    hidden = every.names.index(names[7])
    left = share * columns[:, hidden] + random.standard_normal(400)
    data, sigma = information(wide, left), np.full(len(names), SIZE)
    found = unlisted.strongest(data, data.weighed(0.0), every, terms, sigma)
    assert found is not None
    assert (found.log_bayes_factor > NAMED) == named
    if named:
        assert f"missing.{found.coefficient}.{found.key}" == names[7]


def test_what_a_cause_explains_as_well_is_not_called_unlisted() -> None:
    ranked = rank(told({"cg.x": -0.1}), listed(), EVERY)
    best = ranked[0]
    found = MissingTerm("Cm", ("beta",), best.log_bayes_factor, 0.1, 0.01, 0.2, best.accuracy)
    both, probability = unlisted.weighed(ranked, found)
    assert sum(one.probability for one in both) + probability == pytest.approx(1.0)
    odds = PRIOR_OF_UNLISTED / ranked[0].prior
    assert probability / both[0].probability == pytest.approx(odds)
    surer = replace(found, log_bayes_factor=found.log_bayes_factor + 20.0)
    assert unlisted.weighed(ranked, surer)[1] > 0.99
    assert unlisted.weighed(ranked, None) == (ranked, 0.0)
    # What took no part speaks against it by ten nats: odds fall by as much.
    less = unlisted.weighed(ranked, found, -10.0)[1]
    odds = [share / (1.0 - share) for share in (probability, less)]
    assert odds[1] / odds[0] == pytest.approx(np.exp(-10.0))


def test_the_most_extreme_size_is_told_in_its_own_causes_sigmas() -> None:
    every = listed()
    values = np.zeros(len(every.names))
    values[every.names.index("mass")], values[every.names.index("cg.x")] = 0.25, -0.32
    mass, cg, _ = EVERY
    assert every.farthest((), values) == 0.0
    assert every.farthest((mass,), values) == pytest.approx(0.25 / mass.cause.parameters[0].sigma)
    both = every.farthest((mass, cg), values)
    assert both == pytest.approx(0.32 / cg.cause.parameters[0].sigma)


def test_a_lag_is_known_by_what_more_of_it_does() -> None:
    """What a lag does saturates. By all that it does it would seem known three times as well, and
    half as far from where it was taken as it is.
    """
    size, true = 0.1, 0.11
    shape = np.array([3.0, 1.0, -2.0]) * 30.0

    def does(lag: float) -> np.ndarray:
        return shape * (1.0 - np.exp(-lag / 0.05))

    quantities = {
        "lag.elevator": {"departures.actuators.0": 1.0},
        "more.lag.elevator": {"departures.actuators.1": 11.0, "departures.actuators.0": -10.0},
    }
    names = tuple(f"departures.actuators.{number}" for number in range(2))
    every = of_flights(
        *(names, np.zeros(2), quantities),
        *({"lag.elevator": 1e-3, "more.lag.elevator": 0.0}, {"": 1.0}, 1, np.zeros(2)),
    )
    secants = np.stack([does(at) / at for at in (size, 1.1 * size)], axis=1)
    # Told about 0, where what flights leave is all that the lag does.
    rows = secants @ np.concatenate([np.eye(2), every.directions], axis=1)
    data = information(rows, does(true))
    cause = [Candidate(CAUSES["actuator_lag"], "elevator")]
    place = every.names.index("lag.elevator")
    plain, acting = (
        replace(every, acting=sizes).estimated(data, cause)
        for sizes in ({}, {"lag.elevator": size})
    )
    assert plain.mean[place] == pytest.approx(
        size * (1.0 - np.exp(-2.2)) / (1.0 - np.exp(-2.0)), rel=0.01
    )
    assert acting.mean[place] == pytest.approx(true, abs=0.001)
    slope = np.linalg.norm(does(1.1 * size) - does(size)) / (0.1 * size)
    assert np.sqrt(acting.covariance[place, place]) == pytest.approx(1.0 / slope, rel=1e-3)
    assert acting.covariance[place, place] > 4.0 * plain.covariance[place, place]
    # What does nothing further stays where it was, and evidence is that of all the lag does.
    assert acting.mean[every.names.index("more.lag.elevator")] == 0.0
    assert acting.log_evidence == plain.log_evidence
