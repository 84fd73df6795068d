"""Which control moves which axis, and by how much it may be moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate.result import AeroModel

THROTTLE = "throttle"
"""Name of the input, and of its column, that moves all engines together [0 to 1]."""


@dataclass(frozen=True)
class Axes:
    """The control that does most about each axis; None where none does."""

    pitch: str | None
    roll: str | None
    yaw: str | None

    @property
    def lateral(self) -> tuple[str, ...]:
        """Controls of roll and yaw, each once."""
        both = (self.roll, self.yaw)
        return tuple(dict.fromkeys(name for name in both if name is not None))

    @property
    def every(self) -> tuple[str, ...]:
        """All of them, each once."""
        longitudinal = () if self.pitch is None else (self.pitch,)
        return tuple(dict.fromkeys((*longitudinal, *self.lateral)))


def travel(aircraft: Aircraft, control: str) -> float:
    """How far a control goes to its nearer end when all its servos go as far as they can [rad]."""
    mix = next(item.mix for item in aircraft.controls if item.name == control)
    return float(
        sum(
            abs(mix.get(servo.surface, 0.0)) * min(abs(end) for end in _ends(servo.deflection))
            for servo in aircraft.servos
        )
    )


def _ends(deflection: Sequence[float]) -> tuple[float, float]:
    return min(deflection), max(deflection)


def time_constant(aircraft: Aircraft, control: str) -> float:
    """Slowest lag among a control's servos [s]."""
    mix = next(item.mix for item in aircraft.controls if item.name == control)
    return max(
        (servo.time_constant for servo in aircraft.servos if servo.surface in mix), default=0.0
    )


def rate_limit(aircraft: Aircraft, control: str) -> float | None:
    """Lowest rate limit among a control's servos [rad/s]; None where none has one."""
    mix = next(item.mix for item in aircraft.controls if item.name == control)
    rates = [
        servo.rate_limit
        for servo in aircraft.servos
        if servo.surface in mix and servo.rate_limit is not None
    ]
    return min(rates) if rates else None


def strongest(aircraft: Aircraft, model: AeroModel, coefficient: str) -> str | None:
    """The control that can change a coefficient most; None where none does."""
    if coefficient not in model.fits:
        return None
    fit = model.fits[coefficient]
    effect = {
        name: abs(float(fit.value[fit.keys.index(name)])) * travel(aircraft, name)
        for name in aircraft.control_names
        if name in fit.keys
    }
    return max(effect, key=lambda name: effect[name]) if any(effect.values()) else None


def found(aircraft: Aircraft, model: AeroModel) -> Axes:
    """Pitch, roll and yaw control of an aircraft by its identified moments."""
    return Axes(*(strongest(aircraft, model, name) for name in ("Cm", "Cl", "Cn")))


def throttled(aircraft: Aircraft) -> bool:
    """Whether any engine's thrust is known over throttle, so that steps of it can be planned."""
    return any(engine.rpm is None for engine in aircraft.propulsion)
