"""Gusts keep their intensity, die out in their time, and turn the air as they pass."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from gcs_sysid.model import air
from gcs_sysid.model.air import Air, Turbulence

TURBULENCE = Turbulence(
    gust=jnp.array([1.2, 0.9, 1.7]),
    gust_time=jnp.array([4.0, 5.0, 6.0]),
    spin=jnp.array([0.06, 0.08, 0.05]),
    spin_time=jnp.array([0.2, 0.3, 0.1]),
    coupling=jnp.array([0.2, -0.4]),
    azimuth=jnp.asarray(0.5 * np.pi),
)


def test_a_gust_of_its_stated_size_keeps_it() -> None:
    """Stationary: what the noise adds in a moment, 2 σ²/T dt, is what decay takes away."""
    added = np.asarray(air.density(TURBULENCE))
    size, times = np.asarray(TURBULENCE.gust), np.asarray(TURBULENCE.gust_time)
    np.testing.assert_allclose(added[3:6] * times / 2.0, size**2, rtol=1e-12)
    size, times = np.asarray(TURBULENCE.spin), np.asarray(TURBULENCE.spin_time)
    np.testing.assert_allclose(added[6:9] * times / 2.0, size**2, rtol=1e-12)
    np.testing.assert_allclose(added[:3], air.WIND_DRIFT**2)


def test_a_dying_gust_turns_the_air_by_the_coupling() -> None:
    """Spin starts to change by C dg, and its own part decays with its own time.

    With the field along east, across is south: there a vertical gust turns the air, and it is the
    gust toward south that turns it about down.
    """
    gust, spin = jnp.array([0.5, -0.4, 2.0]), jnp.array([0.1, 0.2, -0.3])
    change = air.drift(Air(jnp.ones(3), gust, spin), TURBULENCE)
    np.testing.assert_allclose(change.wind, 0.0)
    dying = np.array([-0.5 / 5.0, 0.4 / 4.0, -2.0 / 6.0])
    np.testing.assert_allclose(change.gust, dying)
    coupled = np.array([0.2 * -dying[2], 0.0, -0.4 * -dying[0]])
    own = np.array([0.1 / 0.3, 0.2 / 0.2, -0.3 / 0.1])
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
    np.testing.assert_allclose(
        air.correlation_times(5000.0 * foot, 25.0), (21.336, 0.5 * 21.336, 0.5 * 21.336)
    )
