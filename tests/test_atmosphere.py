from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from gcs_sysid import atmosphere

HEIGHTS = np.array([0.0, 500.0, 1000.0, 5000.0, 11000.0, 15000.0, 20000.0])


def test_printed_tables_of_the_standard() -> None:
    """Doc 7488/3 table 4 (geopotential), at the precision printed there."""
    temperature = [288.150, 284.900, 281.650, 255.650, 216.650, 216.650, 216.650]
    pressure = [101325.0, 95460.8, 89874.5, 54019.8, 22632.0, 12044.5, 5474.87]
    density = [1.22500, 1.16727, 1.11164, 0.736115, 0.363918, 0.193673, 0.0880345]
    np.testing.assert_allclose(atmosphere.temperature(HEIGHTS), temperature, atol=5e-4)
    np.testing.assert_allclose(atmosphere.pressure(HEIGHTS), pressure, rtol=6e-6)
    np.testing.assert_allclose(atmosphere.density(HEIGHTS), density, rtol=6e-6)
    np.testing.assert_allclose(
        atmosphere.speed_of_sound(np.array([288.15, 216.65])), [340.294, 295.069], atol=5e-4
    )


def test_pressure_is_hydrostatic() -> None:
    """Second implementation: dp/dh = -ρ·g integrated numerically from sea level."""

    def slope(h: float, p: np.ndarray) -> np.ndarray:
        temperature = max(288.15 - 0.0065 * h, 216.65)
        return -p * 9.80665 / (287.05287 * temperature)

    solved = solve_ivp(
        slope, (0.0, 20000.0), [101325.0], t_eval=[11000.0, 20000.0], rtol=1e-11, max_step=500.0
    )
    # The integrator's tolerance, with its kink at the tropopause.
    np.testing.assert_allclose(
        atmosphere.pressure(np.array([11000.0, 20000.0])), solved.y[0], rtol=1e-8
    )


@given(st.floats(-2000.0, 20000.0))
@settings(deadline=None)
def test_pressure_altitude_inverts_pressure(height: float) -> None:
    height_again = atmosphere.pressure_altitude(atmosphere.pressure(np.float64(height)))
    # Float64 rounding of the pressure, one part in 1e16, is 1e-11 m of height.
    assert abs(height_again - height) < 1e-8


def test_density_from_pressure_is_the_standard_density() -> None:
    np.testing.assert_allclose(
        atmosphere.density_from_pressure(atmosphere.pressure(HEIGHTS)),
        atmosphere.density(HEIGHTS),
        rtol=1e-13,
    )


@given(st.floats(5.0, 250.0), st.floats(0.0, 12000.0))
@settings(deadline=None)
def test_airspeeds_invert_and_keep_the_impact_pressure(cas: float, height: float) -> None:
    static = atmosphere.pressure(np.float64(height))
    density = atmosphere.density(np.float64(height))
    eas = atmosphere.cas_to_eas(np.float64(cas), static)
    tas = atmosphere.eas_to_tas(eas, density)
    # The subtraction of 1 loses digits at low Mach: M² is 2e-4 at 5 m/s.
    assert atmosphere.eas_to_cas(eas, static) == pytest.approx(cas, rel=1e-10)
    assert atmosphere.tas_to_eas(tas, density) == pytest.approx(float(eas), rel=1e-14)
    mach = tas / atmosphere.speed_of_sound(atmosphere.temperature(np.float64(height)))
    impact = static * ((1.0 + 0.2 * mach**2) ** 3.5 - 1.0)
    at_sea_level = 101325.0 * ((1.0 + 0.2 * (cas / 340.294) ** 2) ** 3.5 - 1.0)
    assert impact == pytest.approx(at_sea_level, rel=1e-5)


def test_compressibility_correction_follows_the_series() -> None:
    """Second implementation: q_c = ½ρ0·EAS²·(1 + M²/4 + M⁴/40 + M⁶/1600 + ...)."""
    pressure_ratio = atmosphere.pressure(np.float64(6096.0)) / 101325.0
    cas = np.float64(102.889)
    eas = atmosphere.cas_to_eas(cas, pressure_ratio * 101325.0)

    def impact(speed: float, pressure_ratio: float) -> float:
        mach = speed / (340.294 * pressure_ratio**0.5)
        return 0.6125 * speed**2 * (1.0 + mach**2 / 4.0 + mach**4 / 40.0 + mach**6 / 1600.0)

    # The first term left out is M⁸/80000, 5e-8 at Mach 0.44; the constants carry six digits.
    assert impact(eas, pressure_ratio) == pytest.approx(impact(cas, 1.0), rel=1e-6)
    assert eas < 0.99 * cas


def test_jax_answers_as_numpy_and_differentiates() -> None:
    heights = jnp.asarray(HEIGHTS)
    np.testing.assert_allclose(
        jax.jit(atmosphere.density)(heights), atmosphere.density(HEIGHTS), rtol=1e-14
    )
    slope = jax.vmap(jax.grad(atmosphere.pressure))(heights)
    expected = -atmosphere.density(HEIGHTS) * 9.80665
    np.testing.assert_allclose(slope[:4], expected[:4], rtol=1e-12)
    np.testing.assert_allclose(slope[5:], expected[5:], rtol=1e-12)
    numeric = (
        atmosphere.pressure_altitude(np.float64(70001.0))
        - atmosphere.pressure_altitude(np.float64(69999.0))
    ) / 2.0
    # Central differences: the step squared, and rounding of 3000 m over 2 Pa.
    assert jax.grad(atmosphere.pressure_altitude)(70000.0) == pytest.approx(numeric, rel=1e-8)
