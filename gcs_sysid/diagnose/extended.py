"""An aircraft file with what was found wrong put right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from gcs_sysid.aircraft import Aircraft, Control, Servo


def corrected(aircraft: Aircraft, wrong: Mapping[str, tuple[float, float]]) -> Aircraft:
    """The file with these quantities of `motion.quantities` as they were found.

    Args:
        aircraft: the file.
        wrong: value and standard deviation of each quantity that is wrong.
    """
    for name, (value, deviation) in wrong.items():
        kind, _, which = name.partition(".")
        if kind == "mass":
            aircraft = _mass(aircraft, value, deviation)
        elif kind == "cg":
            aircraft = _cg(aircraft, "xyz".index(which), value)
        elif kind == "airspeed":
            aircraft = _airspeed(aircraft, value, deviation)
        elif kind == "effectiveness":
            aircraft = _effectiveness(aircraft, which, 1.0 + value)
        else:
            raise ValueError(f"`{name}` has no place in an aircraft file")
    return aircraft


def _mass(aircraft: Aircraft, value: float, deviation: float) -> Aircraft:
    body = aircraft.mass
    sigma = deviation / (1.0 + value)
    return replace(aircraft, mass=replace(body, mass=body.mass * (1.0 + value), mass_sigma=sigma))


def _cg(aircraft: Aircraft, axis: int, chords: float) -> Aircraft:
    place = list(aircraft.mass.cg)
    place[axis] += chords * aircraft.geometry.mean_chord
    x, y, z = place
    return replace(aircraft, mass=replace(aircraft.mass, cg=(x, y, z)))


def _airspeed(aircraft: Aircraft, value: float, deviation: float) -> Aircraft:
    error = aircraft.pitot.error
    scale = (1.0 + error.scale[0]) * (1.0 + value) - 1.0
    changed = replace(error, scale=(scale,), scale_sigma=deviation)
    return replace(aircraft, pitot=replace(aircraft.pitot, error=changed))


def _effectiveness(aircraft: Aircraft, control: str, ratio: float) -> Aircraft:
    """In the servos where they move this control only, else in its mix."""
    mix = next(item.mix for item in aircraft.controls if item.name == control)
    elsewhere = {
        surface for item in aircraft.controls if item.name != control for surface in item.mix
    }
    if set(mix) & elsewhere:
        controls = tuple(_remixed(item, ratio, control) for item in aircraft.controls)
        return replace(aircraft, controls=controls)
    servos = tuple(_weakened(servo, ratio, mix) for servo in aircraft.servos)
    return replace(aircraft, servos=servos)


def _remixed(item: Control, ratio: float, control: str) -> Control:
    if item.name != control:
        return item
    return replace(item, mix={surface: ratio * gain for surface, gain in item.mix.items()})


def _weakened(servo: Servo, ratio: float, mix: Mapping[str, float]) -> Servo:
    if servo.surface not in mix:
        return servo
    return replace(servo, effectiveness=ratio * servo.effectiveness)
