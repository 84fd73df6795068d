"""The flight model of the aided filter: rigid body with aerodynamics, moving air and sensors.

Where the kinematic model takes rate and specific force from the inertial unit as given, here they
are *measurements* of a motion that aerodynamics, thrust and gusts bring about. That is what tells
a gust from a motion without flow vanes: air that the aircraft did not feel cannot have been there.

State: attitude q, velocity v of the centre of gravity over ground, body rate ω, what a pitot tube
with a lag shows, the air of `air`, and what lasts of the errors of thrust, attitude, velocity,
airspeed and gyros. The error state has 33 rows (`BLOCKS`), additive but for the attitude,
q ⊗ exp(δ). With u = R(q)ᵀ(v − w − g) and ω_air = ω − R(q)ᵀ s the
equations are those of `rigid_body`; a sensor at r from the centre of gravity feels

    f = (X + T)/m + ω̇ × r + ω × (ω × r)

Unmodelled forces and moments enter as white noise on v̇ and ω̇.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
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
    "tube": slice(9, 10),
    "wind": slice(10, 13),
    "gust": slice(13, 16),
    "spin": slice(16, 19),
    "memory": slice(19, 22),
    "attitude_error": slice(22, 25),
    "push": slice(25, 26),
    "velocity_error": slice(26, 29),
    "airspeed_error": slice(29, 30),
    "gyro_error": slice(30, 33),
}
"""Where each part of the error state lies."""
SIZE = 33
ERRORS = ("attitude_error", "push", "velocity_error", "airspeed_error", "gyro_error")
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
TUBE, LEAST_TUBE, FALLING = 0.2, 0.05, 3.0
"""Lag of a pitot tube [s] that `State.tube` has where there is none to speak of, with a metre of
thin tubing; the least that it has; and by how much it falls as the tube's own lag grows, until it
is that one (see `tube_lag`)."""
PUSH_TIME = 2.0
"""Correlation time of the thrust map's error [s]: that of throttle and airspeed."""
AIRSPEED_TIME = 0.28
"""Correlation time of an airspeed's error [s]: ArduPlane keeps 0.7 of it each tenth of a second."""
GYRO_TIME = 300.0
"""Correlation time of the gyros' drift [s]: a board warms up in minutes."""

ATTITUDE_TILT = math.radians(0.4)
"""One ordinary deviation of what an autopilot calls level [rad]: its trim, and what its filter has
wrong for minutes."""


class State(NamedTuple):
    """Motion, air, and attitude error.

    Attributes:
        attitude: quaternion, body to NED.
        velocity: of the centre of gravity over ground, NED [m/s].
        rate: inertial, body axes, as it would be if moments did not lag [rad/s].
        tube: airspeed that a pitot tube with a lag of `tube_lag` would show [m/s].
        air: the moving air.
        attitude_error: by which the attitude source is turned, level axes [rad].
        push: acceleration along x that the thrust maps do not know [m/s²].
        velocity_error: by which the velocity source is off for seconds, NED [m/s].
        airspeed_error: by which what is indicated is off for tenths of a second [m/s].
        gyro_error: by which the gyros' bias has drifted [rad/s].
    """

    attitude: Float[Array, "*batch four"]
    velocity: Float[Array, "*batch axis"]
    rate: Float[Array, "*batch axis"]
    tube: Float[Array, "*batch one"]
    air: Air
    attitude_error: Float[Array, "*batch axis"]
    push: Float[Array, "*batch one"]
    velocity_error: Float[Array, "*batch axis"]
    airspeed_error: Float[Array, "*batch one"]
    gyro_error: Float[Array, "*batch axis"]


class Sensors(NamedTuple):
    """Errors of the sensors, constant over a flight.

    Attributes:
        gyro_bias: [rad/s].
        accelerometer_bias: [m/s²].
        airspeed_scale: indicated = (1 + scale)·true.
        airspeed_lag: of what is indicated, first order, beyond the aircraft file's [s].
        vane_bias: of angle of attack and sideslip [rad].
        vane_scale: likewise [1].
        surface_delay: of the surfaces behind the servo commands as given [s].
        moment_lag: of the aerodynamic moments behind the motion that causes them: the wake of a
            real wing, the step of a simulation [s].
        airspeed_delay: how long before its stamp a sample describes the aircraft [s].
        velocity_delay: likewise.
        attitude_delay: likewise.
        vane_delay: likewise.
        attitude_tilt: roll and pitch of the attitude that is told in the airframe: level is where
            somebody said so [rad].
    """

    gyro_bias: Float[Array, " axis"]
    accelerometer_bias: Float[Array, " axis"]
    airspeed_scale: Float[Array, ""]
    airspeed_lag: Float[Array, ""]
    vane_bias: Float[Array, " two"]
    vane_scale: Float[Array, " two"]
    surface_delay: Float[Array, ""]
    moment_lag: Float[Array, ""]
    airspeed_delay: Float[Array, ""]
    velocity_delay: Float[Array, ""]
    attitude_delay: Float[Array, ""]
    vane_delay: Float[Array, ""]
    attitude_tilt: Float[Array, " two"]


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
        airspeed_error: error of the airspeed that lasts, noise that a filter has smoothed [m/s].
        gyro_error: drift of the gyros' bias [rad/s].
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
    airspeed_error: Float[Array, ""]
    gyro_error: Float[Array, ""]
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
        climbed: above where the flight begins [m].
        passing: speed at which gusts are passed [m/s]. A field of them is carried by the steady
            wind (Taylor's hypothesis), so that a gust has no part in how fast it is passed itself.
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
    climbed: Float[Array, "*sample"]
    passing: Float[Array, "*sample"]
    gyro: Float[Array, "*sample axis"]
    accelerometer: Float[Array, "*sample axis"]
    inertial: Bool[Array, "*sample"]
    modelled: Bool[Array, "*sample"]
    measured: Measurements


def compose(state: State, error: Float[Array, " state"]) -> State:
    """The state that differs from `state` by an error state."""
    part = {name: error[block] for name, block in BLOCKS.items()}
    return State(
        frames.multiply(state.attitude, frames.exponential(part["attitude"])),
        state.velocity + part["velocity"],
        state.rate + part["rate"],
        state.tube + part["tube"],
        Air(*(getattr(state.air, name) + part[name] for name in Air._fields)),
        *(getattr(state, name) + part[name] for name in ERRORS),
    )


def difference(first: State, second: State) -> Float[Array, " state"]:
    """Error state by which `first` differs from `second`; inverse of `compose`."""
    turn = frames.logarithm(frames.multiply(frames.conjugate(second.attitude), first.attitude))
    moved = (getattr(first, name) - getattr(second, name) for name in ("velocity", "rate", "tube"))
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
        wind = departures.sheared(wind, by, row.climbed)
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


def changing(
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
    change, rate = changing(aircraft, means, state, row, when)
    return State(
        change.attitude,
        change.velocity,
        change.rate,
        filling(aircraft, means, state, row, rate),
        air.drift(state.air, noise.turbulence, row.passing),
        -state.attitude_error / of_axes(noise.attitude_error_time),
        -state.push / PUSH_TIME,
        -state.velocity_error / noise.velocity_error_time,
        -state.airspeed_error / AIRSPEED_TIME,
        -state.gyro_error / GYRO_TIME,
    )


def through_air(
    aircraft: Aircraft,
    means: Means,
    state: State,
    row: Row,
    rate: Float[Array, " axis"],
    place: Float[Array, " axis"],
) -> tuple[Array, Array, Array]:
    """True airspeed, angle of attack and sideslip at a place of the airframe.

    Out on the wing a gust that turns is another one: the lever turns against the air.
    """
    wind, by = state.air.wind, means.departures
    if by is not None:
        wind = departures.sheared(wind, by, row.climbed)
    through = frames.unrotate(state.attitude, state.velocity - wind - state.air.gust)
    against = rate - frames.unrotate(state.attitude, state.air.spin)
    lever = place - departures.centre(aircraft, by)
    return frames.flow_angles(through + frames.cross(against, lever))


def filling(
    aircraft: Aircraft, means: Means, state: State, row: Row, rate: Float[Array, " axis"]
) -> Float[Array, " one"]:
    """Rate of change of what a tube with a lag T shows, (V − tube)/T [m/s²]."""
    speed, _, _ = through_air(
        aircraft, means, state, row, rate, jnp.asarray(aircraft.pitot.position)
    )
    return (speed - state.tube) / tube_lag(aircraft, means.sensors)


def tube_lag(aircraft: Aircraft, errors: Sensors) -> Float[Array, ""]:
    """Lag T of `State.tube` [s], that of the tube where it has one.

    Of a tube with a lag τ, V + τ/T · (tube − V) is shown, which is exact where T = τ, as from
    `LEAST_TUBE` on. Without a lag nothing is shown of the state, but by its T it is foretold what a
    lag would do: that of `TUBE` what one of its size does, a shorter one more of quick gusts.
    """
    lag = own_lag(aircraft, errors)
    return jnp.maximum(lag, jnp.maximum(TUBE - FALLING * lag, LEAST_TUBE))


def own_lag(aircraft: Aircraft, errors: Sensors) -> Float[Array, ""]:
    """Lag τ of the pitot tube [s]."""
    return aircraft.pitot.error.lag + errors.airspeed_lag


def motion(aircraft: Aircraft, means: Means, state: State, row: Row) -> Float[Array, " state"]:
    """Rate of change of the error state in the middle of a row's step, but for what decays."""
    change, rate = changing(aircraft, means, state, row, 1)
    tube = filling(aircraft, means, state, row, rate)
    return jnp.concatenate([rate, change.velocity, change.rate, tube, jnp.zeros(SIZE - MOVING)])


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
    change, rate = changing(aircraft, means, state, row, 2)
    gravity = jnp.array([0.0, 0.0, GRAVITY])
    force = frames.unrotate(state.attitude, change.velocity - gravity)
    unit = jnp.asarray(aircraft.imu.position) - centre
    sensed, source = rate, state.attitude_error
    if by is not None:
        unit = unit + by.imu_position
        source = source.at[2].add(by.heading)
    turning = frames.cross(rate, frames.cross(rate, unit))
    felt = force + frames.cross(change.rate, unit) + turning
    if by is not None:
        felt = departures.turned(felt, by)
        sensed = departures.turned(rate, by) * (1.0 + by.gyro_scale)

    def shifted(group: int, delay: Float[Array, ""]) -> tuple[State, Float[Array, " axis"]]:
        by = row.measured.age[group] - delay
        at = state._replace(
            attitude=frames.multiply(
                state.attitude, frames.exponential(by * rate + 0.5 * by * by * change.rate)
            ),
            velocity=state.velocity + by * change.velocity,
        )
        return at, rate + by * change.rate

    def flow(
        then: tuple[State, Float[Array, " axis"]], place: Float[Array, " axis"]
    ) -> tuple[Array, Array, Array]:
        at, turning = then
        return through_air(aircraft, means, at, row, turning, place)

    speed, _, _ = flow(shifted(0, errors.airspeed_delay), jnp.asarray(aircraft.pitot.position))
    late = row.measured.age[0] - errors.airspeed_delay
    shown = state.tube[0] + late * filling(aircraft, means, state, row, rate)[0]
    share = own_lag(aircraft, errors) / tube_lag(aircraft, errors)
    speed = speed + share * (shown - speed)
    tracked, _ = shifted(1, errors.velocity_delay)
    turned = shifted(2, errors.attitude_delay)[0].attitude
    turned = told(turned, errors)
    expected = frames.multiply(frames.exponential(source), turned)
    vanes = aircraft.vanes.position if aircraft.vanes is not None else aircraft.imu.position
    _, alpha, beta = flow(shifted(3, errors.vane_delay), jnp.asarray(vanes))
    return jnp.concatenate(
        [
            row.gyro - sensed - errors.gyro_bias - state.gyro_error,
            row.accelerometer - felt - errors.accelerometer_bias,
            row.measured.airspeed - speed * (1.0 + errors.airspeed_scale) - state.airspeed_error,
            row.measured.velocity - tracked.velocity - state.velocity_error,
            frames.logarithm(frames.multiply(frames.conjugate(expected), row.measured.attitude)),
            row.measured.vanes
            - jnp.stack([alpha, beta]) * (1.0 + errors.vane_scale)
            - errors.vane_bias,
        ]
    )


def told(attitude: Float[Array, " four"], errors: Sensors) -> Float[Array, " four"]:
    """The attitude that an autopilot tells where the airframe has another."""
    tilt = frames.quaternion_from_euler(jnp.append(errors.attitude_tilt, 0.0))
    return frames.multiply(attitude, tilt)


def of_axes(pair: Float[Array, " two"]) -> Float[Array, " axis"]:
    """Tilt and heading as turns about the level axes."""
    tilt, heading = pair
    return jnp.stack([tilt, tilt, heading])
