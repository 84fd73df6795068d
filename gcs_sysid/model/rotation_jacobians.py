"""Derivatives of rotations with respect to the rotation vector behind them.

With [φ]× the matrix of the vector product, θ = |φ| and exp the quaternion of a rotation vector,

    exp(φ + δ) ≈ exp(φ) ⊗ exp(J_r(φ) δ)        J_r  = I - (1-cos θ)/θ² [φ]× + (θ-sin θ)/θ³ [φ]×²
    log(exp(-δ) ⊗ exp(φ)) ≈ φ - J_l⁻¹(φ) δ     J_l⁻¹ = I - ½ [φ]× + (1 - ½θ cot ½θ)/θ² [φ]×²

(Solà, Deray & Atchuthan, *A micro Lie theory for state estimation in robotics*, 2018, eq. 143–146).
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Float

from gcs_sysid.frames import Array

_SERIES_BELOW = 1e-2
"""Of θ²: there the fourth power left out of the series is below the rounding of the quotient."""


def skew(vector: Float[Array, " axis"]) -> Float[Array, "axis axis"]:
    """Matrix whose product with b is the vector product with b."""
    zero = jnp.zeros(())
    x, y, z = vector
    return jnp.stack([zero, -z, y, z, zero, -x, -y, x, zero]).reshape(3, 3)


def matrix(quaternion: Float[Array, " four"]) -> Float[Array, "axis axis"]:
    """Matrix that turns body vectors into NED."""
    turn = skew(quaternion[1:])
    return jnp.eye(3) + 2.0 * (quaternion[0] * turn + turn @ turn)


def right_jacobian(rotation: Float[Array, " axis"]) -> Float[Array, "axis axis"]:
    """How a rotation turns further, in its own axes, when its vector changes."""
    square, size = _size(rotation)
    turn = skew(rotation)
    first = _guarded(square, (1.0 - jnp.cos(size)) / size**2, (1 / 2, -1 / 24, 1 / 720, -1 / 40320))
    second = _guarded(
        square, (size - jnp.sin(size)) / size**3, (1 / 6, -1 / 120, 1 / 5040, -1 / 362880)
    )
    return jnp.eye(3) - first * turn + second * turn @ turn


def inverse_left_jacobian(rotation: Float[Array, " axis"]) -> Float[Array, "axis axis"]:
    """How the vector of a rotation changes when it is turned in the axes it starts from."""
    square, size = _size(rotation)
    turn = skew(rotation)
    half = 0.5 * size
    second = _guarded(
        square, (1.0 - half / jnp.tan(half)) / size**2, (1 / 12, 1 / 720, 1 / 30240, 1 / 1209600)
    )
    return jnp.eye(3) - 0.5 * turn + second * turn @ turn


def _size(rotation: Float[Array, " axis"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Square of the angle, and the angle itself or 1 where the series is used instead."""
    square = jnp.sum(rotation * rotation)
    return square, jnp.sqrt(jnp.where(square < _SERIES_BELOW, 1.0, square))


def _guarded(
    square: Float[Array, ""], quotient: Float[Array, ""], series: tuple[float, ...]
) -> Float[Array, ""]:
    """The quotient, or near zero its power series in the square of the angle."""
    value = jnp.zeros(())
    for coefficient in reversed(series):
        value = value * square + coefficient
    return jnp.where(square < _SERIES_BELOW, value, quotient)
