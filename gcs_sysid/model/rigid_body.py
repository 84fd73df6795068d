"""Motion of a rigid aircraft under aerodynamics, thrust and gravity, pure and differentiable.

With R the attitude (body to NED), v the velocity of the centre of gravity over ground, ω the body
rate and I the inertia tensor about the centre of gravity (Stevens, Lewis & Johnson, *Aircraft
Control and Simulation*, 3rd ed. 2015, section 1.7):

    ẋ = v     v̇ = R (X + T)/m + g     q̇ = ½ q ⊗ (0, ω)     ω̇ = I⁻¹ (M − ω × I ω)

X are the aerodynamic forces, T the thrusts, M all moments about the centre of gravity. The
coefficients refer to the airframe point of the aircraft file, so that M_cg = M − r_cg × X. They are
functions of the motion relative to the air: the wind at the centre of gravity is taken off the
velocity and the gust's own rotation off the rate.

What an estimator may want to vary is in `Parameters`; what is only looked up (regressors, tables,
thrust maps, geometry) comes from the `Aircraft`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float, Int

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.atmosphere import GRAVITY
from gcs_sysid.frames import Array
from gcs_sysid.model import aerodynamics, propulsion, runge_kutta


class Thrust(NamedTuple):
    """How the thrust departs from that of the aircraft file.

    Attributes:
        ratio: true over the file's.
        drop: it acts this far lower [m].
        tilt: it points up by this [rad].
    """

    ratio: Float[Array, ""] | float = 1.0
    drop: Float[Array, ""] | float = 0.0
    tilt: Float[Array, ""] | float = 0.0


class Parameters(NamedTuple):
    """Numbers of an aircraft that a simulation depends on smoothly.

    Attributes:
        mass: [kg].
        inertia: about the centre of gravity [kg·m²].
        cg: centre of gravity from the airframe point [m].
        aerodynamics: value of every term by coefficient and regressor key.
        thrust: departures from the thrust maps; None as the file has them.
    """

    mass: Float[Array, ""]
    inertia: Float[Array, "axis axis"]
    cg: Float[Array, " axis"]
    aerodynamics: Mapping[str, Mapping[str, Float[Array, ""]]]
    thrust: Thrust | None = None


class State(NamedTuple):
    """Motion of the centre of gravity over ground, and of the body.

    Attributes:
        position: north, east, down of a point on the ground [m].
        velocity: over ground, NED [m/s].
        attitude: quaternion, body to NED.
        rate: inertial, body axes [rad/s].
    """

    position: Float[Array, "*batch axis"]
    velocity: Float[Array, "*batch axis"]
    attitude: Float[Array, "*batch four"]
    rate: Float[Array, "*batch axis"]


class Inputs(NamedTuple):
    """What the aircraft is given from outside.

    Attributes:
        controls: deflections as the air feels them, by name [rad].
        settings: of each engine: throttle 0 to 1, or rpm where its table is over that.
        wind: at the centre of gravity, gust included, toward NED [m/s].
        gust_rate: rotation of the air itself, body axes [rad/s].
        density: of the air [kg/m³].
    """

    controls: Mapping[str, Float[Array, "*batch"]]
    settings: Float[Array, "*batch engine"]
    wind: Float[Array, "*batch axis"]
    gust_rate: Float[Array, "*batch axis"]
    density: Float[Array, "*batch"]


class Loads(NamedTuple):
    """Force [N] and moment about the centre of gravity [N·m], body axes, gravity left out."""

    force: Float[Array, " axis"]
    moment: Float[Array, " axis"]


def parameters(aircraft: Aircraft) -> Parameters:
    """The values that an aircraft file gives."""
    return Parameters(
        mass=jnp.asarray(aircraft.mass.mass),
        inertia=jnp.asarray(aircraft.mass.inertia_rows),
        cg=jnp.asarray(aircraft.mass.cg),
        aerodynamics={
            name: {key: jnp.asarray(item.value) for key, item in model.terms.items()}
            for name, model in aircraft.aerodynamics.items()
        },
    )


def derivative(aircraft: Aircraft, values: Parameters, state: State, inputs: Inputs) -> State:
    """Rate of change of the state, in the fields of a `State`.

    Args:
        aircraft: what is looked up.
        values: what may vary.
        state: one state.
        inputs: what acts on it.
    """
    return accelerated(values, state, loads(aircraft, values, state, inputs))


def accelerated(values: Parameters, state: State, acting: Loads) -> State:
    """The same under forces and moments that are known: `loads` there."""
    turning = frames.cross(state.rate, values.inertia @ state.rate)
    gravity = jnp.array([0.0, 0.0, GRAVITY])
    return State(
        position=state.velocity,
        velocity=frames.rotate(state.attitude, acting.force / values.mass) + gravity,
        attitude=0.5 * frames.multiply(state.attitude, jnp.concatenate([jnp.zeros(1), state.rate])),
        rate=_solved(values.inertia, acting.moment - turning),
    )


def _solved(
    inertia: Float[Array, "axis axis"], moment: Float[Array, " axis"]
) -> Float[Array, " axis"]:
    """Angular acceleration by Cramer's rule: cheaper than a decomposition at every step."""
    first, second, third = inertia
    across = jnp.stack(
        [frames.cross(second, third), frames.cross(third, first), frames.cross(first, second)]
    )
    return moment @ across / (first @ across[0])


def loads(aircraft: Aircraft, values: Parameters, state: State, inputs: Inputs) -> Loads:
    """Aerodynamic and propulsive force and moment; arguments as for `derivative`."""
    shape = aircraft.geometry
    felt = flow(aircraft, values, state, inputs)
    push, twist = _thrust(aircraft, values, felt["V"], inputs)
    found = coefficients(aircraft, values, felt)
    qbar = felt["qbar"]
    lengths = jnp.array([shape.wing_span, shape.mean_chord, shape.wing_span])
    force = qbar * shape.wing_area * found[:3]
    about_point = qbar * shape.wing_area * lengths * found[3:]
    return Loads(force + push, about_point - frames.cross(values.cg, force) + twist)


def flow(
    aircraft: Aircraft, values: Parameters, state: State, inputs: Inputs
) -> dict[str, Float[Array, ""]]:
    """What the coefficients are a function of, by name; arguments as for `derivative`."""
    shape = aircraft.geometry
    speed, alpha, beta = frames.flow_angles(
        frames.unrotate(state.attitude, state.velocity - inputs.wind)
    )
    qbar = 0.5 * inputs.density * speed**2
    push, _ = _thrust(aircraft, values, speed, inputs)
    felt = state.rate - inputs.gust_rate
    half_span, half_chord = 0.5 * shape.wing_span / speed, 0.5 * shape.mean_chord / speed
    return {
        "alpha": alpha,
        "beta": beta,
        "phat": felt[0] * half_span,
        "qhat": felt[1] * half_chord,
        "rhat": felt[2] * half_span,
        # It would make the equations implicit: the force would depend on its own effect. Terms in
        # it are left out, which the pitch damping of an aircraft that has them should make up for.
        "alphadot_hat": jnp.zeros_like(alpha),
        "Tc": jnp.sum(push) / (qbar * shape.wing_area),
        "qbar": qbar,
        "h_over_b": -state.position[2] / shape.wing_span,
        "V": speed,
        **inputs.controls,
    }


def coefficients(
    aircraft: Aircraft, values: Parameters, flow: Mapping[str, Float[Array, "*sample"]]
) -> Float[Array, "*sample six"]:
    """CX…Cn in the order of `COEFFICIENTS`; 0 for those that the aircraft does not have.

    Args:
        aircraft: regressors, tables, and what was learned beyond them.
        values: values of the terms.
        flow: variables of `regressors.VARIABLES` and controls, arrays of one shape.
    """
    return aerodynamics.of_aircraft(aircraft, flow, terms=values.aerodynamics)


def _thrust(
    aircraft: Aircraft, values: Parameters, speed: Float[Array, ""], inputs: Inputs
) -> tuple[Float[Array, " axis"], Float[Array, " axis"]]:
    """Sum of thrusts [N], and their moment about the centre of gravity with torque [N·m]."""
    force, moment = jnp.zeros(3), jnp.zeros(3)
    for index, engine in enumerate(aircraft.propulsion):
        along = jnp.asarray(engine.axis)
        axis, place = along / jnp.linalg.norm(along), jnp.asarray(engine.position)
        ratio: Float[Array, ""] | float = 1.0
        if values.thrust is not None:
            ratio, drop, tilt = values.thrust
            axis = _tilted_up(axis, tilt)
            place = place.at[2].add(drop)
        setting = inputs.settings[index]
        push = ratio * propulsion.static_thrust(engine, setting, speed, inputs.density) * axis
        torque = propulsion.static_torque(engine, setting, speed, inputs.density)
        force = force + push
        moment = moment + frames.cross(place - values.cg, push) + torque * axis
    return force, moment


def _tilted_up(
    axis: Float[Array, " axis"], tilt: Float[Array, ""] | float
) -> Float[Array, " axis"]:
    x, y, z = axis
    cosine, sine = jnp.cos(tilt), jnp.sin(tilt)
    return jnp.stack([x * cosine + z * sine, y, z * cosine - x * sine])


def advance(
    aircraft: Aircraft,
    values: Parameters,
    state: State,
    before: Inputs,
    after: Inputs,
    step: Float[Array, ""],
    *,
    first: State | None = None,
) -> State:
    """State one step later by the classical Runge–Kutta scheme.

    Args:
        aircraft: see `derivative`.
        values: see `derivative`.
        state: at the beginning of the step.
        before: inputs at its beginning.
        after: inputs at its end; linear between.
        step: its length [s], a third of the fastest time constant at most. The roll mode of a small
            aircraft is 40 to 50 ms.
        first: `derivative` at the beginning, where it is known already.
    """
    given = jax.tree.map(
        lambda one, other: jnp.stack([one, 0.5 * (one + other), other]), before, after
    )

    def slope(at: State, when: Int[Array, ""]) -> State:
        return derivative(aircraft, values, at, jax.tree.map(lambda part: part[when], given))

    ahead = runge_kutta.advance(slope, state, step, first=first)
    # The scheme keeps the quaternion's length only to its order.
    length = jnp.sqrt(jnp.sum(ahead.attitude * ahead.attitude))
    return ahead._replace(attitude=ahead.attitude / length)


def propagate(
    aircraft: Aircraft,
    values: Parameters,
    start: State,
    inputs: Inputs,
    time: Float[Array, " sample"],
) -> State:
    """The states at `time` that follow from a first one.

    Args:
        aircraft: see `derivative`.
        values: see `derivative`.
        start: state at the first time.
        inputs: at each time, linear between.
        time: increasing; a repeated time repeats the state [s].
    """

    def move(state: State, row: tuple[Inputs, Inputs, Float[Array, ""]]) -> tuple[State, State]:
        ahead = advance(aircraft, values, state, *row)
        return ahead, ahead

    before = jax.tree.map(lambda value: value[:-1], inputs)
    after = jax.tree.map(lambda value: value[1:], inputs)
    _, later = jax.lax.scan(move, start, (before, after, jnp.diff(time)))
    return jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), start, later)
