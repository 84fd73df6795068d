"""The flight model of the aided filter: its algebra, its motion, and what its sensors feel."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from gcs_sysid import frames
from gcs_sysid.model import aided, aided_linear, aided_step, rigid_body
from gcs_sysid.model.aided import BLOCKS, ROWS, Means, Row, State
from gcs_sysid.model.aided_step import Half, Own
from gcs_sysid.model.air import Air
from tests.model.made_aided import FLYING, NOISE, SPEED, STONE, means, row, state


def test_difference_undoes_compose() -> None:
    error = jnp.asarray(0.1 * np.random.default_rng(2).standard_normal(aided.SIZE))
    moved = aided.compose(state(), error)
    np.testing.assert_allclose(aided.difference(moved, state()), error, atol=1e-14)


def test_without_gusts_the_motion_is_that_of_the_rigid_body() -> None:
    """The two schemes differ by their fourth-order errors, which small steps make vanish."""
    still = Air(jnp.array([2.0, -1.0, 0.1]), *[jnp.zeros(3)] * 3)
    calm = state()._replace(air=still, push=jnp.zeros(1))
    ahead = aided.advance(FLYING, means(FLYING), NOISE, calm, row(0.004))
    start = rigid_body.State(jnp.array([0.0, 0.0, -100.0]), calm.velocity, calm.attitude, calm.rate)
    given = rigid_body.Inputs(
        {"elevator": jnp.asarray(-0.03)},
        jnp.zeros(0),
        calm.air.wind,
        jnp.zeros(3),
        jnp.asarray(1.2),
    )
    wanted = rigid_body.advance(
        FLYING, rigid_body.parameters(FLYING), start, given, given, jnp.asarray(0.004)
    )
    np.testing.assert_allclose(ahead.rate, wanted.rate, atol=1e-10)
    np.testing.assert_allclose(ahead.velocity, wanted.velocity, atol=1e-10)
    np.testing.assert_allclose(ahead.attitude, wanted.attitude, atol=1e-12)


def test_the_scheme_is_of_fourth_order() -> None:
    """Halving the step divides the error over a fixed time by sixteen."""

    @jax.jit
    def ahead(now: State, sample: Row) -> State:
        return aided.advance(FLYING, means(FLYING), NOISE, now, sample)

    def after(steps: int) -> np.ndarray:
        now = state()
        for _ in range(steps):
            now = ahead(now, row(0.08 / steps))
        return np.asarray(now.rate)

    exact = after(64)
    coarse, fine = (np.linalg.norm(after(steps) - exact) for steps in (2, 4))
    assert np.log2(coarse / fine) == pytest.approx(4.0, abs=0.5)


def test_a_spinning_stone_in_free_fall_feels_its_lever_only() -> None:
    """No air forces: f = push + ω̇ × r + ω × (ω × r), and the gyro reads ω and its drift."""
    errors = aided.innovation(STONE, means(STONE), state(), row(0.0))
    rate = np.asarray(state().rate)
    inertia = STONE.mass.inertia
    turning = np.linalg.solve(inertia, -np.cross(rate, inertia @ rate))
    lever = np.array(STONE.imu.position) - np.array(STONE.mass.cg)
    felt = np.cross(turning, lever) + np.cross(rate, np.cross(rate, lever))
    felt = felt + np.array([0.2, 0.0, 0.0])
    np.testing.assert_allclose(errors[ROWS["accelerometer"]], -felt, atol=1e-12)
    drifted = rate + np.array([0.001, -0.002, 0.0015])
    np.testing.assert_allclose(errors[ROWS["gyro"]], -drifted, atol=1e-15)


def test_what_the_sensors_read_leaves_no_innovation() -> None:
    now = state()
    lever = np.array(STONE.pitot.position) - np.array(STONE.mass.cg)
    through = frames.unrotate(now.attitude, now.velocity - now.air.wind - now.air.gust)
    # A gust that turns is stronger where the tube is.
    turning = np.asarray(now.rate - frames.unrotate(now.attitude, now.air.spin))
    speed = np.linalg.norm(np.asarray(through) + np.cross(turning, lever))
    shown = frames.multiply(frames.exponential(now.attitude_error), now.attitude)
    seen = row(0.0).measured._replace(
        airspeed=1.03 * speed + now.airspeed_error,
        velocity=now.velocity + now.velocity_error,
        attitude=shown,
    )
    known = means(STONE)
    known = known._replace(sensors=known.sensors._replace(airspeed_scale=jnp.asarray(0.03)))
    left = aided.innovation(STONE, known, now, row(0.0)._replace(measured=seen))
    for name in ("airspeed", "velocity", "attitude"):
        np.testing.assert_allclose(left[ROWS[name]], 0.0, atol=1e-12)


def test_a_tube_with_a_lag_shows_what_was_a_while_ago() -> None:
    """Steady but for the tube: it fills by (V − tube)/T, and shows what has come in."""
    now = state()._replace(airspeed_error=jnp.zeros(1))
    known = means(STONE)
    still = row(0.0)
    _, rate = aided.changing(STONE, known, now, still, 2)
    place = jnp.asarray(STONE.pitot.position)
    speed, _, _ = aided.through_air(STONE, known, now, still, rate, place)
    filled = aided.filling(STONE, known, now, still, rate)
    np.testing.assert_allclose(filled, [(speed - 21.0) / 0.2])
    seen = still._replace(measured=still.measured._replace(airspeed=jnp.asarray([21.0])))
    late, slight = (
        known._replace(sensors=known.sensors._replace(airspeed_lag=jnp.asarray(lag)))
        for lag in (0.1, 0.02)
    )
    # From a twentieth of a second on it is the tube's own lag that it fills by.
    filled = aided.filling(STONE, late, now, still, rate)
    np.testing.assert_allclose(filled, [(speed - 21.0) / 0.1])
    left = aided.innovation(STONE, late, now, seen)
    np.testing.assert_allclose(left[ROWS["airspeed"]], 0.0, atol=1e-12)
    # Below, the state's is longer, and its share is shown.
    filled = aided.filling(STONE, slight, now, still, rate)
    np.testing.assert_allclose(filled, [(speed - 21.0) / 0.14])
    left = aided.innovation(STONE, slight, now, seen)
    np.testing.assert_allclose(left[ROWS["airspeed"]], 6.0 / 7.0 * (21.0 - speed), atol=1e-12)
    # A lag that the file states counts as one that is found.
    error = replace(STONE.pitot.error, lag=0.08)
    stated = replace(STONE, pitot=replace(STONE.pitot, error=error))
    filled = aided.filling(stated, slight, now, still, rate)
    np.testing.assert_allclose(filled, [(speed - 21.0) / 0.1])
    left = aided.innovation(stated, slight, now, seen)
    np.testing.assert_allclose(left[ROWS["airspeed"]], 0.0, atol=1e-12)


@pytest.mark.parametrize("lag", [0.05, 0.1, 0.3])
def test_a_tube_swings_as_a_first_order_lag_does(lag: float) -> None:
    """V = 20 + sin ωt, ω = 8 rad/s: 1/√(1 + (ωτ)²) of it is shown, arctan ωτ later."""
    errors = means(STONE).sensors._replace(airspeed_lag=jnp.asarray(lag))
    fills = float(aided.tube_lag(STONE, errors))
    share = float(aided.own_lag(STONE, errors)) / fills
    time, omega = np.arange(0.0, 6.0, 1e-4), 8.0
    speed = 20.0 + np.sin(omega * time)
    tube = np.full_like(time, 20.0)
    for i in range(1, time.size):
        tube[i] = tube[i - 1] + 1e-4 * (speed[i - 1] - tube[i - 1]) / fills
    shown = speed + share * (tube - speed)
    late = 20.0 + np.sin(omega * time - np.arctan(omega * lag)) / np.hypot(1.0, omega * lag)
    np.testing.assert_allclose(shown[time > 4.0], late[time > 4.0], atol=1e-3)


@jax.jit
def stepped(known: Means, before: State, sample: Row) -> tuple[State, aided_linear.Linearised]:
    after = aided.advance(FLYING, known, NOISE, before, sample)
    inner = aided_linear.mechanics(FLYING, known, before, after, sample)
    return after, aided_linear.linearise(FLYING, known, NOISE, before, after, sample, inner)


def test_the_transition_is_that_of_the_scheme_to_third_order() -> None:
    """Central differences of the scheme; what is left falls with the step's third power."""
    known = means(FLYING)

    @jax.jit
    def ends(sample: Row, error: jax.Array, after: State) -> jax.Array:
        moved = aided.compose(state(), error)
        ahead = aided.advance(FLYING, known, NOISE, moved, sample)
        return aided.difference(ahead, after)

    def left(length: float) -> np.ndarray:
        sample = row(length)
        after, found = stepped(known, state(), sample)
        np.testing.assert_allclose(found.offset, 0.0, atol=1e-14)
        off = []
        for column in range(aided.SIZE):
            error = jnp.zeros(aided.SIZE).at[column].set(1e-5)
            pair = [ends(sample, sign * error, after) for sign in (1.0, -1.0)]
            off.append(found.transition[:, column] - (pair[0] - pair[1]) / 2e-5)
        return np.stack(off, axis=1)

    coarse, fine = left(0.04), left(0.02)
    assert np.abs(fine).max() < 2e-3
    assert np.log2(np.linalg.norm(coarse) / np.linalg.norm(fine)) > 2.7


def test_noise_of_a_step_is_that_of_the_exponential() -> None:
    """Van Loan (IEEE Trans. Automatic Control 23, 1978): both from one matrix exponential."""
    rng = np.random.default_rng(8)
    length, size = 0.02, aided.SIZE
    # Rates up to those of the roll mode of a small aircraft and of the gusts' rotation.
    rates = 0.3 * rng.standard_normal((size, size))
    rates[aided.MOVING :] = 0.0  # the air and the slow errors feel nothing
    fastest = np.where(np.arange(size) < aided.MOVING, 20.0, 10.0)
    rates -= np.diag(fastest * rng.uniform(size=size))
    shape, across = np.eye(size), np.array([-np.sin(0.4), np.cos(0.4), 0.0])
    down = np.array([0.0, 0.0, 1.0])
    turned = np.stack([np.array([np.cos(0.4), np.sin(0.4), 0.0]), across, down], axis=1)
    coupling = 0.2 * np.outer(across, down) + 0.3 * np.outer(down, across)
    shape[BLOCKS["gust"], BLOCKS["gust"]] = shape[BLOCKS["spin"], BLOCKS["spin"]] = turned
    shape[BLOCKS["spin"], BLOCKS["gust"]] = coupling @ turned
    passing = np.ones(size)
    passing[BLOCKS["gust"].start : BLOCKS["memory"].stop] = SPEED
    density = shape @ np.diag(passing * np.asarray(aided_linear.process_density(NOISE))) @ shape.T
    block = np.block([[-rates, density], [np.zeros((size, size)), rates.T]])
    both = scipy.linalg.expm(block * length)
    transition = both[size:, size:].T
    half = scipy.linalg.expm(0.5 * length * rates)
    slow, blown = half[aided.MOVING :, aided.MOVING :], aided_step.BLOWN
    own = Own(slow[blown, blown], aided_step.UNIT.alone * slow.diagonal())
    parts = Half(half[: aided.MOVING], own)
    found = aided_step.process(parts, row(length), aided_linear.driving(NOISE))
    exact = transition @ both[:size, size:]
    noisy = np.diagonal(exact) > 0.0  # all but the gusts' memory
    scale = np.sqrt(np.outer(np.diagonal(exact), np.diagonal(exact)))[np.ix_(noisy, noisy)]
    # Simpson's rule is exact to third order in the step; what is left is largest where noise has to
    # be integrated first.
    off = (np.asarray(found) - exact)[np.ix_(noisy, noisy)]
    assert np.max(np.abs(off) / scale) < 5e-3


@pytest.mark.parametrize(
    ("name", "size", "time"),
    [("airspeed_error", 0.03, aided.AIRSPEED_TIME), ("gyro_error", 1e-3, aided.GYRO_TIME)],
)
def test_an_error_that_lasts_is_as_large_as_stated_and_lasts_as_long(
    name: str, size: float, time: float
) -> None:
    """Of ẏ = −y/T + w what stays is as large as stated, and falls to 1/e in T."""
    quiet = jax.tree.map(jnp.zeros_like, NOISE)._replace(
        turbulence=NOISE.turbulence,
        **{name: getattr(NOISE, name)},
        attitude_error_time=NOISE.attitude_error_time,
        velocity_error_time=NOISE.velocity_error_time,
    )
    error, step = BLOCKS[name].start, 0.02
    mechanics = jnp.zeros((aided.MOVING, aided.SIZE))
    half = aided_step.half(mechanics, aided_linear.decay(quiet), row(step))
    added = aided_step.process(half, row(step), aided_linear.driving(quiet))[error, error]
    kept = float(aided_step.whole(half)[error, error])
    assert np.sqrt(float(added) / (1.0 - kept**2)) == pytest.approx(size, rel=1e-6)
    assert kept == pytest.approx(np.exp(-step / time), rel=1e-4)


def test_moments_that_lag_turn_the_aircraft_as_much_later() -> None:
    """A step of the rudder's kind: with lag τ the rate after t is that without lag after t − τ."""
    lag, step, count = 0.004, 0.002, 20
    prompt, known = means(FLYING), means(FLYING)
    late = known._replace(sensors=known.sensors._replace(moment_lag=jnp.asarray(lag)))

    @jax.jit
    def flown(values: Means) -> jax.Array:
        def ahead(now: State, _: None) -> tuple[State, jax.Array]:
            after = aided.advance(FLYING, values, NOISE, now, row(step))
            still = row(step)._replace(gyro=jnp.zeros(3))
            return after, -aided.innovation(FLYING, values, after, still)[ROWS["gyro"]]

        return jax.lax.scan(ahead, state(), None, length=count)[1]

    turned, delayed = np.asarray(flown(prompt)), np.asarray(flown(late))
    shifted = turned[: count - int(lag / step)]
    change = np.ptp(turned, axis=0).max()
    # What is left out is of second order in the lag over the roll mode's time.
    assert np.abs(delayed[int(lag / step) :] - shifted).max() < 0.05 * change
    assert np.abs(delayed - turned).max() > 0.1 * change


def test_a_tilted_attitude_tells_more_roll_and_pitch() -> None:
    """Of the airframe, wherever it flies to: rolled it is roll, with wings level pitch."""
    none = means(STONE).sensors
    both = none._replace(attitude_tilt=jnp.array([0.01, 0.02]))
    alone = none._replace(attitude_tilt=jnp.array([0.01, 0.0]))
    for heading in (0.4, 2.9):
        level = frames.quaternion_from_euler(jnp.array([0.0, 0.1, heading]))
        shown = frames.euler_from_quaternion(aided.told(level, both))
        np.testing.assert_allclose(shown, [0.01, 0.12, heading], atol=1e-12)
        rolled = frames.quaternion_from_euler(jnp.array([0.6, 0.0, heading]))
        shown = frames.euler_from_quaternion(aided.told(rolled, alone))
        np.testing.assert_allclose(shown, [0.61, 0.0, heading], atol=1e-12)
