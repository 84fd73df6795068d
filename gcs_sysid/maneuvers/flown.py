"""A maneuver flown by a model, many times with aerodynamics drawn from what is believed of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.atmosphere import GRAVITY
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.frames import Array
from gcs_sysid.maneuvers.holding import Linear
from gcs_sysid.model import propulsion, rigid_body
from gcs_sysid.model import trim as trims
from gcs_sysid.model.rigid_body import Parameters, State
from gcs_sysid.model.trim import Trim

STEP = 0.02
"""Step of the simulation [s]."""
DRAWS = 64
"""Aircraft drawn from the model's posterior, beside its mean."""


class Flown(NamedTuple):
    """Motions of all drawn aircraft, that of the mean first.

    Attributes:
        airspeed: [m/s].
        alpha: [rad].
        beta: [rad].
        rate: [rad/s].
        bank: [rad].
        load_factor: [g].
        height: [m].
        controls: deflections [rad], in the order of the aircraft's controls.
    """

    airspeed: Float[np.ndarray, "draw sample"]
    alpha: Float[np.ndarray, "draw sample"]
    beta: Float[np.ndarray, "draw sample"]
    rate: Float[np.ndarray, "draw sample axis"]
    bank: Float[np.ndarray, "draw sample"]
    load_factor: Float[np.ndarray, "draw sample"]
    height: Float[np.ndarray, "draw sample"]
    controls: Float[np.ndarray, "draw sample control"]


def draws(
    aircraft: Aircraft, model: AeroModel, generator: np.random.Generator
) -> Mapping[str, Mapping[str, Float[np.ndarray, " draw"]]]:
    """Aerodynamic values by coefficient and term: the mean, then draws from the posterior."""
    values = {}
    for name, entry in aircraft.aerodynamics.items():
        if name not in model.fits:
            values[name] = {
                key: np.full(DRAWS + 1, item.value) for key, item in entry.terms.items()
            }
            continue
        fit = model.fits[name]
        roots, vectors = np.linalg.eigh(fit.covariance)
        spread = vectors * np.sqrt(np.maximum(roots, 0.0))
        moved = fit.value + generator.standard_normal((DRAWS, roots.size)) @ spread.T
        every = np.vstack([fit.value, moved])
        column = {key: every[:, index] for index, key in enumerate(fit.keys)}
        values[name] = {key: column[key] for key in entry.terms}
    return values


class Simulator:
    """Flies inputs added to the trim of one condition; compiled once.

    Args:
        aircraft: with the model's mean as its aerodynamics.
        trim: where the maneuver begins.
        linear: motions about it, with the controller's gain.
        values: aerodynamics of every aircraft that is flown, see `draws`.
    """

    def __init__(
        self,
        aircraft: Aircraft,
        trim: Trim,
        linear: Linear,
        values: Mapping[str, Mapping[str, Float[np.ndarray, " draw"]]],
    ) -> None:
        self._values = jax.tree.map(jnp.asarray, dict(values))
        base = rigid_body.parameters(aircraft)

        def one(drawn: Mapping[str, Mapping[str, Array]], added: Array) -> Flown:
            return _fly(aircraft, base._replace(aerodynamics=drawn), trim, linear, added)

        self._fly = jax.jit(jax.vmap(one, in_axes=(0, None)))

    def fly(self, added: Float[np.ndarray, "sample control"]) -> Flown:
        """Motions under inputs added to what the controller commands [rad]."""
        return Flown(*(np.asarray(value) for value in self._fly(self._values, jnp.asarray(added))))


def _fly(aircraft: Aircraft, values: Parameters, trim: Trim, linear: Linear, added: Array) -> Flown:
    gain, settings = jnp.asarray(linear.gain), jnp.asarray(trim.settings)

    def move(state: State, extra: Array) -> tuple[State, tuple[Array, ...]]:
        moved = jnp.asarray(trim.controls) - gain @ trims.deviation(state, trim) + extra
        given = trims.inputs(aircraft, moved, settings, trim.density)
        acting = rigid_body.loads(aircraft, values, state, given)
        speed, alpha, beta = frames.flow_angles(frames.unrotate(state.attitude, state.velocity))
        euler = frames.euler_from_quaternion(state.attitude)
        load = -acting.force[2] / (values.mass * GRAVITY)
        ahead = rigid_body.advance(
            aircraft, values, state, given, given, jnp.asarray(STEP, dtype=speed.dtype)
        )
        seen = (speed, alpha, beta, state.rate, euler[0], load, -state.position[2], moved)
        return ahead, seen

    _, rows = jax.lax.scan(move, trim.state, added)
    return Flown(*rows)


def regressor_values(
    aircraft: Aircraft, trim: Trim, flown: Flown, draw: int = 0
) -> dict[str, Float[np.ndarray, " sample"]]:
    """Every variable that a regressor may use, along one aircraft's motion."""
    shape = aircraft.geometry
    speed, rate = flown.airspeed[draw], flown.rate[draw]
    half_span, half_chord = 0.5 * shape.wing_span / speed, 0.5 * shape.mean_chord / speed
    pressure = 0.5 * trim.density * speed**2
    push = _push(aircraft, trim, speed)
    return {
        "alpha": flown.alpha[draw],
        "beta": flown.beta[draw],
        "phat": rate[:, 0] * half_span,
        "qhat": rate[:, 1] * half_chord,
        "rhat": rate[:, 2] * half_span,
        "alphadot_hat": np.gradient(flown.alpha[draw], STEP) * half_chord,
        "Tc": push / (pressure * shape.wing_area),
        "qbar": pressure,
        "h_over_b": flown.height[draw] / shape.wing_span,
        "V": speed,
        **dict(zip(aircraft.control_names, flown.controls[draw].T, strict=True)),
    }


def _push(
    aircraft: Aircraft, trim: Trim, speed: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " sample"]:
    """Sum of all thrusts [N], as in `rigid_body`."""
    total = np.zeros_like(speed)
    for engine, setting in zip(aircraft.propulsion, trim.settings, strict=True):
        axis = np.array(engine.axis) / np.linalg.norm(engine.axis)
        along = propulsion.static_thrust(
            engine, np.full_like(speed, setting), speed, np.full_like(speed, trim.density)
        )
        total = total + np.asarray(along) * axis.sum()
    return total
