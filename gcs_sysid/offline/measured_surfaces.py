"""Surfaces whose positions were measured: these take the place of the commands sent to them.

The rest of the program knows a surface by the pulse of its servo. A measured position is turned
back to the pulse that the aircraft file's calibration gives it, and the servo of the file becomes
one without lag, delay or limits: what is measured has those behind it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import Aircraft, Servo, StreamTiming
from gcs_sysid.reconstruct.control_history import SERVO_STREAM
from gcs_sysid.recording import Recording, Stream
from gcs_sysid.sources.can.streams import POSITIONS

COMMANDED = "commanded"
"""The commands stay in the recording as `SERVO_OUTPUT_RAW[commanded]`."""


def in_place_of_commands(
    recording: Recording, aircraft: Aircraft
) -> tuple[Recording, Aircraft, tuple[str, ...]]:
    """Recording and aircraft with measured surfaces, and which surfaces these are.

    Actuator N of the bus is the surface on output N. Both come back as they were where nothing was
    measured, or where a surface that was not measured has no commands either.
    """
    positions = recording.streams.get(POSITIONS)
    if positions is None:
        return recording, aircraft, ()
    measured = {
        servo.channel: servo
        for servo in aircraft.servos
        if positions.has(f"position_{servo.channel}")
    }
    if not measured:
        return recording, aircraft, ()
    fastest = max(measured, key=lambda channel: positions.valid(_name(channel)).sum())
    time = np.unique(positions.time[positions.valid(_name(fastest))])
    channels = _held(recording.streams.get(SERVO_STREAM), time)
    for channel, servo in measured.items():
        good = positions.valid(_name(channel))
        seen = np.interp(time, positions.time[good], positions.channels[_name(channel)][good])
        channels[f"pwm_{channel}"] = _pulse(servo, seen)
    streams = dict(recording.streams)
    if SERVO_STREAM in streams:
        kept = f"{SERVO_STREAM}[{COMMANDED}]"
        streams[kept] = replace(streams[SERVO_STREAM], name=kept)
    streams[SERVO_STREAM] = Stream(SERVO_STREAM, time, time, channels)
    known = tuple(
        _ideal(servo) if servo.channel in measured else servo for servo in aircraft.servos
    )
    timing = aircraft.streams
    if len(measured) == len(aircraft.servos):
        timing = {**timing, SERVO_STREAM: StreamTiming(0.0, 0.005)}
    names = tuple(servo.surface for servo in measured.values())
    return (
        replace(recording, streams=streams),
        replace(aircraft, servos=known, streams=timing),
        names,
    )


def _name(channel: int) -> str:
    return f"position_{channel}"


def _held(
    stream: Stream | None, time: Float[np.ndarray, " tick"]
) -> dict[str, Float[np.ndarray, " tick"]]:
    """Commands at other times: each holds until the next."""
    if stream is None:
        return {}
    held = {}
    for name in stream.channels:
        good = stream.valid(name)
        if good.any():
            at = np.searchsorted(stream.time[good], time, side="right") - 1
            held[name] = stream.channels[name][good][np.maximum(at, 0)]
    return held


def _pulse(servo: Servo, deflection: Float[np.ndarray, " tick"]) -> Float[np.ndarray, " tick"]:
    """Pulse [µs] at which the file's calibration has the surface where it was measured."""
    order = np.argsort(servo.deflection)
    return np.interp(deflection, np.array(servo.deflection)[order], np.array(servo.pwm)[order])


def _ideal(servo: Servo) -> Servo:
    return replace(servo, time_constant=0.0, delay=0.0, rate_limit=None, backlash=0.0, offset=0.0)
