"""What each sensor of the aided filter's flight model tells, by a calculation beside it."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from gcs_sysid.aircraft import SensorError, Vanes
from gcs_sysid.atmosphere import GRAVITY
from gcs_sysid.model import aided, departures
from gcs_sysid.model.aided import ROWS, State
from gcs_sysid.model.air import Air
from gcs_sysid.reconstruct.measurements import vane_errors_off
from tests.model.made_aided import NOISE, STONE, VANED, means, row, state, with_vanes

BOOM = (0.7, -0.9, 0.05)


def turned(now: State) -> Rotation:
    w, x, y, z = (float(part) for part in now.attitude)
    return Rotation.from_quat([x, y, z, w])


def fallen(now: State, time: float) -> tuple[Rotation, np.ndarray, np.ndarray]:
    """Attitude, velocity and rate of the stone after a time: Euler's equations and free fall."""
    inertia, push = STONE.mass.inertia, np.array([float(now.push[0]), 0.0, 0.0])

    def slope(_: float, values: np.ndarray) -> np.ndarray:
        rate, attitude = values[6:], Rotation.from_rotvec(values[:3])
        moving = attitude.apply(push) + np.array([0.0, 0.0, GRAVITY])
        turning = np.linalg.solve(inertia, -np.cross(rate, inertia @ rate))
        # d/dt of the rotation vector θ that turns as ω does.
        angle = np.linalg.norm(values[:3])
        across = np.cross(values[:3], rate)
        rest = (1.0 - 0.5 * angle / np.tan(0.5 * angle)) / angle**2
        change = rate + 0.5 * across + rest * np.cross(values[:3], across)
        return np.concatenate([change, moving, turning])

    start = np.concatenate([turned(now).as_rotvec(), now.velocity, now.rate])
    end = solve_ivp(slope, (0.0, time), start, rtol=1e-11, atol=1e-11).y[:, -1]
    return Rotation.from_rotvec(end[:3]), end[3:6], end[6:]


@pytest.mark.parametrize("ago", [0.0, 0.004])
def test_vanes_read_the_flow_where_they_are_and_when(ago: float) -> None:
    """Off the centre of gravity, in a gust that turns, with bias, scale, upwash and delay."""
    quick = state()._replace(rate=jnp.array([2.0, -1.5, 1.0]))
    attitude, velocity, rate = fallen(quick, -ago) if ago else (turned(quick), *quick[1:3])
    blown = np.asarray(quick.air.wind + quick.air.gust)
    through = attitude.inv().apply(np.array(velocity) - blown)
    against = np.asarray(rate) - attitude.inv().apply(np.array(quick.air.spin))
    u, v, w = through + np.cross(against, np.array(BOOM) - np.array(STONE.mass.cg))
    flow = np.array([np.arctan2(w, u), np.arcsin(v / np.sqrt(u * u + v * v + w * w))])
    vanes = Vanes(
        position=BOOM,
        upwash=0.15,
        alpha=SensorError(bias=(0.03,), scale=(0.04,)),
        beta=SensorError(bias=(-0.02,), scale=(-0.06,)),
    )
    aircraft = replace(STONE, vanes=vanes)
    known = means(aircraft)
    errors = known.sensors._replace(
        vane_bias=jnp.array([0.02, -0.01]),
        vane_scale=jnp.array([0.1, -0.05]),
        vane_delay=jnp.asarray(0.01 + ago),
    )
    # What the file does not know comes before what it knows.
    unknown = flow * np.array([1.1, 0.95]) + np.array([0.02, -0.01])
    shown = unknown * np.array([1.04 * 1.15, 0.94]) + np.array([0.03, -0.02])
    sample = with_vanes(row(0.0))
    seen = sample.measured._replace(
        vanes=jnp.asarray(vane_errors_off(aircraft, shown[None])[0]),
        age=jnp.array([0.0, 0.0, 0.0, 0.01]),
    )
    left = aided.innovation(
        aircraft, known._replace(sensors=errors), quick, sample._replace(measured=seen)
    )
    # Of the delay, what is of second order in it is left out: (ω τ)².
    np.testing.assert_allclose(left[ROWS["vanes"]], 0.0, atol=1e-12 if ago == 0.0 else 2e-5)


def test_gyros_read_what_their_scale_makes_of_the_rate_in_their_own_axes() -> None:
    tilt, scale = np.array([0.06, -0.07, 0.05]), np.array([0.01, -0.02, 0.03])
    bias = np.array([0.004, -0.003, 0.002])
    by = departures.none(STONE, 0)._replace(
        imu_tilt=jnp.asarray(tilt), gyro_scale=jnp.asarray(scale)
    )
    now, known = state(), means(STONE)
    errors = known.sensors._replace(gyro_bias=jnp.asarray(bias))
    known = known._replace(sensors=errors, departures=by)
    mounted = Rotation.from_euler("ZYX", tilt[::-1])
    seen = mounted.inv().apply(np.array(now.rate)) * (1.0 + scale) + bias + now.gyro_error
    left = aided.innovation(STONE, known, now, row(0.0)._replace(gyro=jnp.asarray(seen)))
    np.testing.assert_allclose(left[ROWS["gyro"]], 0.0, atol=1e-15)


def test_accelerometers_read_the_lever_of_where_they_are_in_their_own_axes() -> None:
    """The unit and the centre of gravity stand elsewhere than the file says; the unit is tilted."""
    tilt, bias = np.array([0.06, -0.07, 0.05]), np.array([0.1, -0.2, 0.3])
    by = departures.none(STONE, 0)._replace(
        imu_tilt=jnp.asarray(tilt),
        imu_position=jnp.array([0.02, -0.01, 0.03]),
        cg=jnp.asarray(0.04),
        inertia=jnp.array([0.1, 0.0, -0.2]),
    )
    now, known = state(), means(STONE)
    errors = known.sensors._replace(accelerometer_bias=jnp.asarray(bias))
    known = known._replace(sensors=errors, departures=by)
    inertia = STONE.mass.inertia * np.array([[1.1, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 0.8]])
    rate = np.asarray(now.rate)
    turning = np.linalg.solve(inertia, -np.cross(rate, inertia @ rate))
    lever = np.array([0.15, 0.01, -0.02]) - np.array([0.07, 0.0, 0.01])
    felt = np.array([now.push[0], 0.0, 0.0]) + np.cross(turning, lever)
    felt = felt + np.cross(rate, np.cross(rate, lever))
    seen = Rotation.from_euler("ZYX", tilt[::-1]).inv().apply(felt) + bias
    left = aided.innovation(STONE, known, now, row(0.0)._replace(accelerometer=jnp.asarray(seen)))
    np.testing.assert_allclose(left[ROWS["accelerometer"]], 0.0, atol=1e-12)


def test_a_compass_that_is_off_turns_what_the_attitude_tells() -> None:
    by = departures.none(STONE, 0)._replace(heading=jnp.asarray(0.06))
    now, known = state(), means(STONE)._replace(departures=by)
    error = np.asarray(now.attitude_error) + np.array([0.0, 0.0, 0.06])
    x, y, z, w = (Rotation.from_rotvec(error) * turned(now)).as_quat()
    seen = row(0.0).measured._replace(attitude=jnp.array([w, x, y, z]))
    left = aided.innovation(STONE, known, now, row(0.0)._replace(measured=seen))
    np.testing.assert_allclose(left[ROWS["attitude"]], 0.0, atol=1e-14)


@pytest.mark.parametrize(
    ("name", "delay", "order"),
    [
        ("airspeed", "airspeed_delay", 2),
        ("velocity", "velocity_delay", 2),
        ("attitude", "attitude_delay", 3),
        ("vanes", "vane_delay", 2),
    ],
)
def test_a_late_stream_is_compared_with_where_the_aircraft_was(
    name: str, delay: str, order: int
) -> None:
    """But for what is of a higher order in the delay.

    Levers had turned at the rate of now, not of then: with a boom of a metre in a pull-up that is
    as much of the flow angles as all the rest of their change.
    """
    still = Air(jnp.array([2.0, -1.0, 0.1]), *[jnp.zeros(3)] * 3)
    now = state()._replace(
        rate=jnp.array([1.0, -0.6, 0.5]),
        air=still,
        # What decays by itself is not flown back.
        push=jnp.zeros(1),
        **{f"{error}_error": jnp.zeros(3) for error in ("attitude", "velocity", "gyro")},
        airspeed_error=jnp.zeros(1),
    )
    known = means(VANED)
    errors = known.sensors._replace(airspeed_lag=jnp.asarray(0.05))
    known = known._replace(sensors=errors)
    sample = with_vanes(row(0.0))
    sample = sample._replace(measured=sample.measured._replace(attitude=now.attitude))

    @jax.jit
    def seen(late: jax.Array) -> tuple[jax.Array, jax.Array]:
        slow = known._replace(sensors=errors._replace(**{delay: late}))
        then = aided.advance(VANED, known, NOISE, now, row(0.0)._replace(step=-late))
        first = aided.innovation(VANED, slow, now, sample)
        return first[ROWS[name]], aided.innovation(VANED, known, then, sample)[ROWS[name]]

    def off(late: float) -> float:
        first, second = seen(jnp.asarray(late))
        return float(np.linalg.norm(first - second))

    begin, moved = seen(jnp.asarray(0.0))[0], seen(jnp.asarray(0.002))[0]
    assert off(0.002) < 0.05 * np.linalg.norm(moved - begin)
    assert np.log2(off(0.002) / off(0.001)) == pytest.approx(order, abs=0.2)
