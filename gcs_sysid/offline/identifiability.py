"""How well a flight can tell each coefficient, judged before anything is fitted: yes, weak or no.

Cautious on purpose: `yes` asks for deliberate inputs on the axis that do not follow the aircraft's
own motion, fast enough streams, and flow angles that gusts do not drown. What is `weak` may still
come out well; `identify` says how well.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid.aircraft import COEFFICIENTS, MOMENTS, Aircraft
from gcs_sysid.diagnose.investigation import GUSTY
from gcs_sysid.offline import envelope
from gcs_sysid.offline.modes import AXES, axes_of, modes
from gcs_sysid.offline.requirements import Requirements, rate_in_flight
from gcs_sysid.reconstruct.airborne import Interval
from gcs_sysid.reconstruct.control_history import (
    SERVO_STREAM,
    ControlHistory,
    ControlSignal,
    activity,
)
from gcs_sysid.reconstruct.measurements import GYRO_STREAMS
from gcs_sysid.reconstruct.segments import INPUTS, Segment
from gcs_sysid.recording import Recording

LOAD_PER_RADIAN = 10.0
"""Load factor per radian of angle of attack; 6 to 14 over the aircraft at hand."""
COARSE = 10.0
"""Samples per period of the axis' mode below which its answer is weak."""
COLLINEAR = 0.9
"""Correlation from which two regressors count as one (Klein & Morelli 2006, section 5.3)."""
QUIET_CONTROL = np.radians(0.3)
"""A control whose activity is less [rad, one sigma] has said nothing."""
QUIET_RATE = np.radians(1.0)
"""The same for an angular rate [rad/s]."""
FEW_INPUTS = 2
"""Fewer deliberate inputs on an axis leave none to judge the fit by."""

_RATE = {"pitch": "q", "roll": "p", "yaw": "r"}


@dataclass(frozen=True)
class Judgement:
    """`verdict`: yes, weak or no; and why, in words."""

    verdict: str
    reason: str


@dataclass(frozen=True)
class _Axis:
    """What happened on one axis: its controls, inputs, and how they went with the motion."""

    controls: tuple[ControlSignal, ...]
    inputs: int
    moved: float
    turned: float
    doubts: tuple[str, ...]


def judge(
    recording: Recording,
    aircraft: Aircraft | None,
    history: ControlHistory | None,
    segments: Iterable[Segment],
    flights: tuple[Interval, ...],
    requirements: Requirements,
) -> dict[str, Judgement]:
    """A judgement for each of the six coefficients."""
    usable = requirements.usable
    maneuvers = tuple(segments)
    result = {}
    common = [*_gusts(recording, aircraft, flights), *_short(maneuvers)]
    for axis, coefficients in AXES.items():
        seen = _axis(axis, recording, history, maneuvers, flights)
        coarse = _coarse(axis, recording, aircraft, flights)
        for name in coefficients:
            reason = usable[name]
            if reason is not None:
                result[name] = Judgement("no", reason)
            else:
                doubts = [*seen.doubts, *coarse, *common, *_thrust(name, aircraft)]
                result[name] = _verdict(name, axis, seen, doubts)
    return {name: result[name] for name in COEFFICIENTS}


def _verdict(name: str, axis: str, seen: _Axis, doubts: list[str]) -> Judgement:
    control = " and ".join(signal.name for signal in seen.controls)
    rate = _RATE[axis]
    if not seen.controls:
        what = f"no control of the {axis} axis among the outputs"
        return Judgement("no" if name in MOMENTS else "weak", what)
    if seen.moved < QUIET_CONTROL and seen.turned < QUIET_RATE and name in MOMENTS:
        moved, turned = np.degrees(seen.moved), np.degrees(seen.turned)
        return Judgement(
            "no",
            f"{control} hardly moved ({moved:.1f}° sd) and nor did the aircraft ({rate} "
            f"{turned:.1f}°/s sd): fly doublets or a multisine on it",
        )
    if doubts:
        return Judgement("weak", "; ".join(doubts))
    return Judgement(
        "yes",
        f"{seen.inputs} inputs on {control} ({np.degrees(seen.moved):.1f}° sd), {rate} "
        f"{np.degrees(seen.turned):.0f}°/s sd",
    )


def _axis(
    axis: str,
    recording: Recording,
    history: ControlHistory | None,
    maneuvers: tuple[Segment, ...],
    flights: tuple[Interval, ...],
) -> _Axis:
    """Excitation of one axis: in its deliberate inputs, or in the whole flight without any."""
    if history is None:
        return _Axis((), 0, 0.0, 0.0, ())
    controls = tuple(s for s in history.surfaces if axis in axes_of(s.name))
    names = {signal.name for signal in controls}
    inputs = [m for m in maneuvers if m.kind in INPUTS and names & set(m.controls)]
    inside = (
        envelope.airborne_mask(history.time, tuple((m.start, m.end) for m in inputs))
        if inputs
        else envelope.airborne_mask(history.time, flights)
    )
    rates = _rates(recording, history)
    turned = rates[_RATE[axis]] if rates is not None else np.zeros(history.time.size)
    if inside.sum() < 10:
        return _Axis(controls, 0, 0.0, 0.0, ())
    moved = max((_moved(signal, history, inside) for signal in controls), default=0.0)
    doubts = _few(axis, controls, len(inputs), moved)
    doubts += _collinear(axis, controls, history, inside, turned)
    return _Axis(controls, len(inputs), moved, float(np.std(turned[inside])), tuple(doubts))


def _moved(
    signal: ControlSignal, history: ControlHistory, inside: Bool[np.ndarray, " tick"]
) -> float:
    """Activity of a control [rad]."""
    level = activity(signal.values, history.step)[inside]
    return signal.deflection * float(np.sqrt(np.mean(level**2)))


def _few(axis: str, controls: tuple[ControlSignal, ...], inputs: int, moved: float) -> list[str]:
    control = " and ".join(signal.name for signal in controls)
    if inputs == 0:
        return [
            f"no test input on {control or axis}, only corrections by the autopilot or pilot "
            f"({np.degrees(moved):.1f}° sd), which follow the motion"
        ]
    if inputs < FEW_INPUTS:
        return [f"one test input on {control} only: none left to judge the fit by"]
    return []


def _collinear(
    axis: str,
    controls: tuple[ControlSignal, ...],
    history: ControlHistory,
    inside: Bool[np.ndarray, " tick"],
    turned: Float[np.ndarray, " tick"],
) -> list[str]:
    doubts = []
    for signal in controls:
        likeness = _correlation(signal.values[inside], turned[inside])
        if abs(likeness) > COLLINEAR:
            doubts.append(f"{signal.name} and {_RATE[axis]} go together ({likeness:+.2f})")
        for other in history.surfaces:
            if other.name == signal.name or (other in controls and other.name < signal.name):
                continue
            likeness = _correlation(signal.values[inside], other.values[inside])
            if abs(likeness) > COLLINEAR:
                doubts.append(f"{signal.name} and {other.name} go together ({likeness:+.2f})")
    return doubts


def _correlation(first: Float[np.ndarray, " tick"], second: Float[np.ndarray, " tick"]) -> float:
    spread = float(np.std(first) * np.std(second))
    if spread < 1e-12:
        return 0.0
    return float(np.mean((first - np.mean(first)) * (second - np.mean(second)))) / spread


def _rates(
    recording: Recording, history: ControlHistory
) -> dict[str, Float[np.ndarray, " tick"]] | None:
    stream = recording.first(GYRO_STREAMS, "p", "q", "r")
    if stream is None:
        return None
    result = {}
    for name in ("p", "q", "r"):
        good = stream.valid(name)
        result[name] = np.interp(history.time, stream.time[good], stream.channels[name][good])
    return result


def _gusts(
    recording: Recording, aircraft: Aircraft | None, flights: tuple[Interval, ...]
) -> list[str]:
    """Doubt from gusts where no vanes measure the flow angles."""
    if aircraft is not None and aircraft.vanes is not None and "AOA_SSA" in recording.streams:
        return []
    wind = envelope.wind(recording, flights)
    jitter = envelope.restlessness(recording, flights)
    speed = envelope.speed_of(envelope.visited(recording, flights))
    along = wind.gust / speed if wind is not None else 0.0
    across = jitter / LOAD_PER_RADIAN if jitter is not None else 0.0
    if max(along, across) < GUSTY:
        return []
    angle = np.degrees(max(along, across))
    return [
        f"no flow vanes in gusts of about {angle:.0f}°: slopes over angle of attack and sideslip "
        "come out low by least squares, and are fitted inside the filter where servo outputs are "
        "recorded"
    ]


def _short(maneuvers: tuple[Segment, ...]) -> list[str]:
    total = sum(maneuver.duration for maneuver in maneuvers)
    return [f"only {total:.0f} s of flight to use"] if total < 60.0 else []


def _coarse(
    axis: str,
    recording: Recording,
    aircraft: Aircraft | None,
    flights: tuple[Interval, ...],
) -> list[str]:
    guess = modes(recording, aircraft, flights)
    if guess is None:
        return []
    mode, frequency = guess.by_axis[axis]
    rate = min(
        rate_in_flight(recording, GYRO_STREAMS, ("p", "q", "r"), flights),
        rate_in_flight(recording, (SERVO_STREAM,), (), flights),
    )
    if rate >= COARSE * frequency:
        return []
    return [f"{rate:.0f} Hz is coarse for the {mode} ({frequency:.1f} Hz, {guess.origin})"]


def _thrust(name: str, aircraft: Aircraft | None) -> list[str]:
    if name != "CX":
        return []
    if aircraft is None or not aircraft.propulsion:
        return ["thrust is not known: CX is drag less thrust"]
    sigma = max(engine.thrust_sigma for engine in aircraft.propulsion)
    return [f"thrust is known to {100.0 * sigma:.0f} % only"] if sigma >= 0.2 else []
