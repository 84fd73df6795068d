"""Derivatives of the kinematics with respect to the error state, written out.

Automatic differentiation of `kinematics.propagate` and `kinematics.innovation` gives the same
matrices (a test holds both together). Written out they are a tenth of the operations: most of the
39 columns are zero or one, which a compiler is not told.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Float

from gcs_sysid import frames
from gcs_sysid.frames import Array
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
    air_velocity,
    corrected,
    innovation,
    part,
    propagate,
    shifted,
)
from gcs_sysid.model.rotation_jacobians import inverse_left_jacobian, matrix, right_jacobian, skew

MOVING = 6
"""Rows of attitude and velocity: all others only decay."""

Sensitivity = Mapping[str, Float[Array, "_ _"]]
"""Derivative of something by blocks of the error state; blocks left out do not act on it."""


class Transition(NamedTuple):
    """Derivative of the error after a step by the error before: F = [moving; diag(kept)].

    Attributes:
        moving: rows of attitude and velocity.
        kept: factors of all other rows.
    """

    moving: Float[Array, "moving state"]
    kept: Float[Array, " other"]

    def dense(self) -> Float[Array, "state state"]:
        """The whole matrix."""
        return jnp.concatenate([self.moving, self.kept[:, None] * jnp.eye(SIZE)[MOVING:]])

    def times(self, right: Float[Array, "state column"]) -> Float[Array, "state column"]:
        """Product with a matrix on its right."""
        return jnp.concatenate([self.moving @ right, self.kept[:, None] * right[MOVING:]])

    def carried(self, covariance: Float[Array, "state state"]) -> Float[Array, "state state"]:
        """F P Fᵀ."""
        return self.times(self.times(covariance).T)


def transition(
    state: State, before: Imu, after: Imu, step: Float[Array, ""], noise: Noise
) -> tuple[State, Transition]:
    """Propagated state and the Jacobian of its error with respect to the error before."""
    mean = Imu(0.5 * (before.gyro + after.gyro), 0.5 * (before.accelerometer + after.accelerometer))
    rate, force = corrected(mean, state.rest)
    whole, half = step * rate, 0.5 * step * rate
    attitude, middle = matrix(state.attitude), matrix(frames.exponential(half))
    turn = {
        "attitude": matrix(frames.exponential(whole)).T,
        **_times(step * right_jacobian(whole), _of_rate(rate, state)),
    }
    velocity = {
        "attitude": -step * attitude @ skew(middle @ force),
        "velocity": jnp.eye(3),
        **_times(
            -0.5 * step**2 * attitude @ middle @ skew(force) @ right_jacobian(half),
            _of_rate(rate, state),
        ),
        **_times(step * attitude @ middle, _of_force(force, state)),
    }
    moving = jnp.concatenate([_row(turn), _row(velocity)])
    kept = jnp.ones(SIZE)
    kept = kept.at[BLOCKS["gust"]].set(jnp.exp(-step / noise.gust_time))
    kept = kept.at[BLOCKS["attitude_error"]].set(jnp.exp(-step / noise.attitude_error_time))
    return propagate(state, before, after, step, noise), Transition(moving, kept[MOVING:])


def linearised(
    state: State,
    imu: Imu,
    measured: Measurements,
    levers: Levers,
    groups: Collection[str] = MEASURED.keys(),
) -> tuple[Float[Array, " row"], Float[Array, "row state"]]:
    """Innovation and the Jacobian of the expected measurement (minus that of the innovation).

    Vanes are not asked about a gust along the flight path: see `_across`. Arguments are those of
    `kinematics.innovation`.
    """
    rest = state.rest
    rate = corrected(imu, rest).gyro
    residual = innovation(state, imu, measured, levers, groups)

    def moved(group: int, name: str) -> _Moved:
        return _moved(state, imu, measured.age[group], f"{name}_delay")

    def airspeed() -> Sensitivity:
        pitot, scale = moved(0, "airspeed"), part(rest, "airspeed_scale")
        along = (1.0 + scale)[:, None] * jnp.eye(1, 3)
        return {
            **_times(along, _of_flow(pitot, rate, levers.pitot)),
            "airspeed_scale": _without_gust(pitot, rate, levers.pitot)[:1, None],
        }

    def velocity() -> Sensitivity:
        return _of_ground_velocity(moved(1, "velocity"), rate, levers.velocity)

    def attitude() -> Sensitivity:
        source = moved(2, "attitude")
        error, offset = part(rest, "attitude_error"), part(rest, "attitude_offset")
        ahead = inverse_left_jacobian(residual[MEASURED["attitude"]])
        mounted = ahead @ matrix(frames.exponential(offset)).T
        return {
            **_times(mounted, source.turn),
            "attitude_error": mounted @ matrix(source.state.attitude).T @ right_jacobian(error),
            "attitude_offset": ahead @ right_jacobian(offset),
        }

    def vanes() -> Sensitivity:
        angles, scale = moved(3, "vane"), part(rest, "vane_scale")
        across = (1.0 + scale)[:, None] * jnp.eye(2, 3, 1)
        turned = _times(across, _of_flow(angles, rate, levers.vanes))
        return {
            **turned,
            "gust": _across(turned["gust"], state),
            "vane_bias": jnp.eye(2),
            "vane_scale": jnp.diag(_without_gust(angles, rate, levers.vanes)[1:]),
        }

    each = {"airspeed": airspeed, "velocity": velocity, "attitude": attitude, "vanes": vanes}
    rows = [
        _row(each[name]()) if name in groups else jnp.zeros((where.stop - where.start, SIZE))
        for name, where in MEASURED.items()
    ]
    return residual, jnp.concatenate(rows)


def flow_sensitivity(
    state: State, imu: Imu, lever: Float[Array, " axis"]
) -> Float[Array, "three state"]:
    """Derivative of `kinematics.flow`: airspeed, angle of attack and sideslip at a point."""
    rate = corrected(imu, state.rest).gyro
    now = _Moved(state, {"attitude": jnp.eye(3)}, {"velocity": jnp.eye(3)}, _of_rate(rate, state))
    return _row(_of_flow(now, rate, lever))


class _Moved(NamedTuple):
    """The state some time away, and how it changes with the error state.

    Attributes:
        state: see `kinematics.shifted`.
        turn: rotation in its own axes.
        velocity: velocity over ground.
        rate: angular rate, sensor errors off.
    """

    state: State
    turn: Sensitivity
    velocity: Sensitivity
    rate: Sensitivity


def _moved(state: State, imu: Imu, age: Float[Array, ""], delay: str) -> _Moved:
    """State `age` less the delay away."""
    shift = age - part(state.rest, delay)[0]
    rate, force = corrected(imu, state.rest)
    attitude = matrix(state.attitude)
    turn = shift * rate
    by_rate = _of_rate(rate, state)
    return _Moved(
        shifted(state, imu, shift),
        {
            "attitude": matrix(frames.exponential(turn)).T,
            **_times(shift * right_jacobian(turn), by_rate),
            delay: -rate[:, None],
        },
        {
            "attitude": -shift * attitude @ skew(force),
            "velocity": jnp.eye(3),
            **_times(shift * attitude, _of_force(force, state)),
            delay: -(attitude @ force + jnp.array([0.0, 0.0, GRAVITY]))[:, None],
        },
        by_rate,
    )


def _of_rate(rate: Float[Array, " axis"], state: State) -> Sensitivity:
    """Derivative of the rate, sensor errors off."""
    share = 1.0 / (1.0 + part(state.rest, "gyro_scale"))
    return {"gyro_bias": -jnp.diag(share), "gyro_scale": -jnp.diag(share * rate)}


def _of_force(force: Float[Array, " axis"], state: State) -> Sensitivity:
    """Derivative of the specific force, sensor errors off."""
    share = 1.0 / (1.0 + part(state.rest, "accelerometer_scale"))
    return {
        "accelerometer_bias": -jnp.diag(share),
        "accelerometer_scale": -jnp.diag(share * force),
    }


def _of_ground_velocity(
    moved: _Moved, rate: Float[Array, " axis"], lever: Float[Array, " axis"]
) -> dict[str, Array]:
    """Derivative of the velocity over ground of a point `lever` away."""
    attitude = matrix(moved.state.attitude)
    return _sum(
        moved.velocity,
        _times(-attitude @ skew(frames.cross(rate, lever)), moved.turn),
        _times(-attitude @ skew(lever), moved.rate),
    )


def _of_flow(
    moved: _Moved, rate: Float[Array, " axis"], lever: Float[Array, " axis"]
) -> Sensitivity:
    """Derivative of airspeed, angle of attack, sideslip at a point `lever` away."""
    to_body = matrix(moved.state.attitude).T
    centre = air_velocity(moved.state, jnp.zeros(3), lever)
    here = centre + frames.cross(rate, lever)
    velocity = _sum(
        _times(skew(centre), moved.turn),
        _times(to_body, {**moved.velocity, "wind": -jnp.eye(3), "gust": -jnp.eye(3)}),
        _times(-skew(lever), moved.rate),
    )
    u, v, w = here
    along = u * u + w * w
    speed = jnp.sqrt(along + v * v)
    gradient = jnp.stack(
        [
            here / speed,
            jnp.stack([-w, jnp.zeros(()), u]) / along,
            (jnp.array([0.0, 1.0, 0.0]) - v * here / speed**2) / jnp.sqrt(along),
        ]
    )
    return _times(gradient, velocity)


def _without_gust(
    moved: _Moved, rate: Float[Array, " axis"], lever: Float[Array, " axis"]
) -> Float[Array, " three"]:
    """Flow as it were without the gust: what the sensors' scales learn from."""
    calm = moved.state._replace(rest=moved.state.rest.at[BLOCKS["gust"]].set(0.0))
    return jnp.stack(frames.flow_angles(air_velocity(calm, rate, lever)))


def _across(by_gust: Float[Array, "row axis"], state: State) -> Float[Array, "row axis"]:
    """Derivative by the gust without the gust's part along the horizontal flight path.

    A vane tells of such a gust by how far it turns when the aircraft climbs or slips. How far it
    seems to turn is what gusts feign, by more than the flight can tell airspeed from it: unseen
    gusts are in the motion already (`reconstruct.vane_scale`). The pitot tube tells of it directly.
    """
    through_air = part(state.rest, "velocity") - part(state.rest, "wind") - part(state.rest, "gust")
    level = through_air.at[2].set(0.0)
    ahead = level / jnp.sqrt(jnp.sum(level * level))
    return by_gust - jnp.outer(by_gust @ ahead, ahead)


def _times(left: Float[Array, "row middle"], right: Sensitivity) -> dict[str, Array]:
    return {name: left @ values for name, values in right.items()}


def _sum(*parts: Sensitivity) -> dict[str, Array]:
    total: dict[str, Array] = {}
    for sensitivity in parts:
        for name, values in sensitivity.items():
            total[name] = total[name] + values if name in total else values
    return total


def _row(sensitivity: Sensitivity) -> Float[Array, "row state"]:
    """As a matrix over the whole error state."""
    rows = next(iter(sensitivity.values())).shape[0]
    return jnp.concatenate(
        [
            sensitivity.get(name, jnp.zeros((rows, where.stop - where.start)))
            for name, where in BLOCKS.items()
        ],
        axis=1,
    )
