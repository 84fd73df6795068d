"""How fast an aircraft's modes are: what sampling rates are judged by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate import first_guess
from gcs_sysid.reconstruct.airborne import Interval
from gcs_sysid.reconstruct.measurements import AIRSPEED_STREAMS
from gcs_sysid.recording import Recording

AXES: Mapping[str, tuple[str, ...]] = {
    "pitch": ("CX", "CZ", "Cm"),
    "roll": ("Cl",),
    "yaw": ("CY", "Cn"),
}
"""Coefficients that live in the mode of each axis."""
WANTED = 25.0
"""Samples per period wanted (Klein & Morelli 2006, Aircraft System Identification, ch. 9)."""
SLOWEST = 5.0
"""Samples per period below which a mode is not seen: its phase is lost."""
SLOWEST_EVER = 8.0
"""Rate [Hz] below which nothing is tried without an aircraft file."""
DAMPED: Mapping[str, tuple[str, ...]] = {
    "CZ": ("alpha",),
    "Cl": ("phat",),
    "Cm": ("alpha", "qhat"),
    "Cn": ("beta",),
}
"""Derivatives that modes live by."""
DENSITY = 1.225
"""Sea level [kg/m³]; airspeeds are equivalent ones."""

_MANNED_SPAN = 11.0
_MANNED_SHORT_PERIOD = 4.0
"""A light aircraft of 11 m span has its short period at about 4 rad/s, and modes to 1.5 Hz; smaller
ones are faster as the square root of the span (Froude)."""
_MANNED_FASTEST = 1.5
_MANNED_SPEED = 50.0
"""Its airspeed [m/s], for when not even the span is known."""


_USUAL_OUTPUTS: Mapping[str, str] = {"servo1": "roll", "servo2": "pitch", "servo4": "yaw"}
"""Aileron, elevator, throttle, rudder: the usual order of outputs."""
_NAMES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("flaperon", ("roll",)),
    ("elevon", ("pitch", "roll")),
    ("vtail", ("pitch", "yaw")),
    ("elevator", ("pitch",)),
    ("stab", ("pitch",)),
    ("canard", ("pitch",)),
    ("flap", ("pitch",)),
    ("aileron", ("roll",)),
    ("spoiler", ("roll",)),
    ("rudder", ("yaw",)),
)


def axes_of(control: str) -> tuple[str, ...]:
    """Axes that a control of that name is for; none where the name does not tell."""
    name = control.lower()
    for word, axes in _NAMES:
        if word in name:
            return axes
    return (_USUAL_OUTPUTS[name],) if name in _USUAL_OUTPUTS else ()


@dataclass(frozen=True)
class Modes:
    """Frequencies [Hz] by axis, each with the mode's name.

    Attributes:
        by_axis: mode and frequency.
        origin: where they come from, in words.
        certain: false where only the airspeed told.
    """

    by_axis: Mapping[str, tuple[str, float]]
    origin: str
    certain: bool = True

    def slowest_rate(self, axis: str) -> float:
        """Sampling rate [Hz] below which an axis is refused.

        A frequency guessed from the airspeed may be twice too high; no wing that flies is so slow
        that `SLOWEST_EVER` would do for it without knowing more.
        """
        rate = SLOWEST * self.by_axis[axis][1]
        return rate if self.certain else max(0.5 * rate, SLOWEST_EVER)

    @property
    def wanted_rate(self) -> float:
        """Sampling rate [Hz] to ask for, by the faster oscillation: one of the usual two."""
        fastest = max(self.by_axis[axis][1] for axis in ("pitch", "yaw"))
        return 50.0 if WANTED * fastest <= 65.0 else 100.0


def modes(
    recording: Recording, aircraft: Aircraft | None, flights: tuple[Interval, ...]
) -> Modes | None:
    """Short period, roll mode and dutch roll of this flight; None where nothing tells.

    From the aircraft file's aerodynamics where it has them, otherwise scaled from light aircraft by
    span, otherwise by airspeed. Good to a factor of one and a half, from airspeed alone of two:
    enough to judge a sampling rate, not for anything else.
    """
    speed = _airspeed(recording, flights)
    if aircraft is None:
        if speed is None:
            return None
        guess = _scaled(_MANNED_SPEED / speed, "guessed from the airspeed")
        return replace(guess, certain=False)
    scale = float(np.sqrt(_MANNED_SPAN / aircraft.geometry.wing_span))
    result = _scaled(scale, f"scaled to {aircraft.geometry.wing_span:.1f} m span")
    if not aircraft.aerodynamics or speed is None:
        return result
    by_axis = dict(result.by_axis)
    values = {
        name: {key: term.value for key, term in model.terms.items()}
        for name, model in aircraft.aerodynamics.items()
    }
    for axis, frequency in _frequencies(aircraft, values, speed).items():
        if np.isfinite(frequency) and frequency > 0.0:
            by_axis[axis] = (by_axis[axis][0], frequency)
    return Modes(by_axis, f"from {aircraft.name}'s derivatives")


def _scaled(scale: float, origin: str) -> Modes:
    slow = _MANNED_SHORT_PERIOD / (2.0 * np.pi) * scale
    return Modes(
        {
            "pitch": ("short period", slow),
            "roll": ("roll mode", _MANNED_FASTEST * scale),
            "yaw": ("dutch roll", slow),
        },
        origin,
    )


def _airspeed(recording: Recording, flights: tuple[Interval, ...]) -> float | None:
    stream = recording.first(AIRSPEED_STREAMS, "airspeed")
    if stream is None:
        return None
    values = stream.channels["airspeed"]
    inside = np.zeros(stream.count, dtype=bool)
    for start, end in flights:
        inside |= (stream.time >= start) & (stream.time <= end)
    inside &= np.isfinite(values)
    return float(np.median(values[inside])) if inside.any() else None


def fastest(aircraft: Aircraft, speed: float) -> float:
    """Size of the fastest root of roll mode, short period and dutch roll [1/s].

    Of this mass and size with the derivatives of an ordinary aircraft: whoever identifies without
    a prior may not look at the file's. Good to a factor of one and a half.

    Args:
        aircraft: mass, inertia and geometry.
        speed: equivalent airspeed [m/s].
    """
    usual = first_guess.derivatives(aircraft, DAMPED)
    lift, damping = _pitching(aircraft, usual, speed)
    frequency = {
        axis: 2.0 * np.pi * one for axis, one in _frequencies(aircraft, usual, speed).items()
    }
    short_period = np.roots([1.0, lift + damping, frequency["pitch"] ** 2])
    return float(max(np.abs(short_period).max(), frequency["roll"], frequency["yaw"]))


Derivatives = Mapping[str, Mapping[str, float]]


def _frequencies(aircraft: Aircraft, values: Derivatives, speed: float) -> dict[str, float]:
    """Frequencies [Hz] of the classical approximations (Etkin & Reid 1996, ch. 6)."""
    wing, mass = aircraft.geometry, aircraft.mass
    force = 0.5 * DENSITY * speed**2 * wing.wing_area
    lift, damping = _pitching(aircraft, values, speed)
    stiffness = -_derivative(values, "Cm", "alpha") * force * wing.mean_chord / mass.Iyy
    roll = -_derivative(values, "Cl", "phat") * force * wing.wing_span**2 / (2.0 * speed)
    weathercock = _derivative(values, "Cn", "beta") * force * wing.wing_span / mass.Izz
    return {
        "pitch": float(np.sqrt(max(stiffness + damping * lift, 0.0))) / (2.0 * np.pi),
        "roll": roll / mass.Ixx / (2.0 * np.pi),
        "yaw": float(np.sqrt(max(weathercock, 0.0))) / (2.0 * np.pi),
    }


def _pitching(aircraft: Aircraft, values: Derivatives, speed: float) -> tuple[float, float]:
    """How fast lift takes away an angle of attack, and damping a pitch rate [1/s]."""
    wing, mass = aircraft.geometry, aircraft.mass
    force = 0.5 * DENSITY * speed**2 * wing.wing_area
    lift = -_derivative(values, "CZ", "alpha") * force / (mass.mass * speed)
    damping = -_derivative(values, "Cm", "qhat") * force * wing.mean_chord**2 / (2.0 * speed)
    return lift, damping / mass.Iyy


def _derivative(values: Derivatives, coefficient: str, regressor: str) -> float:
    return values.get(coefficient, {}).get(regressor, 0.0)
