"""Rotations between body axes (x forward, y right, z down) and north-east-down.

Every function takes NumPy or JAX arrays alike and answers in kind. A quaternion is scalar first and
turns body vectors into NED ones; Euler angles are roll, pitch, yaw in the z-y-x order of flight
mechanics (Stevens, Lewis & Johnson, *Aircraft Control and Simulation*, 3rd ed. 2015, section 1.3).
Axes marked `#` broadcast: one mounting turns a whole flight.
"""

from __future__ import annotations

from typing import Any

from jaxtyping import Float

Array = Any
"""A NumPy or JAX array."""


def quaternion_from_euler(angles: Float[Array, "*batch axis"]) -> Float[Array, "*batch four"]:
    """Quaternion of roll, pitch, yaw [rad]."""
    xp = angles.__array_namespace__()
    half = 0.5 * angles
    c, s = xp.cos(half), xp.sin(half)
    cr, cp, cy = c[..., 0], c[..., 1], c[..., 2]
    sr, sp, sy = s[..., 0], s[..., 1], s[..., 2]
    return xp.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=-1,
    )


def euler_from_quaternion(quaternion: Float[Array, "*batch four"]) -> Float[Array, "*batch axis"]:
    """Roll, pitch, yaw [rad]; roll and yaw in (-π, π], pitch in [-π/2, π/2]."""
    xp = quaternion.__array_namespace__()
    w, x, y, z = (quaternion[..., i] for i in range(4))
    return xp.stack(
        [
            xp.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            xp.asin(xp.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
            xp.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        ],
        axis=-1,
    )


def multiply(first: Float[Array, "*#batch four"], second: Float[Array, "*#batch four"]) -> Array:
    """Hamilton product: the rotation `second`, then `first`."""
    xp = first.__array_namespace__()
    a, b, c, d = (first[..., i] for i in range(4))
    w, x, y, z = (second[..., i] for i in range(4))
    return xp.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        axis=-1,
    )


def conjugate(quaternion: Float[Array, "*batch four"]) -> Float[Array, "*batch four"]:
    """The inverse rotation."""
    xp = quaternion.__array_namespace__()
    return xp.concat([quaternion[..., :1], -quaternion[..., 1:]], axis=-1)


def exponential(rotation: Float[Array, "*batch axis"]) -> Float[Array, "*batch four"]:
    """Quaternion of a rotation vector [rad].

    sin(x)/x by its series near zero keeps value and derivative finite there.
    """
    xp = rotation.__array_namespace__()
    square = 0.25 * xp.sum(rotation * rotation, axis=-1, keepdims=True)
    small = square < 1e-8
    half = xp.sqrt(xp.where(small, xp.ones_like(square), square))
    cosine = xp.where(small, 1.0 - square / 2.0 + square * square / 24.0, xp.cos(half))
    cardinal = xp.where(small, 1.0 - square / 6.0 + square * square / 120.0, xp.sin(half) / half)
    return xp.concat([cosine, 0.5 * cardinal * rotation], axis=-1)


def logarithm(quaternion: Float[Array, "*batch four"]) -> Float[Array, "*batch axis"]:
    """Rotation vector [rad] of a quaternion, of length at most π; inverse of `exponential`."""
    xp = quaternion.__array_namespace__()
    sign = xp.where(quaternion[..., :1] < 0.0, -1.0, 1.0)
    scalar, vector = sign * quaternion[..., :1], sign * quaternion[..., 1:]
    square = xp.sum(vector * vector, axis=-1, keepdims=True)
    small = square < 1e-14
    length = xp.sqrt(xp.where(small, xp.ones_like(square), square))
    factor = xp.where(small, 2.0 / scalar, 2.0 * xp.atan2(length, scalar) / length)
    return factor * vector


def rotate(quaternion: Float[Array, "*#batch four"], body: Float[Array, "*#batch axis"]) -> Array:
    """Body vector into NED."""
    scalar, vector = quaternion[..., :1], quaternion[..., 1:]
    turned = 2.0 * cross(vector, body)
    return body + scalar * turned + cross(vector, turned)


def unrotate(quaternion: Float[Array, "*#batch four"], ned: Float[Array, "*#batch axis"]) -> Array:
    """NED vector into body axes."""
    return rotate(conjugate(quaternion), ned)


def cross(first: Float[Array, "*#batch axis"], second: Float[Array, "*#batch axis"]) -> Array:
    """Vector product over the last axis, with broadcasting."""
    xp = first.__array_namespace__()
    a, b, c = (first[..., i] for i in range(3))
    x, y, z = (second[..., i] for i in range(3))
    return xp.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=-1)


def flow_angles(velocity: Float[Array, "*batch axis"]) -> tuple[Array, Array, Array]:
    """True airspeed [m/s], angle of attack and sideslip [rad] of an air-relative body velocity.

    α = atan2(w, u), β = asin(v/V) (Klein & Morelli, *Aircraft System Identification*, 2006, eq.
    3.34).
    """
    xp = velocity.__array_namespace__()
    u, v, w = (velocity[..., i] for i in range(3))
    airspeed = xp.sqrt(u * u + v * v + w * w)
    return airspeed, xp.atan2(w, u), xp.asin(v / airspeed)


def wrap(angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """The same angle in [-π, π) [rad]."""
    xp = angle.__array_namespace__()
    return xp.remainder(angle + xp.pi, 2.0 * xp.pi) - xp.pi
