"""Maneuvers flown by a model, many times: aircraft drawn from what is believed, in drawn gusts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.atmosphere import GRAVITY
from gcs_sysid.estimate import traces
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.frames import Array
from gcs_sysid.maneuvers import information
from gcs_sysid.maneuvers.holding import Linear
from gcs_sysid.model import propulsion, rigid_body
from gcs_sysid.model import trim as trims
from gcs_sysid.model.rigid_body import Inputs, Parameters, State
from gcs_sysid.model.trim import Trim

STEP = 0.02
"""Step of the simulation [s]."""
CHUNK = 100
"""Steps flown by one call of the compiled program: it is the same for every length of maneuver."""
LANES = 64
"""Aircraft that it flies at once."""
LEAD = CHUNK
"""Steps flown in the first of the gusts before a maneuver begins: none begins in still air."""
INTEGRATING = np.arange(LANES) % 2.0
"""Every second aircraft's autopilot also integrates the error of the pitch rate, as most do. What
has wound up against one pulse carries the next further: an elevator's 3-2-1-1 to 4.1 g instead of
2.6. Which kind flies nobody says, so that both must be safe, unless flights told what the elevator
answered to (`flown_hold`)."""
TRIM_STEPS = 12
"""Gauss–Newton steps from the trim of the mean to that of a drawn aircraft."""

Drawn = Mapping[str, Mapping[str, Float[np.ndarray, " _"]]]
"""Aerodynamic values of drawn aircraft by coefficient and term; of any number of them."""


class Flown(NamedTuple):
    """Motions of all drawn aircraft relative to the air.

    Attributes:
        airspeed: [m/s].
        alpha: [rad].
        beta: [rad].
        rate: less the gust's own rotation [rad/s].
        bank: [rad].
        load_factor: [g].
        height: [m].
        controls: deflections as the air feels them [rad], in the order of the aircraft's controls.
        commanded: deflections asked of the surfaces [rad], in the order of the servos.
        settings: of the engines.
        thrust: of all engines together [N].
    """

    airspeed: Float[np.ndarray, "draw sample"]
    alpha: Float[np.ndarray, "draw sample"]
    beta: Float[np.ndarray, "draw sample"]
    rate: Float[np.ndarray, "draw sample axis"]
    bank: Float[np.ndarray, "draw sample"]
    load_factor: Float[np.ndarray, "draw sample"]
    height: Float[np.ndarray, "draw sample"]
    controls: Float[np.ndarray, "draw sample control"]
    commanded: Float[np.ndarray, "draw sample servo"]
    settings: Float[np.ndarray, "draw sample engine"]
    thrust: Float[np.ndarray, "draw sample"]


class Fleet(NamedTuple):
    """Drawn aircraft, each in its own level flight, on which an autopilot has settled.

    `integrating` is 1 where that integrates, see `INTEGRATING`.
    """

    values: Mapping[str, Mapping[str, Array]]
    state: State
    controls: Float[Array, "draw control"]
    settings: Float[Array, "draw engine"]
    integrating: Float[Array, " draw"]


class _Hold(NamedTuple):
    """What holds attitude and heading, see `Linear`."""

    gain: Float[Array, "control nine"]
    winding: Float[Array, " nine"]
    unwinding: Float[Array, " control"]


class _Motion(NamedTuple):
    """What goes from one step to the next.

    `asked` holds commands that are still under way, `wound` the integral of the pitch rate's error.
    """

    state: State
    surfaces: Float[Array, " servo"]
    asked: Float[Array, "delay servo"]
    settings: Float[Array, " engine"]
    wound: Float[Array, ""]


def draws(
    aircraft: Aircraft, model: AeroModel, generator: np.random.Generator, count: int
) -> Drawn:
    """Aerodynamic values by coefficient and term: the mean first, then draws from the posterior.

    Without what errors of mass and inertia leave: a flight tells accelerations, and those hold
    whatever the mass is. Drawn with a moment 30 % too large and the file's inertia, aircraft fly
    that answer a third faster than the one that was measured.
    """
    values: dict[str, dict[str, np.ndarray]] = {}
    for name, entry in aircraft.aerodynamics.items():
        if name not in model.fits:
            values[name] = {key: np.full(count, item.value) for key, item in entry.terms.items()}
            continue
        fit = model.fits[name]
        roots, vectors = np.linalg.eigh(fit.covariance - information.lasting(fit))
        spread = vectors * np.sqrt(np.maximum(roots, 0.0))
        moved = fit.value + generator.standard_normal((count - 1, roots.size)) @ spread.T
        every = np.vstack([fit.value, moved])
        column = {key: every[:, index] for index, key in enumerate(fit.keys)}
        values[name] = {key: column[key] for key in entry.terms}
    return values


def lanes(values: Drawn, first: int) -> Drawn:
    """So many drawn aircraft as are flown at once, from one on."""
    return jax.tree.map(lambda value: value[first : first + LANES], dict(values))


class Simulator:
    """Flies inputs added to what an autopilot's hold commands; compiled once for an aircraft.

    Args:
        aircraft: with the model's mean as its aerodynamics.
    """

    def __init__(self, aircraft: Aircraft) -> None:
        self.aircraft = aircraft
        self._settle = jax.jit(_settling(aircraft))
        self._fly = jax.jit(_flying(aircraft))

    def settle(self, values: Drawn, trim: Trim) -> Fleet:
        """Each of `LANES` drawn aircraft in level flight at the airspeed and height of a trim."""
        drawn = jax.tree.map(jnp.asarray, dict(values))
        alpha, beta, bank = _angles(trim)
        start = jnp.concatenate([jnp.stack([alpha, beta, bank]), trim.controls, trim.settings])
        height = -jnp.asarray(trim.state.position[2])
        state, controls, settings = self._settle(
            drawn, start, jnp.asarray(trim.airspeed), height, jnp.asarray(trim.density)
        )
        return Fleet(drawn, state, controls, settings, jnp.asarray(INTEGRATING))

    def fly(
        self,
        fleet: Fleet,
        linear: Linear,
        density: float,
        added: Float[np.ndarray, "sample input"],
        gust: Float[np.ndarray, "draw instant six"],
    ) -> Flown:
        """Motions under inputs added to what the hold commands.

        Args:
            fleet: aircraft to fly.
            linear: whose hold flies them.
            density: of the air [kg/m³].
            added: to each control [rad], and last to the throttle (0 to 1).
            gust: that each meets, see `gusts.draw`; `LEAD` longer than `added`, at least.
        """
        end = LEAD + added.shape[0]
        padded = np.zeros((-(-end // CHUNK) * CHUNK, added.shape[1]))
        padded[LEAD:end] = added
        air = np.zeros((LANES, padded.shape[0], 6))
        air[:, :end] = gust[:, :end]
        delay = _delay_steps(self.aircraft)
        surfaces = jnp.asarray(fleet.controls) @ jnp.asarray(_to_surfaces(self.aircraft)).T
        motion = _Motion(
            fleet.state,
            surfaces,
            jnp.repeat(surfaces[:, None], max(delay) + 1, axis=1),
            fleet.settings,
            jnp.zeros(LANES),
        )
        hold = _Hold(*map(jnp.asarray, (linear.gain, linear.winding, linear.unwinding)))
        parts = []
        for first in range(0, padded.shape[0], CHUNK):
            rows = slice(first, first + CHUNK)
            motion, seen = self._fly(
                fleet,
                motion,
                hold,
                jnp.asarray(density),
                jnp.asarray(padded[rows]),
                jnp.asarray(air[:, rows]),
            )
            parts.append([np.asarray(value) for value in seen])
        return Flown(
            *(np.concatenate(item, axis=1)[:, LEAD:end] for item in zip(*parts, strict=True))
        )


def _to_surfaces(aircraft: Aircraft) -> Float[np.ndarray, "servo control"]:
    """From controls to surfaces: the pseudo-inverse of the mix."""
    return np.linalg.pinv(_mix(aircraft))


def _mix(aircraft: Aircraft) -> Float[np.ndarray, "control servo"]:
    names = [servo.surface for servo in aircraft.servos]
    return np.array([[item.mix.get(name, 0.0) for name in names] for item in aircraft.controls])


def _delay_steps(aircraft: Aircraft) -> list[int]:
    return [round(servo.delay / STEP) for servo in aircraft.servos]


def _angles(trim: Trim) -> tuple[Array, Array, Array]:
    body = frames.unrotate(trim.state.attitude, trim.state.velocity)
    _, alpha, beta = frames.flow_angles(body)
    return alpha, beta, frames.euler_from_quaternion(trim.state.attitude)[0]


def _settling(aircraft: Aircraft) -> Callable[..., tuple[State, Array, Array]]:
    base, count = rigid_body.parameters(aircraft), len(aircraft.controls)

    def one(
        drawn: Mapping, start: Array, airspeed: Array, height: Array, density: Array
    ) -> tuple[State, Array, Array]:
        values = base._replace(aerodynamics=drawn)

        def left(unknown: Array) -> Array:
            return trims.imbalance(aircraft, values, unknown, airspeed, height, density)

        def better(unknown: Array, _: None) -> tuple[Array, None]:
            slope = jax.jacfwd(left)(unknown)
            return unknown - jnp.linalg.solve(slope.T @ slope, slope.T @ left(unknown)), None

        found, _ = jax.lax.scan(better, start, None, length=TRIM_STEPS)
        straight = jnp.stack([airspeed, height, density, jnp.zeros(()), jnp.zeros(())])
        state = trims.steady(found, straight)
        return state, found[3 : 3 + count], found[3 + count :]

    return jax.vmap(one, in_axes=(0, None, None, None, None))


def _flying(aircraft: Aircraft) -> Callable[..., tuple[_Motion, Flown]]:
    def one(
        fleet: Fleet, motion: _Motion, hold: _Hold, density: Array, added: Array, gust: Array
    ) -> tuple[_Motion, Flown]:
        values = rigid_body.parameters(aircraft)._replace(aerodynamics=fleet.values)

        def move(now: _Motion, row: tuple[Array, Array]) -> tuple[_Motion, Flown]:
            return _move(aircraft, values, fleet, hold, density, now, *row)

        return jax.lax.scan(move, motion, (added, gust))

    return jax.vmap(one, in_axes=(0, 0, None, None, None, 0))


def _move(
    aircraft: Aircraft,
    values: Parameters,
    own: Fleet,
    hold: _Hold,
    density: Array,
    now: _Motion,
    added: Array,
    gust: Array,
) -> tuple[_Motion, Flown]:
    """One step of one aircraft, and what is seen before it."""
    change = _described(now.state) - _described(own.state)
    # Round the compass it is the shorter way.
    change = change.at[8].set(jnp.arctan2(jnp.sin(change[8]), jnp.cos(change[8])))
    wanted = own.controls - hold.gain @ change + hold.unwinding * now.wound + added[:-1]
    commanded = jnp.asarray(_to_surfaces(aircraft)) @ wanted
    given = _inputs(aircraft, now, gust, density)
    aircraft = _learned_held(aircraft, rigid_body.flow(aircraft, values, now.state, given))
    acting = rigid_body.loads(aircraft, values, now.state, given)
    through = frames.unrotate(now.state.attitude, now.state.velocity - gust[:3])
    speed, alpha, beta = frames.flow_angles(through)
    seen = Flown(
        airspeed=speed,
        alpha=alpha,
        beta=beta,
        rate=now.state.rate - gust[3:],
        bank=frames.euler_from_quaternion(now.state.attitude)[0],
        load_factor=-acting.force[2] / (values.mass * GRAVITY),
        height=-now.state.position[2],
        controls=jnp.asarray(_mix(aircraft)) @ now.surfaces,
        commanded=commanded,
        settings=now.settings,
        thrust=_push(aircraft, speed, now.settings, density),
    )
    step = jnp.asarray(STEP, dtype=speed.dtype)
    first = rigid_body.accelerated(values, now.state, acting)
    ahead = rigid_body.advance(aircraft, values, now.state, given, given, step, first=first)
    asked = jnp.concatenate([commanded[None], now.asked[:-1]])
    settings = _throttled(aircraft, own.settings, now.settings, added[-1])
    wound = now.wound - STEP * own.integrating * (hold.winding @ change)
    moved = _followed(aircraft, now.surfaces, asked)
    return _Motion(ahead, moved, asked, settings, wound), seen


def _learned_held(aircraft: Aircraft, flow: Mapping[str, Array]) -> Aircraft:
    """The aircraft with what was learned beyond its terms as it is in one flow.

    Asked at every stage of a step it is nine tenths of what a flight costs; it changes little in
    20 ms. In single precision, where it is half: its seventh digit is far below what it knows.
    """
    if aircraft.beyond is None:
        return aircraft
    learned, now = jax.tree.map(_single, (aircraft.beyond, dict(flow)))
    found = learned(now).astype(flow["alpha"].dtype)
    return replace(aircraft, beyond=lambda _: found)


def _single(value: Array) -> Array:
    given = jnp.asarray(value)
    return given.astype(jnp.float32) if jnp.issubdtype(given.dtype, jnp.floating) else given


def _described(state: State) -> Array:
    """Velocity and rate in body axes, roll, pitch and heading."""
    euler = frames.euler_from_quaternion(state.attitude)
    body = frames.unrotate(state.attitude, state.velocity)
    return jnp.concatenate([body, state.rate, euler])


def _inputs(aircraft: Aircraft, now: _Motion, gust: Array, density: Array) -> Inputs:
    controls = jnp.asarray(_mix(aircraft)) @ now.surfaces
    return Inputs(
        controls=dict(zip(aircraft.control_names, controls, strict=True)),
        settings=now.settings,
        # Flown towards north: along, across and down are north, east and down.
        wind=gust[:3],
        gust_rate=gust[3:],
        density=density,
    )


def _followed(aircraft: Aircraft, surfaces: Array, asked: Array) -> Array:
    """Surfaces one step later: delay, travel, lag and rate limit of each servo."""
    moved = []
    for index, (servo, steps) in enumerate(
        zip(aircraft.servos, _delay_steps(aircraft), strict=True)
    ):
        goal = jnp.clip(asked[steps, index], min(servo.deflection), max(servo.deflection))
        share = 1.0 - np.exp(-STEP / servo.time_constant) if servo.time_constant else 1.0
        change = share * (goal - surfaces[index])
        if servo.rate_limit is not None:
            change = jnp.clip(change, -servo.rate_limit * STEP, servo.rate_limit * STEP)
        moved.append(surfaces[index] + change)
    return jnp.stack(moved)


def _throttled(aircraft: Aircraft, trimmed: Array, settings: Array, added: Array) -> Array:
    """Engines' settings one step later; those over rotation speed stay where they are."""
    moved = []
    for index, engine in enumerate(aircraft.propulsion):
        if engine.rpm is not None:
            moved.append(settings[index])
            continue
        goal = jnp.clip(trimmed[index] + added, 0.0, 1.0)
        share = 1.0 - np.exp(-STEP / engine.time_constant) if engine.time_constant else 1.0
        moved.append(settings[index] + share * (goal - settings[index]))
    return jnp.stack(moved) if moved else settings


def regressor_values(
    aircraft: Aircraft, density: float, flown: Flown, draw: int = 0
) -> dict[str, Float[np.ndarray, " sample"]]:
    """Every variable that a regressor may use, along one aircraft's motion, and `traces.names`."""
    shape = aircraft.geometry
    speed, rate = flown.airspeed[draw], flown.rate[draw]
    half_span, half_chord = 0.5 * shape.wing_span / speed, 0.5 * shape.mean_chord / speed
    pressure = 0.5 * density * speed**2
    found = {
        "alpha": flown.alpha[draw],
        "beta": flown.beta[draw],
        "phat": rate[:, 0] * half_span,
        "qhat": rate[:, 1] * half_chord,
        "rhat": rate[:, 2] * half_span,
        "alphadot_hat": np.gradient(flown.alpha[draw], STEP) * half_chord,
        "Tc": flown.thrust[draw] / (pressure * shape.wing_area),
        "qbar": pressure,
        "h_over_b": flown.height[draw] / shape.wing_span,
        "V": speed,
        **dict(zip(aircraft.control_names, flown.controls[draw].T, strict=True)),
    }
    time = STEP * np.arange(speed.size)
    return found | traces.values(found, aircraft.control_names, time)


def _push(aircraft: Aircraft, speed: Array, settings: Array, density: Array) -> Array:
    """Sum of all thrusts [N], as `rigid_body` has it in Tc."""
    total = jnp.zeros_like(speed)
    for index, engine in enumerate(aircraft.propulsion):
        axis = np.array(engine.axis) / np.linalg.norm(engine.axis)
        along = propulsion.static_thrust(engine, settings[index], speed, density)
        total = total + along * axis.sum()
    return total
