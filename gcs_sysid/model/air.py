"""The air that an aircraft flies through: steady wind, gusts, and the gusts' own rotation.

Gusts are first-order Gauss–Markov processes of translation g and rotation s in level axes (north,
east, down), each kept at its own intensity σ with correlation time T. The field that carries a gust
past the aircraft also turns it: MIL-F-8785C (1980, section 3.7.2) makes pitching and yawing gusts
high-passed copies of the vertical and lateral ones, so s is driven by the changes of g as well,

    dg = −g/T_g dt + σ_g √(2/T_g) dW        ds = −s/T_s dt + C dg + σ_s √(2/T_s) dW′

with C [rad/m] unknown but no larger than about π/4 over the span. The aerodynamics feel the
velocity less wind and gust, and the rate less s. The steady wind drifts as a random walk.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Float

from gcs_sysid.frames import Array

FOOT = 0.3048
WIND_DRIFT = 0.02
"""Random walk of the steady wind [m/s/√s]: half a metre a second in ten minutes."""


class Air(NamedTuple):
    """The air at the aircraft, level axes: north, east, down.

    Attributes:
        wind: steady wind, blowing toward [m/s].
        gust: translation of the gust [m/s].
        spin: its rotation [rad/s].
    """

    wind: Float[Array, " axis"]
    gust: Float[Array, " axis"]
    spin: Float[Array, " axis"]


class Turbulence(NamedTuple):
    """How strong the gusts are and how long they last; of translation, horizontal axes alike.

    Attributes:
        gust: standard deviation, horizontal and vertical [m/s].
        gust_time: correlation time, likewise [s].
        spin: standard deviation of the rotation that the gust does not explain, about north, east
            and down: the specification's own differ with the axis [rad/s].
        spin_time: correlation time, likewise [s].
        coupling: entries of C: vertical gust into rotation about north and about east, gust toward
            north and toward east into rotation about down [rad/m].
    """

    gust: Float[Array, " two"]
    gust_time: Float[Array, " two"]
    spin: Float[Array, " axis"]
    spin_time: Float[Array, " axis"]
    coupling: Float[Array, " four"]


def scale_lengths(height: float) -> tuple[float, float]:
    """Horizontal and vertical scale of turbulence [m] at a height above ground [m].

    MIL-F-8785C (1980), sections 3.7.3.1 and 3.7.3.2: low altitude below 1000 ft, 1750 ft above
    2000 ft, linear between.
    """
    low, high, aloft = 1000.0 * FOOT, 2000.0 * FOOT, 1750.0 * FOOT
    near = min(max(height, 10.0 * FOOT), low)
    level = near / (0.177 + 0.000823 * near / FOOT) ** 1.2
    share = min(max((height - low) / (high - low), 0.0), 1.0)
    return level + share * (aloft - level), near + share * (aloft - near)


def correlation_times(height: float, airspeed: float) -> tuple[float, float]:
    """Correlation time of horizontal and vertical gusts [s], as first-order processes.

    Those that have Dryden's spectra at low frequency: L/V along the flight path and L/(2V) across
    it. A horizontal gust is one or the other with the heading, so that the mean is taken.
    """
    level, down = scale_lengths(height)
    return 0.75 * level / airspeed, 0.5 * down / airspeed


def drift(air: Air, turbulence: Turbulence) -> Air:
    """Mean rate of change of the air, in the fields of an `Air`."""
    gust = -air.gust / _axes(turbulence.gust_time)
    spin = -air.spin / turbulence.spin_time + coupling_matrix(turbulence) @ gust
    return Air(jnp.zeros(3), gust, spin)


def density(turbulence: Turbulence) -> Float[Array, " nine"]:
    """Spectral density of the white noise that drives wind, gust and spin: 2 σ²/T.

    Without the part of the spin that comes with the gust.
    """
    gust = 2.0 * turbulence.gust**2 / turbulence.gust_time
    spin = 2.0 * turbulence.spin**2 / turbulence.spin_time
    return jnp.concatenate([jnp.full(3, WIND_DRIFT**2), _axes(gust), spin])


def coupling_matrix(turbulence: Turbulence) -> Float[Array, "axis axis"]:
    """C: rotation that a change of the gust brings along [rad/m]."""
    north, east, from_north, from_east = turbulence.coupling
    zero = jnp.zeros_like(north)
    return jnp.stack(
        [
            jnp.stack([zero, zero, north]),
            jnp.stack([zero, zero, east]),
            jnp.stack([from_north, from_east, zero]),
        ]
    )


def _axes(pair: Float[Array, " two"]) -> Float[Array, " axis"]:
    """Horizontal, horizontal, vertical."""
    return jnp.stack([pair[0], pair[0], pair[1]])
