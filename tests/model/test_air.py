"""Gusts keep their intensity, die out over their length, and turn the air as they pass."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from gcs_sysid.model import air
from gcs_sysid.model.air import Air, Turbulence

TURBULENCE = Turbulence(
    gust=jnp.array([1.2, 0.9, 1.7]),
    gust_length=jnp.array([4.0, 5.0, 6.0]),
    spin=jnp.array([0.06, 0.08, 0.05]),
    spin_length=jnp.array([0.2, 0.3, 0.1]),
    coupling=jnp.array([0.2, -0.4]),
    azimuth=jnp.asarray(0.5 * np.pi),
)
SPEED = 2.0
"""At which the aircraft passes [m/s]: times are half of the lengths."""


def flowing(values: jax.Array) -> jax.Array:
    """Drift of gust, spin and memory, of a field that lies to the north."""
    gust, spin, memory = jnp.split(values, 3)
    north = TURBULENCE._replace(azimuth=jnp.asarray(0.0))
    change = air.drift(Air(jnp.zeros(3), gust, spin, memory), north, SPEED)
    return jnp.concatenate([change.gust, change.spin, change.memory])


def test_a_gust_of_its_stated_size_keeps_it() -> None:
    """Stationary covariance, by Lyapunov's equation: σ² of gusts, and of spin without coupling."""
    matrix = np.array(jax.jacfwd(flowing)(jnp.zeros(9)))
    matrix[3:6, :3] = matrix[3:6, 6:] = 0.0
    added = np.asarray(air.density(TURBULENCE, SPEED))
    kept = scipy.linalg.solve_continuous_lyapunov(matrix, -np.diag(added[3:]))
    np.testing.assert_allclose(np.diagonal(kept)[:3], TURBULENCE.gust**2, rtol=1e-12)
    np.testing.assert_allclose(np.diagonal(kept)[3:6], TURBULENCE.spin**2, rtol=1e-12)
    np.testing.assert_allclose(added[:3], air.WIND_DRIFT**2)


def test_gusts_have_the_specification_s_spectra() -> None:
    """MIL-F-8785C, section 3.7.1.2, over all time frequencies: along, and across and down."""
    matrix = np.asarray(jax.jacfwd(flowing)(jnp.zeros(9)))
    added = np.asarray(air.density(TURBULENCE, SPEED))[3:]
    for omega in (0.0, 0.05, 0.3, 2.0):
        answer = np.linalg.inv(1j * omega * np.eye(9) - matrix)
        # Their gusts drive nothing but spin here, so that each axis hears its own noise only.
        power = np.array([added[axis] * abs(answer[axis, axis]) ** 2 for axis in range(3)])
        size, times = np.asarray(TURBULENCE.gust) ** 2, np.asarray(TURBULENCE.gust_length) / SPEED
        x = (omega * times) ** 2
        wanted = size * times * np.where([True, False, False], 2.0 / (1 + x), 0.0)
        wanted += size * times * np.where([False, True, True], (1 + 3 * x) / (1 + x) ** 2, 0.0)
        np.testing.assert_allclose(power, wanted, rtol=1e-10)


def test_a_changing_gust_turns_the_air_by_the_coupling() -> None:
    """Spin starts to change by C dg, and its own part decays over its own length.

    With the field along east, across is south: there a vertical gust turns the air, and it is the
    gust toward south that turns it about down.
    """
    gust, spin = jnp.array([0.5, -0.4, 2.0]), jnp.array([0.1, 0.2, -0.3])
    change = air.drift(Air(jnp.ones(3), gust, spin, 0.3 * gust), TURBULENCE, SPEED)
    np.testing.assert_allclose(change.wind, 0.0)
    # Along is east, of first order.
    assert float(change.gust[1]) == pytest.approx(SPEED * 0.4 / 4.0)
    coupled = np.array([0.2 * -change.gust[2], 0.0, -0.4 * -change.gust[0]])
    own = SPEED * np.array([0.1 / 0.3, 0.2 / 0.2, -0.3 / 0.1])
    np.testing.assert_allclose(change.spin, coupled - own, rtol=1e-12, atol=1e-15)


def test_a_field_turned_by_half_a_circle_is_the_same_with_the_signs_changed() -> None:
    turned = TURBULENCE._replace(coupling=-TURBULENCE.coupling, azimuth=TURBULENCE.azimuth + np.pi)
    np.testing.assert_allclose(
        air.coupling_matrix(turned), air.coupling_matrix(TURBULENCE), atol=1e-15
    )


def test_scales_of_turbulence_are_those_of_the_specification() -> None:
    """MIL-F-8785C, figures 10 and 12: 1000 ft at 1000 ft, 1750 ft from 2000 ft up."""
    foot = air.FOOT
    np.testing.assert_allclose(air.scale_lengths(1000.0 * foot), 1000.0 * foot, rtol=1e-3)
    np.testing.assert_allclose(air.scale_lengths(5000.0 * foot), 1750.0 * foot)
    np.testing.assert_allclose(air.scale_lengths(1500.0 * foot), 1375.0 * foot, rtol=1e-3)
    level, down = air.scale_lengths(200.0 * foot)
    assert down == 200.0 * foot
    np.testing.assert_allclose(level, 200.0 * foot / 0.3416**1.2)
