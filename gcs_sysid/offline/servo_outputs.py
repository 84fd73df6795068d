"""What the servo stream of a log tells: pulses, and where it fell silent."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from gcs_sysid.aircraft import Aircraft, StreamTiming
from gcs_sysid.reconstruct.control_history import RESOLUTION, SERVO_STREAM
from gcs_sysid.recording import Recording, Stream

STEADY, MOSTLY, MOST_LOST = 0.25, 0.8, 3
"""A stream has a steady rate if so many of its intervals are the usual one to within this share;
of it so many messages in a row may be made up for."""
LEAST_RATE = 10
"""Fewer messages have no rate."""
LONG = 0.5
"""In a longer silence [s] a command may have come and gone: a doublet's first half."""
COME_AND_GONE = 0.1
"""By so much then, in half travels: a usual test input."""
TOLD = 2.0 * RESOLUTION
"""A command that differs by less after a silence [half travels] is the same."""


def control_channels(aircraft: Aircraft) -> tuple[int, ...]:
    """Output channels behind the surfaces that any control mixes."""
    used = {name for control in aircraft.controls for name in control.mix}
    return tuple(servo.channel for servo in aircraft.servos if servo.surface in used)


def pulses(
    stream: Stream, channels: Sequence[int]
) -> tuple[Float[np.ndarray, " sample"], dict[int, Float[np.ndarray, " sample"]]]:
    """Times and pulses [µs] of the samples in which every one of `channels` was reported.

    Messages that a radio has lost are made up for, as the mean of their neighbours: a command that
    is held instead moves the surface by what it moves in one interval at the wrong time, many times
    what a gyro sees.
    """
    time, sent = _reported(stream, channels)
    if time.size < LEAST_RATE:
        return time, sent
    place = places(time)
    every = np.arange(place[-1] + 1)
    return np.interp(every, place, time), {
        channel: np.interp(every, place, values) for channel, values in sent.items()
    }


def known(
    recording: Recording,
    aircraft: Aircraft,
    begin: Float[np.ndarray, " step"],
    end: Float[np.ndarray, " step"],
) -> Bool[np.ndarray, " step"]:
    """Whether it is known through each step of time where surfaces stood and what engines did.

    Nobody knows when within a silence of a steady stream a command changed. A surface whose command
    is Δ another afterwards is known again once its servo has forgotten, Δ e^(-t/τ) being less than
    the stream's resolution.

    Args:
        recording: with servo outputs.
        aircraft: its servos and engines.
        begin: of the steps [s].
        end: of the steps [s].
    """
    stream = recording.streams[SERVO_STREAM]
    seen = np.ones(begin.size, dtype=bool)
    for output in outputs(aircraft):
        if not stream.has(f"pwm_{output.channel}"):
            continue
        time, sent = _reported(stream, (output.channel,))
        if time.size < LEAST_RATE:
            continue
        silent = (np.diff(places(time)) == 1) & (np.diff(time) > longest(time))
        change = np.diff(sent[output.channel])[silent]
        for first, last in output.doubted(time[:-1][silent], time[1:][silent], change):
            seen &= (end <= first) | (begin >= last)
    return seen


class Output(NamedTuple):
    """Something that is commanded.

    Attributes:
        channel: of the output.
        travel: half of it [µs].
        delay: until the command acts, of the stream and of the servo [s].
        constant: time constant [s].
    """

    channel: int
    travel: float
    delay: float
    constant: float

    def doubted(
        self,
        before: Float[np.ndarray, " silence"],
        after: Float[np.ndarray, " silence"],
        change: Float[np.ndarray, " silence"],
    ) -> list[tuple[float, float]]:
        """From when until when nobody knows where it stood [s].

        Args:
            before: last message before each silence [s].
            after: first one after it [s].
            change: of the command [µs].
        """
        size = np.abs(change) / self.travel
        size = np.where(after - before > LONG, np.maximum(size, COME_AND_GONE), size)
        forgotten = self.constant * np.log(np.maximum(size, TOLD) / TOLD)
        first, last = before + self.delay, after + self.delay + forgotten
        other = size > TOLD
        return list(zip(first[other].tolist(), last[other].tolist(), strict=True))


def outputs(aircraft: Aircraft) -> Iterator[Output]:
    """Everything that is commanded."""
    used = set(control_channels(aircraft))
    late = aircraft.streams.get(SERVO_STREAM, StreamTiming()).delay
    for servo in aircraft.servos:
        if servo.channel in used:
            travel = 0.5 * float(np.ptp(servo.pwm))
            yield Output(servo.channel, travel, servo.delay + late, servo.time_constant)
    for engine in aircraft.propulsion:
        if engine.rpm is None:
            travel = 0.5 * float(np.ptp(engine.pwm))
            yield Output(engine.throttle_channel, travel, late, engine.time_constant)


def _reported(
    stream: Stream, channels: Sequence[int]
) -> tuple[Float[np.ndarray, " sample"], dict[int, Float[np.ndarray, " sample"]]]:
    good = np.all([stream.valid(f"pwm_{channel}") for channel in channels], axis=0)
    sent = {channel: np.asarray(stream.channels[f"pwm_{channel}"])[good] for channel in channels}
    return np.asarray(stream.time)[good], sent


def places(time: Float[np.ndarray, " sample"]) -> Int[np.ndarray, " sample"]:
    """Numbers of the messages that arrived, where those that were lost between them have theirs.

    Of a stream at a steady rate only, and no more than `MOST_LOST` in a row: what is sent when it
    changes has lost nothing, and longer silence is a hole.
    """
    steps = np.diff(time)
    count = np.ones(steps.size, dtype=int)
    if _steady(steps):
        found = np.rint(steps / np.median(steps))
        count = np.where((found > 1) & (found <= MOST_LOST + 1), found, 1).astype(int)
    return np.concatenate([[0], np.cumsum(count)])


def longest(time: Float[np.ndarray, " sample"]) -> float:
    """A longer interval is a silence [s]; none is in a stream without a steady rate."""
    steps = np.diff(time)
    return float((MOST_LOST + 1) * np.median(steps)) if _steady(steps) else np.inf


def _steady(steps: Float[np.ndarray, " interval"]) -> bool:
    usual = float(np.median(steps))
    return bool(np.mean(np.abs(steps - usual) < STEADY * usual) > MOSTLY)
