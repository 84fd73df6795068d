"""Linear models against published ones, differences of the equations of motion, and draws."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from gcs_sysid.model import linear, rigid_body, trim
from gcs_sysid.model.linear import OUTPUTS, STATES, Linear, Linearisation
from tests.model.made_linear import AIRSPEED, DENSITY, HEIGHT, flying
from tests.sitl.published import CONTROLS, PUBLISHED, as_published, entries
from tests.sitl.published import STATES as PUBLISHED_STATES


@pytest.fixture(scope="module")
def made() -> tuple[Linearisation, Linear]:
    aircraft = flying()
    level = trim.find(aircraft, AIRSPEED, HEIGHT, DENSITY)
    found = Linearisation(aircraft)
    return found, found.at(level, linear.stated_covariance(aircraft))


def test_the_published_linear_model_of_the_ultra_stick() -> None:
    """Every entry that matters within 3 %: published with four digits, at a density not told.

    Its states are body velocities; with T = ∂(u, v, w)/∂(V, α, β), A_body = T A T⁻¹.
    """
    aircraft = as_published()
    level = trim.find(aircraft, 17.0, HEIGHT, DENSITY)
    found = Linearisation(aircraft).at(level, linear.stated_covariance(aircraft))

    def body(flow):
        speed, alpha, beta = flow
        return speed * jnp.stack(
            [jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)]
        )

    turn = np.eye(8)
    turn[:3, :3] = jax.jacobian(body)(jnp.asarray(found.mean.state[:3]))
    names = ["u", "v", "w", *list(STATES)[3:]]
    order = [names.index(name) for name in PUBLISHED_STATES]
    A = (turn @ found.mean.A @ np.linalg.inv(turn))[np.ix_(order, order)]
    inputs = [list(found.inputs).index(name) for name in CONTROLS]
    B = (turn @ found.mean.B)[np.ix_(order, inputs)]
    wanted = entries(np.array(PUBLISHED["A"]), np.array(PUBLISHED["B"]))
    assert len(wanted) > 20
    ours = np.hstack([A, B])
    columns = [*PUBLISHED_STATES, *CONTROLS]
    for (row, column), value in wanted.items():
        # u by q is -w less thrust and drag by pitching: the alpha-dot term is one of q here.
        within = 0.05 if (row, column) == ("u", "q") else 0.03
        entry = ours[PUBLISHED_STATES.index(row), columns.index(column)]
        assert entry == pytest.approx(value, rel=within), (row, column)


def test_the_matrices_are_differences_of_the_equations_of_motion(made) -> None:
    solver, found = made
    aircraft, mean = solver.aircraft, found.mean
    values = rigid_body.parameters(aircraft)

    @jax.jit
    def fast(motion, control):
        change, felt = linear.rate(
            aircraft, values, motion, control, jnp.asarray(HEIGHT), jnp.asarray(DENSITY)
        )
        return jnp.concatenate([change, motion, felt])

    step = 1e-5
    columns = []
    for place in range(8 + mean.B.shape[1]):
        above, below = (np.concatenate([mean.state, mean.control]) for _ in range(2))
        above[place] += step
        below[place] -= step
        columns.append((fast(above[:8], above[8:]) - fast(below[:8], below[8:])) / (2.0 * step))
    both = np.array(columns).T
    exact = np.block([[mean.A, mean.B], [mean.C, mean.D]])
    np.testing.assert_allclose(exact, both, rtol=1e-6, atol=1e-6)


def test_the_trim_is_still_and_the_state_flows_where_the_rigid_body_goes(made) -> None:
    """A second's free flight from a small disturbance: the matrix exponential against RK4."""
    solver, found = made
    aircraft, mean = solver.aircraft, found.mean
    values = rigid_body.parameters(aircraft)
    small = 1e-4 * np.array([10.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])

    def flown(start):
        def move(motion, _):
            def slope(at):
                return linear.rate(
                    aircraft,
                    values,
                    at,
                    jnp.asarray(mean.control),
                    jnp.asarray(HEIGHT),
                    jnp.asarray(DENSITY),
                )[0]

            one = slope(motion)
            two = slope(motion + 0.005 * one)
            three = slope(motion + 0.005 * two)
            four = slope(motion + 0.01 * three)
            return motion + 0.01 / 6.0 * (one + 2.0 * two + 2.0 * three + four), None

        return jax.lax.scan(move, start, None, length=100)[0]

    fly = jax.jit(flown)
    moved = np.asarray(fly(jnp.asarray(mean.state + small)) - fly(jnp.asarray(mean.state)))
    np.testing.assert_allclose(moved, expm(mean.A) @ small, atol=2e-3 * np.abs(small).max())


def test_deviations_to_first_order_are_those_of_draws(made) -> None:
    """400 aircraft drawn, each trimmed anew. A sample deviation of 400 scatters by 3.5 %."""
    solver, found = made
    spread = np.sqrt(np.diagonal(found.covariance))
    drawn = np.random.default_rng(1).standard_normal((400, spread.size)) * spread
    many = solver.drawn(found.trim, drawn)
    for name in ("A", "B", "C", "D", "state", "control"):
        first, sampled = getattr(found.deviation, name), getattr(many, name).std(axis=0)
        matters = first > 1e-3 * first.max()
        np.testing.assert_allclose(sampled[matters], first[matters], rtol=0.15, err_msg=name)


def test_only_derivatives_by_mass_are_seen_so_a_found_model_has_no_error_of_mass(made) -> None:
    solver, _ = made
    aircraft = solver.aircraft
    terms = {name: len(model.terms) for name, model in aircraft.aerodynamics.items()}
    found = {name: 0.01 * np.eye(count) for name, count in terms.items()}
    stated = linear.stated_covariance(aircraft)
    identified = linear.stated_covariance(aircraft, found)
    np.testing.assert_allclose(np.diagonal(stated)[-2:], [0.02**2, 0.1**2])
    np.testing.assert_allclose(np.diagonal(identified), [0.01] * sum(terms.values()) + [0.0, 0.0])


def test_outputs_are_the_states_and_the_load(made) -> None:
    """az by alpha is Z_α/m, by hand."""
    _, found = made
    np.testing.assert_array_equal(found.mean.C[:8], np.eye(8))
    force = 0.5 * DENSITY * AIRSPEED**2 * 0.55
    place = list(OUTPUTS).index("az"), list(STATES).index("alpha")
    assert found.mean.C[place] == pytest.approx(-5.0 * force / 11.0, rel=1e-8)
    assert found.mean.D[place[0], list(found.inputs).index("elevator")] == pytest.approx(
        -0.13 * force / 11.0
    )
    assert list(found.inputs.values()) == ["rad", "rad", "rad", "1"]


def test_at_a_breakpoint_of_the_thrust_table_intervals_stay_what_they_are_beside_it() -> None:
    """Rounding put some of the differenced models on the other side: a damping of 0.4 ± 44."""
    aircraft = flying()
    [engine] = aircraft.propulsion
    bent = replace(engine, airspeed=(10.0, AIRSPEED, 30.0), thrust=((0.0,) * 3, (40.0, 32.0, 20.0)))
    solver = Linearisation(replace(aircraft, propulsion=(bent,)))
    covariance = linear.stated_covariance(aircraft)
    at, beside = (
        solver.at(trim.find(solver.aircraft, speed, HEIGHT, DENSITY), covariance)
        for speed in (AIRSPEED, AIRSPEED + 0.01)
    )
    np.testing.assert_allclose(at.deviation.A[0], beside.deviation.A[0], rtol=0.01, atol=1e-6)
