"""Linear models of small motions about steady flight, with what is not known about them.

    ẋ = A x + B u      y = C x + D u      deviations from a trim

of the rigid body of `rigid_body` in still air, by exact derivatives. Uncertain aerodynamics move
the trim as well as the slopes at it, so that the trim is solved again for every set of values.
Surfaces and engines are taken to follow their commands at once; whoever closes a loop adds their
lags.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.atmosphere import GRAVITY
from gcs_sysid.frames import Array
from gcs_sysid.model import rigid_body
from gcs_sysid.model import trim as trims
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.model.rigid_body import Parameters, State
from gcs_sysid.model.trim import Trim

STATES = {
    "V": "m/s",
    "alpha": "rad",
    "beta": "rad",
    "p": "rad/s",
    "q": "rad/s",
    "r": "rad/s",
    "phi": "rad",
    "theta": "rad",
}
"""States and their units."""
OUTPUTS = {**STATES, "ax": "m/s^2", "ay": "m/s^2", "az": "m/s^2"}
"""Outputs and their units: the states, and specific force at the centre of gravity, body axes."""
LONGITUDINAL = ("V", "alpha", "q", "theta")
LATERAL = ("beta", "p", "r", "phi")
MASS, INERTIA = "mass", "inertia"
"""Names of the relative errors of mass and inertia among the uncertain values."""
TRIM_STEPS = 30
"""Gauss–Newton steps from the trim of the mean values: a sideslip that nothing but the weight of
`trim.LEAST` holds loses a third of its error in each."""
STEPS = (1e-4, 0.1)
"""Least and largest step of central differences over a value, relative. Between them it is one
standard deviation: next to a table's breakpoint a smaller one would take the bend for a slope."""
SMALLEST = 0.01
"""Size that a value near zero has for that."""
BESIDE = 1e-9
"""How much faster, relative, than asked for: at a breakpoint of a thrust table rounding would
choose the side."""


class Matrices(NamedTuple):
    """A linear model and the trim that it is about.

    Attributes:
        A: dynamics.
        B: of the controls and, after them, the engines' settings.
        C: of the outputs.
        D: direct part of the outputs.
        state: values of the states at the trim, in the order of `STATES`.
        control: controls [rad] and settings at the trim.
    """

    A: Float[Array, "state state"]
    B: Float[Array, "state input"]
    C: Float[Array, "output state"]
    D: Float[Array, "output input"]
    state: Float[Array, " state"]
    control: Float[Array, " input"]


@dataclass(frozen=True)
class Linear:
    """A linear model with its uncertainty to first order.

    Attributes:
        trim: where it holds.
        inputs: units of the inputs by name.
        mean: the matrices.
        deviation: one standard deviation of every entry.
        names: uncertain values: (coefficient, regressor), or one of mass and inertia twice.
        covariance: of these values.
        slopes: derivative of every entry by each of them, in the last axis.
    """

    trim: Trim
    inputs: Mapping[str, str]
    mean: Matrices
    deviation: Matrices
    names: tuple[tuple[str, str], ...]
    covariance: Float[np.ndarray, "value value"]
    slopes: Matrices


def uncertain(aircraft: Aircraft) -> tuple[tuple[str, str], ...]:
    """Values of an aircraft that a linear model depends on, in the order of covariances."""
    terms = [(name, key) for name, model in aircraft.aerodynamics.items() for key in model.terms]
    return (*terms, (MASS, MASS), (INERTIA, INERTIA))


def stated_covariance(
    aircraft: Aircraft, found: Mapping[str, Float[np.ndarray, "term term"]] | None = None
) -> Float[np.ndarray, "value value"]:
    """Covariance of the values of `uncertain`.

    Args:
        aircraft: its sigmas count where nothing was found.
        found: covariance of coefficients that were identified, by name, in the order of their
            terms. Mass and inertia then count as exact: what was seen are force by mass and moment
            by inertia, and errors of the divisors are made up for by the coefficients. Covariances
            should leave them out too.
    """
    blocks = []
    for name, model in aircraft.aerodynamics.items():
        if found is not None and name in found:
            blocks.append(np.asarray(found[name]))
        else:
            blocks.append(np.diag([item.sigma**2 for item in model.terms.values()]))
    sigma = (aircraft.mass.mass_sigma, aircraft.mass.inertia_sigma)
    blocks.append(np.diag([item**2 if found is None else 0.0 for item in sigma]))
    size = sum(block.shape[0] for block in blocks)
    whole = np.zeros((size, size))
    at = 0
    for block in blocks:
        end = at + block.shape[0]
        whole[at:end, at:end] = block
        at = end
    return whole


class Linearisation:
    """Linear models of one aircraft, for all conditions and all values of its terms.

    Args:
        aircraft: with its aerodynamics.
    """

    def __init__(self, aircraft: Aircraft) -> None:
        self.aircraft = aircraft
        self._model = FlightModel(aircraft)

    def at(self, trim: Trim, covariance: Float[np.ndarray, "value value"]) -> Linear:
        """The linear model at a trim of the aircraft.

        Args:
            trim: steady flight.
            covariance: of the values of `uncertain`.
        """
        size = np.maximum(np.abs(_mean(self.aircraft)), SMALLEST)
        low, high = STEPS
        step = np.clip(np.sqrt(np.diagonal(covariance)), low * size, high * size)
        moved = np.vstack([np.zeros_like(step), np.diag(step), -np.diag(step)])
        every = self.drawn(trim, moved)
        count = step.size

        def slope(values: np.ndarray) -> np.ndarray:
            across = (values[1 : count + 1] - values[count + 1 :]).T / (2.0 * step)
            return np.moveaxis(across, 0, -2) if values.ndim == 3 else across

        slopes = Matrices(*(slope(values) for values in every))
        return Linear(
            trim=trim,
            inputs=_inputs(self.aircraft),
            mean=Matrices(*(values[0] for values in every)),
            deviation=Matrices(*(spread(values, covariance) for values in slopes)),
            names=uncertain(self.aircraft),
            covariance=covariance,
            slopes=slopes,
        )

    def drawn(self, trim: Trim, moved: Float[np.ndarray, "draw value"]) -> Matrices:
        """Linear models for other values, each about its own trim; the first axis is the draw.

        Args:
            trim: steady flight of the aircraft as its file has it.
            moved: added to the values of `uncertain`; relative for mass and inertia.
        """
        unknown = np.tile(trim.unknown, (moved.shape[0], 1))
        air = trim.condition * np.array([1.0 + BESIDE, 1.0, 1.0, 1.0, 1.0])
        values = _mean(self.aircraft) + moved
        for _ in range(TRIM_STEPS):
            off, slope = (np.asarray(item) for item in _off(values, unknown, air, self._model))
            # Columns are scaled: a setting may be thousands of revolutions, an angle hundredths.
            size = 1.0 / np.linalg.norm(slope, axis=1)
            turn, triangle = np.linalg.qr(slope * size[:, None, :])
            along = np.einsum("dij,di->dj", turn, off)
            unknown = unknown - size * np.linalg.solve(triangle, along[..., None])[..., 0]
        return Matrices(*(np.asarray(item) for item in _found(values, unknown, air, self._model)))


# What was compiled serves all aircraft of a form: numbers are arguments.
@jax.jit
@partial(jax.vmap, in_axes=(0, 0, None, None))
def _off(
    values: Array, unknown: Array, air: Array, model: FlightModel
) -> tuple[Float[Array, " equation"], Float[Array, "equation unknown"]]:
    """What keeps a flight from being steady, and how that changes with the trim."""

    def off(unknown: Array) -> Array:
        return trims.imbalance(model.aircraft, parameters(model.aircraft, values), unknown, *air)

    return off(unknown), jax.jacfwd(off)(unknown)


@jax.jit
@partial(jax.vmap, in_axes=(0, 0, None, None))
def _found(values: Array, unknown: Array, air: Array, model: FlightModel) -> Matrices:
    return matrices(model.aircraft, values, unknown, air)


def _mean(aircraft: Aircraft) -> Float[np.ndarray, " value"]:
    """The values of `uncertain` as the file has them."""
    terms = [
        item.value for model in aircraft.aerodynamics.values() for item in model.terms.values()
    ]
    return np.array([*terms, 1.0, 1.0])


def _inputs(aircraft: Aircraft) -> dict[str, str]:
    """Units of controls and engines' settings by name."""
    units = dict.fromkeys(aircraft.control_names, "rad")
    several = len(aircraft.propulsion) > 1
    for number, engine in enumerate(aircraft.propulsion, start=1):
        name, unit = ("throttle", "1") if engine.rpm is None else ("rpm", "rpm")
        units[f"{name}_{number}" if several else name] = unit
    return units


def spread(
    slopes: Float[np.ndarray, "*entry value"], covariance: Float[np.ndarray, "value value"]
) -> Float[np.ndarray, "*entry"]:
    """One standard deviation of entries to first order."""
    variance = np.einsum("...i,ij,...j->...", slopes, covariance, slopes, optimize=True)
    return np.sqrt(np.maximum(variance, 0.0))


def matrices(
    aircraft: Aircraft,
    values: Float[Array, " value"],
    unknown: Float[Array, " unknown"],
    air: Float[Array, " five"],
) -> Matrices:
    """The linear model at a trim.

    Args:
        aircraft: what is looked up.
        values: of `uncertain`; mass and inertia over the file's.
        unknown: the trim, as for `trim.imbalance`.
        air: its condition, as of `Trim.condition`.
    """
    numbers = parameters(aircraft, values)
    _, height, density, _, _ = air

    def moving(motion: Array, control: Array) -> tuple[Array, Array]:
        return rate(aircraft, numbers, motion, control, height, density)

    def both(motion: Array, control: Array) -> Array:
        change, felt = moving(motion, control)
        return jnp.concatenate([change, motion, felt])

    motion = motion_of(trims.steady(unknown, air))
    control = unknown[3:]
    by_state, by_input = jax.jacfwd(both, argnums=(0, 1))(motion, control)
    count = len(STATES)
    return Matrices(
        by_state[:count], by_input[:count], by_state[count:], by_input[count:], motion, control
    )


def motion_of(state: State) -> Float[Array, " state"]:
    """A state in still air in the order of `STATES`."""
    euler = frames.euler_from_quaternion(state.attitude)
    flow = frames.flow_angles(frames.unrotate(state.attitude, state.velocity))
    return jnp.concatenate([jnp.stack(flow), state.rate, euler[:2]])


def rate(
    aircraft: Aircraft,
    values: Parameters,
    motion: Float[Array, " state"],
    control: Float[Array, " input"],
    height: Float[Array, ""],
    density: Float[Array, ""],
) -> tuple[Float[Array, " state"], Float[Array, " axis"]]:
    """Rate of change of the motion in still air, and specific force in body axes [m/s²].

    Args:
        aircraft: what is looked up.
        values: what may vary.
        motion: in the order of `STATES`.
        control: controls [rad], then engines' settings.
        height: [m].
        density: of the air [kg/m³].
    """
    speed, alpha, beta = motion[0], motion[1], motion[2]
    roll, pitch = motion[6], motion[7]
    turning = motion[3:6]
    body = speed * jnp.stack(
        [jnp.cos(alpha) * jnp.cos(beta), jnp.sin(beta), jnp.sin(alpha) * jnp.cos(beta)]
    )
    attitude = frames.quaternion_from_euler(jnp.stack([roll, pitch, jnp.zeros_like(roll)]))
    state = State(
        position=jnp.stack([jnp.zeros_like(height), jnp.zeros_like(height), -height]),
        velocity=frames.rotate(attitude, body),
        attitude=attitude,
        rate=turning,
    )
    count = len(aircraft.controls)
    given = trims.inputs(aircraft, control[:count], control[count:], density)
    slope = rigid_body.derivative(aircraft, values, state, given)
    weight = frames.unrotate(attitude, jnp.array([0.0, 0.0, GRAVITY]))
    felt = frames.unrotate(attitude, slope.velocity) - weight
    pulled = felt + weight - frames.cross(turning, body)
    flow = jax.jvp(frames.flow_angles, (body,), (pulled,))[1]
    swing = turning[1] * jnp.sin(roll) + turning[2] * jnp.cos(roll)
    roll_rate = turning[0] + swing * jnp.tan(pitch)
    pitch_rate = turning[1] * jnp.cos(roll) - turning[2] * jnp.sin(roll)
    return jnp.concatenate([jnp.stack(flow), slope.rate, jnp.stack([roll_rate, pitch_rate])]), felt


def parameters(aircraft: Aircraft, values: Float[Array, " value"]) -> Parameters:
    """An aircraft's numbers with other values of `uncertain`; mass and inertia over the file's."""
    base = rigid_body.parameters(aircraft)
    given = dict(zip(uncertain(aircraft), values, strict=True))
    return base._replace(
        mass=base.mass * given[MASS, MASS],
        inertia=base.inertia * given[INERTIA, INERTIA],
        aerodynamics={
            name: {key: given[name, key] for key in terms}
            for name, terms in base.aerodynamics.items()
        },
    )
