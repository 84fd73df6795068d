"""A simulation flown beside a measured flight, in windows that each begin with the measured state.

A window is started from the reconstructed state, given the measured controls and the reconstructed
wind, and left alone: for a few seconds, since later an aircraft that is but a little different is
elsewhere and little can be read from the difference; or for a whole maneuver, which is how the
simulation would be used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.frames import Array
from gcs_sysid.model import actuators, rigid_body
from gcs_sysid.model.rigid_body import Inputs, Parameters, State
from gcs_sysid.offline import flight as flights
from gcs_sysid.offline.flight import Flight

LENGTH = 3.0
"""Length of a short window [s]."""
FREE = 30.0
"""Longest part of a maneuver [s] that is flown freely, from its beginning."""
STEP = 0.01
"""Step of the integration [s]: a quarter of the roll mode of a small aircraft."""
SHARE = 1e-3
"""Part of a sigma that a value is moved by to see what it does."""
_NONE = (np.zeros(0), np.zeros(0), np.zeros(0))
CHANNELS = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi")
UNITS = {"V": "m/s", "p": "rad/s", "q": "rad/s", "r": "rad/s"}
"""Of channels that are not in rad."""


class Windows(NamedTuple):
    """Measured motion and inputs, cut into windows, those that end earlier filled up.

    Attributes:
        time: [s after the recording's epoch].
        piece: maneuver of each window.
        start: state at the beginning of each.
        flow_sigma: one standard deviation of airspeed, angle of attack, sideslip there.
        inputs: what acted on the aircraft.
        measured: the reconstructed channels, in the order of `CHANNELS` [m/s, rad, rad/s]; NaN
            after a window's end.
    """

    time: Float[np.ndarray, "window sample"]
    piece: np.ndarray
    start: State
    flow_sigma: Float[np.ndarray, "window three"]
    inputs: Inputs
    measured: Float[np.ndarray, "window sample channel"]


class Simulated(NamedTuple):
    """Simulated channels, and one standard deviation of them.

    The deviation is what the sigmas of the aircraft file's aerodynamics and of the state at the
    window's beginning make of them.
    """

    value: Float[np.ndarray, "window sample channel"]
    deviation: Float[np.ndarray, "window sample channel"]


def cut(flight: Flight, aircraft: Aircraft) -> Windows:
    """Short windows: every maneuver from its beginning, without holes in the telemetry."""
    spans = [
        (begin, begin + LENGTH, segment.id)
        for segment in flight.segments
        for begin in np.arange(segment.start, segment.end - LENGTH + 1e-9, LENGTH).tolist()
    ]
    return _cut(flight, aircraft, spans)


def whole(flight: Flight, aircraft: Aircraft) -> Windows:
    """Every maneuver without holes in the telemetry, each one window of `FREE` at most."""
    spans = [
        (segment.start, min(segment.end, segment.start + FREE), segment.id)
        for segment in flight.segments
    ]
    return _cut(flight, aircraft, spans)


def _cut(flight: Flight, aircraft: Aircraft, spans: Sequence[tuple[float, float, int]]) -> Windows:
    """Windows from begin to end, each of a maneuver; those with holes are left out."""
    states = flight.reconstruction
    bad = flights.beside_holes(states.time)
    kept = []
    for begin, end, piece in spans:
        inside = (states.time >= begin) & (states.time <= end)
        if inside.sum() > 2 and not bad[inside].any():
            kept.append((begin, end, piece))
    begins, ends, pieces = (np.array(part) for part in zip(*kept, strict=True)) if kept else _NONE
    count = round(float(np.max(ends - begins, initial=0.0)) / STEP) + 1
    time = begins[:, None] + STEP * np.arange(count)
    beyond = time > ends[:, None] + 0.5 * STEP

    def at(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(values.shape[0], -1)
        columns = [np.interp(time.ravel(), states.time, column) for column in flat.T]
        return np.stack(columns, axis=1).reshape(*time.shape, *values.shape[1:])

    speed, alpha, beta = at(states.airspeed), at(states.alpha), at(states.beta)
    rate, wind = at(states.rate), at(states.wind)
    turning = np.zeros_like(wind) if states.gust_rate is None else at(states.gust_rate)
    euler = at(np.unwrap(states.euler, axis=0))
    through = speed[..., None] * np.stack(
        [np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)], axis=-1
    )
    attitude = frames.quaternion_from_euler(euler)
    position = np.zeros_like(rate)
    position[..., 2] = -at(states.height)
    deviation = np.sqrt(np.einsum("sii->si", states.flow_covariance))
    measured = np.concatenate([np.stack([speed, alpha, beta], axis=-1), rate, euler], axis=-1)
    return Windows(
        time=time,
        piece=pieces.astype(int),
        start=State(
            *(
                jnp.asarray(values[:, 0])
                for values in (position, frames.rotate(attitude, through) + wind, attitude, rate)
            )
        ),
        flow_sigma=at(deviation)[:, 0],
        inputs=_inputs(flight, aircraft, time, wind, turning, at(states.density)),
        measured=np.where(beyond[..., None], np.nan, measured),
    )


def _inputs(
    flight: Flight,
    aircraft: Aircraft,
    time: Float[np.ndarray, "window sample"],
    wind: Float[np.ndarray, "window sample axis"],
    turning: Float[np.ndarray, "window sample axis"],
    density: Float[np.ndarray, "window sample"],
) -> Inputs:
    """Deflections and engine settings exactly between the recorded commands."""
    stream = flight.recording.streams[flights.SERVO_STREAM]
    when, sent = flights.pulses(stream, flights.control_channels(aircraft))
    late = flight.delay.value
    controls = actuators.controls(aircraft, sent, when, at=time.ravel(), extra_delay=late)
    settings = [
        flights.setting(flight.recording, aircraft, engine, time.ravel()).reshape(time.shape)
        for engine in aircraft.propulsion
    ]
    return Inputs(
        controls={
            name: jnp.broadcast_to(jnp.asarray(value), (time.size,)).reshape(time.shape)
            for name, value in controls.items()
        },
        settings=jnp.asarray(np.stack(settings, axis=-1))
        if settings
        else jnp.zeros((*time.shape, 0)),
        wind=jnp.asarray(wind),
        gust_rate=jnp.asarray(turning),
        density=jnp.asarray(density),
    )


def fly(aircraft: Aircraft, windows: Windows) -> Simulated:
    """The file's aircraft on the measured controls, window by window."""
    sigma = {
        name: {key: jnp.asarray(item.sigma) for key, item in model.terms.items()}
        for name, model in aircraft.aerodynamics.items()
    }
    count = 3 + sum(len(entry) for entry in sigma.values())
    # The file as it is first, then a small share of each sigma: differences, since a derivative of
    # the whole flight takes three times as long to compile.
    moves = jnp.concatenate([jnp.zeros((1, count)), SHARE * jnp.eye(count)])
    paths = _flown(aircraft, windows, sigma, moves)
    spread = (paths[1:] - paths[0]) / SHARE
    return Simulated(paths[0], np.sqrt(np.sum(spread**2, axis=0)))


def fly_freely(aircraft: Aircraft, windows: Windows) -> Float[np.ndarray, "window sample channel"]:
    """The same without deviations; what the simulation cannot fly to the end is not finite."""
    none = {name: {key: jnp.zeros(()) for key in model.terms}
            for name, model in aircraft.aerodynamics.items()}  # fmt: skip
    count = 3 + sum(len(entry) for entry in none.values())
    return _flown(aircraft, windows, none, jnp.zeros((1, count)))[0]


def _flown(
    aircraft: Aircraft,
    windows: Windows,
    sigma: Mapping[str, Mapping[str, Array]],
    moves: Float[Array, "move value"],
) -> Float[np.ndarray, "move window sample channel"]:
    """Channels with flow at the beginning and values moved by so many of their sigmas."""
    values = rigid_body.parameters(aircraft)
    time = jnp.asarray(STEP * np.arange(windows.time.shape[1]))

    def one(change: Array, start: State, inputs: Inputs, flow: Array) -> Array:
        moved = _started(start, inputs, change[:3] * flow)
        changed = _changed(values, sigma, change[3:])
        path = rigid_body.propagate(aircraft, changed, moved, inputs, time)
        return jax.vmap(channels_of)(path, inputs.wind)

    given = (windows.start, windows.inputs, jnp.asarray(windows.flow_sigma))
    every = jax.vmap(one, in_axes=(None, 0, 0, 0))
    paths = np.array(jax.jit(lambda rows: jax.lax.map(lambda row: every(row, *given), rows))(moves))
    with np.errstate(invalid="ignore"):  # what was lost stays lost
        paths[..., 6:] = np.unwrap(paths[..., 6:], axis=2)
    turns = (windows.measured[:, :1, 6:] - paths[0, :, :1, 6:]) / (2.0 * np.pi)
    paths[..., 6:] += 2.0 * np.pi * np.round(turns)
    return paths


def _changed(
    values: Parameters, sigma: Mapping[str, Mapping[str, Array]], change: Array
) -> Parameters:
    """Aerodynamic values moved by so many of their sigmas."""
    shares = iter(change)
    moved = {
        name: {
            key: value + next(shares) * sigma[name][key]
            for key, value in values.aerodynamics[name].items()
        }
        for name in sigma
    }
    return values._replace(aerodynamics=moved)


def _started(start: State, inputs: Inputs, change: Float[Array, " three"]) -> State:
    """The first state with other airspeed and flow angles; the wind stays."""
    wind = inputs.wind[0]
    through = frames.unrotate(start.attitude, start.velocity - wind)
    speed, alpha, beta = frames.flow_angles(through)
    speed, alpha, beta = speed + change[0], alpha + change[1], beta + change[2]
    turned = speed * jnp.stack(
        [jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)]
    )
    return start._replace(velocity=frames.rotate(start.attitude, turned) + wind)


def channels_of(state: State, wind: Float[Array, " axis"]) -> Float[Array, " channel"]:
    """The channels of one state, in the order of `CHANNELS`."""
    flow = frames.flow_angles(frames.unrotate(state.attitude, state.velocity - wind))
    return jnp.concatenate(
        [jnp.stack(flow), state.rate, frames.euler_from_quaternion(state.attitude)]
    )
