"""Made-up flights with known maneuvers: telemetry of a small aircraft under a feedback law."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import signal

from gcs_sysid.recording import Recording, Stream, Vehicle

CHANNEL = {"servo1": 1, "servo2": 2, "throttle": 3, "servo4": 4}
GRAVITY = 9.80665


@dataclass(frozen=True)
class Input:
    """A deliberate input: what, from when [s], on which output, how large [µs]."""

    kind: str
    start: float
    control: str
    size: float = 80.0

    @property
    def length(self) -> float:
        """How long the command differs from trim [s]."""
        return {"doublet": 1.6, "multistep": 4.2, "throttle": 4.0}.get(self.kind, 20.0)

    def values(self, time: np.ndarray) -> np.ndarray:
        """The command [µs] to be added to trim."""
        t = time - self.start
        inside = (t >= 0.0) & (t < self.length)
        if self.kind in ("doublet", "throttle"):
            shape = np.where(t < 0.5 * self.length, 1.0, -1.0)
        elif self.kind == "multistep":
            shape = np.select([t < 1.8, t < 3.0, t < 3.6], [1.0, -1.0, 1.0], -1.0)
        elif self.kind == "multisine":
            lines = 0.05 * np.array([5, 9, 14, 19, 25, 31])
            phases = np.pi * np.arange(6) ** 2 / 6.0  # Schroeder 1970: a low peak factor
            shape = np.sum(np.cos(2.0 * np.pi * np.outer(t, lines) + phases), axis=1) / 3.0
        else:  # a sweep from 0.4 to 3 Hz
            shape = np.sin(2.0 * np.pi * (0.4 * t + 0.5 * (3.0 - 0.4) / self.length * t**2))
        return np.where(inside, self.size * shape, 0.0)


def flight(
    inputs: Iterable[Input] = (),
    *,
    duration: float = 120.0,
    rate: float = 50.0,
    turns: Iterable[tuple[float, float]] = (),
    airborne: tuple[float, float] | None = None,
    feedback: float = 3.0,
    open_loop: bool = False,
    speed: float = 20.0,
    gust: float = 0.05,
    seed: int = 0,
) -> Recording:
    """A flight at constant height.

    Args:
        inputs: added to the commands.
        duration: s.
        rate: of inertial data, attitude and servo outputs [Hz].
        turns: (start, end) of turns at 35° bank [s].
        airborne: flying time [s]; None flies from beginning to end.
        feedback: what the feedback law does to every output [µs, one sigma].
        open_loop: whether feedback is off, every output frozen, from two seconds before each input
            to two seconds after it.
        speed: airspeed [m/s].
        gust: one sigma of the airspeed [m/s].
        seed: of all random parts.
    """
    random = np.random.default_rng(seed)
    time = np.arange(0.0, duration, 1.0 / rate)
    inputs = tuple(inputs)
    flying = np.ones(time.size) if airborne is None else _flying(time, airborne)
    loop = np.ones(time.size)
    if open_loop:
        for item in inputs:
            loop[(time > item.start - 2.0) & (time < item.start + item.length + 2.0)] = 0.0
    pulses = {}
    for name, channel in CHANNEL.items():
        corrections = feedback * _coloured(random, time.size, rate) * flying * loop
        level = 1500.0 + (100.0 * flying - 250.0 if name == "throttle" else 0.0)
        test = sum((item.values(time) for item in inputs if item.control == name), start=0.0 * time)
        pulses[f"pwm_{channel}"] = np.round(level + corrections + test)
    bank = np.radians(35.0) * _plateaus(time, turns)
    airspeed = speed * flying + gust * _coloured(random, time.size, rate) * flying
    heading = np.cumsum(np.where(flying > 0.5, GRAVITY / speed * np.tan(bank), 0.0)) / rate
    rates = {
        "p": np.gradient(bank, time) + 0.01 * random.standard_normal(time.size),
        "q": 4e-4 * (pulses["pwm_2"] - 1500.0) + 0.01 * random.standard_normal(time.size),
        "r": np.gradient(heading, time) + 0.01 * random.standard_normal(time.size),
    }
    slow = np.arange(0.0, duration, max(0.1, 1.0 / rate))
    at = np.searchsorted(time, slow - 1e-9).clip(max=time.size - 1)
    height = 100.0 * flying
    streams = (
        _stream("SERVO_OUTPUT_RAW", time, pulses),
        _stream(
            "RAW_IMU",
            time,
            {
                **rates,
                "acc_x": np.zeros(time.size),
                "acc_y": np.zeros(time.size),
                "acc_z": -GRAVITY / np.cos(bank) + 0.05 * random.standard_normal(time.size),
            },
        ),
        _stream(
            "ATTITUDE",
            time,
            {"roll": bank, "pitch": np.full(time.size, 0.03), "yaw": heading, **rates},
        ),
        _stream(
            "VFR_HUD",
            slow,
            {"airspeed": airspeed[at], "throttle": (pulses["pwm_3"][at] - 1000.0) / 1000.0},
        ),
        _stream(
            "GLOBAL_POSITION_INT",
            slow,
            {
                "v_north": (speed * flying * np.cos(heading))[at],
                "v_east": (speed * flying * np.sin(heading))[at],
                "v_down": np.zeros(slow.size),
                "altitude": 500.0 + height[at],
                "height": height[at],
            },
        ),
        _stream("SCALED_PRESSURE", slow, {"static_pressure": np.full(slow.size, 95000.0)}),
    )
    return Recording(
        source="made_up.tlog",
        sha256="0" * 64,
        vehicle=Vehicle(1, 1, "MAV_AUTOPILOT_ARDUPILOTMEGA", "MAV_TYPE_FIXED_WING", 1),
        epoch_us=1_700_000_000_000_000,
        streams={stream.name: stream for stream in streams},
    )


def without(recording: Recording, *names: str) -> Recording:
    """The recording without some streams, or without a channel given as `STREAM.channel`."""
    streams = dict(recording.streams)
    for name in names:
        stream, _, channel = name.partition(".")
        if channel:
            kept = {k: v for k, v in streams[stream].channels.items() if k != channel}
            streams[stream] = replace(streams[stream], channels=kept)
        else:
            del streams[stream]
    return replace(recording, streams=streams)


def _stream(name: str, time: np.ndarray, channels: Mapping[str, np.ndarray]) -> Stream:
    return Stream(name, time, time, dict(channels))


def _coloured(random: np.random.Generator, count: int, rate: float) -> np.ndarray:
    """Noise of unit variance below about one hertz, as feedback on gusts looks."""
    numbers, denominators = signal.butter(2, min(1.0, 0.2 * rate), fs=rate)
    noise = signal.lfilter(numbers, denominators, random.standard_normal(count + 200))[200:]
    return noise / np.std(noise)


def _flying(time: np.ndarray, airborne: tuple[float, float]) -> np.ndarray:
    """0 on the ground, 1 in the air, three seconds between."""
    start, end = airborne
    up = np.clip((time - start + 1.5) / 3.0, 0.0, 1.0)
    return up * np.clip((end + 1.5 - time) / 3.0, 0.0, 1.0)


def _plateaus(time: np.ndarray, spans: Iterable[tuple[float, float]]) -> np.ndarray:
    """1 inside the spans with a second of rolling in and out."""
    result = np.zeros(time.size)
    for start, end in spans:
        ramp = np.clip(np.minimum(time - start + 0.5, end + 0.5 - time), 0.0, 1.0)
        result = np.maximum(result, ramp)
    return result
