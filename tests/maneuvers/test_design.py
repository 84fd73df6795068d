"""Level flight, drawn aircraft, recipes and safe amplitudes of a made-up aircraft."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import linalg

from gcs_sysid.aircraft import Value
from gcs_sysid.errors import UsageError
from gcs_sysid.estimate import basis
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.estimate.suspects import file_sigmas, suspects
from gcs_sysid.maneuvers import (
    axes,
    design,
    flown,
    holding,
    information,
    recipes,
    separation,
    sizes,
    sortie,
)
from gcs_sysid.maneuvers import target as targets
from gcs_sysid.maneuvers.design import Condition, Maneuver, Refusal
from gcs_sysid.maneuvers.flown import LANES, STEP, Flown, Simulator
from gcs_sysid.maneuvers.knowledge import Added
from gcs_sysid.maneuvers.separation import Pair
from gcs_sysid.model import rigid_body, trim
from tests.maneuvers.made_model import aircraft, model, white


@pytest.fixture(scope="module")
def at() -> Condition:
    made, generator = aircraft(), np.random.default_rng(0)
    level = trim.find(made, 22.0, 100.0, 1.2)
    drawn = flown.draws(made, model(), generator, LANES * design.TRIALS)
    return design.condition(
        made, model(), Simulator(made), drawn, level, gust=0.5, generator=generator
    )


@pytest.fixture(scope="module")
def planned(at) -> dict[str, Maneuver | Refusal]:
    wanted = {"elevator_multisine", "elevator_doublet", "aileron_rudder_multisine", "wind_up_turn"}
    return {
        recipe.name: design.sized(at, recipe)
        for recipe in recipes.every(at.place())
        if recipe.name in wanted
    }


def pulses(at: Condition, seconds: float) -> np.ndarray:
    return np.zeros((round(seconds / STEP) + 1, len(at.aircraft.controls) + 1))


def flies(at: Condition, added: np.ndarray, air: np.ndarray) -> Flown:
    return at.simulator.fly(at.fleet, at.linear, at.trim.density, added, air)


def test_trim_is_level_and_still(at) -> None:
    given = trim.inputs(
        at.aircraft, jnp.asarray(at.trim.controls), jnp.asarray(at.trim.settings), at.trim.density
    )
    change = rigid_body.derivative(
        at.aircraft, rigid_body.parameters(at.aircraft), at.trim.state, given
    )
    np.testing.assert_allclose(change.velocity, 0.0, atol=1e-3)
    np.testing.assert_allclose(change.rate, 0.0, atol=1e-3)
    assert abs(float(at.trim.state.velocity[2])) < 1e-9
    assert float(jnp.linalg.norm(at.trim.state.velocity)) == pytest.approx(22.0)


def test_an_airspeed_that_the_thrust_does_not_reach_is_refused() -> None:
    with pytest.raises(UsageError, match="cannot fly level at 70 m/s"):
        trim.find(aircraft(), 70.0, 100.0, 1.2)


def test_the_short_period_is_that_of_the_two_state_approximation(at) -> None:
    """ω² ≈ Z_w M_q − U M_w (Stevens, Lewis & Johnson 2015, section 4.2), Z_w and M_w by hand."""
    speed, pressure, area = 22.0, 0.5 * 1.2 * 22.0**2, 0.55
    lift = -5.0 * pressure * area / (11.0 * speed)
    chord = at.aircraft.geometry.mean_chord
    stiffness = -1.5 * pressure * area * chord / 1.135
    damping = -30.0 * pressure * area * chord / 1.135 * chord / (2.0 * speed)
    expected = np.sqrt(lift * damping - stiffness)
    assert at.linear.natural_frequency(lateral=False) == pytest.approx(expected, rel=0.05)
    assert at.linear.frequencies().pitch == pytest.approx(expected, rel=0.05)


def test_the_roll_mode_is_the_damping_in_roll(at) -> None:
    """1/τ ≈ −L_p = q̄ S b²/(2 V Ixx) · 0.5."""
    span = at.aircraft.geometry.wing_span
    expected = 0.5 * 0.5 * 1.2 * 22.0**2 * 0.55 * span / 0.824 * span / (2.0 * 22.0)
    assert at.linear.frequencies().roll == pytest.approx(expected, rel=0.1)


def test_the_attitude_hold_has_the_bandwidth_that_servos_allow(at) -> None:
    fast = holding.RATE / (holding.lag(at.aircraft) + holding.PERIOD)
    effect = at.linear.inputs[3:6, :3] @ at.linear.gain
    assert effect[0, 3] == pytest.approx(fast)
    assert effect[1, 4] == pytest.approx(fast)
    assert np.linalg.eigvals(at.linear.held).real.max() < 0.0


def test_what_was_learned_beyond_the_terms_acts_as_a_term_would(at) -> None:
    """It is held for a step: the motion is that of the same effect written as a term."""
    lift = -1.5
    term = replace(
        aircraft().aerodynamics["CZ"],
        terms={**aircraft().aerodynamics["CZ"].terms, "alpha^2": Value(20.0 * lift, 0.0)},
    )

    def learned(flow: Mapping[str, jax.Array]) -> jax.Array:
        none = jnp.zeros_like(flow["alpha"])
        found = 20.0 * lift * flow["alpha"] ** 2
        return jnp.stack([none, none, found, none, none, none], axis=-1)

    written = replace(aircraft(), aerodynamics={**aircraft().aerodynamics, "CZ": term})
    moved = pulses(at, 6.0)
    moved[:, 1] = 0.06 * np.sin(2.0 * np.pi * 1.2 * STEP * np.arange(moved.shape[0]))
    flights = []
    for one in (written, replace(aircraft(), beyond=jax.tree_util.Partial(learned)), aircraft()):
        level = trim.find(one, 22.0, 100.0, 1.2)
        simulator = Simulator(one)
        drawn = flown.draws(one, AeroModel({}, ()), np.random.default_rng(0), LANES)
        fleet = simulator.settle(drawn, level)
        air = np.zeros((LANES, moved.shape[0] + flown.LEAD, 6))
        found = simulator.fly(fleet, holding.linearised(at.aircraft, level), 1.2, moved, air)
        flights.append(found.load_factor[0])
    wanted, held, without = flights
    assert np.std(without - wanted) > 0.05 * np.std(wanted)
    # Half a step late: 10 ms of 1.2 Hz are 0.075 of it.
    assert np.std(held - wanted) < 0.1 * np.std(without - wanted)


def test_drawn_aircraft_fly_level_each_with_its_own_controls(at) -> None:
    air = np.zeros((LANES, 300, 6))
    still = flies(at, pulses(at, 4.0)[:200], air)
    assert np.ptp(still.alpha, axis=1).max() < 1e-3
    assert np.abs(still.airspeed - 22.0).max() < 0.05
    assert np.asarray(at.fleet.controls)[:, 1].std() > 1e-4


def test_small_motions_are_those_of_the_linear_model(at) -> None:
    """A second implementation: the matrix exponential of the linear model with ideal servos."""
    added = pulses(at, 2.0)
    added[10:35, 1] = 0.004
    expected = sizes.motion(at.linear, added)
    path = flies(at, added, np.zeros((LANES, 300, 6)))
    turned = expected[:, 2] / 22.0
    found = path.alpha[0] - path.alpha[0, 0]
    # The servos lag by 0.06 s, which the linear model leaves out.
    later = np.interp(np.arange(found.size) * STEP - 0.06, np.arange(found.size) * STEP, turned)
    assert np.abs(found - later).max() < 0.12 * np.abs(turned).max()
    block = linalg.expm(at.linear.held * STEP)
    assert np.abs(np.linalg.eigvals(block)).max() < 1.0


def test_heading_is_held_in_a_maneuver_and_not_in_a_turn(at) -> None:
    """Rudder to one side for a while: on a leg the aircraft comes back to its heading."""
    added = pulses(at, 8.0)
    added[10:60, 2] = 0.05
    calm = np.zeros((LANES, 600, 6))
    turned = {
        name: np.trapezoid(
            at.simulator.fly(at.fleet, linear, at.trim.density, added, calm).rate[0, :, 2], dx=STEP
        )
        for name, linear in (("held", at.linear), ("free", at.linear.turning()))
    }
    assert abs(turned["free"]) > 0.02
    assert abs(turned["held"]) < 0.3 * abs(turned["free"])


def test_pulses_go_further_where_the_autopilot_integrates(at) -> None:
    """The integral winds up against the first pulse and adds to the one after it."""
    added = pulses(at, 3.0)
    added[10:60, 1], added[60:85, 1] = 0.04, -0.04
    load = flies(at, added, np.zeros((LANES, 300, 6))).load_factor
    first, second = load[:, 10:60], load[:, 60:100]
    without, integrating = (flown.INTEGRATING == kind for kind in (0.0, 1.0))
    down, up = (np.abs(part - 1.0).max(axis=1) for part in (first, second))
    assert np.median(up[integrating]) > 1.1 * np.median(up[without])
    assert np.median(down[integrating]) < np.median(down[without])


def test_a_servo_is_late_and_slow(at) -> None:
    """δ(t) = u (1 − e^(−(t − delay)/τ))."""
    added = pulses(at, 1.0)
    added[:, 0] = 0.05
    path = flies(at, added, np.zeros((LANES, 300, 6)))
    step = path.controls[0, :, 0] - path.controls[0, 0, 0]
    time = STEP * np.arange(step.size)
    first = 0.05 * (1.0 - np.exp(-(time - 0.02) / 0.04))
    np.testing.assert_allclose(step[1:4], np.maximum(first[1:4], 0.0), rtol=0.1, atol=1e-9)


def test_gusts_are_felt_as_wind_and_rotation(at) -> None:
    air = np.zeros((LANES, 300, 6))
    air[:, flown.LEAD :, 2] = -1.0
    path = flies(at, pulses(at, 0.1), air)
    calm = flies(at, pulses(at, 0.1), 0.0 * air)
    # Rising air: 1 m/s at 22 m/s is 2.6 degrees of angle of attack, and more lift at once.
    assert path.alpha[0, 0] - calm.alpha[0, 0] == pytest.approx(1.0 / 22.0, rel=0.02)
    assert path.load_factor[0, 0] > calm.load_factor[0, 0] + 0.3
    air[:, :, 2], air[:, flown.LEAD :, 3] = 0.0, 0.2
    assert flies(at, pulses(at, 0.1), air).rate[0, 0, 0] == pytest.approx(-0.2)


def test_every_maneuver_of_the_list_is_made_and_begins_and_ends_at_zero(at) -> None:
    made = list(recipes.every(at.place()))
    assert {recipe.kind for recipe in made} == set(recipes.KINDS)
    assert len({recipe.name for recipe in made}) == len(made)
    for recipe in made:
        np.testing.assert_allclose(recipe.added[0], 0.0, atol=1e-9, err_msg=recipe.name)
        limit = 1e-9 * np.abs(recipe.added).max()
        assert np.abs(recipe.added[-1]).max() <= limit, recipe.name
        assert recipe.duration <= STEP * (recipe.added.shape[0] - 1) + 1e-9
        assert recipe.duration > STEP * (recipe.added.shape[0] - 2)
        assert recipe.duration + design.AFTER <= design.LONGEST


def test_inputs_that_are_flown_together_share_no_line(at) -> None:
    recipe = next(
        item for item in recipes.every(at.place()) if item.name == "all_and_throttle_multisine"
    )
    used = recipe.added[:-1, np.abs(recipe.added).max(axis=0) > 0.0]
    assert used.shape[1] == 4
    np.testing.assert_allclose(np.corrcoef(used.T), np.eye(4), atol=1e-6)


@pytest.mark.parametrize("slow", [("elevator", "aileron", "rudder"), ("rudder",)])
def test_no_line_is_faster_than_a_slow_servo_follows(at, slow: tuple[str, ...]) -> None:
    """Half a second follows up to 0.32 Hz; lines up to 0.8 Hz had been put on it."""
    servos = tuple(
        replace(one, time_constant=0.5) if one.surface in slow else one
        for one in at.aircraft.servos
    )
    place = replace(at.place(), aircraft=replace(at.aircraft, servos=servos))
    followed = 1.0 / (2.0 * np.pi * 0.5)
    seen = 0
    for recipe in recipes.every(place):
        if recipe.kind not in ("multisine", "sweep"):
            continue
        for name in set(recipe.moved) & set(slow):
            assert place.last(name) <= followed
            if recipe.kind == "sweep":
                assert recipe.fastest <= followed
                continue
            used = recipe.added[:-1, place.names.index(name)]
            lines = np.abs(np.fft.rfft(used))
            fastest = np.flatnonzero(lines > 1e-6 * lines.max()).max()
            assert fastest / recipes.PERIOD <= followed, recipe.name
            seen += 1
    assert seen >= 2 * len(slow)


def test_a_share_is_as_large_as_is_safe(at, planned) -> None:
    for name, item in planned.items():
        assert isinstance(item, Maneuver), name
        assert item.share > design.LEAST
        low, high = at.allowed.alpha
        assert low < item.flown.alpha.min() < item.flown.alpha.max() < high
    # Where it is not full size, a larger share would leave.
    item = planned["aileron_rudder_multisine"]
    if item.share < 1.0:
        larger = at.fly(at.fleet, item.recipe, 1.3 * item.share, at.air)
        assert design._lost(larger, at).any()


def test_a_proof_takes_five_hundred_flights(at, planned) -> None:
    found = design.proved(at, planned["elevator_doublet"], np.random.default_rng(1))
    assert isinstance(found, Maneuver)
    assert found.excursion.flights == LANES * design.TRIALS
    assert found.excursion.violation_probability <= 0.01
    assert found.share <= planned["elevator_doublet"].share


def test_what_cannot_be_safe_is_refused_with_the_limit(at) -> None:
    tight = replace(at, allowed=replace(at.allowed, load_factor=(0.9, 1.1)))
    assert design.unsafe_level_flight(tight) == "load_factor"
    assert design.unsafe_level_flight(at) is None
    none = replace(at, allowed=replace(at.allowed, airspeed=(21.0, 60.0)))
    one = design.sized(none, next(iter(recipes.every(at.place()))))
    assert isinstance(one, Refusal)
    assert "airspeed" in one.reason


def test_an_input_teaches_what_it_moves(at, planned) -> None:
    before = information.nothing(model())
    pitch = planned["elevator_multisine"].gains(model(), before)
    assert pitch["Cm"].after < 0.7 * pitch["Cm"].before
    turns = planned["aileron_rudder_multisine"].gains(model(), before)
    roll = turns["Cl"].derivatives["phat"]
    beside = pitch["Cl"].derivatives["phat"]
    assert roll[0] - roll[1] > 20.0 * (beside[0] - beside[1])
    control = turns["Cl"].derivatives["aileron"]
    assert control[1] < 0.9 * control[0]
    beta = pitch["Cn"].derivatives["beta"]
    assert beta[1] > 0.98 * beta[0]


def test_a_sortie_takes_what_is_worth_most_and_stops(at, planned) -> None:
    before = {name: fit.covariance for name, fit in model().fits.items()}
    known = targets.derivatives(model(), ("Cl", "Cm", "Cn"))
    items = list(planned.values())
    start = information.nothing(model())
    ranked = sortie.ranked(known, model(), start, items)
    plan = sortie.planned(known, model(), start, items, budget=300.0)
    assert plan.steps[0].maneuver is ranked[0][1]
    assert plan.duration <= 300.0
    worth = [step.worth / sortie.cost(step.maneuver) for step in plan.steps]
    assert worth == sorted(worth, reverse=True)
    assert [step.leg for step in plan.steps[:4]] == [1, 1, 2, 2]
    assert {step.direction for step in plan.steps} == {"out", "back"}
    for name, later in plan.after.items():
        assert np.all(np.diagonal(later) <= np.diagonal(before[name]) * (1.0 + 1e-9))
    sure = model(relative=1e-6)
    assert sortie.planned(known, sure, information.nothing(sure), items, budget=300.0).steps == ()


def test_nothing_is_flown_for_what_only_an_inertia_leaves_unsure(planned) -> None:
    """Cm known but for its inertia: what is flown is for the rolling and yawing moments alone."""
    fits = dict(model().fits)
    exact = model(relative=1e-3).fits["Cm"]
    fits["Cm"] = replace(
        exact,
        covariance=exact.covariance + np.outer(0.1 * exact.value, 0.1 * exact.value),
        deviations={**exact.deviations, "scale": 0.1 * np.abs(exact.value)},
    )
    unsure = AeroModel(fits, model().controls)
    known = targets.derivatives(unsure, ("Cl", "Cm", "Cn"))
    plan = sortie.planned(
        known, unsure, information.nothing(unsure), list(planned.values()), budget=300.0
    )
    assert {step.maneuver.recipe.name for step in plan.steps} == {"aileron_rudder_multisine"}


def test_what_half_of_the_aircraft_learn_nothing_from_is_not_flown_first(planned) -> None:
    """Two maneuvers that teach the same in the mean over the aircraft drawn."""
    steady = planned["elevator_doublet"]
    mean, draws = steady.taught, len(steady.each)
    assert draws == design.CALM == 8
    steady = replace(steady, each=(mean,) * draws)
    risky = replace(
        steady,
        each=tuple(
            Added(2.0 * (draw % 2) * mean.information, mean.samples) for draw in range(draws)
        ),
    )
    known, start = targets.derivatives(model(), ("Cm",)), information.nothing(model())
    worth = [known.worth(model(), start, item.taught) for item in (risky, steady)]
    assert worth[0] == pytest.approx(worth[1])
    plan = sortie.planned(known, model(), start, [risky, steady], budget=60.0)
    assert plan.steps[0].maneuver is steady


def test_a_poor_model_is_tried_at_small_amplitude_first(at, planned) -> None:
    loose = model(relative=0.3)
    assert sortie.poor(loose)
    assert not sortie.poor(model())
    fit = model().fits["Cm"]
    scale = 0.3 * np.abs(fit.value)
    heavy = replace(
        fit,
        covariance=fit.covariance + np.outer(*2 * [np.sign(fit.value) * scale]),
        deviations={**fit.deviations, "scale": scale},
    )
    assert not sortie.poor(AeroModel({**model().fits, "Cm": heavy}, model().controls))
    # Nor one derivative that hardly acts.
    yaw = model().fits["Cn"]
    part = np.where([key == "phat" for key in yaw.keys], 0.3, 0.05)
    faint = replace(
        yaw,
        covariance=np.diag((part * yaw.value) ** 2),
        excitation=np.where(part > 0.1, 0.2, 1.0),
    )
    assert not sortie.poor(AeroModel({**model().fits, "Cn": faint}, model().controls))
    acting = replace(faint, excitation=np.ones(part.size))
    assert sortie.poor(AeroModel({**model().fits, "Cn": acting}, model().controls))
    known = targets.derivatives(loose, ("Cm",))
    items = [planned["elevator_multisine"]]
    plan = sortie.planned(known, loose, information.nothing(loose), items, budget=300.0)
    assert [step.share for step in plan.steps][:3] == [0.25, 0.5, 1.0]


def test_controls_are_those_that_do_most() -> None:
    made = aircraft()
    assert axes.strongest(made, model(), "Cm") == "elevator"
    assert axes.found(made, model()) == axes.Axes("elevator", "aileron", "rudder")
    assert axes.found(made, model()).every == ("elevator", "aileron", "rudder")
    assert axes.travel(made, "elevator") == pytest.approx(0.5)


def test_the_maneuver_for_two_causes_tells_most_of_their_difference(at, planned) -> None:
    """Among all that were flown, by λ before and after each for its flight time."""
    which = {one.label: one.moves for one in suspects(at.aircraft)}
    names = ("surface_effectiveness elevator", "inertia Iyy")
    pair = Pair(which[names[0]], which[names[1]], file_sigmas(at.aircraft))
    asked = separation.separation(model(), " or ".join(names), pair)
    start, items = information.nothing(model()), list(planned.values())

    def told(item: Maneuver) -> float:
        before = separation.apart(model(), start, pair)
        after = [separation.apart(model(), start.with_more(one), pair) for one in item.each]
        return float(np.mean(0.5 * np.log(np.array(after) / before))) / sortie.cost(item)

    plan = sortie.planned(asked, model(), start, items, budget=60.0)
    best = plan.steps[0].maneuver
    assert told(best) == max(told(item) for item in items) > 0.0
    assert "elevator" in best.recipe.name or best.recipe.name == "wind_up_turn"


def test_what_the_filter_hears_is_what_a_maneuver_teaches(at, planned) -> None:
    """Where rows count alike that is plain regression on the motion in calm air; level flight
    beside the maneuver counts as well."""
    item, variance = planned["elevator_doublet"], 1e-4
    heard = white(variance)
    again = design.sized(replace(at, heard=heard), item.recipe)
    assert isinstance(again, Maneuver)
    assert again.share == item.share
    known = information.nothing(model(), heard)
    fit = model().fits["Cm"]
    motion = flown.regressor_values(at.aircraft, at.trim.density, again.flown, 0)
    columns = basis.columns(fit.keys, model().controls, motion)
    beside = round(design.AROUND / STEP) * np.outer(columns[0], columns[0])
    expected = (columns.T @ columns + beside) / variance
    first = known.with_more(again.each[0]).of("Cm").information
    np.testing.assert_allclose(first, expected, rtol=1e-6, atol=1e-9 * expected.max())
    assert again.reach["Cm"].spread == pytest.approx(item.reach["Cm"].spread)
