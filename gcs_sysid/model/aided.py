"""The flight model of the aided filter: rigid body with aerodynamics, moving air and sensors.

Where the kinematic model takes rate and specific force from the inertial unit as given, here they
are *measurements* of a motion that aerodynamics, thrust and gusts bring about. That is what tells
a gust from a motion without flow vanes: air that the aircraft did not feel cannot have been there.

State: attitude q, velocity v of the centre of gravity over ground, body rate ω, the air of `air`,
and the slow errors of the sources of attitude and velocity. The error state has 28 rows (`BLOCKS`),
additive but for the attitude, q ⊗ exp(δ). With u = R(q)ᵀ(v − w − g) and ω_air = ω − R(q)ᵀ s the
equations are those of `rigid_body`; a sensor at r from the centre of gravity feels

    f = (X + T)/m + ω̇ × r + ω × (ω × r)

Unmodelled forces and moments enter as white noise on v̇ and ω̇.
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
from gcs_sysid.atmosphere import GRAVITY
from gcs_sysid.frames import Array
from gcs_sysid.model import air, departures, rigid_body, runge_kutta
from gcs_sysid.model.air import Air, Turbulence
from gcs_sysid.model.departures import Departures
from gcs_sysid.model.kinematics import Measurements

BLOCKS: dict[str, slice] = {
    "attitude": slice(0, 3),
    "velocity": slice(3, 6),
    "rate": slice(6, 9),
    "wind": slice(9, 12),
    "gust": slice(12, 15),
    "spin": slice(15, 18),
    "memory": slice(18, 21),
    "attitude_error": slice(21, 24),
    "push": slice(24, 25),
    "velocity_error": slice(25, 28),
}
"""Where each part of the error state lies."""
SIZE = 28
ERRORS = ("attitude_error", "push", "velocity_error")
"""Parts of the state that are errors of what is measured or known."""
ROWS: dict[str, slice] = {
    "gyro": slice(0, 3),
    "accelerometer": slice(3, 6),
    "airspeed": slice(6, 7),
    "velocity": slice(7, 10),
    "attitude": slice(10, 13),
    "vanes": slice(13, 15),
}
"""Rows of the innovation."""
ROW_COUNT = 15
MOVING = BLOCKS["wind"].start
"""The states of the aircraft's motion are those before this one; they feel the others, which go
their own way."""
UNBELIEVED = 3.0
"""White noise of acceleration and angular acceleration where the equations are not to be believed
[m/s²/√Hz, rad/s²/√Hz]: what a maneuver reaches within a second."""
ATTITUDE_FLOOR = 2e-4
"""Of white noise of an attitude [rad]: less than a millisecond of its stamp in a lively turn."""
PUSH_TIME = 2.0
"""Correlation time of the thrust map's error [s]: that of throttle and airspeed."""


class State(NamedTuple):
    """Motion, air, and attitude error.

    Attributes:
        attitude: quaternion, body to NED.
        velocity: of the centre of gravity over ground, NED [m/s].
        rate: inertial, body axes, as it would be if moments did not lag [rad/s].
        air: the moving air.
        attitude_error: by which the attitude source is turned, level axes [rad].
        push: acceleration along x that the thrust maps do not know [m/s²].
        velocity_error: by which the velocity source is off for seconds, NED [m/s].
    """

    attitude: Float[Array, "*batch four"]
    velocity: Float[Array, "*batch axis"]
    rate: Float[Array, "*batch axis"]
    air: Air
    attitude_error: Float[Array, "*batch axis"]
    push: Float[Array, "*batch one"]
    velocity_error: Float[Array, "*batch axis"]


class Sensors(NamedTuple):
    """Errors of the sensors, constant over a flight.

    Attributes:
        gyro_bias: [rad/s].
        accelerometer_bias: [m/s²].
        airspeed_scale: indicated = (1 + scale)·true.
        vane_bias: of angle of attack and sideslip [rad].
        vane_scale: likewise [1].
        surface_delay: of the surfaces behind the servo commands as given [s].
        moment_lag: of the aerodynamic moments behind the motion that causes them: the wake of a
            real wing, the step of a simulation [s].
        airspeed_delay: how long before its stamp a sample describes the aircraft [s].
        velocity_delay: likewise.
        attitude_delay: likewise.
        vane_delay: likewise.
    """

    gyro_bias: Float[Array, " axis"]
    accelerometer_bias: Float[Array, " axis"]
    airspeed_scale: Float[Array, ""]
    vane_bias: Float[Array, " two"]
    vane_scale: Float[Array, " two"]
    surface_delay: Float[Array, ""]
    moment_lag: Float[Array, ""]
    airspeed_delay: Float[Array, ""]
    velocity_delay: Float[Array, ""]
    attitude_delay: Float[Array, ""]
    vane_delay: Float[Array, ""]


class Means(NamedTuple):
    """Everything that the expected measurements depend on.

    Attributes:
        aerodynamics: value of every term by coefficient and regressor key.
        sensors: their errors.
        departures: from the rest of the aircraft file; None where that is taken as it is.
    """

    aerodynamics: Mapping[str, Mapping[str, Float[Array, ""]]]
    sensors: Sensors
    departures: Departures | None = None


class Noise(NamedTuple):
    """Intensities, all one standard deviation.

    Attributes:
        turbulence: of the air.
        force: white noise of the acceleration [m/s²/√Hz].
        moment: of the angular acceleration about each axis [rad/s²/√Hz].
        attitude_error: slow error of the attitude source, tilt and heading [rad].
        attitude_error_time: its correlation times [s].
        push: error of the thrust maps [m/s²].
        velocity_error: slow error of the velocity source [m/s].
        velocity_error_time: its correlation time [s].
        gyro: white noise of a sample [rad/s].
        accelerometer: likewise [m/s²].
        airspeed: likewise [m/s].
        velocity: likewise, horizontal and vertical [m/s].
        attitude: likewise, tilt and heading [rad].
        vanes: likewise [rad].
    """

    turbulence: Turbulence
    force: Float[Array, ""]
    moment: Float[Array, " axis"]
    attitude_error: Float[Array, " two"]
    attitude_error_time: Float[Array, " two"]
    push: Float[Array, ""]
    velocity_error: Float[Array, ""]
    velocity_error_time: Float[Array, ""]
    gyro: Float[Array, ""]
    accelerometer: Float[Array, ""]
    airspeed: Float[Array, ""]
    velocity: Float[Array, " two"]
    attitude: Float[Array, " two"]
    vanes: Float[Array, ""]


class Row(NamedTuple):
    """One sample: the step that leads to it, and what was measured at its end.

    Attributes:
        step: length of the step [s]; 0 for the first row and for padding.
        controls: at a step's beginning, middle, end (`runge_kutta.inputs`), in file order [rad].
        control_slopes: change of `controls` per second of surface delay [rad/s].
        control_changes: of `controls` with each of `Departures.actuators`.
        settings: of the engines, throttle or rpm, at the same three times.
        setting_changes: of `settings` with each of `Departures.actuators`.
        density: of the air [kg/m³].
        height: above the ground [m].
        airspeed: at which gusts are passed, true [m/s].
        gyro: angular rate [rad/s].
        accelerometer: specific force [m/s²].
        inertial: whether these two were measured.
        modelled: whether the equations are to be believed. Where they are not, the flight follows
            its sensors, and says nothing about the aerodynamics.
        measured: the other sensors.
    """

    step: Float[Array, "*sample"]
    controls: Float[Array, "*sample three control"]
    control_slopes: Float[Array, "*sample three control"]
    control_changes: Float[Array, "*sample three control change"]
    settings: Float[Array, "*sample three engine"]
    setting_changes: Float[Array, "*sample three engine change"]
    density: Float[Array, "*sample"]
    height: Float[Array, "*sample"]
    airspeed: Float[Array, "*sample"]
    gyro: Float[Array, "*sample axis"]
    accelerometer: Float[Array, "*sample axis"]
    inertial: Bool[Array, "*sample"]
    modelled: Bool[Array, "*sample"]
    measured: Measurements


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


def compose(state: State, error: Float[Array, " state"]) -> State:
    """The state that differs from `state` by an error state."""
    part = {name: error[block] for name, block in BLOCKS.items()}
    return State(
        frames.multiply(state.attitude, frames.exponential(part["attitude"])),
        state.velocity + part["velocity"],
        state.rate + part["rate"],
        Air(*(getattr(state.air, name) + part[name] for name in Air._fields)),
        *(getattr(state, name) + part[name] for name in ERRORS),
    )


def difference(first: State, second: State) -> Float[Array, " state"]:
    """Error state by which `first` differs from `second`; inverse of `compose`."""
    turn = frames.logarithm(frames.multiply(frames.conjugate(second.attitude), first.attitude))
    moved = (first.velocity - second.velocity, first.rate - second.rate)
    blown = (one - other for one, other in zip(first.air, second.air, strict=True))
    slow = (getattr(first, name) - getattr(second, name) for name in ERRORS)
    return jnp.concatenate([turn, *moved, *blown, *slow])


def _inputs(
    aircraft: Aircraft, means: Means, state: State, row: Row, when: Int[Array, ""] | int
) -> tuple[rigid_body.Parameters, rigid_body.State, rigid_body.Inputs]:
    """What `rigid_body` asks for; `when` is 0, 1, 2 for the step's beginning, middle, end."""
    values = rigid_body.parameters(aircraft)._replace(aerodynamics=means.aerodynamics)
    late = means.sensors.surface_delay
    deflections = row.controls[when] + late * row.control_slopes[when]
    settings, wind, by = row.settings[when], state.air.wind, means.departures
    if by is not None:
        values = departures.body(values, by)
        deflections = deflections + by.offset + row.control_changes[when] @ by.actuators
        settings = settings + row.setting_changes[when] @ by.actuators
        wind = departures.sheared(wind, by, row.height)
    position = jnp.stack([jnp.zeros_like(row.height), jnp.zeros_like(row.height), -row.height])
    motion = rigid_body.State(position, state.velocity, state.attitude, state.rate)
    acting = rigid_body.Inputs(
        controls=dict(zip(aircraft.control_names, deflections, strict=True)),
        settings=settings,
        wind=wind + state.air.gust,
        gust_rate=frames.unrotate(state.attitude, state.air.spin),
        density=row.density,
    )
    return values, motion, acting


def _change(
    aircraft: Aircraft, means: Means, state: State, row: Row, when: Int[Array, ""] | int
) -> tuple[rigid_body.State, Float[Array, " axis"]]:
    """Rate of change of the motion, and the rate at which the aircraft turns.

    With moments that lag by τ it turns at ω(t) = ω̃(t − τ) ≈ ω̃ − τ dω̃/dt, where ω̃ is the state: the
    integral of the moments. It is ω that damps and that turns the axes. Two rounds find it to
    (τ/T)² of a mode of time constant T.
    """
    values, motion, acting = _inputs(aircraft, means, state, row, when)

    def turned(rate: Float[Array, " axis"], _: None) -> tuple[Array, rigid_body.State]:
        change = rigid_body.derivative(aircraft, values, motion._replace(rate=rate), acting)
        return state.rate - means.sensors.moment_lag * change.rate, change

    # A loop, so that the equations are compiled once.
    rate, changes = jax.lax.scan(turned, state.rate, None, length=2)
    change = jax.tree.map(lambda part: part[-1], changes)
    ahead = frames.rotate(state.attitude, jnp.pad(state.push, (0, 2)))
    return change._replace(velocity=change.velocity + ahead), rate


def flow(
    aircraft: Aircraft, means: Means, state: State, row: Row, when: Int[Array, ""] | int
) -> dict[str, Float[Array, ""]]:
    """What the coefficients are a function of, by name; `when` as for `jacobian`."""
    return rigid_body.flow(aircraft, *_inputs(aircraft, means, state, row, when))


def _slope(
    aircraft: Aircraft,
    means: Means,
    noise: Noise,
    state: State,
    row: Row,
    when: Int[Array, ""] | int,
) -> State:
    change, _ = _change(aircraft, means, state, row, when)
    return State(
        change.attitude,
        change.velocity,
        change.rate,
        air.drift(state.air, noise.turbulence, row.airspeed),
        -state.attitude_error / _of_axes(noise.attitude_error_time),
        -state.push / PUSH_TIME,
        -state.velocity_error / noise.velocity_error_time,
    )


def motion(aircraft: Aircraft, means: Means, state: State, row: Row) -> Float[Array, " state"]:
    """Rate of change of the error state in the middle of a row's step, but for what decays."""
    change, rate = _change(aircraft, means, state, row, 1)
    return jnp.concatenate([rate, change.velocity, change.rate, jnp.zeros(SIZE - MOVING)])


def advance(aircraft: Aircraft, means: Means, noise: Noise, state: State, row: Row) -> State:
    """State at the end of a row's step, by the classical Runge–Kutta scheme."""

    def slope(at: State, when: Int[Array, ""]) -> State:
        return _slope(aircraft, means, noise, at, row, when)

    ahead = runge_kutta.advance(slope, state, row.step)
    length = jnp.sqrt(jnp.sum(ahead.attitude * ahead.attitude))
    return ahead._replace(attitude=ahead.attitude / length)


def innovation(aircraft: Aircraft, means: Means, state: State, row: Row) -> Float[Array, " row"]:
    """Measured minus expected; rows of absent sensors are meaningless."""
    errors, by = means.sensors, means.departures
    centre = departures.centre(aircraft, by)
    change, rate = _change(aircraft, means, state, row, 2)
    gravity = jnp.array([0.0, 0.0, GRAVITY])
    force = frames.unrotate(state.attitude, change.velocity - gravity)
    unit = jnp.asarray(np.array(aircraft.imu.position)) - centre
    wind, sensed, source = state.air.wind, rate, state.attitude_error
    if by is not None:
        unit = unit + by.imu_position
        wind = departures.sheared(wind, by, row.height)
        source = source.at[2].add(by.heading)
    turning = frames.cross(rate, frames.cross(rate, unit))
    felt = force + frames.cross(change.rate, unit) + turning
    if by is not None:
        felt = departures.turned(felt, by)
        sensed = departures.turned(rate, by) * (1.0 + by.gyro_scale)

    def shifted(group: int, delay: Float[Array, ""]) -> State:
        by = row.measured.age[group] - delay
        return state._replace(
            attitude=frames.multiply(state.attitude, frames.exponential(by * rate)),
            velocity=state.velocity + by * change.velocity,
        )

    def flow(at: State, place: tuple[float, float, float]) -> tuple[Array, Array, Array]:
        through = frames.unrotate(at.attitude, at.velocity - wind - at.air.gust)
        against = rate - frames.unrotate(at.attitude, at.air.spin)
        lever = jnp.asarray(np.array(place)) - centre
        return frames.flow_angles(through + frames.cross(against, lever))

    speed, _, _ = flow(shifted(0, errors.airspeed_delay), aircraft.pitot.position)
    tracked = shifted(1, errors.velocity_delay)
    turned = shifted(2, errors.attitude_delay).attitude
    expected = frames.multiply(frames.exponential(source), turned)
    vanes = aircraft.vanes.position if aircraft.vanes is not None else aircraft.imu.position
    _, alpha, beta = flow(shifted(3, errors.vane_delay), vanes)
    return jnp.concatenate(
        [
            row.gyro - sensed - errors.gyro_bias,
            row.accelerometer - felt - errors.accelerometer_bias,
            row.measured.airspeed - speed * (1.0 + errors.airspeed_scale),
            row.measured.velocity - tracked.velocity - state.velocity_error,
            frames.logarithm(frames.multiply(frames.conjugate(expected), row.measured.attitude)),
            row.measured.vanes
            - jnp.stack([alpha, beta]) * (1.0 + errors.vane_scale)
            - errors.vane_bias,
        ]
    )


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


def process(
    half: Float[Array, "state state"],
    row: Row,
    driving: Float[Array, "state state"],
) -> Float[Array, "state state"]:
    """Covariance that a step's white noise leaves at its end, ∫ Φ(s) D Φ(s)ᵀ ds by Simpson's rule.

    A gust that arrives early in the step has moved the aircraft by its end, one that arrives late
    has not: taken as arriving together they would tell the filter what no sensor can know.

    Args:
        half: transition over half the step.
        row: of the step.
        driving: D at `passing` 1.
    """
    late = passing(row)[:, None] * driving
    middle = half @ late @ half.T
    early = half @ middle @ half.T
    return row.step / 6.0 * (late + 4.0 * middle + early)


def passing(row: Row) -> Float[Array, " state"]:
    """How fast what changes by itself does so: gusts at the airspeed [m/s], all else at 1."""
    blown = slice(BLOCKS["gust"].start, BLOCKS["memory"].stop)
    return jnp.ones(SIZE).at[blown].set(row.airspeed)


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
    lasting = _of_axes(noise.attitude_error_time)
    return jnp.concatenate(
        [
            jnp.zeros(3),
            jnp.full(3, 1.0) * noise.force**2,
            noise.moment**2,
            air.density(noise.turbulence, 1.0),
            _of_axes(noise.attitude_error) ** 2 * (2.0 / lasting),
            noise.push[None] ** 2 * (2.0 / PUSH_TIME),
            jnp.full(3, noise.velocity_error**2 * (2.0 / noise.velocity_error_time)),
        ]
    )


def _of_axes(pair: Float[Array, " two"]) -> Float[Array, " axis"]:
    """Tilt and heading as turns about the level axes."""
    tilt, heading = pair
    return jnp.stack([tilt, tilt, heading])


def jacobian(
    aircraft: Aircraft, means: Means, state: State, row: Row, when: Int[Array, ""] | int
) -> Float[Array, "state state"]:
    """Rate of change of an error state with the error state, but for what decays by itself.

    Wind and gust act through the velocity through the air only, so that their columns are those of
    the velocity over ground.
    """
    parts = ("attitude", "velocity", "rate", "spin")

    def moved(errors: Float[Array, " twelve"]) -> tuple[Array, Array]:
        error = jnp.zeros(SIZE)
        for name, part in zip(parts, jnp.split(errors, len(parts)), strict=True):
            error = error.at[BLOCKS[name]].set(part)
        change, rate = _change(aircraft, means, compose(state, error), row, when)
        return jnp.concatenate([rate, change.velocity, change.rate]), rate

    found, rate = jax.jacfwd(moved, has_aux=True)(jnp.zeros(3 * len(parts)))
    columns = dict(zip(parts, jnp.split(found, len(parts), axis=1), strict=True))
    columns["wind"] = columns["gust"] = -columns["velocity"]
    matrix = jnp.zeros((SIZE, SIZE))
    for name, column in columns.items():
        matrix = matrix.at[:MOVING, BLOCKS[name]].set(column)
    turning = jax.vmap(lambda axis: frames.cross(rate, axis), out_axes=1)(jnp.eye(3))
    matrix = matrix.at[BLOCKS["attitude"], BLOCKS["attitude"]].add(-turning)
    forward = frames.rotate(state.attitude, jnp.array([1.0, 0.0, 0.0]))
    return matrix.at[BLOCKS["velocity"], BLOCKS["push"]].set(forward[:, None])


def half_transition(
    mechanics: Float[Array, "state state"],
    decay: Float[Array, "slow slow"],
    row: Row,
) -> Float[Array, "state state"]:
    """Transition over half a step: the exponential's series to the order of the scheme.

    Args:
        mechanics: the Jacobian in the middle of the step.
        decay: how what is not motion changes by itself, where `passing` is 1.
        row: of the step.
    """
    unit = jnp.eye(SIZE)
    slow = passing(row)[MOVING:, None] * decay
    rates = 0.5 * row.step * mechanics.at[MOVING:, MOVING:].set(slow)
    half = unit + rates / 4.0
    for order in (3.0, 2.0, 1.0):
        half = unit + rates @ half / order
    return half


def decay(noise: Noise) -> Float[Array, "slow slow"]:
    """How the air and the slow errors change by themselves, where `passing` is 1."""

    def change(values: Float[Array, " slow"]) -> Float[Array, " slow"]:
        *blown, tilted, push, tracked = jnp.split(values, (3, 6, 9, 12, 15, 16))
        moving = air.drift(Air(*blown), noise.turbulence, 1.0)
        tilted = tilted / _of_axes(noise.attitude_error_time)
        slow = (tilted, push / PUSH_TIME, tracked / noise.velocity_error_time)
        return jnp.concatenate([*moving, *(-part for part in slow)])

    return jax.jacfwd(change)(jnp.zeros(SIZE - MOVING))


def _seen(
    aircraft: Aircraft, means: Means, state: State, row: Row
) -> tuple[Float[Array, "row state"], Float[Array, " row"]]:
    """Sensitivity of the expected measurements to an error state, and the innovation."""
    parts = ("attitude", "velocity", "rate", "spin", *ERRORS)
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
    columns["wind"] = columns["gust"] = -through
    matrix = jnp.zeros((ROW_COUNT, SIZE))
    for name, column in columns.items():
        matrix = matrix.at[:, BLOCKS[name]].set(column)
    return matrix, residual


def linearise(
    aircraft: Aircraft, means: Means, noise: Noise, before: State, after: State, row: Row
) -> Linearised:
    """One row about a nominal flight.

    Args:
        aircraft: what is looked up; its aerodynamic terms are those of `means`.
        means: derivatives and sensor errors.
        noise: intensities.
        before: nominal state at the step's beginning.
        after: nominal state at its end.
        row: the sample.
    """
    middle = compose(before, 0.5 * difference(after, before))
    mechanics = jacobian(aircraft, means, middle, row, 1)
    half = half_transition(mechanics, decay(noise), row)
    moved = advance(aircraft, means, noise, before, row)
    sensitivity, residual = _seen(aircraft, means, after, row)
    present = present_rows(row)
    return Linearised(
        transition=half @ half,
        offset=difference(moved, after),
        process=process(half, row, driving(doubted(noise, row.modelled))),
        sensitivity=jnp.where(present[:, None], sensitivity, 0.0),
        residual=jnp.where(present, residual, 0.0),
        variance=jnp.where(present, measurement_variance(noise), 1.0),
        present=present,
    )
