"""The air that an aircraft flies through: steady wind, gusts, and the gusts' own rotation.

Gusts have Dryden's spectra (MIL-F-8785C, 1980, section 3.7.1) in axes along their field, across it,
and down, each with its own intensity σ and scale length L, which the aircraft passes in the time
T = L/V, with V its speed through the steady wind that carries the gusts (Taylor's hypothesis): of
first order along, and across and down

    g(s) = σ √T (1 + √3 T s)/(1 + T s)² W(s)

with a memory z = g(s)/(1 + T s) beside g,

    dg = (−g + (1 − √3) x)/T dt + σ √(3/T) dW     dz = (x − z)/T dt     x = (g − (1 − √3) z)/√3

The field that carries a gust past the aircraft also turns it: the specification (section 3.7.2)
makes pitching and yawing gusts high-passed copies of the vertical and lateral ones, so the gust's
rotation s is driven by the changes of g as well,

    ds = −s/T_s dt + C dg + σ_s √(2/T_s) dW′

C holds one number for the vertical gust that turns the air about the axis across, and one for the
gust across that turns it about down [rad/m], π/4 and π/3 over the span by the specification. T_s is
a length over V as well. A gyro that sees the rotation tells how the gust changes, and a
constant of sideslip, which turns with the aircraft, does not change so: it is told to a tenth of a
degree, and wrongly by more where the times are taken as constant while V is not, or as those of the
airspeed, in which the gust has a part (up to 400 nats of four minutes).

Which way the field lies is unknown, the azimuth ψ. The aerodynamics feel the velocity less wind and
gust, and the rate less s. The steady wind drifts as a random walk.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid.frames import Array

FOOT = 0.3048
ROOT = np.sqrt(3.0)
LATE = 1.0 - ROOT
SECOND = np.array([0.0, 1.0, 1.0])
"""Which axes of the field have gusts of second order."""
WIND_DRIFT = 0.02
"""Random walk of the steady wind [m/s/√s]: half a metre a second in ten minutes."""


class Air(NamedTuple):
    """The air at the aircraft, level axes: north, east, down.

    Attributes:
        wind: steady wind, blowing toward [m/s].
        gust: translation of the gust [m/s].
        spin: its rotation [rad/s].
        memory: what decides how the gust goes on [m/s].
    """

    wind: Float[Array, " axis"]
    gust: Float[Array, " axis"]
    spin: Float[Array, " axis"]
    memory: Float[Array, " axis"]


class Turbulence(NamedTuple):
    """How strong the gusts are and how long they last, along their field, across it and down.

    Attributes:
        gust: standard deviation of translation [m/s].
        gust_length: L, likewise [m].
        spin: standard deviation of the rotation that the gust does not explain: the specification's
            own differ with the axis [rad/s].
        spin_length: over which it changes, T_s V, likewise [m].
        coupling: entries of C: vertical gust into rotation about the axis across, gust across into
            rotation about down [rad/m].
        azimuth: of the axis along the field, from north toward east [rad].
    """

    gust: Float[Array, " axis"]
    gust_length: Float[Array, " axis"]
    spin: Float[Array, " axis"]
    spin_length: Float[Array, " axis"]
    coupling: Float[Array, " two"]
    azimuth: Float[Array, ""]


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


def rotation_lengths(span: float, height: float) -> tuple[float, float, float]:
    """Lengths over which the gusts' rotation changes along the field, across it and down [m].

    MIL-F-8785C (1980), section 3.7.2 for pitch and yaw, 4b/π and 3b/π; MIL-HDBK-1797 (1997),
    section 4.9 for roll, √(L b)/2.6 with L the scale of the vertical gusts.
    """
    across = 4.0 * span / np.pi
    along = np.sqrt(scale_lengths(height)[1] * span) / 2.6
    return float(along), float(across), float(0.75 * across)


def drift(air: Air, turbulence: Turbulence, speed: Float[Array, ""] | float) -> Air:
    """Mean rate of change of the air whose gusts are passed at a speed [m/s]."""
    turned = field_axes(turbulence)
    now, memory = turned.T @ air.gust, turned.T @ air.memory
    inner = SECOND * (now - LATE * memory) / ROOT
    gust = turned @ ((LATE * inner - now) * (speed / turbulence.gust_length))
    later = turned @ ((inner - memory) * (speed / turbulence.gust_length))
    own = -turned @ ((turned.T @ air.spin) * (speed / turbulence.spin_length))
    return Air(jnp.zeros(3), gust, own + coupling_matrix(turbulence) @ gust, later)


def density(turbulence: Turbulence, speed: Float[Array, ""] | float) -> Float[Array, " twelve"]:
    """Spectral density of the white noise that drives wind, gust, spin and memory.

    2 σ²/T, and 3 σ²/T of gusts across and down. Those of gust and spin are in the axes of the
    field, the spin's without what the gust brings.
    """
    gust = (2.0 + SECOND) * turbulence.gust**2 * (speed / turbulence.gust_length)
    spin = 2.0 * turbulence.spin**2 * (speed / turbulence.spin_length)
    return jnp.concatenate([jnp.full(3, WIND_DRIFT**2), gust, spin, jnp.zeros(3)])


def field_axes(turbulence: Turbulence) -> Float[Array, "axis axis"]:
    """From the axes of the field (along, across, down) to level axes (north, east, down)."""
    cos, sin = jnp.cos(turbulence.azimuth), jnp.sin(turbulence.azimuth)
    zero, one = jnp.zeros_like(cos), jnp.ones_like(cos)
    return jnp.stack(
        [
            jnp.stack([cos, -sin, zero]),
            jnp.stack([sin, cos, zero]),
            jnp.stack([zero, zero, one]),
        ]
    )


def coupling_matrix(turbulence: Turbulence) -> Float[Array, "axis axis"]:
    """C in level axes: rotation that a change of the gust brings along [rad/m]."""
    pitching, yawing = turbulence.coupling
    across = field_axes(turbulence)[:, 1]
    down = jnp.array([0.0, 0.0, 1.0])
    return pitching * jnp.outer(across, down) + yawing * jnp.outer(down, across)
