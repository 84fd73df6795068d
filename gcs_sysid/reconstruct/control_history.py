"""The control commands of a flight on one uniform clock, and what is going on in them.

Commands are compared in half travels (neutral to full throw is 1), so that one threshold serves a
calibrated surface, an uncalibrated channel and the throttle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.recording import Recording, Stream

SERVO_STREAM = "SERVO_OUTPUT_RAW"
FASTEST = 50.0
"""Rate of the uniform clock [Hz] for streams that come at least as often."""
HALF_TRAVEL_US = 500.0
"""Pulse that moves an uncalibrated output from neutral to full throw [µs] (1000 to 2000 µs)."""
NOMINAL_DEFLECTION = np.radians(25.0)
"""Full throw [rad] assumed for an output without calibration: usual for small aircraft."""
RESOLUTION = 1.0 / HALF_TRAVEL_US
"""One microsecond, in half travels: the step of MAVLink's servo outputs."""
SMALLEST_STEP = 15.0 * RESOLUTION
"""Smaller jumps are no test input: 0.75° of a surface with 25° throw."""

_SURFACE_FUNCTIONS: Mapping[int, str] = {
    2: "flap",
    3: "flap",
    4: "aileron",
    19: "elevator",
    21: "rudder",
    24: "flaperon_left",
    25: "flaperon_right",
    77: "elevon_left",
    78: "elevon_right",
    79: "vtail_left",
    80: "vtail_right",
}
_THROTTLE_FUNCTIONS = (70, 73, 74)
"""ArduPilot's SERVOn_FUNCTION values (ardupilot.org/plane, parameter reference, 4.6)."""
_UNKNOWN_FUNCTIONS = (-1, 1)
"""Not in the log, or passed through from the pilot: may well be a surface."""


@dataclass(frozen=True)
class ControlSignal:
    """One control command.

    Attributes:
        name: control of the aircraft file, or the output (`servo4`; `rudder` where the autopilot's
            parameters tell).
        throttle: whether it drives a motor instead of a surface.
        values: command [half travels].
        deflection: what one half travel is [rad].
        calibrated: whether `deflection` comes from an aircraft file.
    """

    name: str
    throttle: bool
    values: Float[np.ndarray, " tick"]
    deflection: float
    calibrated: bool


@dataclass(frozen=True)
class ControlHistory:
    """All controls at uniform times.

    Attributes:
        time: s after the recording's epoch.
        step: time between ticks [s].
        sample: number of the sample held at each tick.
        since: ticks between that sample and the one before it.
        signals: surfaces first, then throttles.
        missing: controls of the aircraft file whose outputs are not in the log, with the channels.
    """

    time: Float[np.ndarray, " tick"]
    step: float
    sample: Int[np.ndarray, " tick"]
    since: Float[np.ndarray, " tick"]
    signals: tuple[ControlSignal, ...]
    missing: Mapping[str, tuple[int, ...]]

    @property
    def surfaces(self) -> tuple[ControlSignal, ...]:
        """Signals that move a surface."""
        return tuple(signal for signal in self.signals if not signal.throttle)

    @property
    def throttles(self) -> tuple[ControlSignal, ...]:
        """Signals that drive a motor."""
        return tuple(signal for signal in self.signals if signal.throttle)

    def span(self, start: float, end: float) -> slice:
        """Ticks between two times [s]."""
        first, last = np.searchsorted(self.time, (start, end))
        return slice(int(first), int(last))


@dataclass(frozen=True)
class Jump:
    """A sudden change of a command: when [s] and by how much [half travels]."""

    time: float
    size: float


def control_history(recording: Recording, aircraft: Aircraft | None) -> ControlHistory | None:
    """Controls of the aircraft file, or the outputs that moved, on a uniform clock.

    Returns:
        None when the log has no servo outputs.
    """
    stream = recording.streams.get(SERVO_STREAM)
    if stream is None or stream.count < 10 or stream.rate <= 0.0:
        return None
    step = 1.0 / min(FASTEST, stream.rate)
    time = np.arange(float(stream.time[0]), float(stream.time[-1]) + 0.5 * step, step)
    index = np.maximum(np.searchsorted(stream.time, time + 1e-6, side="right") - 1, 0)
    since = np.diff(stream.time, prepend=stream.time[:1] - step)[index] / step
    pwm = _pulses(stream, index)
    missing: dict[str, tuple[int, ...]] = {}
    if aircraft is not None and aircraft.controls:
        signals = _controls(aircraft, pwm, missing)
    else:
        signals = _outputs(recording, stream, pwm)
    return ControlHistory(
        time=time, step=step, sample=index, since=since, signals=signals, missing=missing
    )


def _pulses(stream: Stream, index: np.ndarray) -> dict[int, Float[np.ndarray, " tick"]]:
    """Pulses by channel, the last known value held; channels never measured are left out."""
    result = {}
    for name, values in stream.channels.items():
        valid = stream.valid(name)
        if not name.startswith("pwm_") or not valid.any():
            continue
        known = np.maximum.accumulate(np.where(valid, np.arange(stream.count), 0))
        held = np.where(valid[known], values[known], values[np.argmax(valid)])
        result[int(name.removeprefix("pwm_"))] = held[index]
    return result


def _controls(
    aircraft: Aircraft,
    pwm: Mapping[int, Float[np.ndarray, " tick"]],
    missing: dict[str, tuple[int, ...]],
) -> tuple[ControlSignal, ...]:
    signals = []
    for control in aircraft.controls:
        servos = [servo for servo in aircraft.servos if control.mix.get(servo.surface, 0.0)]
        absent = tuple(servo.channel for servo in servos if servo.channel not in pwm)
        if absent or not servos:
            missing[control.name] = absent
            continue
        gains = [control.mix[servo.surface] for servo in servos]
        travel = sum(
            abs(gain) * 0.5 * float(np.ptp(servo.deflection))
            for gain, servo in zip(gains, servos, strict=True)
        )
        deflection = sum(
            gain * _interpolate(pwm[servo.channel], servo.pwm, servo.deflection)
            for gain, servo in zip(gains, servos, strict=True)
        )
        signals.append(
            ControlSignal(control.name, False, np.asarray(deflection) / travel, travel, True)
        )
    channels = sorted({unit.throttle_channel for unit in aircraft.propulsion} & set(pwm))
    for channel in channels:
        name = "throttle" if len(channels) == 1 else f"throttle{channel}"
        signals.append(_output(name, pwm[channel], throttle=True))
    return tuple(signals)


def _interpolate(
    pwm: Float[np.ndarray, " tick"], known: tuple[float, ...], values: tuple[float, ...]
) -> Float[np.ndarray, " tick"]:
    order = np.argsort(known)
    return np.interp(pwm, np.array(known)[order], np.array(values)[order])


def _output(name: str, pwm: Float[np.ndarray, " tick"], *, throttle: bool) -> ControlSignal:
    values = (pwm - 1500.0) / HALF_TRAVEL_US
    return ControlSignal(name, throttle, values, float(NOMINAL_DEFLECTION), False)


def _outputs(
    recording: Recording, stream: Stream, pwm: Mapping[int, Float[np.ndarray, " tick"]]
) -> tuple[ControlSignal, ...]:
    """Outputs that moved, named by the autopilot's parameters where the log holds them."""
    # Channel 3 is the throttle by default of both ArduPilot and PX4.
    throttle = _throttle_channel(recording, stream) or 3
    surfaces, motors = [], []
    for channel, values in sorted(pwm.items()):
        function = int(recording.parameters.get(f"SERVO{channel}_FUNCTION", -1))
        motor = function in _THROTTLE_FUNCTIONS or (function < 0 and channel == throttle)
        known = function in _SURFACE_FUNCTIONS or function in _UNKNOWN_FUNCTIONS or motor
        if np.ptp(values) < 20.0 or not known:
            continue
        name = _SURFACE_FUNCTIONS.get(function, f"servo{channel}")
        if any(signal.name == name for signal in surfaces):
            name = f"{name}{channel}"
        if motor:
            motors.append(_output("throttle", values, throttle=True))
        else:
            surfaces.append(_output(name, values, throttle=False))
    return (*surfaces, *motors[:1])


def _throttle_channel(recording: Recording, stream: Stream) -> int | None:
    """The output that follows the reported throttle, by correlation; None when none does."""
    hud = recording.first(("VFR_HUD",), "throttle")
    if hud is None:
        return None
    good = hud.valid("throttle")
    reported = np.interp(stream.time, hud.time[good], hud.channels["throttle"][good])
    best, channel = 0.9, None
    for name in stream.channels:
        valid = stream.valid(name)
        if not name.startswith("pwm_") or valid.sum() < 10:
            continue
        values, against = stream.channels[name][valid], reported[valid]
        if np.ptp(values) < 20.0 or np.ptp(against) < 0.02:
            continue
        likeness = float(np.corrcoef(values, against)[0, 1])
        if likeness > best:
            best, channel = likeness, int(name.removeprefix("pwm_"))
    return channel


def frozen(values: Float[np.ndarray, " tick"], step: float) -> Bool[np.ndarray, " tick"]:
    """Where a command does not move by more than its resolution for at least a second."""
    size = max(3, round(1.0 / step) | 1)
    still = (
        ndimage.maximum_filter1d(values, size) - ndimage.minimum_filter1d(values, size)
        <= 1.5 * RESOLUTION
    )
    return ndimage.binary_dilation(still, structure=np.ones(size, dtype=bool))


def activity(values: Float[np.ndarray, " tick"], step: float) -> Float[np.ndarray, " tick"]:
    """Root mean square over a second of what is faster than two seconds [half travels]."""
    fast = values - ndimage.uniform_filter1d(values, max(3, round(2.0 / step) | 1))
    mean_square = ndimage.uniform_filter1d(fast**2, max(3, round(1.0 / step) | 1))
    return np.sqrt(np.maximum(mean_square, 0.0))


def jumps(
    signal: ControlSignal, history: ControlHistory, alone: Bool[np.ndarray, " tick"]
) -> tuple[Jump, ...]:
    """Sudden changes that stand out of what the command does around them.

    A jump is a change within two ticks of more than `SMALLEST_STEP` and of eight times the local
    (one second, median) change per tick, more after lost samples: a smooth oscillation, however
    large, has none. Where the command moves `alone` there is no feedback to tell it from, and the
    second condition falls.
    """
    values = signal.values
    if values.size < 8:
        return ()
    change = pace(values, history)
    usual = 1.4826 * ndimage.median_filter(change, max(5, round(1.0 / history.step) | 1))
    lost = ndimage.maximum_filter1d(np.maximum(history.since, 1.0), 3)
    across = np.zeros_like(values)
    across[1:-1] = values[2:] - values[:-2]
    background = np.where(alone, 0.0, 8.0 * usual * lost)
    candidate = np.abs(across) > np.maximum(SMALLEST_STEP, background)
    found = []
    for sign in (1.0, -1.0):
        labels, count = ndimage.label(candidate & (np.sign(across) == sign))
        for piece in ndimage.find_objects(labels, count):
            first, last = max(piece[0].start - 1, 0), min(piece[0].stop, values.size - 1)
            middle = piece[0].start + int(np.argmax(np.abs(across[piece[0]])))
            size = float(values[last] - values[first])
            found.append(Jump(float(history.time[middle]), size))
    return _without_echoes(sorted(found, key=lambda jump: jump.time))


def pace(values: Float[np.ndarray, " tick"], history: ControlHistory) -> Float[np.ndarray, " tick"]:
    """Change per tick, that of a lost stretch spread over it."""
    _, first, which = np.unique(history.sample, return_index=True, return_inverse=True)
    change = np.abs(np.diff(values[first])) / np.maximum(history.since[first[1:]], 1.0)
    return np.append(change, 0.0)[which]


def _without_echoes(found: list[Jump]) -> tuple[Jump, ...]:
    """Drops what belongs to a jump 0.09 s or less away.

    That is feedback's first answer to a step (smaller), and a mode change's single stray sample
    (a jump and its undoing).
    """
    kept: list[Jump] = []
    for jump in found:
        last = kept[-1] if kept else None
        if last is None or jump.time - last.time > 0.09:
            kept.append(jump)
        elif jump.time - last.time < 0.05 and abs(jump.size + last.size) < 0.3 * abs(jump.size):
            kept.pop()
        elif abs(jump.size) >= 0.5 * abs(last.size):
            kept.append(jump)
    return tuple(kept)
