"""Units in which tables state values, and what they are in SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gcs_sysid.sources.messages import DEGREE, STANDARD_GRAVITY, ZERO_CELSIUS

FOOT = 0.3048
"""International foot [m] (1959 agreement)."""
NAUTICAL_MILE = 1852.0
"""International nautical mile [m] (BIPM)."""
PSI = 6894.757293168
"""Pound-force per square inch [Pa] (0.45359237 kg · 9.80665 m/s² / (0.0254 m)²)."""


@dataclass(frozen=True)
class Unit:
    """One unit of a quantity: SI value = factor · value + zero.

    Attributes:
        quantity: what it measures, for instance `speed`.
        factor: SI units per unit.
        zero: SI value of zero.
    """

    quantity: str
    factor: float
    zero: float = 0.0


UNITS: Mapping[str, Unit] = {
    "s": Unit("time", 1.0),
    "ms": Unit("time", 1e-3),
    "us": Unit("time", 1e-6),
    "ns": Unit("time", 1e-9),
    "rad": Unit("angle", 1.0),
    "deg": Unit("angle", DEGREE),
    "rad/s": Unit("angular rate", 1.0),
    "deg/s": Unit("angular rate", DEGREE),
    "m/s": Unit("speed", 1.0),
    "km/h": Unit("speed", 1.0 / 3.6),
    "kt": Unit("speed", NAUTICAL_MILE / 3600.0),
    "ft/s": Unit("speed", FOOT),
    "m/s^2": Unit("acceleration", 1.0),
    "g": Unit("acceleration", STANDARD_GRAVITY),
    "ft/s^2": Unit("acceleration", FOOT),
    "m": Unit("length", 1.0),
    "ft": Unit("length", FOOT),
    "Pa": Unit("pressure", 1.0),
    "hPa": Unit("pressure", 1e2),
    "kPa": Unit("pressure", 1e3),
    "psi": Unit("pressure", PSI),
    "K": Unit("temperature", 1.0),
    "C": Unit("temperature", 1.0, ZERO_CELSIUS),
    "T": Unit("magnetic flux density", 1.0),
    "uT": Unit("magnetic flux density", 1e-6),
    "gauss": Unit("magnetic flux density", 1e-4),
    "mgauss": Unit("magnetic flux density", 1e-7),
    "rpm": Unit("rotation speed", 1.0),
    "V": Unit("voltage", 1.0),
    "A": Unit("current", 1.0),
    "1": Unit("number", 1.0),
    "percent": Unit("number", 1e-2),
}
"""Names of units in a column map. A pulse, which stays in µs, takes `us` too."""

PULSE = Unit("pulse", 1.0)
"""Servo pulses are µs in files as well as inside the program."""


def units_of(quantity: str) -> tuple[str, ...]:
    """Names of the units of one quantity."""
    if quantity == "pulse":
        return ("us",)
    return tuple(name for name, unit in UNITS.items() if unit.quantity == quantity)


def unit_of(name: str, quantity: str) -> Unit | None:
    """The unit of that name if it measures the quantity, otherwise None."""
    if name not in units_of(quantity):
        return None
    return PULSE if quantity == "pulse" else UNITS[name]


def to_si(values: np.ndarray, unit: Unit) -> np.ndarray:
    """Values in SI units."""
    return unit.factor * values + unit.zero
