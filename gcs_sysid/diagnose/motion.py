"""What a file predicts of a flight's accelerations, as a function of all that may be wrong.

The measured side stays what the sensors gave, whatever is wrong: were mass or airspeed allowed to
change it, the noise in it would shrink with them, and the best explanation of any flight would be
an aircraft without mass. So with C the coefficients at the flow and the deflections as they really
were, T the thrust, M_T its moment about the airframe point,

    f = (q̄S C + T)/m + ω̇ × r + ω × (ω × r) + b
    ω̇ = I⁻¹ (q̄S L C + M_T − r_cg × (q̄S C + T) − ω × I ω)

are held against the specific force at the inertial unit (lever r, bias b) and the angular
acceleration, both made dimensionless as coefficients are, with the numbers of the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.frames import Array
from gcs_sysid.model import aerodynamics

Wrong = Mapping[str, Array]
"""How wrong everything is, by name: see `quantities`."""

AXES = ("x", "y", "z")


class Motion(NamedTuple):
    """What a flight measured, before a file turns it into coefficients.

    Attributes:
        airspeed: true airspeed at the centre of gravity [m/s].
        alpha: angle of attack there [rad].
        beta: sideslip there [rad].
        alpha_rate: [rad/s].
        rate: smoothed angular rate [rad/s].
        acceleration: angular acceleration of the same smoother [rad/s²].
        force: specific force at the inertial unit [m/s²].
        lever: of that unit from the centre of gravity of the file [m].
        thrust: sum of all engines, body axes [N].
        thrust_moment: of them about the airframe point, torque included [N·m].
        density: of the air [kg/m³].
        height: above ground [m].
        controls: deflections [rad].
        control_rates: [rad/s].
        airspeed_scale: error of the indicated airspeed that has been taken off `airspeed`.
    """

    airspeed: Float[Array, " sample"]
    alpha: Float[Array, " sample"]
    beta: Float[Array, " sample"]
    alpha_rate: Float[Array, " sample"]
    rate: Float[Array, "sample axis"]
    acceleration: Float[Array, "sample axis"]
    force: Float[Array, "sample axis"]
    lever: Float[Array, " axis"]
    thrust: Float[Array, "sample axis"]
    thrust_moment: Float[Array, "sample axis"]
    density: Float[Array, " sample"]
    height: Float[Array, " sample"]
    controls: Mapping[str, Float[Array, " sample"]]
    control_rates: Mapping[str, Float[Array, " sample"]]
    airspeed_scale: Float[Array, ""]


@dataclass(frozen=True)
class Quantity:
    """One thing that may be wrong: its unit and meaning."""

    unit: str
    meaning: str


def quantities(aircraft: Aircraft) -> dict[str, Quantity]:
    """Everything that may be wrong with an aircraft, by name."""
    found = {
        "mass": Quantity("1", "true over believed mass, less one"),
        "thrust": Quantity("1", "true over believed thrust, less one"),
        "airspeed": Quantity("1", "indicated over true airspeed, less one"),
        "alpha": Quantity("rad", "angle of attack used less true"),
        "beta": Quantity("rad", "sideslip used less true"),
        "delay": Quantity("s", "by which the surfaces move later than used"),
    }
    for axis in AXES:
        found[f"inertia.{axis}"] = Quantity("1", f"true over believed inertia about {axis}, less 1")
        found[f"cg.{axis}"] = Quantity("mean chords", f"true less believed place along {axis}")
        found[f"accelerometer.{axis}"] = Quantity("m/s²", "indicated less true specific force")
    for name in aircraft.control_names:
        found[f"effectiveness.{name}"] = Quantity("1", "true over believed effect, less one")
        found[f"offset.{name}"] = Quantity("rad", "true less believed deflection")
    for coefficient, model in aircraft.aerodynamics.items():
        for key in (*model.terms, *(table.name for table in model.tables)):
            found[f"{coefficient}.{key}"] = Quantity("sigma", "true less believed value")
    return found


def nothing(aircraft: Aircraft, motion: Motion) -> dict[str, Array]:
    """The file as it is, but for the error of airspeed that has been taken off already."""
    return dict.fromkeys(quantities(aircraft), jnp.zeros(())) | {"airspeed": motion.airspeed_scale}


def measured(aircraft: Aircraft, motion: Motion) -> Float[Array, "sample six"]:
    """The accelerations that the sensors gave, as coefficients are made of them."""
    return _dimensionless(aircraft, motion, motion.force, motion.acceleration)


def predicted(aircraft: Aircraft, wrong: Wrong, motion: Motion) -> Float[Array, "sample six"]:
    """The accelerations that the file foretells, likewise."""
    shape, body, rate = aircraft.geometry, aircraft.mass, motion.rate
    speed = _airspeed(wrong, motion)
    area = (0.5 * motion.density * speed**2 * shape.wing_area)[:, None]
    found = _coefficients(aircraft, wrong, flow(aircraft, wrong, motion))
    thrust = 1.0 + wrong["thrust"]
    force = area * found[:, :3] + thrust * motion.thrust
    moved = shape.mean_chord * _vector(wrong, "cg")
    lever = jnp.broadcast_to((motion.lever - moved)[None], rate.shape)
    specific = force / (body.mass * (1.0 + wrong["mass"])) + _vector(wrong, "accelerometer")[None]
    specific = specific + frames.cross(motion.acceleration, lever)
    specific = specific + frames.cross(rate, frames.cross(rate, lever))
    cg = jnp.broadcast_to((np.array(body.cg) + moved)[None], rate.shape)
    lengths = jnp.array([[shape.wing_span, shape.mean_chord, shape.wing_span]])
    moment = area * lengths * found[:, 3:] + thrust * motion.thrust_moment
    moment = moment - frames.cross(cg, force)
    inertia = body.inertia + jnp.diag(_vector(wrong, "inertia") * np.diagonal(body.inertia))
    turning = frames.cross(rate, rate @ inertia.T)
    acceleration = jnp.linalg.solve(inertia, (moment - turning).T).T
    return _dimensionless(aircraft, motion, specific, acceleration)


def _coefficients(
    aircraft: Aircraft, wrong: Wrong, values: Mapping[str, Float[Array, " sample"]]
) -> Float[Array, "sample six"]:
    """CX…Cn of the file's aerodynamics, with their values as wrong as `wrong` says."""
    models = aircraft.aerodynamics
    terms = {
        name: {
            key: term.value + term.sigma * wrong[f"{name}.{key}"]
            for key, term in model.terms.items()
        }
        for name, model in models.items()
    }
    shares = {
        name: {item.name: 1.0 + item.sigma * wrong[f"{name}.{item.name}"] for item in model.tables}
        for name, model in models.items()
    }
    return aerodynamics.of_aircraft(aircraft, values, terms=terms, shares=shares)


def flow(aircraft: Aircraft, wrong: Wrong, motion: Motion) -> dict[str, Float[Array, " sample"]]:
    """Every variable that a regressor may use, corrected for what is wrong."""
    shape = aircraft.geometry
    speed = _airspeed(wrong, motion)
    half_span, half_chord = 0.5 * shape.wing_span / speed, 0.5 * shape.mean_chord / speed
    pressure = 0.5 * motion.density * speed**2
    push = (1.0 + wrong["thrust"]) * jnp.sum(motion.thrust, axis=1)
    return {
        "alpha": motion.alpha - wrong["alpha"],
        "beta": motion.beta - wrong["beta"],
        "phat": motion.rate[:, 0] * half_span,
        "qhat": motion.rate[:, 1] * half_chord,
        "rhat": motion.rate[:, 2] * half_span,
        "alphadot_hat": motion.alpha_rate * half_chord,
        "Tc": push / (pressure * shape.wing_area),
        "qbar": pressure,
        "h_over_b": motion.height / shape.wing_span,
        "V": speed,
        **{
            name: (1.0 + wrong[f"effectiveness.{name}"])
            * (value - wrong["delay"] * motion.control_rates[name] + wrong[f"offset.{name}"])
            for name, value in motion.controls.items()
        },
    }


def _dimensionless(
    aircraft: Aircraft,
    motion: Motion,
    force: Float[Array, "sample axis"],
    acceleration: Float[Array, "sample axis"],
) -> Float[Array, "sample six"]:
    """Specific force and angular acceleration over what makes a coefficient of them."""
    shape, body = aircraft.geometry, aircraft.mass
    area = (0.5 * motion.density * motion.airspeed**2 * shape.wing_area)[:, None]
    lengths = jnp.array([[shape.wing_span, shape.mean_chord, shape.wing_span]])
    moment = acceleration @ body.inertia.T / (area * lengths)
    return jnp.concatenate([body.mass * force / area, moment], axis=1)


def _airspeed(wrong: Wrong, motion: Motion) -> Float[Array, " sample"]:
    return motion.airspeed * (1.0 + motion.airspeed_scale) / (1.0 + wrong["airspeed"])


def _vector(wrong: Wrong, name: str) -> Float[Array, " axis"]:
    return jnp.stack([wrong[f"{name}.{axis}"] for axis in AXES])
