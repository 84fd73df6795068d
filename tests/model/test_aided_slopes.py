"""Slopes of the aided filter's flight model against differences, with everything in it at once."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.model import aided, aided_linear
from gcs_sysid.model.aided import ROWS, Means, Noise, Row, State
from tests.model.made_aided import (
    FLYING,
    NOISE,
    VANED,
    WHOLE,
    departed,
    erring,
    means,
    row,
    state,
    whole_row,
    with_vanes,
)


def case(name: str) -> tuple[Aircraft, Means, Row]:
    """An aircraft, what is known of it, and a row of 20 ms."""
    if name == "all":
        return (
            WHOLE,
            means(WHOLE)._replace(sensors=erring(), departures=departed()),
            whole_row(0.02),
        )
    aircraft = VANED if name == "vanes" else FLYING
    known = means(aircraft)
    errors = known.sensors._replace(
        moment_lag=jnp.asarray(0.004),
        velocity_delay=jnp.asarray(0.1),
        vane_delay=jnp.asarray(0.03),
        vane_scale=jnp.array([0.1, -0.05]),
    )
    sample = with_vanes(row(0.02)) if name == "vanes" else row(0.02)
    return aircraft, known._replace(sensors=errors), sample


@pytest.mark.parametrize("name", ["no vanes", "vanes", "all"])
def test_sensitivities_are_differences_of_the_innovation(name: str) -> None:
    """In a wind that grows with height, too: what moves there is more than the wind itself."""
    aircraft, known, sample = case(name)

    @jax.jit
    def stepped(before: State) -> tuple[State, aided_linear.Linearised]:
        after = aided.advance(aircraft, known, NOISE, before, sample)
        inner = aided_linear.mechanics(aircraft, known, before, after, sample)
        found = aided_linear.linearise(aircraft, known, NOISE, before, after, sample, inner)
        return after, found

    after, found = stepped(state())
    present = np.asarray(found.present)
    assert present[ROWS["vanes"]].all() == (name != "no vanes")
    assert (np.asarray(found.sensitivity)[ROWS["vanes"]] != 0.0).any() == (name != "no vanes")

    @jax.jit
    def left(error: jax.Array) -> jax.Array:
        return aided.innovation(aircraft, known, aided.compose(after, error), sample)

    for column in range(aided.SIZE):
        error = jnp.zeros(aided.SIZE).at[column].set(1e-5)
        change = -np.asarray(left(error) - left(-error)) / 2e-5
        expected = np.where(found.present, change, 0.0)
        # Central differences: second order in 1e-5 on curvatures of up to 1e3.
        np.testing.assert_allclose(found.sensitivity[:, column], expected, atol=1e-6)
    spread = np.asarray(found.process)
    np.testing.assert_allclose(spread, spread.T, atol=1e-18)
    assert np.linalg.eigvalsh(spread).min() > -1e-15


def test_the_jacobian_is_differences_of_the_motion_in_a_wind_that_grows() -> None:
    aircraft, known, sample = case("all")

    @jax.jit
    def change(error: jax.Array) -> jax.Array:
        moved = aided.compose(state(), error)
        return aided.motion(aircraft, known, moved, sample)

    @jax.jit
    def slope(at: State) -> jax.Array:
        return aided_linear.jacobian(aircraft, known, at, sample, 1)

    found = np.asarray(slope(state()))
    rate = np.asarray(change(jnp.zeros(aided.SIZE)))[:3]
    for column in range(aided.SIZE):
        error = jnp.zeros(aided.SIZE).at[column].set(1e-5)
        expected = np.array(change(error) - change(-error)) / 2e-5
        if column < 3:
            # Of a turn that is told in axes that turn.
            expected[:3] -= np.cross(rate, np.eye(3)[column])
        np.testing.assert_allclose(found[:, column], expected[: aided.MOVING], atol=2e-6)
        assert not expected[aided.MOVING :].any()


def weighed(
    means: Means, noise: Noise, before: State, *, aircraft: Aircraft, sample: Row
) -> jax.Array:
    """One number that everything in the model moves."""
    weights = jnp.asarray(np.random.default_rng(4).standard_normal(aided.ROW_COUNT))
    after = aided.advance(aircraft, means, noise, before, sample)
    return weights @ aided.innovation(aircraft, means, after, sample)


def test_slopes_by_every_mean_and_intensity_are_differences() -> None:
    """Backward, forward and by differences, and of two states at once as of each.

    Every mean moves something, and of the intensities those that say how errors and gusts fade.
    """
    aircraft, known, sample = case("all")
    flat, unravel = ravel_pytree((known, NOISE))

    def of(values: jax.Array, before: State) -> jax.Array:
        return weighed(*unravel(values), before, aircraft=aircraft, sample=sample)

    slopes = jax.jit(jax.grad(of))
    backward = slopes(flat, state())
    along = jax.jit(jax.vmap(lambda way: jax.jvp(partial(of, before=state()), (flat,), (way,))[1]))
    np.testing.assert_allclose(along(jnp.eye(flat.size)), backward, rtol=1e-11, atol=1e-12)
    size = 1e-5 * jnp.maximum(jnp.abs(flat), 0.1)
    many = jax.jit(jax.vmap(partial(of, before=state())))
    ends = flat[None, None] + jnp.stack([jnp.diag(size), -jnp.diag(size)])
    up, down = (many(part) for part in ends)
    apart = (up - down) / (2.0 * size)
    # Rounding: 1e-16 of a sum of some tens, by steps of 1e-6 and more.
    np.testing.assert_allclose(apart, backward, rtol=1e-6, atol=2e-7)
    told, intensities = unravel(jnp.where(jnp.abs(backward) > 1e-9, 1.0, 0.0))
    assert np.asarray(ravel_pytree(told)[0]).all()
    turbulence = intensities.turbulence
    assert {name for name in turbulence._fields if np.any(getattr(turbulence, name))} == {
        "gust_length", "spin_length", "coupling", "azimuth",
    }  # fmt: skip
    assert {name for name in intensities._fields[1:] if np.any(getattr(intensities, name))} == {
        "attitude_error_time", "velocity_error_time",
    }  # fmt: skip
    other = aided.compose(state(), jnp.full(aided.SIZE, 0.02))
    both = jax.tree.map(lambda *parts: jnp.stack(parts), state(), other)
    together = jax.jit(jax.vmap(jax.grad(of), in_axes=(None, 0)))(flat, both)
    alone = jnp.stack([backward, slopes(flat, other)])
    np.testing.assert_allclose(together, alone, rtol=1e-11, atol=1e-12)
