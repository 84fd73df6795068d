"""The ICAO standard atmosphere from sea level to 20 km, and what an airspeed indicator reads in it.

Every function takes NumPy or JAX arrays alike and answers in kind. Heights are geopotential, above
mean sea level. Below sea level the tropospheric law continues; above 20 km the temperature would
rise again, and nothing here is good for that.

References:
    ICAO Doc 7488/3, *Manual of the ICAO Standard Atmosphere*, 3rd ed. 1993, part 1.
    Airspeeds: Gracey, *Measurement of Aircraft Speed and Altitude*, NASA RP-1046, 1980, chapter 3.
"""

from __future__ import annotations

from typing import Any

from jaxtyping import Float

Array = Any
"""A NumPy or JAX array."""

GRAVITY = 9.80665
"""Standard gravity [m/s²], by definition."""
GAS_CONSTANT = 287.05287
"""Specific gas constant of dry air [J/(kg·K)], Doc 7488 table A."""
HEAT_RATIO = 1.4
SEA_LEVEL_TEMPERATURE = 288.15
SEA_LEVEL_PRESSURE = 101325.0
SEA_LEVEL_DENSITY = SEA_LEVEL_PRESSURE / (GAS_CONSTANT * SEA_LEVEL_TEMPERATURE)
LAPSE = -0.0065
"""Temperature gradient of the troposphere [K/m]."""
TROPOPAUSE = 11000.0
"""Height [m] from which the temperature stays the same."""

_EXPONENT = GRAVITY / (GAS_CONSTANT * -LAPSE)
_TROPOPAUSE_TEMPERATURE = SEA_LEVEL_TEMPERATURE + LAPSE * TROPOPAUSE
_TROPOPAUSE_PRESSURE = (
    SEA_LEVEL_PRESSURE * (_TROPOPAUSE_TEMPERATURE / SEA_LEVEL_TEMPERATURE) ** _EXPONENT
)
_SCALE_HEIGHT = GAS_CONSTANT * _TROPOPAUSE_TEMPERATURE / GRAVITY


def temperature(height: Float[Array, "*sample"]) -> Float[Array, "*sample"]:
    """Standard temperature [K] at a geopotential height [m]."""
    xp = height.__array_namespace__()
    return SEA_LEVEL_TEMPERATURE + LAPSE * xp.minimum(height, TROPOPAUSE)


def pressure(height: Float[Array, "*sample"]) -> Float[Array, "*sample"]:
    """Standard static pressure [Pa] at a geopotential height [m]."""
    xp = height.__array_namespace__()
    troposphere = (temperature(height) / SEA_LEVEL_TEMPERATURE) ** _EXPONENT
    above = xp.maximum(height - TROPOPAUSE, 0.0)
    return SEA_LEVEL_PRESSURE * troposphere * xp.exp(-above / _SCALE_HEIGHT)


def density(height: Float[Array, "*sample"]) -> Float[Array, "*sample"]:
    """Standard air density [kg/m³] at a geopotential height [m]."""
    return pressure(height) / (GAS_CONSTANT * temperature(height))


def pressure_altitude(static_pressure: Float[Array, "*sample"]) -> Float[Array, "*sample"]:
    """Height [m] at which the standard atmosphere has this pressure [Pa]; inverse of `pressure`."""
    xp = static_pressure.__array_namespace__()
    troposphere = xp.maximum(static_pressure, _TROPOPAUSE_PRESSURE)
    stratosphere = xp.minimum(static_pressure, _TROPOPAUSE_PRESSURE)
    warmth = (troposphere / SEA_LEVEL_PRESSURE) ** (1.0 / _EXPONENT)
    below = SEA_LEVEL_TEMPERATURE / LAPSE * (warmth - 1.0)
    return below - _SCALE_HEIGHT * xp.log(stratosphere / _TROPOPAUSE_PRESSURE)


def density_from_pressure(static_pressure: Float[Array, "*sample"]) -> Float[Array, "*sample"]:
    """Air density [kg/m³] from static pressure [Pa] and the standard temperature at that pressure.

    One percent too high for every 3 K that the air is warmer than standard.
    """
    standard = temperature(pressure_altitude(static_pressure))
    return static_pressure / (GAS_CONSTANT * standard)


def speed_of_sound(air_temperature: Float[Array, "*sample"]) -> Float[Array, "*sample"]:
    """Speed of sound [m/s] at an air temperature [K]."""
    return (HEAT_RATIO * GAS_CONSTANT * air_temperature) ** 0.5


def eas_to_tas(
    eas: Float[Array, "*sample"], air_density: Float[Array, "*sample"]
) -> Float[Array, "*sample"]:
    """True airspeed of an equivalent airspeed [m/s] at an air density [kg/m³]."""
    return eas * (SEA_LEVEL_DENSITY / air_density) ** 0.5


def tas_to_eas(
    tas: Float[Array, "*sample"], air_density: Float[Array, "*sample"]
) -> Float[Array, "*sample"]:
    """Equivalent airspeed of a true airspeed [m/s] at an air density [kg/m³]."""
    return tas * (air_density / SEA_LEVEL_DENSITY) ** 0.5


def cas_to_eas(
    cas: Float[Array, "*sample"], static_pressure: Float[Array, "*sample"]
) -> Float[Array, "*sample"]:
    """Equivalent airspeed of a subsonic calibrated airspeed [m/s] at a static pressure [Pa].

    Both show the same impact pressure, which compressibility makes larger than ½ρV²:
    q_c = p·((1 + M²/5)^3.5 - 1). Not differentiable at 0.
    """
    return _same_impact(cas, SEA_LEVEL_PRESSURE, static_pressure)


def eas_to_cas(
    eas: Float[Array, "*sample"], static_pressure: Float[Array, "*sample"]
) -> Float[Array, "*sample"]:
    """Calibrated airspeed of a subsonic equivalent airspeed [m/s]; inverse of `cas_to_eas`."""
    return _same_impact(eas, static_pressure, SEA_LEVEL_PRESSURE)


def _same_impact(
    speed: Float[Array, "*sample"], pressure_in: Array, pressure_out: Array
) -> Float[Array, "*sample"]:
    """Equivalent airspeed at `pressure_out` with the impact pressure of `speed` at `pressure_in`.

    M² = ρ0·EAS²/(γ·p) whatever the temperature; at sea level's pressure EAS and CAS are the same.
    """
    per_pressure = HEAT_RATIO / SEA_LEVEL_DENSITY
    impact = pressure_in * ((1.0 + 0.2 * speed**2 / (per_pressure * pressure_in)) ** 3.5 - 1.0)
    mach_squared = 5.0 * ((impact / pressure_out + 1.0) ** (2.0 / 7.0) - 1.0)
    return (per_pressure * pressure_out * mach_squared) ** 0.5
