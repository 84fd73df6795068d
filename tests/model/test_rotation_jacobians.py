"""Derivatives of rotations against differences of the rotations themselves."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gcs_sysid import frames
from gcs_sysid.model import rotation_jacobians
from gcs_sysid.model.rotation_jacobians import inverse_left_jacobian, right_jacobian

AXIS = np.array([0.48, -0.6, 0.64])
ANGLES = [0.0, 1e-9, 1e-4, 0.0999, 0.1001, 1.0, 2.5, np.pi - 1e-3]
"""On both sides of where the series takes over."""
STEP = 1e-6


@pytest.mark.parametrize("angle", ANGLES)
def test_right_jacobian_is_the_turn_that_a_changed_vector_makes(angle: float) -> None:
    vector = angle * AXIS
    start = frames.exponential(jnp.asarray(vector))

    def turned(change: np.ndarray) -> np.ndarray:
        ahead = frames.exponential(jnp.asarray(vector + change))
        return np.asarray(frames.logarithm(frames.multiply(frames.conjugate(start), ahead)))

    columns = [(turned(STEP * row) - turned(-STEP * row)) / (2.0 * STEP) for row in np.eye(3)]
    found = jax.jit(right_jacobian)(jnp.asarray(vector))
    np.testing.assert_allclose(found, np.stack(columns, axis=1), atol=1e-9)


@pytest.mark.parametrize("angle", ANGLES)
def test_inverse_left_jacobian_is_the_change_that_a_turn_before_makes(angle: float) -> None:
    vector = angle * AXIS
    start = frames.exponential(jnp.asarray(vector))

    def moved(turn: np.ndarray) -> np.ndarray:
        before = frames.exponential(jnp.asarray(-turn))
        return np.asarray(frames.logarithm(frames.multiply(before, start)))

    columns = [(moved(-STEP * row) - moved(STEP * row)) / (2.0 * STEP) for row in np.eye(3)]
    found = jax.jit(inverse_left_jacobian)(jnp.asarray(vector))
    np.testing.assert_allclose(found, np.stack(columns, axis=1), atol=1e-8)


def test_matrix_turns_as_the_quaternion_does() -> None:
    body = Rotation.from_rotvec([0.7, -0.3, 2.0])
    quaternion = jnp.asarray(body.as_quat(scalar_first=True))
    np.testing.assert_allclose(rotation_jacobians.matrix(quaternion), body.as_matrix(), atol=1e-15)
