"""Maneuvers for the coefficients that a model is least sure of, as large as the envelope allows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import Aircraft, Envelope
from gcs_sysid.errors import UsageError
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.maneuvers import flown, signals
from gcs_sysid.maneuvers.envelope import LIKELY, Excursion, excursion
from gcs_sysid.maneuvers.flown import STEP, Flown, Simulator
from gcs_sysid.maneuvers.holding import Linear
from gcs_sysid.maneuvers.information import Gain, gain
from gcs_sysid.model.trim import Trim

Kind = Literal["multisine", "multistep", "doublet"]
KINDS: tuple[Kind, ...] = get_args(Kind)

PERIOD = 15.0
"""Length of a multisine [s]."""
LEAST_FREQUENCY = 0.2
"""First line of a multisine [Hz]."""
BEYOND = 1.5
"""Its last line, over the fastest oscillation of the motion."""
AFTER = 3.0
"""Answer of the aircraft after the input that is flown and counted too [s]."""
PULSE = 1.6
"""Length of the shortest step of a 3-2-1-1, over 1/ω (Hamel & Jategaonkar 1996)."""
HALF = 2.3
"""Length of each half of a doublet, over 1/ω."""
SLOWEST = 3.0
"""Frequency [rad/s] that stands in where the motion has no oscillation."""
TRAVEL = 0.35
"""Largest part of a control's travel that an input uses."""
LARGEST = float(np.radians(10.0))
SMALLER = 0.8
TRIES = 15


@dataclass(frozen=True)
class Maneuver:
    """An input to fly.

    Attributes:
        name: of the maneuver.
        kind: shape of the input.
        coefficients: that it is for.
        controls: that it moves.
        duration: of the input [s].
        time: [s].
        added: to trim and to what the autopilot commands, one column a control in `controls` [rad].
        flown: motions of the drawn aircraft, answer after the input included.
        excursion: how far these go.
        gains: what it would teach, by coefficient.
    """

    name: str
    kind: Kind
    coefficients: tuple[str, ...]
    controls: tuple[str, ...]
    duration: float
    time: Float[np.ndarray, " sample"]
    added: Float[np.ndarray, "sample control"]
    flown: Flown
    excursion: Excursion
    gains: Mapping[str, Gain]

    @property
    def worth(self) -> float:
        """Sum over its coefficients of log(deviation before / after)."""
        pairs = [self.gains[name] for name in self.coefficients]
        return float(sum(np.log(item.before / max(item.after, 1e-300)) for item in pairs))


@dataclass(frozen=True)
class Condition:
    """Where maneuvers are flown, and by what."""

    aircraft: Aircraft
    model: AeroModel
    allowed: Envelope
    trim: Trim
    linear: Linear
    simulator: Simulator


def travel(aircraft: Aircraft, control: str) -> float:
    """Half the range of a control that its servos allow [rad]."""
    mix = next(item.mix for item in aircraft.controls if item.name == control)
    return float(
        sum(
            abs(mix.get(servo.surface, 0.0)) * 0.5 * float(np.ptp(servo.deflection))
            for servo in aircraft.servos
        )
    )


def strongest_control(aircraft: Aircraft, model: AeroModel, coefficient: str) -> str | None:
    """The control that can change a coefficient most; None where none does."""
    fit = model.fits[coefficient]
    effect = {
        name: abs(float(fit.value[fit.keys.index(name)])) * travel(aircraft, name)
        for name in aircraft.control_names
        if name in fit.keys
    }
    return max(effect, key=lambda name: effect[name]) if any(effect.values()) else None


def groups(
    aircraft: Aircraft, model: AeroModel, targets: Sequence[str]
) -> dict[tuple[str, ...], tuple[str, ...]]:
    """Coefficients that one set of controls excites together, by these controls.

    Rolling and yawing moment go together: neither control moves the aircraft in one of them alone.
    """
    lateral = [name for name in ("Cl", "Cn") if name in model.fits]
    found: dict[tuple[str, ...], tuple[str, ...]] = {}
    for coefficients in (["Cm"], lateral):
        wanted = [name for name in coefficients if name in targets and name in model.fits]
        controls = [strongest_control(aircraft, model, name) for name in coefficients if wanted]
        moved = tuple(dict.fromkeys(name for name in controls if name is not None))
        if moved:
            found[moved] = tuple(wanted)
    return found


def suggest(
    at: Condition, controls: tuple[str, ...], coefficients: tuple[str, ...], kind: Kind
) -> Maneuver:
    """The largest input of one kind that stays inside the envelope.

    Raises:
        UsageError: even the smallest leaves it.
    """
    lateral = any(name in ("Cl", "Cn") for name in coefficients)
    frequency = at.linear.natural_frequency(lateral=lateral) or SLOWEST
    time = STEP * np.arange(round((PERIOD + AFTER) / STEP) + 1)
    shapes, duration = _shapes(kind, len(controls), frequency, time)
    size = np.array([min(LARGEST, TRAVEL * travel(at.aircraft, name)) for name in controls])
    place = [at.aircraft.control_names.index(name) for name in controls]
    for _ in range(TRIES):
        added = np.zeros((time.size, len(at.aircraft.controls)))
        added[:, place] = shapes * size
        path = at.simulator.fly(added)
        rows = slice(0, round((duration + AFTER) / STEP) + 1)
        part = Flown(*(values[:, rows] for values in path))
        reach = excursion(part, at.allowed)
        if reach.violation_probability <= LIKELY:
            break
        size = SMALLER * size
    else:
        raise UsageError(
            f"{at.aircraft.name}: at {at.trim.airspeed:.0f} m/s even a small input on "
            f"{' and '.join(controls)} leaves the envelope; widen `[envelope]`, or check its "
            "airspeeds"
        )
    values = flown.regressor_values(at.aircraft, at.trim, part)
    used = slice(0, round(duration / STEP) + 1)
    return Maneuver(
        name=f"{'_'.join(controls)}_{kind}",
        kind=kind,
        coefficients=coefficients,
        controls=controls,
        duration=duration,
        time=time[used],
        added=(shapes * size)[used],
        flown=part,
        excursion=reach,
        gains={name: gain(at.model, name, values, STEP) for name in coefficients},
    )


def _shapes(
    kind: Kind, count: int, frequency: float, time: Float[np.ndarray, " sample"]
) -> tuple[Float[np.ndarray, "sample control"], float]:
    """Unit inputs of all controls and the length of the whole [s].

    Multisines run together, on lines of their own; pulses one control after the other.
    """
    if kind == "multisine":
        first = max(1, round(LEAST_FREQUENCY * PERIOD))
        last = max(first + 2 * count, round(BEYOND * frequency / (2.0 * np.pi) * PERIOD))
        lines = signals.interleaved(first, last, count)
        return np.stack([signals.multisine(item, PERIOD, time) for item in lines], axis=1), PERIOD
    one = 7.0 * PULSE / frequency if kind == "multistep" else 2.0 * HALF / frequency
    one = min(one, 0.4 * PERIOD)
    wait = one + 2.0
    shape = signals.multistep if kind == "multistep" else signals.doublet
    columns = [shape(one, time - index * wait) for index in range(count)]
    return np.stack(columns, axis=1), (count - 1) * wait + one
