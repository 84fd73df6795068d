"""An aircraft whose servos answer otherwise than its file says, one control at a time.

A change of a control belongs to the servos behind it; each takes the share that makes the control,
by the pseudo-inverse of the mix, so that a servo behind two controls moves both of them wrongly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gcs_sysid.aircraft import Aircraft, Servo

Change = Callable[[Servo, float], Servo]
"""A servo, and its share of the control, into one that answers otherwise."""


def lag(more: float) -> Change:
    """A time constant longer by so much [s], or shorter as far as there is one."""
    return lambda servo, share: replace(servo, time_constant=max(servo.time_constant + more, 0.0))


def backlash(width: float) -> Change:
    """More play, full width at the control [rad]."""
    return lambda servo, share: replace(servo, backlash=servo.backlash + width * abs(share))


def rate_limit(limit: float) -> Change:
    """The control moves no faster than this [rad/s]."""

    def limited(servo: Servo, share: float) -> Servo:
        own = limit * abs(share)
        return replace(servo, rate_limit=min(own, servo.rate_limit or own))

    return limited


def offset(angle: float) -> Change:
    """The control stands here when told to stand at zero [rad]."""
    return lambda servo, share: replace(servo, offset=servo.offset + angle * share)


def changed(aircraft: Aircraft, control: str, change: Change) -> Aircraft:
    """The aircraft with every servo behind a control changed."""
    by_surface = shares(aircraft, control)
    servos = tuple(
        change(servo, by_surface[servo.surface]) if servo.surface in by_surface else servo
        for servo in aircraft.servos
    )
    return replace(aircraft, servos=servos)


def together(aircraft: Aircraft, control: str) -> tuple[str, ...]:
    """Controls that the same servos move, such as both of two elevons; itself among them."""
    own = shares(aircraft, control).keys()
    return tuple(name for name in aircraft.control_names if shares(aircraft, name).keys() == own)


def shares(aircraft: Aircraft, control: str) -> dict[str, float]:
    """How far each surface moves for one radian of a control, surfaces that stay left out."""
    surfaces = sorted({name for item in aircraft.controls for name in item.mix})
    mix = np.array([[item.mix.get(name, 0.0) for name in surfaces] for item in aircraft.controls])
    column = np.linalg.pinv(mix)[:, aircraft.control_names.index(control)]
    return {
        name: float(share)
        for name, share in zip(surfaces, column, strict=True)
        if abs(share) > 1e-9
    }
