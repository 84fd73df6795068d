"""Air that changes as quickly as an aircraft yields to it.

A gust g and a motion w of the aircraft lift alike, a = Z (w − g) with ẇ = a + q V, and are told
apart by how they go on: the motion dies away within 1/Z, a tenth of a second or two, the gust
within T = L/V. In the atmosphere that is seconds: L is the height above ground, tens of metres at
least (MIL-F-8785C, 1980, section 3.7.3). Where T is no longer than 1/Z the two times change places
at hardly any cost, and with them the slopes over the angle of attack: in the turbulence of
ArduPlane's built-in simulation, 42 ms, they come out twice the true ones (decision 0040).
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Float

from gcs_sysid.frames import Array
from gcs_sysid.model.aided import Noise

DOWN = 2
"""Of the axes of a gust."""
SHARE = 0.1
"""Of the specification's length, less than which no air has: three deviations of what is believed
of it."""
STRONG = 0.5
"""Gusts weaker than this [m/s] move no aircraft by more than its sensors' noise; their length is
anything."""


class QuickAirError(Exception):
    """The air changes as quickly as the aircraft yields to it.

    Args:
        lasting: how long its gusts last [s].
        strength: one standard deviation of them [m/s].
    """

    def __init__(self, lasting: float, strength: float) -> None:
        super().__init__(
            f"vertical gusts of {strength:.1f} m/s that last {lasting:.2f} s: what they do cannot "
            "be told from what the aircraft does, and slopes over the angle of attack would come "
            "out up to twice the true ones; no atmosphere is like that, but ArduPlane's simulated "
            "one is"
        )
        self.lasting = lasting
        self.strength = strength


FIX = "fly in calmer air, or with SIM_WIND_TURB = 0"


def check(log_noise: Noise, believed: Noise, passing: Float[Array, " row"]) -> None:
    """Refuses air that a filter has found to be too quick.

    Args:
        log_noise: logarithms of the intensities that were found.
        believed: of those that were believed, lengths by the specification.
        passing: speed at which gusts are passed, row by row [m/s].

    Raises:
        QuickAirError: it is.
    """
    strength = float(jnp.exp(log_noise.turbulence.gust[DOWN]))
    length = float(jnp.exp(log_noise.turbulence.gust_length[DOWN]))
    usual = float(jnp.exp(believed.turbulence.gust_length[DOWN]))
    if strength > STRONG and length < SHARE * usual:
        raise QuickAirError(length / float(jnp.median(passing)), strength)
