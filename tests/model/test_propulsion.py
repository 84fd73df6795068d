from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid.aircraft import Propulsion
from gcs_sysid.errors import UsageError
from gcs_sysid.model import propulsion

SEA_LEVEL = 1.225
ENGINE = Propulsion(
    throttle_channel=3,
    pwm=(1100.0, 1900.0),
    throttle=(0.0, 0.5, 1.0),
    airspeed=(10.0, 30.0),
    thrust=((0.0, -2.0), (12.0, 4.0), (40.0, 20.0)),
    torque=((0.0, 0.0), (0.2, 0.1), (0.6, 0.4)),
    time_constant=0.15,
)


def test_throttle_is_held_beyond_its_pulses_and_lags() -> None:
    time = np.array([0.0, 10.0, 20.0, 30.0])
    pwm = np.array([1000.0, 1500.0, 2000.0, 1300.0])
    at = np.array([5.0, 10.1, 19.9, 29.9, 59.0])
    found = propulsion.throttle(ENGINE, pwm, time, at=at)
    expected = [0.0, 0.5 * (1.0 - np.exp(-0.1 / 0.15)), 0.5, 1.0, 0.25]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-13)


def test_reversed_pulses_are_allowed() -> None:
    reverse = replace(ENGINE, pwm=(1900.0, 1100.0))
    found = propulsion.throttle(reverse, np.array([1700.0, 1700.0]), np.array([0.0, 1.0]))
    np.testing.assert_allclose(found, [0.25, 0.25], rtol=1e-14)


def test_thrust_is_the_table_times_the_density_ratio() -> None:
    """By hand: throttle 0.75 and 20 m/s are in the middle of the upper cell."""
    setting, airspeed = np.array([0.75, 0.75, 2.0]), np.array([20.0, 20.0, 5.0])
    density = np.array([SEA_LEVEL, 0.5 * SEA_LEVEL, SEA_LEVEL])
    np.testing.assert_allclose(
        propulsion.static_thrust(ENGINE, setting, airspeed, density), [19.0, 9.5, 40.0], rtol=1e-7
    )
    np.testing.assert_allclose(
        propulsion.static_torque(ENGINE, setting, airspeed, density),
        [0.325, 0.1625, 0.6],
        rtol=1e-7,
    )


def test_thrust_uses_the_lagged_throttle() -> None:
    time = 0.02 * np.arange(100)
    pwm = np.where(time < 1.0, 1100.0, 1900.0)
    airspeed, density = np.full(100, 20.0), np.full(100, SEA_LEVEL)
    setting = propulsion.throttle(ENGINE, pwm, time, extra_delay=0.03)
    for function, steady in (
        (propulsion.thrust, propulsion.static_thrust),
        (propulsion.torque, propulsion.static_torque),
    ):
        found = jax.jit(
            lambda pwm, delay, function=function: function(
                ENGINE, pwm, time, airspeed, density, extra_delay=delay
            )
        )(pwm, 0.03)
        np.testing.assert_allclose(found, steady(ENGINE, setting, airspeed, density), atol=1e-12)


def test_without_torque_there_is_none() -> None:
    setting = np.array([0.5])
    found = propulsion.static_torque(replace(ENGINE, torque=None), setting, 20.0 * setting, setting)
    np.testing.assert_array_equal(found, [0.0])


def test_table_over_rotation_speed() -> None:
    engine = replace(ENGINE, throttle=(), rpm=(0.0, 4000.0, 8000.0), rpm_channel=2)
    found = propulsion.static_thrust(
        engine, np.array([6000.0]), np.array([20.0]), np.array([SEA_LEVEL])
    )
    np.testing.assert_allclose(found, [19.0], rtol=1e-7)
    sample = np.array([0.0])
    with pytest.raises(UsageError, match="measured speed of motor 2"):
        propulsion.thrust(engine, sample, sample, sample, sample)


def test_thrust_gradient_equals_finite_differences() -> None:
    density = jnp.asarray(1.1)

    def at(setting: jax.Array, airspeed: jax.Array) -> jax.Array:
        return propulsion.static_thrust(ENGINE, setting, airspeed, density)

    slopes = jax.grad(at, argnums=(0, 1))(jnp.asarray(0.6), jnp.asarray(17.0))
    step = 1e-6
    numeric = (
        (at(0.6 + step, 17.0) - at(0.6 - step, 17.0)) / (2.0 * step),
        (at(0.6, 17.0 + step) - at(0.6, 17.0 - step)) / (2.0 * step),
    )
    # Bilinear: central differences are exact but for rounding, 20 N·1e-16 / 1e-6.
    np.testing.assert_allclose(slopes, numeric, rtol=1e-8)
