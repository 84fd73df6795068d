"""Rotations against SciPy's, against themselves, and NumPy against JAX."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gcs_sysid import frames

ROUNDING = 1e-14
"""A few dozen float64 operations on numbers of order one."""

vectors = st.tuples(*[st.floats(-50.0, 50.0)] * 3).map(np.array)
angle = st.floats(-3.14, 3.14)
# Nearer than 1e-3 rad to vertical, roll and yaw lose digits: rounding over the cosine of pitch.
attitudes = st.tuples(angle, st.floats(-1.5698, 1.5698), angle).map(np.array)
directions = vectors.filter(lambda v: np.linalg.norm(v) > 1e-3).map(lambda v: v / np.linalg.norm(v))


def scipy_rotation(angles: np.ndarray) -> Rotation:
    return Rotation.from_euler("ZYX", angles[..., ::-1])


@given(attitudes)
def test_quaternion_of_euler_angles_is_scipys(angles: np.ndarray) -> None:
    ours = frames.quaternion_from_euler(angles)
    theirs = scipy_rotation(angles).as_quat(scalar_first=True)
    assert abs(ours @ theirs) == pytest.approx(1.0, abs=ROUNDING)
    assert np.linalg.norm(ours - np.sign(ours @ theirs) * theirs) < ROUNDING


@given(attitudes)
def test_euler_angles_survive_a_round_trip(angles: np.ndarray) -> None:
    back = frames.euler_from_quaternion(frames.quaternion_from_euler(angles))
    near_vertical = max(1.0, 1.0 / np.cos(angles[1]) ** 2)
    np.testing.assert_allclose(back, angles, atol=10 * ROUNDING * near_vertical)


@given(angle, st.sampled_from([-0.5 * np.pi, 0.5 * np.pi]), angle)
def test_straight_up_and_down_give_finite_angles_of_the_same_pitch(
    roll: float, pitch: float, yaw: float
) -> None:
    back = frames.euler_from_quaternion(frames.quaternion_from_euler(np.array([roll, pitch, yaw])))
    assert np.isfinite(back).all()
    assert back[1] == pytest.approx(pitch, abs=1e-7)  # arc sine near one keeps half the digits


@given(attitudes, vectors)
def test_rotation_is_scipys_and_unrotation_its_inverse(
    angles: np.ndarray, vector: np.ndarray
) -> None:
    quaternion = frames.quaternion_from_euler(angles)
    turned = frames.rotate(quaternion, vector)
    atol = 100 * ROUNDING
    np.testing.assert_allclose(turned, scipy_rotation(angles).apply(vector), atol=atol)
    np.testing.assert_allclose(frames.unrotate(quaternion, turned), vector, atol=atol)


def test_signs_are_those_of_flight_mechanics() -> None:
    def down_in_body(angles: list[float]) -> np.ndarray:
        quaternion = frames.quaternion_from_euler(np.array(angles))
        return frames.unrotate(quaternion, np.array([0.0, 0.0, 1.0]))

    half = 0.5
    np.testing.assert_allclose(down_in_body([half, 0, 0]), [0, np.sin(half), np.cos(half)])
    np.testing.assert_allclose(down_in_body([0, half, 0]), [-np.sin(half), 0, np.cos(half)])
    nose = frames.rotate(
        frames.quaternion_from_euler(np.array([0.0, 0.0, half])), np.array([1.0, 0.0, 0.0])
    )
    np.testing.assert_allclose(nose, [np.cos(half), np.sin(half), 0.0], atol=ROUNDING)


@given(attitudes, attitudes, vectors)
def test_product_turns_by_the_second_then_by_the_first(
    first: np.ndarray, second: np.ndarray, vector: np.ndarray
) -> None:
    one, two = frames.quaternion_from_euler(first), frames.quaternion_from_euler(second)
    at_once = frames.rotate(frames.multiply(one, two), vector)
    in_turn = frames.rotate(one, frames.rotate(two, vector))
    np.testing.assert_allclose(at_once, in_turn, atol=100 * ROUNDING)
    identity = frames.multiply(one, frames.conjugate(one))
    np.testing.assert_allclose(identity, [1.0, 0.0, 0.0, 0.0], atol=ROUNDING)


lengths = st.one_of(
    st.just(0.0),
    st.floats(1e-12, 1e-3),
    st.floats(1e-3, 3.0),
    st.floats(1e-9, 0.1).map(lambda gap: np.pi - gap),
)


@given(directions, lengths)
def test_logarithm_undoes_exponential(direction: np.ndarray, length: float) -> None:
    """Tiny rotations keep their relative precision; those near half a turn their sign."""
    vector = length * direction
    quaternion = frames.exponential(vector)
    theirs = Rotation.from_rotvec(vector).as_quat(scalar_first=True)
    np.testing.assert_allclose(quaternion, np.sign(theirs[0]) * theirs, atol=ROUNDING)
    # The vector part of a tiny rotation keeps its digits; the series neglects 1e-8² at most.
    np.testing.assert_allclose(frames.logarithm(quaternion), vector, rtol=1e-11, atol=1e-18)


@given(directions, st.floats(0.0, 3.0))
def test_both_signs_of_a_quaternion_have_one_logarithm(
    direction: np.ndarray, length: float
) -> None:
    quaternion = frames.exponential(length * direction)
    np.testing.assert_allclose(
        frames.logarithm(-quaternion), frames.logarithm(quaternion), rtol=ROUNDING
    )


@pytest.mark.parametrize("length", [0.0, 1e-9, 0.99e-4, 1.01e-4, 2.01e-4, 0.3, 3.0])
def test_derivatives_of_the_maps_agree_with_finite_differences(length: float) -> None:
    """The series and the closed form meet at 2e-4 rad; a `where` could leak NaN there."""
    vector = jnp.array([0.6, -0.64, 0.48]) * length

    def there_and_back(x: jax.Array) -> jax.Array:
        return frames.logarithm(frames.exponential(x))

    np.testing.assert_allclose(jax.jacfwd(there_and_back)(vector), np.eye(3), atol=1e-7)
    np.testing.assert_allclose(jax.jacrev(there_and_back)(vector), np.eye(3), atol=1e-7)
    step = 1e-6
    differences = np.stack(
        [
            (frames.exponential(vector + step * e) - frames.exponential(vector - step * e))
            / (2.0 * step)
            for e in jnp.eye(3)
        ],
        axis=-1,
    )
    # Central differences: rounding 1e-16/1e-6, truncation 1e-12.
    np.testing.assert_allclose(jax.jacfwd(frames.exponential)(vector), differences, atol=1e-9)


@given(st.floats(3.0, 60.0), st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_flow_angles_undo_their_closed_form(airspeed: float, alpha: float, beta: float) -> None:
    velocity = airspeed * np.array(
        [np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)]
    )
    np.testing.assert_allclose(
        np.stack(frames.flow_angles(velocity)), [airspeed, alpha, beta], rtol=1e-12, atol=1e-12
    )


@given(st.floats(-1e3, 1e3))
def test_wrapped_angle_is_the_same_angle(angle: float) -> None:
    wrapped = frames.wrap(np.array(angle))
    assert -np.pi <= wrapped <= np.pi  # rounding may reach the excluded end
    turns = (wrapped - angle) / (2.0 * np.pi)
    assert turns == pytest.approx(np.round(turns), abs=1e-12)


def test_wrap_knows_its_ends() -> None:
    found = frames.wrap(np.array([-np.pi, 0.0, np.pi, 2.0 * np.pi, 3.0]))
    np.testing.assert_allclose(found, [-np.pi, 0.0, -np.pi, 0.0, 3.0], atol=1e-15)


@given(vectors, vectors)
def test_cross_is_numpys(first: np.ndarray, second: np.ndarray) -> None:
    np.testing.assert_allclose(frames.cross(first, second), np.cross(first, second), atol=1e-12)


RANDOM = np.random.default_rng(4)
QUATERNIONS = frames.exponential(RANDOM.standard_normal((5, 2, 3)))
VECTORS = RANDOM.standard_normal((5, 2, 3)) + np.array([20.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("function", "arguments"),
    [
        (frames.quaternion_from_euler, (VECTORS,)),
        (frames.euler_from_quaternion, (QUATERNIONS,)),
        (frames.multiply, (QUATERNIONS, QUATERNIONS[::-1])),
        (frames.conjugate, (QUATERNIONS,)),
        (frames.exponential, (VECTORS,)),
        (frames.logarithm, (QUATERNIONS,)),
        (frames.rotate, (QUATERNIONS, VECTORS)),
        (frames.unrotate, (QUATERNIONS, VECTORS)),
        (frames.cross, (VECTORS, VECTORS[::-1])),
        (frames.flow_angles, (VECTORS,)),
        (frames.wrap, (VECTORS[..., 0],)),
    ],
)
def test_jax_and_numpy_agree_over_any_batch(
    function: Callable, arguments: tuple[np.ndarray, ...]
) -> None:
    ours = function(*arguments)
    theirs = function(*(jnp.asarray(value) for value in arguments))
    assert all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(theirs))
    assert all(isinstance(leaf, np.ndarray) for leaf in jax.tree.leaves(ours))
    np.testing.assert_allclose(np.stack(ours), np.stack(theirs), rtol=1e-13, atol=1e-13)
    one = function(*(value[3, 1] for value in arguments))
    whole = ours if isinstance(ours, tuple) else (ours,)
    single = one if isinstance(one, tuple) else (one,)
    for batch, element in zip(whole, single, strict=True):
        np.testing.assert_allclose(batch[3, 1], element, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("function", [frames.rotate, frames.unrotate])
def test_one_mounting_turns_a_whole_flight(function: Callable) -> None:
    """Batches broadcast: one quaternion for many vectors, one vector for many attitudes."""
    many_vectors, many_turns = VECTORS[:, 0], QUATERNIONS[:, 0]
    whole = function(many_turns[:1], many_vectors)
    np.testing.assert_allclose(whole[2], function(many_turns[0], many_vectors[2]), rtol=1e-14)
    whole = function(many_turns, many_vectors[:1])
    np.testing.assert_allclose(whole[2], function(many_turns[2], many_vectors[0]), rtol=1e-14)
