"""Thrust and torque from tables over throttle, or rotation speed, and airspeed.

The tables hold sea-level values over true airspeed; both scale with air density, as the forces on a
propeller do at the same advance ratio. Not good for engines that lose power with height in another
way.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from gcs_sysid.aircraft import Propulsion
from gcs_sysid.atmosphere import SEA_LEVEL_DENSITY
from gcs_sysid.errors import UsageError
from gcs_sysid.model import tables
from gcs_sysid.model.actuators import response


def throttle(
    propulsion: Propulsion,
    pwm: Float[ArrayLike, " sample"],
    time: Float[ArrayLike, " sample"],
    *,
    at: Float[ArrayLike, " grid"] | None = None,
    extra_delay: Float[ArrayLike, ""] = 0.0,
) -> Float[Array, " grid"]:
    """Throttle, 0 to 1, as the propeller follows it: a first-order lag behind the pulses.

    Args:
        propulsion: pulses of throttle 0 and 1, and the time constant.
        pwm: pulses, finite [µs].
        time: of the pulses, not decreasing [s].
        at: when the throttle is wanted [s]; by default at `time`.
        extra_delay: of the telemetry stream; may be negative and may be traced [s].
    """
    idle, full = propulsion.pwm
    command = jnp.clip((jnp.asarray(pwm) - idle) / (full - idle), 0.0, 1.0)
    return response(
        command,
        time,
        time if at is None else at,
        time_constant=propulsion.time_constant,
        delay=extra_delay,
    )


def static_thrust(
    propulsion: Propulsion,
    setting: Float[ArrayLike, "*sample"],
    airspeed: Float[ArrayLike, "*sample"],
    density: Float[ArrayLike, "*sample"],
) -> Float[Array, "*sample"]:
    """Thrust [N] along the axis at a steady setting.

    Args:
        propulsion: whose table to read; held at its edges.
        setting: throttle, 0 to 1, or rotation speed [rpm] where the table is over that.
        airspeed: true airspeed [m/s].
        density: of the air [kg/m³].
    """
    return _scaled(propulsion, jnp.asarray(propulsion.thrust), setting, airspeed, density)


def static_torque(
    propulsion: Propulsion,
    setting: Float[ArrayLike, "*sample"],
    airspeed: Float[ArrayLike, "*sample"],
    density: Float[ArrayLike, "*sample"],
) -> Float[Array, "*sample"]:
    """Reaction torque [N·m] on the airframe about the axis; 0 where the file has none.

    Arguments as for `static_thrust`.
    """
    if propulsion.torque is None:
        return jnp.zeros_like(jnp.asarray(setting))
    return _scaled(propulsion, jnp.asarray(propulsion.torque), setting, airspeed, density)


def thrust(
    propulsion: Propulsion,
    pwm: Float[ArrayLike, " sample"],
    time: Float[ArrayLike, " sample"],
    airspeed: Float[ArrayLike, " grid"],
    density: Float[ArrayLike, " grid"],
    *,
    at: Float[ArrayLike, " grid"] | None = None,
    extra_delay: Float[ArrayLike, ""] = 0.0,
) -> Float[Array, " grid"]:
    """Thrust [N] along the axis, from the pulses of the throttle.

    Args:
        propulsion: a thruster whose table is over throttle.
        pwm: pulses, finite [µs].
        time: of the pulses, not decreasing [s].
        airspeed: true airspeed at each of `at` [m/s].
        density: of the air at each of `at` [kg/m³].
        at: when the thrust is wanted [s]; by default at `time`.
        extra_delay: see `throttle` [s].

    Raises:
        UsageError: the table is over rotation speed; use `static_thrust` with the measured one.
    """
    _require_throttle_table(propulsion)
    setting = throttle(propulsion, pwm, time, at=at, extra_delay=extra_delay)
    return static_thrust(propulsion, setting, airspeed, density)


def torque(
    propulsion: Propulsion,
    pwm: Float[ArrayLike, " sample"],
    time: Float[ArrayLike, " sample"],
    airspeed: Float[ArrayLike, " grid"],
    density: Float[ArrayLike, " grid"],
    *,
    at: Float[ArrayLike, " grid"] | None = None,
    extra_delay: Float[ArrayLike, ""] = 0.0,
) -> Float[Array, " grid"]:
    """Reaction torque [N·m] about the axis, from the pulses of the throttle; as `thrust`."""
    _require_throttle_table(propulsion)
    setting = throttle(propulsion, pwm, time, at=at, extra_delay=extra_delay)
    return static_torque(propulsion, setting, airspeed, density)


def _scaled(
    propulsion: Propulsion,
    table: Float[Array, "row column"],
    setting: Float[ArrayLike, "*sample"],
    airspeed: Float[ArrayLike, "*sample"],
    density: Float[ArrayLike, "*sample"],
) -> Float[Array, "*sample"]:
    rows = jnp.asarray(propulsion.throttle if propulsion.rpm is None else propulsion.rpm)
    at_sea_level = tables.bilinear(setting, airspeed, rows, jnp.asarray(propulsion.airspeed), table)
    return at_sea_level * jnp.asarray(density) / SEA_LEVEL_DENSITY


def _require_throttle_table(propulsion: Propulsion) -> None:
    if propulsion.rpm is not None:
        raise UsageError(
            f"the thrust of channel {propulsion.throttle_channel} is over rpm, not throttle: "
            f"use the measured speed of motor {propulsion.rpm_channel} with `static_thrust`"
        )
