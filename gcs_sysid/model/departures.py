"""What an aircraft may do otherwise than its file says, beside its aerodynamics and sensor errors.

Every number is a departure: 0 where the file is right. What is wrong with the aerodynamics needs
none of these, since it is a change of terms that a model has or may be given.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Float

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.frames import Array
from gcs_sysid.model import rigid_body

LIGHT = 0.7
"""A wind of less has no direction to grow along [m/s], and nothing grows with height there; of
2 m/s 1.5 % less than is said does. In calm air the direction of what seems to blow turns with every
centimetre a second, and no filter that follows it comes to rest."""


class Departures(NamedTuple):
    """Departures from an aircraft file.

    Attributes:
        mass: relative.
        inertia: relative, of Ixx, Iyy and Izz.
        cg: centre of gravity further forward [m].
        thrust: relative.
        thrust_drop: thrust acts this far lower [m].
        thrust_tilt: thrust points up by this [rad].
        offset: where each control stands when told to stand at zero [rad].
        actuators: how much of each of the rows' `control_changes` and `setting_changes` there is.
        gyro_scale: indicated = (1 + scale)·true.
        imu_tilt: roll, pitch and yaw of the inertial unit in the airframe [rad].
        imu_position: of the inertial unit from where the file has it [m].
        heading: indicated less true [rad].
        shear: growth of the steady wind with height [1/s].
    """

    mass: Float[Array, ""]
    inertia: Float[Array, " axis"]
    cg: Float[Array, ""]
    thrust: Float[Array, ""]
    thrust_drop: Float[Array, ""]
    thrust_tilt: Float[Array, ""]
    offset: Float[Array, " control"]
    actuators: Float[Array, " change"]
    gyro_scale: Float[Array, " axis"]
    imu_tilt: Float[Array, " axis"]
    imu_position: Float[Array, " axis"]
    heading: Float[Array, ""]
    shear: Float[Array, ""]


def none(aircraft: Aircraft, changes: int) -> Departures:
    """The aircraft as its file has it, with so many changes of its actuators in the rows."""
    zero, axes = jnp.zeros(()), jnp.zeros(3)
    return Departures(
        mass=zero,
        inertia=axes,
        cg=zero,
        thrust=zero,
        thrust_drop=zero,
        thrust_tilt=zero,
        offset=jnp.zeros(len(aircraft.control_names)),
        actuators=jnp.zeros(changes),
        gyro_scale=axes,
        imu_tilt=axes,
        imu_position=axes,
        heading=zero,
        shear=zero,
    )


def body(values: rigid_body.Parameters, by: Departures) -> rigid_body.Parameters:
    """Mass properties and thrust with their departures."""
    diagonal = jnp.diag(jnp.diagonal(values.inertia) * by.inertia)
    return values._replace(
        mass=values.mass * (1.0 + by.mass),
        inertia=values.inertia + diagonal,
        cg=values.cg.at[0].add(by.cg),
        thrust=rigid_body.Thrust(1.0 + by.thrust, by.thrust_drop, by.thrust_tilt),
    )


def sheared(
    wind: Float[Array, " axis"], by: Departures, climbed: Float[Array, ""]
) -> Float[Array, " axis"]:
    """The steady wind, which grows along itself with height [m/s].

    Args:
        wind: where nothing has been climbed, NED [m/s].
        by: departures.
        climbed: height above there [m].
    """
    along = wind.at[2].set(0.0)
    squared = along @ along + 1e-12  # where nothing blows the root has no derivative
    share = squared**2 / (squared**2 + LIGHT**4)
    return wind + by.shear * climbed * share * along / jnp.sqrt(squared)


def turned(unit: Float[Array, " axis"], by: Departures) -> Float[Array, " axis"]:
    """A vector of the airframe as the inertial unit sees it."""
    return frames.unrotate(frames.quaternion_from_euler(by.imu_tilt), unit)


def centre(aircraft: Aircraft, by: Departures | None) -> Float[Array, " axis"]:
    """Centre of gravity from the airframe point [m]."""
    place = jnp.asarray(aircraft.mass.cg)
    return place if by is None else place.at[0].add(by.cg)
