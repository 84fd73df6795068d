"""One row of the aided filter, linear about a nominal flight, and the noise that comes with it.

e(k) = Φ e(k−1) + offset + w. The transition Φ is the exponential of the Jacobian in the middle of
the step; white noise enters all along the step.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.frames import Array
from gcs_sysid.model import aided_step, air, departures
from gcs_sysid.model.aided import (
    AIRSPEED_TIME,
    BLOCKS,
    GYRO_TIME,
    MOVING,
    PUSH_TIME,
    ROW_COUNT,
    ROWS,
    SIZE,
    Means,
    Noise,
    Row,
    State,
    advance,
    changing,
    compose,
    difference,
    filling,
    innovation,
    of_axes,
    tube_lag,
)
from gcs_sysid.model.air import Air, Turbulence

UNBELIEVED = 3.0
"""White noise of acceleration and angular acceleration where the equations are not to be believed
[m/s²/√Hz, rad/s²/√Hz]: what a maneuver reaches within a second."""
ATTITUDE_FLOOR = 2e-4
"""Of white noise of an attitude [rad]: less than a millisecond of its stamp in a lively turn."""


class Linearised(NamedTuple):
    """A step and its measurements, linear in the deviation e from a nominal flight.

    e(k) = transition · e(k−1) + offset + w,  w ~ N(0, process);  residual = sensitivity · e + v.
    Absent rows of the residual are zero with unit `variance`.
    """

    transition: Float[Array, "*sample state state"]
    offset: Float[Array, "*sample state"]
    process: Float[Array, "*sample state state"]
    sensitivity: Float[Array, "*sample row state"]
    residual: Float[Array, "*sample row"]
    variance: Float[Array, "*sample row"]
    present: Bool[Array, "*sample row"]


def present_rows(row: Row) -> Bool[Array, " row"]:
    """Which rows of the innovation were measured."""
    flags = (row.inertial, row.inertial & row.modelled, *row.measured.valid)
    parts = zip(flags, ROWS.values(), strict=True)
    return jnp.concatenate([jnp.full(part.stop - part.start, flag) for flag, part in parts])


def measurement_variance(noise: Noise) -> Float[Array, " row"]:
    """White noise variance of each row of the innovation."""
    level, down = noise.velocity
    tilt, heading = noise.attitude
    deviation = jnp.stack(
        [noise.gyro] * 3
        + [noise.accelerometer] * 3
        + [noise.airspeed, level, level, down, tilt, tilt, heading]
        + [noise.vanes] * 2
    )
    return (deviation**2).at[ROWS["attitude"]].add(ATTITUDE_FLOOR**2)


def driving(noise: Noise) -> Float[Array, "state state"]:
    """Spectral density D of the white noise that drives the states, where `passing` is 1."""
    shape = noise_shape(noise.turbulence)
    return (shape * process_density(noise)[None, :]) @ shape.T


def noise_shape(turbulence: Turbulence) -> Float[Array, "state state"]:
    """How white noises of `process_density` push the states: gusts turn the air as they come."""
    gust, spin = BLOCKS["gust"], BLOCKS["spin"]
    turned = air.field_axes(turbulence)
    shape = jnp.eye(SIZE).at[spin, gust].set(air.coupling_matrix(turbulence) @ turned)
    return shape.at[gust, gust].set(turned).at[spin, spin].set(turned)


def doubted(noise: Noise, modelled: Bool[Array, ""]) -> Noise:
    """Intensities of a row's step, whose equations are to be believed or not."""
    return noise._replace(
        force=jnp.where(modelled, noise.force, UNBELIEVED),
        moment=jnp.where(modelled, noise.moment, UNBELIEVED),
    )


def process_density(noise: Noise) -> Float[Array, " state"]:
    """Of each state's white noise where `passing` is 1, before gusts turn the air as well."""
    lasting = of_axes(noise.attitude_error_time)
    return jnp.concatenate(
        [
            jnp.zeros(3),
            jnp.full(3, 1.0) * noise.force**2,
            noise.moment**2,
            jnp.zeros(1),
            air.density(noise.turbulence, 1.0),
            of_axes(noise.attitude_error) ** 2 * (2.0 / lasting),
            noise.push[None] ** 2 * (2.0 / PUSH_TIME),
            jnp.full(3, noise.velocity_error**2 * (2.0 / noise.velocity_error_time)),
            noise.airspeed_error[None] ** 2 * (2.0 / AIRSPEED_TIME),
            jnp.full(3, noise.gyro_error**2 * (2.0 / GYRO_TIME)),
        ]
    )


def jacobian(
    aircraft: Aircraft, means: Means, state: State, row: Row, when: Int[Array, ""] | int
) -> Float[Array, "moving state"]:
    """Rate of change of the motion's errors with the error state, but for what decays by itself.

    Rows of the motion: nothing moves the others. Wind and gust act through the velocity through the
    air only, so that their columns come from those of the velocity over ground.
    """
    parts = ("attitude", "velocity", "rate", "spin")

    def moved(errors: Float[Array, " twelve"]) -> tuple[Array, Array]:
        error = jnp.zeros(SIZE)
        for name, part in zip(parts, jnp.split(errors, len(parts)), strict=True):
            error = error.at[BLOCKS[name]].set(part)
        at = compose(state, error)
        change, rate = changing(aircraft, means, at, row, when)
        tube = filling(aircraft, means, at, row, rate)
        return jnp.concatenate([rate, change.velocity, change.rate, tube]), rate

    found, rate = jax.jacfwd(moved, has_aux=True)(jnp.zeros(3 * len(parts)))
    columns = dict(zip(parts, jnp.split(found, len(parts), axis=1), strict=True))
    columns["gust"] = -columns["velocity"]
    columns["wind"] = columns["gust"] @ _grown(means, state, row)
    turning = jax.vmap(lambda axis: frames.cross(rate, axis), out_axes=1)(jnp.eye(3))
    columns["attitude"] -= _placed(turning, "attitude")
    forward = frames.rotate(state.attitude, jnp.array([1.0, 0.0, 0.0]))
    columns["push"] = _placed(forward[:, None], "velocity")
    columns["tube"] = _placed(-1.0 / tube_lag(aircraft, means.sensors)[None, None], "tube")
    return _side_by_side(columns, MOVING)


def _placed(rows: Float[Array, "row column"], name: str) -> Float[Array, "moving column"]:
    """Rows of a part of the motion, the others 0."""
    part = BLOCKS[name]
    return jnp.pad(rows, ((part.start, MOVING - part.stop), (0, 0)))


def _side_by_side(
    columns: Mapping[str, Float[Array, "row _"]], rows: int
) -> Float[Array, "row state"]:
    """A matrix from columns by block of the error state; 0 where there are none.

    Put together at once: set into zeros one by one they took as long as what they are made of.
    """
    none = {name: jnp.zeros((rows, part.stop - part.start)) for name, part in BLOCKS.items()}
    return jnp.concatenate([columns.get(name, none[name]) for name in BLOCKS], axis=1)


def _grown(means: Means, state: State, row: Row) -> Float[Array, "axis axis"]:
    """How the wind where the aircraft is changes with the steady wind below it."""
    by = means.departures
    if by is None:
        return jnp.eye(3)
    return jax.jacfwd(lambda wind: departures.sheared(wind, by, row.climbed))(state.air.wind)


def decay(noise: Noise) -> Float[Array, "slow slow"]:
    """How the air and the slow errors change by themselves, where `passing` is 1."""

    def change(values: Float[Array, " slow"]) -> Float[Array, " slow"]:
        ends = (3, 6, 9, 12, 15, 16, 19, 20)
        *blown, tilted, push, tracked, indicated, drifted = jnp.split(values, ends)
        moving = air.drift(Air(*blown), noise.turbulence, 1.0)
        tilted = tilted / of_axes(noise.attitude_error_time)
        tracked = tracked / noise.velocity_error_time
        felt = (indicated / AIRSPEED_TIME, drifted / GYRO_TIME)
        slow = (tilted, push / PUSH_TIME, tracked, *felt)
        return jnp.concatenate([*moving, *(-part for part in slow)])

    return jax.jacfwd(change)(jnp.zeros(SIZE - MOVING))


def _seen(
    aircraft: Aircraft, means: Means, state: State, row: Row
) -> tuple[Float[Array, "row state"], Float[Array, " row"]]:
    """Sensitivity of the expected measurements to an error state, and the innovation."""
    parts = ("attitude", "velocity", "rate", "tube", "spin", "attitude_error", "push")
    ends = np.cumsum([BLOCKS[name].stop - BLOCKS[name].start for name in parts]).tolist()

    def left(errors: Float[Array, " error"]) -> tuple[Array, Array]:
        error = jnp.zeros(SIZE)
        for name, part in zip(parts, jnp.split(errors, ends[:-1]), strict=True):
            error = error.at[BLOCKS[name]].set(part)
        found = innovation(aircraft, means, compose(state, error), row)
        return found, found

    found, residual = jax.jacfwd(left, has_aux=True)(jnp.zeros(ends[-1]))
    columns = dict(zip(parts, jnp.split(-found, ends[:-1], axis=1), strict=True))
    # Of the velocity over ground, all but its own measurement comes from the air.
    through = columns["velocity"].at[ROWS["velocity"]].add(-jnp.eye(3))
    columns["gust"] = -through
    columns["wind"] = columns["gust"] @ _grown(means, state, row)
    # Of the other errors, each is what its sensor tells too much.
    for name in ("gyro", "airspeed", "velocity"):
        columns[f"{name}_error"] = jnp.eye(ROW_COUNT)[:, ROWS[name]]
    return _side_by_side(columns, ROW_COUNT), residual


def mechanics(
    aircraft: Aircraft, means: Means, before: State, after: State, row: Row
) -> Float[Array, "moving state"]:
    """The motion's Jacobian in the middle of a step, but for what decays by itself."""
    return jacobian(aircraft, means, compose(before, 0.5 * difference(after, before)), row, 1)


def linearise(
    aircraft: Aircraft,
    means: Means,
    noise: Noise,
    before: State,
    after: State,
    row: Row,
    inner: Float[Array, "moving state"],
) -> Linearised:
    """One row about a nominal flight.

    Args:
        aircraft: what is looked up; its aerodynamic terms are those of `means`.
        means: derivatives and sensor errors.
        noise: intensities.
        before: nominal state at the step's beginning.
        after: nominal state at its end.
        row: the sample.
        inner: `mechanics` of the step.
    """
    half = aided_step.half(inner, decay(noise), row)
    # Both of all rows alike: where many rows are linearised at once they are worked out once.
    believed, not_believed = (driving(doubted(noise, jnp.asarray(flag))) for flag in (True, False))
    moved = advance(aircraft, means, noise, before, row)
    sensitivity, residual = _seen(aircraft, means, after, row)
    present = present_rows(row)
    return Linearised(
        transition=aided_step.whole(half),
        offset=difference(moved, after),
        process=aided_step.process(half, row, jnp.where(row.modelled, believed, not_believed)),
        sensitivity=jnp.where(present[:, None], sensitivity, 0.0),
        residual=jnp.where(present, residual, 0.0),
        variance=jnp.where(present, measurement_variance(noise), 1.0),
        present=present,
    )
