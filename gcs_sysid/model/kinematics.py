"""Rigid-body kinematics in a moving air mass, with the errors of the sensors that watch it.

No aerodynamics: specific force and angular rate are inputs, as the inertial unit measures them, so
what comes out is independent of any belief about the aircraft (data compatibility; Klein & Morelli,
*Aircraft System Identification*, 2006, chapter 10). With q the attitude, v the velocity over ground
of the inertial unit, ω and f the corrected rate and specific force:

    q̇ = ½ q ⊗ (0, ω)        v̇ = R(q) f + g        u = R(q)ᵀ (v − w − d)

w is the steady wind, d the gust, u the air-relative velocity at the inertial unit. Carrying the
velocity of the *inertial unit* rather than of the centre of gravity makes the lever arm exact
without an angular acceleration: a point r away moves with u + ω × r. Over ground it moves with
v + R(q)(ω × r): navigation filters report the velocity of such a point, the aircraft's own, having
taken off where their sensors sit.

The error state is additive but for the attitude, whose error δθ turns the body axes: q ⊗ exp(δθ).

An autopilot's attitude errs in two ways: e drifts and stays with the ground while the aircraft
turns (heading, and the vertical that accelerations mislead), o is how its axes are mounted against
the inertial unit's. What it reports is exp(e) ⊗ q ⊗ exp(o). Taking e for an error of the body axes
instead, the filter believes every roll to prove the heading right.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from gcs_sysid import frames
from gcs_sysid.frames import Array

GRAVITY = 9.80665

BLOCKS: dict[str, slice] = {
    "attitude": slice(0, 3),
    "velocity": slice(3, 6),
    "wind": slice(6, 9),
    "gust": slice(9, 12),
    "accelerometer_bias": slice(12, 15),
    "gyro_bias": slice(15, 18),
    "attitude_error": slice(18, 21),
    "airspeed_scale": slice(21, 22),
    "vane_bias": slice(22, 24),
    "vane_scale": slice(24, 26),
    "airspeed_delay": slice(26, 27),
    "velocity_delay": slice(27, 28),
    "attitude_delay": slice(28, 29),
    "vane_delay": slice(29, 30),
    "gyro_scale": slice(30, 33),
    "accelerometer_scale": slice(33, 36),
    "attitude_offset": slice(36, 39),
}
"""Where each part of the error state lies."""

SIZE = 39
MEASURED: dict[str, slice] = {
    "airspeed": slice(0, 1),
    "velocity": slice(1, 4),
    "attitude": slice(4, 7),
    "vanes": slice(7, 9),
}
"""Rows of the measurement vector, one group for each kind of message."""


class State(NamedTuple):
    """Attitude quaternion and the additive rest (rows `attitude` of `rest` stay zero)."""

    attitude: Float[Array, " four"]
    rest: Float[Array, " state"]


class Imu(NamedTuple):
    """One sample of the inertial unit: rate [rad/s], specific force [m/s²]."""

    gyro: Float[Array, " axis"]
    accelerometer: Float[Array, " axis"]


class Levers(NamedTuple):
    """Positions relative to the inertial unit [m].

    Attributes:
        pitot: of the pitot tube.
        vanes: of the flow vanes.
        velocity: of the point whose velocity over ground is measured.
    """

    pitot: Float[Array, " axis"]
    vanes: Float[Array, " axis"]
    velocity: Float[Array, " axis"]


class Noise(NamedTuple):
    """Intensities, all one standard deviation.

    Attributes:
        gyro: white noise of a sample [rad/s].
        accelerometer: white noise of a sample [m/s²].
        gyro_change: random walk that the rate makes between samples [rad/s/√s].
        accelerometer_change: the same of the specific force [m/s²/√s].
        accelerometer_drift: random walk of the bias [m/s²/√s].
        gyro_drift: random walk of the bias [rad/s/√s].
        wind_drift: random walk of the steady wind toward north, east, down [m/s/√s].
        gust: standard deviation of the gust toward north, east, down [m/s].
        gust_time: correlation time of the gust [s].
        attitude_error: slow error of the attitude source, a turn about north, east, down [rad].
        attitude_error_time: its correlation time [s].
        measured: white noise of the measurement rows, in the order of `MEASURED`.
    """

    gyro: Float[Array, ""]
    accelerometer: Float[Array, ""]
    gyro_change: Float[Array, ""]
    accelerometer_change: Float[Array, ""]
    accelerometer_drift: Float[Array, ""]
    gyro_drift: Float[Array, ""]
    wind_drift: Float[Array, " axis"]
    gust: Float[Array, " axis"]
    gust_time: Float[Array, ""]
    attitude_error: Float[Array, " axis"]
    attitude_error_time: Float[Array, ""]
    measured: Float[Array, " row"]


class Measurements(NamedTuple):
    """What arrived since the last step of the filter, group by group (see `MEASURED`).

    Attributes:
        airspeed: true airspeed indicated [m/s].
        velocity: velocity over ground, NED [m/s].
        attitude: quaternion, body to NED.
        vanes: angle of attack and sideslip indicated [rad].
        valid: which groups arrived.
        age: time of each group's sample less the time of the state [s].
    """

    airspeed: Float[Array, " one"]
    velocity: Float[Array, " axis"]
    attitude: Float[Array, " four"]
    vanes: Float[Array, " two"]
    valid: Bool[Array, " group"]
    age: Float[Array, " group"]


def part(rest: Float[Array, "*batch state"], name: str) -> Float[Array, "*batch size"]:
    """One block of the error state."""
    return rest[..., BLOCKS[name]]


def compose(state: State, error: Float[Array, " state"]) -> State:
    """The state that differs from `state` by an error state."""
    return State(
        frames.multiply(state.attitude, frames.exponential(error[:3])),
        state.rest + error.at[:3].set(0.0),
    )


def difference(first: State, second: State) -> Float[Array, " state"]:
    """Error state by which `first` differs from `second`; inverse of `compose`."""
    turn = frames.logarithm(frames.multiply(frames.conjugate(second.attitude), first.attitude))
    return (first.rest - second.rest).at[:3].set(turn)


def corrected(imu: Imu, rest: Float[Array, " state"]) -> Imu:
    """Rate and specific force with bias and scale of the sensors taken off."""
    return Imu(
        (imu.gyro - part(rest, "gyro_bias")) / (1.0 + part(rest, "gyro_scale")),
        (imu.accelerometer - part(rest, "accelerometer_bias"))
        / (1.0 + part(rest, "accelerometer_scale")),
    )


def propagate(state: State, before: Imu, after: Imu, step: Float[Array, ""], noise: Noise) -> State:
    """State one step later; rate and specific force as the mean of the samples at both ends.

    Turning the specific force with the attitude of mid step makes the scheme second order.
    """
    mean = Imu(0.5 * (before.gyro + after.gyro), 0.5 * (before.accelerometer + after.accelerometer))
    rate, force = corrected(mean, state.rest)
    middle = frames.multiply(state.attitude, frames.exponential(0.5 * step * rate))
    attitude = frames.multiply(state.attitude, frames.exponential(step * rate))
    attitude = attitude / jnp.sqrt(jnp.sum(attitude * attitude))
    gravity = jnp.array([0.0, 0.0, GRAVITY])
    velocity = part(state.rest, "velocity") + step * (frames.rotate(middle, force) + gravity)
    rest = state.rest.at[BLOCKS["velocity"]].set(velocity)
    rest = rest.at[BLOCKS["gust"]].multiply(jnp.exp(-step / noise.gust_time))
    rest = rest.at[BLOCKS["attitude_error"]].multiply(jnp.exp(-step / noise.attitude_error_time))
    return State(attitude, rest)


def process_covariance(step: Float[Array, ""], noise: Noise) -> Float[Array, " state"]:
    """Diagonal of the process noise over one step.

    White sensor noise is held over the step: an angle grows by σ·dt. What the motion does between
    two samples, of which only the ends are known, is a Brownian bridge: its integral has the
    variance change²·dt³/12, nothing at full rate and much across a hole in the telemetry. Gust and
    attitude error are first-order Gauss–Markov processes kept at their own variance.
    """
    ones = jnp.ones(3)
    between = step**3 / 12.0
    kept = 1.0 - jnp.exp(-2.0 * step / noise.gust_time)
    slow = 1.0 - jnp.exp(-2.0 * step / noise.attitude_error_time)
    return jnp.concatenate(
        [
            ((noise.gyro * step) ** 2 + noise.gyro_change**2 * between) * ones,
            ((noise.accelerometer * step) ** 2 + noise.accelerometer_change**2 * between) * ones,
            noise.wind_drift**2 * step,
            noise.gust**2 * kept,
            noise.accelerometer_drift**2 * step * ones,
            noise.gyro_drift**2 * step * ones,
            noise.attitude_error**2 * slow,
            jnp.zeros(SIZE - 21),
        ]
    )


def air_velocity(
    state: State, rate: Float[Array, " axis"], lever: Float[Array, " axis"]
) -> Float[Array, " axis"]:
    """Velocity relative to the air of a point `lever` away from the inertial unit, body axes."""
    through_air = part(state.rest, "velocity") - part(state.rest, "wind") - part(state.rest, "gust")
    return frames.unrotate(state.attitude, through_air) + frames.cross(rate, lever)


def ground_velocity(
    state: State, rate: Float[Array, " axis"], lever: Float[Array, " axis"]
) -> Float[Array, " axis"]:
    """Velocity over ground, NED, of a point `lever` away from the inertial unit."""
    swing = frames.rotate(state.attitude, frames.cross(rate, lever))
    return part(state.rest, "velocity") + swing


def shifted(state: State, imu: Imu, shift: Float[Array, ""]) -> State:
    """State `shift` seconds away, to first order in the shift."""
    rate, force = corrected(imu, state.rest)
    gravity = jnp.array([0.0, 0.0, GRAVITY])
    acceleration = frames.rotate(state.attitude, force) + gravity
    return State(
        frames.multiply(state.attitude, frames.exponential(shift * rate)),
        state.rest.at[BLOCKS["velocity"]].add(shift * acceleration),
    )


def _indicated(
    state: State,
    rate: Float[Array, " axis"],
    lever: Float[Array, " axis"],
    scale: Float[Array, " three"],
) -> Float[Array, " three"]:
    """Airspeed and flow angles at a sensor, each with its `scale` error.

    The scale learns from the flow without the gust only. Its product with the gust would teach it
    to grow: a gust half as large through a sensor twice as sensitive looks the same and is far more
    likely, and the filter's linearisation misses the determinant that makes up for it. What the
    inertial motion foretells is an instrument that gusts do not know (Söderström & Stoica 1983).
    """
    flow = jnp.stack(frames.flow_angles(air_velocity(state, rate, lever)))
    calm = state._replace(rest=state.rest.at[BLOCKS["gust"]].set(0.0))
    still = jnp.stack(frames.flow_angles(air_velocity(calm, rate, lever)))
    return (1.0 + scale) * still + (1.0 + jax.lax.stop_gradient(scale)) * (flow - still)


def innovation(
    state: State,
    imu: Imu,
    measured: Measurements,
    levers: Levers,
    groups: Collection[str] = MEASURED.keys(),
) -> Float[Array, " row"]:
    """Measured minus expected; rows of absent groups are meaningless.

    A sample describes the aircraft `delay` before its stamp. Angles of the attitude are the
    rotation vector from expected to measured, so no angle ever wraps.

    Args:
        state: of the aircraft.
        imu: inertial sample of that time.
        measured: what arrived.
        levers: positions of the sensors.
        groups: what is asked about; rows of the others are zero.
    """
    rest = state.rest
    rate = corrected(imu, rest).gyro
    scales = jnp.concatenate([part(rest, "airspeed_scale"), part(rest, "vane_scale")])

    def at(group: int, delay: str) -> State:
        return shifted(state, imu, measured.age[group] - part(rest, delay)[0])

    def airspeed() -> Array:
        speed = _indicated(at(0, "airspeed_delay"), rate, levers.pitot, scales)
        return measured.airspeed - speed[:1]

    def velocity() -> Array:
        tracked = at(1, "velocity_delay")
        return measured.velocity - ground_velocity(tracked, rate, levers.velocity)

    def attitude() -> Array:
        drifted = frames.multiply(
            frames.exponential(part(rest, "attitude_error")), at(2, "attitude_delay").attitude
        )
        expected = frames.multiply(drifted, frames.exponential(part(rest, "attitude_offset")))
        return frames.logarithm(frames.multiply(frames.conjugate(expected), measured.attitude))

    def vanes() -> Array:
        angles = _indicated(at(3, "vane_delay"), rate, levers.vanes, scales)[1:]
        return measured.vanes - angles - part(rest, "vane_bias")

    each = {"airspeed": airspeed, "velocity": velocity, "attitude": attitude, "vanes": vanes}
    return jnp.concatenate(
        [
            each[name]() if name in groups else jnp.zeros(rows.stop - rows.start)
            for name, rows in MEASURED.items()
        ]
    )


def flow(state: State, imu: Imu, lever: Float[Array, " axis"]) -> Float[Array, " three"]:
    """True airspeed [m/s], angle of attack and sideslip [rad] at a point off the inertial unit."""
    rate = corrected(imu, state.rest).gyro
    return jnp.stack(frames.flow_angles(air_velocity(state, rate, lever)))
