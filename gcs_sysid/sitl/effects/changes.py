"""Small changes to an aircraft that several effects are made of."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

from gcs_sysid import regressors
from gcs_sysid.aircraft import (
    Aircraft,
    CoefficientModel,
    Propulsion,
    Servo,
    TableTerm,
    Value,
    Vector,
)
from gcs_sysid.aircraft_toml.section import Section
from gcs_sysid.sitl.flight import Flight
from gcs_sysid.sitl.jsbsim_xml import Feel
from gcs_sysid.sitl.servo import shares as servo_shares

Rework = Callable[[Propulsion], Propulsion]


def numbers(entry: Section, keys: Mapping[str, str]) -> dict[str, float]:
    """The numbers of an effect, 0 where it gives none; at least one must be there.

    Args:
        entry: of the effect file.
        keys: unit by name.
    """
    if not any(entry.has(key) for key in keys):
        first = next(iter(keys))
        raise entry.error(
            first, found="nothing", allowed=", ".join(keys), fix=f"give it a size, `{first} = ...`"
        )
    return {key: entry.number(key, unit, default=0.0) for key, unit in keys.items()}


def vector(entry: Section, keys: tuple[str, str, str], unit: str) -> Vector:
    """Three numbers of an effect, one an axis."""
    x, y, z = numbers(entry, dict.fromkeys(keys, unit)).values()
    return x, y, z


def control(entry: Section, aircraft: Aircraft) -> str:
    """The control that an effect names."""
    return entry.text("control", allowed=aircraft.control_names)


def plus(old: tuple[float, ...], more: Iterable[float]) -> Vector:
    """The sum of two vectors."""
    x, y, z = (a + b for a, b in zip(old, more, strict=True))
    return x, y, z


def flying(flight: Flight, aircraft: Aircraft) -> Flight:
    """The flight with another aircraft that flies."""
    return replace(flight, flown=aircraft)


def add_terms(aircraft: Aircraft, more: Mapping[str, Mapping[str, float]]) -> Aircraft:
    """The aircraft with values added to its coefficients: by coefficient, by regressor."""
    aerodynamics = dict(aircraft.aerodynamics)
    for name, values in more.items():
        model = aerodynamics.get(name, CoefficientModel())
        terms = dict(model.terms)
        for text, value in values.items():
            key = regressors.parse(text, controls=aircraft.control_names).key
            old = terms.get(key, Value(0.0, 0.0))
            terms[key] = replace(old, value=old.value + value)
        aerodynamics[name] = replace(model, terms=terms)
    return replace(aircraft, aerodynamics=aerodynamics)


def add_table(aircraft: Aircraft, coefficient: str, table: TableTerm) -> Aircraft:
    """The aircraft with a table added to one coefficient."""
    aerodynamics = dict(aircraft.aerodynamics)
    model = aerodynamics.get(coefficient, CoefficientModel())
    aerodynamics[coefficient] = replace(model, tables=(*model.tables, table))
    return replace(aircraft, aerodynamics=aerodynamics)


def change_servos(flight: Flight, name: str, changed: Callable[[Servo, float], Servo]) -> Flight:
    """The flight with `changed(servo, share)` for each servo behind a control."""
    by_surface = servo_shares(flight.flown, name)
    servos = tuple(
        changed(servo, by_surface[servo.surface]) if servo.surface in by_surface else servo
        for servo in flight.flown.servos
    )
    return flying(flight, replace(flight.flown, servos=servos))


def feeling(flight: Flight, names: Iterable[str], **parts: float) -> Flight:
    """The flight with parts of a `Feel` replaced for the controls named."""
    feel = dict(flight.hidden.feel)
    for name in names:
        feel[name] = replace(feel.get(name, Feel()), **parts)
    return replace(flight, hidden=replace(flight.hidden, feel=feel))
