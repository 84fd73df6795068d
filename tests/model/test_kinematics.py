"""Kinematics against closed-form flights, an adaptive integrator and finite differences."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from gcs_sysid.model import kinematic_jacobians, kinematics
from gcs_sysid.model.kinematics import (
    BLOCKS,
    GRAVITY,
    MEASURED,
    SIZE,
    Imu,
    Levers,
    Measurements,
    Noise,
    State,
)

NOISE = Noise(
    gyro=jnp.asarray(0.01),
    accelerometer=jnp.asarray(0.1),
    gyro_change=jnp.asarray(0.1),
    accelerometer_change=jnp.asarray(1.0),
    accelerometer_drift=jnp.asarray(1e-3),
    gyro_drift=jnp.asarray(1e-5),
    wind_drift=jnp.full(3, 0.05),
    gust=jnp.asarray([1.0, 1.5, 2.0]),
    gust_time=jnp.asarray(3.0),
    attitude_error=jnp.asarray([0.01, 0.02, 0.05]),
    attitude_error_time=jnp.asarray(20.0),
    measured=jnp.full(9, 0.1),
)
SPEED = 22.0
DOWN = np.array([0.0, 0.0, GRAVITY])
propagate = jax.jit(kinematics.propagate)
transition = jax.jit(kinematic_jacobians.transition)
innovation = jax.jit(kinematics.innovation)
linearised = jax.jit(kinematic_jacobians.linearised, static_argnames="groups")
compose = jax.jit(kinematics.compose)
difference = jax.jit(kinematics.difference)


def rest(**blocks: list[float]) -> jax.Array:
    """Error state with the given blocks, zero elsewhere."""
    values = np.zeros(SIZE)
    for name, value in blocks.items():
        values[BLOCKS[name]] = value
    return jnp.asarray(values)


def quaternion(rotation: Rotation) -> jax.Array:
    return jnp.asarray(rotation.as_quat(scalar_first=True))


def imu(gyro: list[float] | np.ndarray, accelerometer: list[float] | np.ndarray) -> Imu:
    return Imu(jnp.asarray(gyro, dtype=float), jnp.asarray(accelerometer, dtype=float))


def random_state(seed: int) -> State:
    """Every block at a plausible size."""
    rng = np.random.default_rng(seed)
    return State(
        quaternion(Rotation.from_rotvec(rng.standard_normal(3))),
        rest(
            velocity=[20.0, -8.0, 1.5],
            wind=rng.standard_normal(3) * 4.0,
            gust=rng.standard_normal(3),
            accelerometer_bias=rng.standard_normal(3) * 0.2,
            gyro_bias=rng.standard_normal(3) * 0.02,
            attitude_error=rng.standard_normal(3) * 0.03,
            attitude_offset=rng.standard_normal(3) * 0.02,
            airspeed_scale=[0.07],
            vane_bias=[0.02, -0.03],
            vane_scale=[0.1, -0.05],
            airspeed_delay=[0.05],
            velocity_delay=[0.12],
            attitude_delay=[-0.01],
            vane_delay=[0.03],
            gyro_scale=rng.standard_normal(3) * 0.01,
            accelerometer_scale=rng.standard_normal(3) * 0.01,
        ),
    )


def random_imu(seed: int) -> Imu:
    rng = np.random.default_rng(seed)
    return imu(rng.standard_normal(3) * 0.5, rng.standard_normal(3) * 3.0 - [0.0, 0.0, GRAVITY])


def fly(state: State, sample: Callable[[float], Imu], *, duration: float, steps: int) -> State:
    """State after `duration` in equal steps."""
    step = duration / steps
    samples = [sample(index * step) for index in range(steps + 1)]
    for before, after in itertools.pairwise(samples):
        state = propagate(state, before, after, jnp.asarray(step), NOISE)
    return state


def test_an_accelerometer_on_the_ground_reads_upward_and_nothing_moves() -> None:
    """Specific force at rest is -g along z down: a wrong sign of gravity falls at 2 g."""
    still = imu([0.0, 0.0, 0.0], [0.0, 0.0, -GRAVITY])
    begin = State(jnp.array([1.0, 0.0, 0.0, 0.0]), rest())
    end = fly(begin, lambda _: still, duration=10.0, steps=50)
    np.testing.assert_allclose(end.rest, 0.0, atol=1e-13)
    np.testing.assert_allclose(end.attitude, begin.attitude, atol=1e-15)


def test_free_fall_with_constant_spin_is_exact() -> None:
    rate = np.array([0.7, -1.1, 0.4])
    start = Rotation.from_euler("ZYX", [0.4, -0.2, 1.0])
    begin = State(quaternion(start), rest(velocity=[10.0, 2.0, -3.0]))
    end = fly(begin, lambda _: imu(rate, [0.0, 0.0, 0.0]), duration=5.0, steps=100)
    turned = start * Rotation.from_rotvec(5.0 * rate)
    np.testing.assert_allclose(
        Rotation.from_quat(end.attitude, scalar_first=True).as_matrix(),
        turned.as_matrix(),
        atol=1e-12,  # a hundred products of unit quaternions
    )
    velocity = kinematics.part(end.rest, "velocity")
    np.testing.assert_allclose(velocity, [10.0, 2.0, -3.0 + 5.0 * GRAVITY], atol=1e-11)


def test_a_coordinated_turn_keeps_bank_and_flies_a_circle() -> None:
    """Level turn at bank φ: ψ̇ = g tan φ / V, specific force -g/cos φ along z, nothing else.

    The rate is constant, so the attitude is exact. Each step takes the force of its middle where
    the mean over the step is sin(x)/x of it, x = ψ̇·dt/2: that factor is the scheme's whole error.
    """
    bank, step = np.deg2rad(40.0), 0.02
    turn = GRAVITY * np.tan(bank) / SPEED
    steps = round(2.0 * np.pi / turn / step) // 3  # a third of the circle
    sample = imu(
        [0.0, turn * np.sin(bank), turn * np.cos(bank)], [0.0, 0.0, -GRAVITY / np.cos(bank)]
    )
    begin = State(
        quaternion(Rotation.from_euler("ZYX", [0.0, 0.0, bank])), rest(velocity=[SPEED, 0.0, 0.0])
    )
    end = fly(begin, lambda _: sample, duration=steps * step, steps=steps)
    heading = turn * steps * step
    angles = Rotation.from_quat(end.attitude, scalar_first=True).as_euler("ZYX")
    np.testing.assert_allclose(angles, [heading, 0.0, bank], atol=1e-12)
    exact = SPEED * np.array([np.cos(heading), np.sin(heading), 0.0])
    x = 0.5 * turn * step
    start = np.array([SPEED, 0.0, 0.0])
    velocity = kinematics.part(end.rest, "velocity")
    np.testing.assert_allclose(velocity, start + x / np.sin(x) * (exact - start), atol=1e-10)
    np.testing.assert_allclose(velocity, exact, atol=SPEED * (turn * step) ** 2)


def test_order_two_on_a_tumbling_flight() -> None:
    """Against an adaptive integrator of tolerance 1e-12: halving the step quarters the error."""

    def gyro(t: float) -> np.ndarray:
        return np.array([1.2 * np.sin(2.0 * t), 0.8 * np.cos(1.3 * t), 0.5 + 0.3 * np.sin(t)])

    def force(t: float) -> np.ndarray:
        return np.array([2.0 * np.cos(t), 1.5 * np.sin(1.7 * t), -GRAVITY + 3.0 * np.sin(2.5 * t)])

    def slope(t: float, values: np.ndarray) -> np.ndarray:
        w, x, y, z = values[:4]
        p, q, r = gyro(t)
        turning = 0.5 * np.array(
            [-x * p - y * q - z * r, w * p + y * r - z * q, w * q + z * p - x * r,
             w * r + x * q - y * p]
        )  # fmt: skip
        body = Rotation.from_quat(values[:4], scalar_first=True)
        return np.concatenate([turning, body.apply(force(t)) + DOWN])

    start = np.array([1.0, 0.0, 0.0, 0.0, 20.0, 0.0, 0.0])
    true = solve_ivp(slope, (0.0, 2.0), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    begin = State(jnp.asarray(start[:4]), rest(velocity=[20.0, 0.0, 0.0]))
    errors = []
    for steps in (50, 100, 200):
        end = fly(begin, lambda t: imu(gyro(t), force(t)), duration=2.0, steps=steps)
        found = np.concatenate([end.attitude, kinematics.part(end.rest, "velocity")])
        errors.append(np.abs(found - true))
    attitude = [np.linalg.norm(error[:4]) for error in errors]
    velocity = [np.linalg.norm(error[4:]) for error in errors]
    for sizes in (attitude, velocity):
        orders = np.log2(np.array(sizes[:-1]) / np.array(sizes[1:]))
        np.testing.assert_allclose(orders, 2.0, atol=0.1)


def test_gust_and_attitude_error_decay_and_the_rest_stays() -> None:
    begin = random_state(1)
    end = fly(begin, lambda _: random_imu(2), duration=1.5, steps=30)
    expected = np.array(begin.rest)
    expected[BLOCKS["gust"]] *= np.exp(-1.5 / 3.0)
    expected[BLOCKS["attitude_error"]] *= np.exp(-1.5 / 20.0)
    moved = slice(BLOCKS["velocity"].start, BLOCKS["velocity"].stop)
    expected[moved] = end.rest[moved]
    np.testing.assert_allclose(end.rest, expected, rtol=1e-13)


@pytest.mark.parametrize("step", [0.001, 0.02, 1.0])
def test_gauss_markov_states_keep_their_own_variance(step: float) -> None:
    spread = np.asarray(kinematics.process_covariance(jnp.asarray(step), NOISE))
    for name, time in (("gust", 3.0), ("attitude_error", 20.0)):
        own = np.asarray(getattr(NOISE, name)) ** 2
        decayed = own * np.exp(-2.0 * step / time)
        np.testing.assert_allclose(decayed + spread[BLOCKS[name]], own, rtol=1e-13)
    constants = [name for name, rows in BLOCKS.items() if rows.start >= 21]
    assert all((spread[BLOCKS[name]] == 0.0).all() for name in constants)


errors = st.lists(st.floats(-1.0, 1.0), min_size=SIZE, max_size=SIZE).map(np.array)


@settings(max_examples=50)
@given(st.integers(0, 1000), errors)
def test_difference_undoes_compose(seed: int, error: np.ndarray) -> None:
    state = random_state(seed)
    moved = compose(state, jnp.asarray(error))
    np.testing.assert_allclose(difference(moved, state), error, atol=1e-13)
    assert (np.asarray(moved.rest[:3]) == 0.0).all()


@settings(max_examples=50)
@given(st.integers(0, 1000), st.integers(0, 1000))
def test_compose_undoes_difference(first: int, second: int) -> None:
    one, two = random_state(first), random_state(second)
    back = compose(two, difference(one, two))
    assert abs(float(back.attitude @ one.attitude)) == pytest.approx(1.0, abs=1e-13)
    np.testing.assert_allclose(back.rest, one.rest, atol=1e-13)


def by_differences(function: Callable[[jax.Array], jax.Array], step: float = 1e-5) -> np.ndarray:
    """Jacobian at zero by central differences; float64 leaves about 1e-9 of a value of 20."""
    columns = []
    for index in range(SIZE):
        error = np.zeros(SIZE)
        error[index] = step
        ahead, behind = function(jnp.asarray(error)), function(jnp.asarray(-error))
        columns.append((np.asarray(ahead) - np.asarray(behind)) / (2.0 * step))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("seed", [3, 4])
def test_transition_jacobian_is_that_of_finite_differences(seed: int) -> None:
    state, before, after = random_state(seed), random_imu(seed + 10), random_imu(seed + 20)
    step = jnp.asarray(0.05)
    ahead, jacobian = transition(state, before, after, step, NOISE)
    plain = propagate(state, before, after, step, NOISE)
    np.testing.assert_allclose(ahead.rest, plain.rest, rtol=1e-14)

    def of_error(error: jax.Array) -> jax.Array:
        return difference(propagate(compose(state, error), before, after, step, NOISE), plain)

    np.testing.assert_allclose(jacobian.dense(), by_differences(of_error), atol=1e-8)


LEVERS = Levers(
    pitot=jnp.asarray([0.3, -1.2, 0.05]),
    vanes=jnp.asarray([0.5, 0.9, -0.1]),
    velocity=jnp.asarray([-0.4, 0.2, 0.15]),
)


@pytest.mark.parametrize("seed", [5, 6])
def test_measurement_jacobian_is_that_of_finite_differences(seed: int) -> None:
    state, sample = random_state(seed), random_imu(seed)
    measured = seen_from(state, sample, LEVERS, age=np.array([0.03, -0.01, 0.0, 0.005]))
    residual, jacobian = linearised(state, sample, measured, LEVERS)
    np.testing.assert_allclose(residual, innovation(state, sample, measured, LEVERS), atol=1e-13)

    def expected(error: jax.Array) -> jax.Array:
        return -innovation(compose(state, error), sample, measured, LEVERS)

    differences = by_differences(expected)
    scales = [BLOCKS["airspeed_scale"].start, *range(24, 26)]
    # The scales learn from the flow without the gust: that is their column.
    calm = state._replace(rest=state.rest.at[BLOCKS["gust"]].set(0.0))
    still = linearised(calm, sample, measured, LEVERS)[1]
    differences[:, scales] = np.asarray(still)[:, scales]
    np.testing.assert_allclose(jacobian, without_head_gust(differences, state), atol=2e-7)

    def calm_expected(error: jax.Array) -> jax.Array:
        return -innovation(compose(calm, error), sample, measured, LEVERS)

    in_calm = without_head_gust(by_differences(calm_expected), calm)
    np.testing.assert_allclose(still, in_calm, atol=2e-7)


@pytest.mark.parametrize("asked", [("attitude",), ("airspeed", "vanes"), ("velocity",)])
def test_groups_that_are_not_asked_about_are_nought_and_the_others_as_ever(
    asked: tuple[str, ...],
) -> None:
    state, sample = random_state(7), random_imu(7)
    measured = seen_from(state, sample, LEVERS, age=np.array([0.03, -0.01, 0.02, 0.005]))
    measured = measured._replace(airspeed=measured.airspeed + 0.4, vanes=measured.vanes + 0.02)
    every = linearised(state, sample, measured, LEVERS)
    some = linearised(state, sample, measured, LEVERS, groups=asked)
    for name, rows in kinematics.MEASURED.items():
        for whole, part in zip(every, some, strict=True):
            expected = whole[rows] if name in asked else np.zeros_like(whole[rows])
            np.testing.assert_allclose(part[rows], expected, atol=1e-14)


def without_head_gust(differences: np.ndarray, state: State) -> np.ndarray:
    """Vanes are not asked about a gust along the horizontal flight path."""
    values = {name: np.array(state.rest)[rows] for name, rows in BLOCKS.items()}
    north, east, _ = values["velocity"] - values["wind"] - values["gust"]
    ahead = np.array([north, east, 0.0]) / np.hypot(north, east)
    vanes, gust = kinematics.MEASURED["vanes"], BLOCKS["gust"]
    found = differences.copy()
    found[vanes, gust] = differences[vanes, gust] @ (np.eye(3) - np.outer(ahead, ahead))
    return found


def seen_from(state: State, sample: Imu, levers: Levers, *, age: np.ndarray) -> Measurements:
    """What the sensors say, from the equations of the module docstring, in NumPy and SciPy.

    A sample seen at `age` shows the aircraft `delay` earlier, to which the present acceleration and
    rate carry it.
    """
    blocks = {name: np.array(state.rest)[rows] for name, rows in BLOCKS.items()}
    rate = (np.asarray(sample.gyro) - blocks["gyro_bias"]) / (1.0 + blocks["gyro_scale"])
    force = (np.asarray(sample.accelerometer) - blocks["accelerometer_bias"]) / (
        1.0 + blocks["accelerometer_scale"]
    )
    body = Rotation.from_quat(np.asarray(state.attitude), scalar_first=True)
    acceleration = body.apply(force) + DOWN

    def at(group: int, delay: str) -> tuple[Rotation, np.ndarray]:
        shift = age[group] - blocks[delay][0]
        turned = body * Rotation.from_rotvec(shift * rate)
        return turned, blocks["velocity"] + shift * acceleration

    def flow(group: int, delay: str, lever: jax.Array) -> np.ndarray:
        turned, velocity = at(group, delay)
        through_air = velocity - blocks["wind"] - blocks["gust"]
        return turned.inv().apply(through_air) + np.cross(rate, lever)

    u, v, w = flow(3, "vane_delay", levers.vanes)
    angles = np.array([np.arctan2(w, u), np.arctan2(v, np.hypot(u, w))])
    speed = np.linalg.norm(flow(0, "airspeed_delay", levers.pitot))
    drift, offset = (
        Rotation.from_rotvec(blocks[name]) for name in ("attitude_error", "attitude_offset")
    )
    attitude = drift * at(2, "attitude_delay")[0] * offset
    turned, unit = at(1, "velocity_delay")
    centre = unit + turned.apply(np.cross(rate, levers.velocity))
    return Measurements(
        airspeed=jnp.asarray((1.0 + blocks["airspeed_scale"]) * speed),
        velocity=jnp.asarray(centre),
        attitude=quaternion(attitude),
        vanes=jnp.asarray((1.0 + blocks["vane_scale"]) * angles + blocks["vane_bias"]),
        valid=jnp.ones(len(MEASURED), dtype=bool),
        age=jnp.asarray(age),
    )


@pytest.mark.parametrize("seed", range(7, 12))
def test_consistent_measurements_leave_no_innovation(seed: int) -> None:
    state, sample = random_state(seed), random_imu(seed)
    rng = np.random.default_rng(seed)
    measured = seen_from(state, sample, LEVERS, age=rng.uniform(-0.05, 0.05, 4))
    found = innovation(state, sample, measured, LEVERS)
    np.testing.assert_allclose(found, 0.0, atol=1e-12)


def test_an_innovation_is_measured_minus_expected() -> None:
    state, sample = random_state(13), random_imu(13)
    measured = seen_from(state, sample, LEVERS, age=np.zeros(4))
    turned = Rotation.from_quat(np.asarray(measured.attitude), scalar_first=True)
    extra = np.array([0.02, -0.01, 0.03])
    off = measured._replace(
        airspeed=measured.airspeed + 1.0,
        velocity=measured.velocity + jnp.array([0.1, 0.2, 0.3]),
        attitude=-quaternion(turned * Rotation.from_rotvec(extra)),  # either sign is one attitude
        vanes=measured.vanes + jnp.array([0.01, -0.02]),
    )
    found = innovation(state, sample, off, LEVERS)
    np.testing.assert_allclose(found, [1.0, 0.1, 0.2, 0.3, *extra, 0.01, -0.02], atol=1e-12)


def test_a_pitot_on_the_wing_tip_feels_the_yaw_rate() -> None:
    """Turning right (r > 0), the left tip (y < 0) is the faster one."""
    state = State(jnp.array([1.0, 0.0, 0.0, 0.0]), rest(velocity=[20.0, 0.0, 0.0]))
    rate = jnp.array([0.0, 0.0, 0.5])
    left = kinematics.air_velocity(state, rate, jnp.array([0.0, -1.5, 0.0]))
    np.testing.assert_allclose(left, [20.75, 0.0, 0.0], atol=1e-14)


def test_in_a_turn_the_velocity_is_that_of_the_centre_of_gravity() -> None:
    """Guards against a false accelerometer scale: the unit was taken for the centre of gravity.

    Level circle to the right in closed form: the centre flies along the nose, the unit 0.25 m ahead
    of it swings to the right.
    """
    speed, turning, ahead, heading = 25.0, 0.4, 0.25, 0.7
    nose = np.array([np.cos(heading), np.sin(heading), 0.0])
    right = np.array([-np.sin(heading), np.cos(heading), 0.0])
    unit = speed * nose + turning * ahead * right
    state = State(quaternion(Rotation.from_euler("z", heading)), rest(velocity=list(unit)))
    sample = imu([0.0, 0.0, turning], [-(turning**2) * ahead, speed * turning, -GRAVITY])
    levers = LEVERS._replace(velocity=jnp.array([-ahead, 0.0, 0.0]))
    seen = seen_from(state, sample, LEVERS, age=np.zeros(4))
    seen = seen._replace(velocity=jnp.asarray(speed * nose))
    left = innovation(state, sample, seen, levers)[MEASURED["velocity"]]
    np.testing.assert_allclose(left, 0.0, atol=1e-12)


def test_a_vane_ahead_sees_pitching_as_less_alpha_and_wind_from_ahead_as_speed() -> None:
    state = State(
        jnp.array([1.0, 0.0, 0.0, 0.0]), rest(velocity=[20.0, 0.0, 1.0], wind=[-5.0, 0.0, 0.0])
    )
    pitching = imu([0.0, 0.4, 0.0], [0.0, 0.0, -GRAVITY])
    airspeed, alpha, beta = kinematics.flow(state, pitching, jnp.array([0.5, 0.0, 0.0]))
    assert float(alpha) == pytest.approx(np.arctan2(1.0 - 0.4 * 0.5, 25.0), rel=1e-12)
    assert float(airspeed) == pytest.approx(np.hypot(25.0, 0.8), rel=1e-12)
    assert float(beta) == 0.0


def test_sensor_errors_come_off_as_they_went_on() -> None:
    state = random_state(14)
    rate, force = np.array([0.3, -0.2, 0.5]), np.array([1.0, 0.4, -9.0])
    blocks = {name: np.array(state.rest)[rows] for name, rows in BLOCKS.items()}
    found = kinematics.corrected(
        imu(
            rate * (1.0 + blocks["gyro_scale"]) + blocks["gyro_bias"],
            force * (1.0 + blocks["accelerometer_scale"]) + blocks["accelerometer_bias"],
        ),
        state.rest,
    )
    np.testing.assert_allclose(found.gyro, rate, rtol=1e-13)
    np.testing.assert_allclose(found.accelerometer, force, rtol=1e-13)


def test_blocks_cover_the_error_state_once() -> None:
    rows = np.concatenate([np.arange(rows.start, rows.stop) for rows in BLOCKS.values()])
    np.testing.assert_array_equal(rows, np.arange(SIZE))
    rows = np.concatenate([np.arange(rows.start, rows.stop) for rows in MEASURED.values()])
    np.testing.assert_array_equal(rows, np.arange(9))
