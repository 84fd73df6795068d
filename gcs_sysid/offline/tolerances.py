"""How far a simulated motion may be from the measured one before it counts as another motion.

The usual ones are those of 14 CFR part 60, appendix A, table A2A, for the short period and roll
response of full flight simulators (about 11 m span); rates grow with √(11 m/b) for smaller
aircraft, which move faster by that factor (Froude scaling). Theil's inequality coefficient of 0.25
to 0.3 is the usual limit of a good match (Jategaonkar, *Flight Vehicle System Identification*, 2nd
ed. 2015, ch. 11). Others may be given in a file,

    theil = 0.25
    V = 1.0      # m/s
    alpha = 1.0  # deg
    q = 3.0      # deg/s

of which what it leaves out stays usual.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.aircraft_toml.section import Section
from gcs_sysid.errors import InputError

SPAN = 11.0
"""Span [m] of the aircraft that the usual tolerances were written for."""
UNITS = {
    "V": "m/s",
    **dict.fromkeys(("alpha", "beta"), "deg"),
    **dict.fromkeys(("p", "q", "r"), "deg/s"),
    **dict.fromkeys(("phi", "theta", "psi"), "deg"),
}
"""Of every simulated channel in a file."""


@dataclass(frozen=True)
class Tolerances:
    """What passes.

    Attributes:
        channels: root mean square error of each channel [m/s, rad, rad/s].
        theil: Theil's coefficient, at which a channel passes however large its error.
    """

    channels: Mapping[str, float]
    theil: float


def usual(aircraft: Aircraft) -> Tolerances:
    """Those for flight simulators, scaled to the aircraft."""
    angle = math.radians(1.5)
    rate = math.radians(2.0) * max(1.0, math.sqrt(SPAN / aircraft.geometry.wing_span))
    by_unit = {"m/s": 1.54, "deg": angle, "deg/s": rate}  # 1.54 m/s is 3 kt
    return Tolerances({name: by_unit[unit] for name, unit in UNITS.items()}, theil=0.3)


def read(path: Path, aircraft: Aircraft) -> Tolerances:
    """The usual tolerances with those of a TOML file instead.

    Raises:
        InputError: the file is no TOML, or a key in it is unknown or out of bounds.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(
            str(path), f"no tolerances: {error}", fix="lines such as `alpha = 1.0`, in degrees"
        ) from error
    section, otherwise = Section(str(path), "", data), usual(aircraft)
    section.allow_only("theil", *UNITS)
    channels = {
        name: section.number(name, unit, default=otherwise.channels[name], above=0.0)
        for name, unit in UNITS.items()
    }
    return Tolerances(
        channels, section.number("theil", "", default=otherwise.theil, least=0.0, most=1.0)
    )
