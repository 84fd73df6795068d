"""Aerodynamics and air that are not what the aircraft file says.

References:
    Ground effect: share of the induced drag that the ground takes away, exp(-2.48·(2h/b)^0.768);
    Torenbeek, Synthesis of Subsonic Airplane Design (1982), appendix G-7 (after Wieselsberger).
"""

from __future__ import annotations

import math
from dataclasses import replace

from gcs_sysid import regressors
from gcs_sysid.aircraft import COEFFICIENTS, TableTerm
from gcs_sysid.aircraft_toml.section import Section
from gcs_sysid.errors import RegressorError
from gcs_sysid.sitl.effects import changes
from gcs_sysid.sitl.flight import Flight
from gcs_sysid.sitl.jsbsim_xml import knots
from gcs_sysid.sitl.terms import slope

_HEIGHTS = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.5, 2.0)
"""Heights over span at which the ground's influence is tabulated; the last one is out of it."""

_ALPHAS = tuple(math.radians(degree) for degree in range(-20, 31))


def wind_shear(flight: Flight, entry: Section) -> Flight:
    """`gradient`: growth of the steady wind with height [1/s]."""
    entry.allow_only("name", "gradient")
    gradient = flight.wind.gradient + entry.number("gradient", "1/s")
    return replace(flight, wind=replace(flight.wind, gradient=gradient))


def drag_increase(flight: Flight, entry: Section) -> Flight:
    """`CX0`: added to the constant of CX; more drag is negative."""
    entry.allow_only("name", "CX0")
    return _added(flight, {"CX": {"1": entry.number("CX0", "1")}})


def asymmetry(flight: Flight, entry: Section) -> Flight:
    """`Cl0`, `Cn0`: added to the constants."""
    entry.allow_only("name", "Cl0", "Cn0")
    sizes = changes.numbers(entry, {"Cl0": "1", "Cn0": "1"})
    return _added(flight, {"Cl": {"1": sizes["Cl0"]}, "Cn": {"1": sizes["Cn0"]}})


def cross_coupling(flight: Flight, entry: Section) -> Flight:
    """`Cm_beta`, `Cl_alpha`: added slopes [1/rad]."""
    entry.allow_only("name", "Cm_beta", "Cl_alpha")
    sizes = changes.numbers(entry, {"Cm_beta": "1/rad", "Cl_alpha": "1/rad"})
    return _added(flight, {"Cm": {"beta": sizes["Cm_beta"]}, "Cl": {"alpha": sizes["Cl_alpha"]}})


def aero_derivative(flight: Flight, entry: Section) -> Flight:
    """`ratio`: true over believed value of one derivative; `derivative = "Cm.alpha"` names it."""
    entry.allow_only("name", "derivative", "ratio")
    known = tuple(
        f"{name}.{key}" for name, model in flight.flown.aerodynamics.items() for key in model.terms
    )
    coefficient, key = entry.text("derivative", allowed=known).split(".", maxsplit=1)
    more = (entry.number("ratio", "1") - 1.0) * slope(flight.flown, coefficient, key)
    return _added(flight, {coefficient: {key: more}})


def unlisted(flight: Flight, entry: Section) -> Flight:
    """`terms`: by coefficient, any regressor and the value added to it."""
    entry.allow_only("name", "terms")
    terms = entry.table("terms")
    terms.allow_only(*COEFFICIENTS)
    added: dict[str, dict[str, float]] = {}
    for coefficient in terms.data:
        values = terms.table(coefficient)
        for key in values.data:
            try:
                regressors.parse(key, controls=flight.flown.control_names)
            except RegressorError as error:
                raise values.error(
                    key, found=error.found, allowed=error.allowed, fix=error.fix
                ) from error
        added[coefficient] = {key: values.number(key, "1") for key in values.data}
    return _added(flight, added)


def stall(flight: Flight, entry: Section) -> Flight:
    """`alpha_break` [rad], `slope_loss`: share of the lift slope lost beyond it.

    With `lag` [s] all that happens beyond a knot of alpha comes and goes late, which is a
    hysteresis; alone, it is the file's own stall that does.
    """
    entry.allow_only("name", "alpha_break", "slope_loss", "lag")
    lag = entry.number("lag", "s", default=0.0, least=0.0)
    late = replace(flight, hidden=replace(flight.hidden, stall_lag=lag))
    if lag > 0.0 and not entry.has("alpha_break") and knots(flight.flown):
        return late
    beyond = entry.number("alpha_break", "rad", above=0.0)
    lost = -entry.number("slope_loss", "1") * slope(flight.flown, "CZ", "alpha")
    return _added(late, {"CZ": {f"max(0, alpha - {beyond!r})": lost}})


def ground_effect(flight: Flight, entry: Section) -> Flight:
    """Near the ground, σ(h/b) is what it takes of the induced drag.

    `lift`: CZ grows by the share lift·σ; `drag`: CX gains drag·σ·CZ²/(π·b²/S); `moment`: Cm gains
    moment·σ·CZ (positive pitches down). CZ here is its constant and its slope in alpha.
    """
    entry.allow_only("name", "lift", "drag", "moment")
    sizes = changes.numbers(entry, {"lift": "1", "drag": "1", "moment": "1"})
    aircraft, geometry = flight.flown, flight.flown.geometry
    aspect_ratio = geometry.wing_span**2 / geometry.wing_area
    force = [slope(aircraft, "CZ", "1") + slope(aircraft, "CZ", "alpha") * a for a in _ALPHAS]
    grown = {
        "CZ": [sizes["lift"] * z for z in force],
        "CX": [sizes["drag"] * z * z / (math.pi * aspect_ratio) for z in force],
        "Cm": [sizes["moment"] * z for z in force],
    }
    for coefficient, values in grown.items():
        if any(values):
            aircraft = changes.add_table(aircraft, coefficient, _near_ground(values))
    return changes.flying(flight, aircraft)


def ground_share(height: float) -> float:
    """σ at a height over span; nothing from two spans up."""
    if height >= _HEIGHTS[-1]:
        return 0.0
    return math.exp(-2.48 * (2.0 * height) ** 0.768)


def _near_ground(values: list[float]) -> TableTerm:
    rows = tuple(tuple(ground_share(h) * value for value in values) for h in _HEIGHTS)
    return TableTerm("ground", ("h_over_b", "alpha"), (_HEIGHTS, _ALPHAS), rows, sigma=0.0)


def _added(flight: Flight, terms: dict[str, dict[str, float]]) -> Flight:
    return changes.flying(flight, changes.add_terms(flight.flown, terms))
