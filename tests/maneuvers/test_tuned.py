"""A multisine made for what is not known, beside the ordinary ones in the same limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.maneuvers import axes, design, envelope, flown, information, recipes, sizes, tuned
from gcs_sysid.maneuvers import target as targets
from gcs_sysid.maneuvers.design import Condition, Maneuver
from gcs_sysid.maneuvers.flown import LANES, LEAD, STEP, Flown, Simulator
from gcs_sysid.maneuvers.knowledge import Added
from gcs_sysid.maneuvers.recipes import Recipe
from gcs_sysid.maneuvers.target import Target
from gcs_sysid.maneuvers.tuned import Lines
from gcs_sysid.model import trim
from tests.maneuvers.made_model import aircraft, model, white

ALL = ("Cl", "Cm", "Cn")
BUDGET = 120.0
VARIANCE = 1e-4


@pytest.fixture(scope="module", params=["by the filter", "by least squares"])
def at(request: pytest.FixtureRequest) -> Condition:
    made, generator = aircraft(), np.random.default_rng(0)
    level = trim.find(made, 22.0, 100.0, 1.2)
    drawn = flown.draws(made, model(), generator, LANES * design.TRIALS)
    heard = white(VARIANCE) if request.param == "by the filter" else None
    return design.condition(
        *(made, model(), Simulator(made), drawn, level),
        **{"gust": 0.5, "generator": generator, "heard": heard},
    )


@pytest.fixture(scope="module")
def lines(at: Condition) -> Lines:
    return tuned._over(tuned.probed(at), tuned._room(at))


@pytest.fixture(scope="module")
def recipe(at: Condition) -> Recipe:
    return made(at, targets.derivatives(model(), ALL))


def made(at: Condition, target: Target) -> Recipe:
    start = information.nothing(model(), at.heard)
    found = tuned.recipe(at, tuned.probed(at), target, start, BUDGET)
    assert found is not None
    return found


def test_it_is_worth_more_than_any_ordinary_multisine(at: Condition, recipe: Recipe) -> None:
    """Each as large as is safe, all aircraft in the same gusts."""
    target, start = targets.derivatives(model(), ALL), information.nothing(model(), at.heard)

    def worth(one: Recipe) -> float:
        flight = design.sized(at, one)
        assert isinstance(flight, Maneuver), one.name
        return target.worth(model(), start, flight.taught)

    ordinary = [
        one
        for one in recipes.every(at.place())
        if one.kind == "multisine" and one.duration == recipes.PERIOD
    ]
    assert len(ordinary) >= 5
    assert worth(recipe) > 1.05 * max(worth(one) for one in ordinary)


def test_it_begins_and_ends_at_rest_within_what_inputs_may_use(
    at: Condition, recipe: Recipe
) -> None:
    np.testing.assert_allclose(recipe.added[[0, -1]], 0.0, atol=1e-12)
    assert recipe.duration + design.AFTER <= design.LONGEST
    for name, column in zip(at.place().names, recipe.added.T, strict=True):
        throttle = name == axes.THROTTLE
        most = sizes.POWER if throttle else sizes.TRAVEL * axes.travel(at.aircraft, name)
        assert np.abs(column).max() <= 1.01 * most
        assert (np.abs(column).max() > 0.0) == (name in recipe.moved)


def used(at: Condition, flight: Flown, share: float) -> dict[str, float]:
    """Of the room of each limit, by the mean aircraft of a flight at a share of full size."""
    found = {}
    for name, limit in envelope.limits(at.allowed).items():
        if name == "height":
            continue
        still, values = getattr(at.still, name), getattr(flight, name)[0]
        low, high = limit.low + limit.room, limit.high - limit.room
        room = min((high - still).min(), (still - low).min())
        found[name] = float(np.abs(values - values[0]).max() / (share * room))
    return found


def test_a_first_design_uses_limits_as_far_as_linear_answers_say(
    at: Condition, lines: Lines
) -> None:
    """Flown small by the mean aircraft in calm air: the largest share of a limit is the peak."""
    target, start = targets.derivatives(model(), ALL), information.nothing(model(), at.heard)
    first, share = tuned.designed(at, lines, target, start, 3.0), 0.05
    assert first is not None
    recipe = first.recipe
    air = np.zeros((LANES, LEAD + recipe.added.shape[0], 6))
    path = at.simulator.fly(at.fleet, at.linear, at.trim.density, share * recipe.added, air)
    inputs = [
        np.abs(recipe.added[:, place]).max() / (sizes.TRAVEL * axes.travel(at.aircraft, name))
        for place, name in enumerate(at.aircraft.control_names)
    ]
    # The fading in and the first answers are not those of the settled motion.
    assert max(*used(at, path, share).values(), *inputs) == pytest.approx(1.0, abs=0.2)


def test_a_limit_that_large_motions_break_gets_less_room(at: Condition) -> None:
    """What each limit allows by itself, and a design that is at least as good as the first."""
    target, start = targets.derivatives(model(), ALL), information.nothing(model(), at.heard)
    tight = replace(at, allowed=replace(at.allowed, load_factor=(0.4, 1.6)))
    over = tuned._over(tuned.probed(tight), tuned._room(tight))
    first = tuned.designed(tight, over, target, start, BUDGET / 33.0)
    assert first is not None
    allowed = tuned.inside(tight, first.recipe)
    assert allowed["load_factor"] < 1.0
    assert allowed["airspeed"] == 1.0

    def worth(recipe: Recipe) -> float:
        one = design.sized(tight, recipe)
        assert isinstance(one, Maneuver)
        return target.worth(model(), start, one.taught)

    # Shares are of a grid of 6 %, and lines add up in small motions only.
    assert worth(made(tight, target)) > 0.97 * worth(first.recipe)


def test_a_question_about_pitch_leaves_the_rudder_alone(at: Condition) -> None:
    recipe = made(at, targets.derivative(model(), "Cm", "qhat"))
    assert "elevator" in recipe.moved
    assert "rudder" not in recipe.moved
    assert "Cm" in recipe.coefficients


def test_it_moves_nothing_but_what_it_may(at: Condition, lines: Lines) -> None:
    target, start = targets.derivatives(model(), ALL), information.nothing(model(), at.heard)
    found = tuned.recipe(at, tuned.probed(at).on(("elevator",)), target, start, BUDGET)
    assert found is not None
    assert found.moved == ("elevator",)
    assert set(lines.on(("elevator",)).inputs) == {"elevator"}
    assert (
        tuned.recipe(at, lines.on(("elevator",)), targets.derivatives(model(), ()), start, BUDGET)
        is None
    )


def test_no_powers_nearby_are_worth_more(at: Condition, lines: Lines) -> None:
    """Any two lines trade power within the limits: the optimum of a concave worth is one."""
    target, start = targets.derivatives(model(), ALL), information.nothing(model(), at.heard)
    runs = 3.0
    powers = tuned.best(lines, target, at, start, runs)
    taken = (np.abs(lines.answers) ** 2).max(axis=0).T

    def worth(power: np.ndarray) -> float:
        most = float(np.sum((power @ taken) ** tuned.NORM) ** (1.0 / tuned.NORM))
        added = [runs * np.einsum("l,lij->ij", power / most, told) for told in lines.told]
        return float(np.mean([target.worth(model(), start, Added(one, 0.0)) for one in added]))

    best, generator = worth(powers), np.random.default_rng(0)
    even = 1.0 / taken.max(axis=1)
    assert best > worth(even) + 0.1
    for _ in range(50):
        other = powers * np.exp(0.3 * generator.standard_normal(powers.size))
        other += generator.uniform(0.0, 0.02) * even
        assert worth(other) < best + 0.02  # lines that bring a hundredth are left out


def test_lines_tell_what_a_flight_of_them_all_tells(at: Condition) -> None:
    """A motion that repeats itself, Cl's terms without a mean: the sum over its harmonics."""
    generator, count = np.random.default_rng(1), 750
    time = STEP * np.arange(count)
    names = ("alpha", "beta", "phat", "qhat", "rhat", *aircraft().control_names)
    values = {}
    for name in (*names, "alphadot_hat", *(f"{one}_rate" for one in aircraft().control_names)):
        harmonics = generator.choice(np.arange(2, 40), 5, replace=False)
        phases = generator.uniform(0.0, 2.0 * np.pi, 5)
        waves = np.sin(2.0 * np.pi * np.outer(time / 15.0, harmonics) + phases)
        values[name] = 0.05 * waves.sum(axis=1)
    every = information.by_line(model(), values, STEP, at.heard, np.arange(1, count // 2))
    whole = information.told(model(), values, STEP, at.heard, 0.0).information
    place = information.places(model())[0]["Cl"]
    np.testing.assert_allclose(
        every.sum(axis=0)[place, place], whole[place, place], rtol=1e-6, atol=1e-6 * whole.max()
    )


def test_answers_of_a_probe_are_those_of_the_motion(at: Condition, lines: Lines) -> None:
    """A sine on the elevator alone: load factor in time, by its line, over its room."""
    place = next(
        one
        for one, (name, harmonic) in enumerate(zip(lines.inputs, lines.harmonics, strict=True))
        if name == "elevator" and harmonic == 10
    )
    added = np.zeros((3 * 750, 4))
    added[:, 1] = 0.002 * np.sin(2.0 * np.pi * 10 * STEP * np.arange(added.shape[0]) / 15.0)
    path: Flown = at.simulator.fly(
        at.fleet, at.linear, at.trim.density, added, np.zeros((LANES, LEAD + added.shape[0], 6))
    )
    load = path.load_factor[0, -750:]
    limit = envelope.limits(at.allowed)["load_factor"]
    still = at.still.load_factor
    room = min((limit.high - limit.room - still).min(), (still - limit.low - limit.room).min())
    which = list(envelope.limits(at.allowed)).index("load_factor")
    time = STEP * np.arange(750)
    turned = 0.002 * lines.answers[0, which, place] * np.exp(2j * np.pi * 10 * time / 15.0)
    expected = room * turned.imag
    np.testing.assert_allclose(load - load.mean(), expected, atol=0.05 * expected.max())
