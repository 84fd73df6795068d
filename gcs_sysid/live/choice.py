"""Which of several streams to believe, decided from what has been heard so far."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gcs_sysid.reconstruct.measurements import GYRO_STREAMS, IMU_STREAMS
from gcs_sysid.sources.samples import Sample

FRESH_S = 2.0
"""A stream silent for longer makes room for the next best one."""
LOOK_S = 1.0
"""So long are the inertial streams compared before one is chosen."""
RATE = ("p", "q", "r")
FORCE = ("acc_x", "acc_y", "acc_z")
MOST = {
    **dict.fromkeys(RATE, 100.0),
    **dict.fromkeys(FORCE, 1000.0),
    **dict.fromkeys(("airspeed", "v_north", "v_east", "v_down"), 500.0),
    **dict.fromkeys(("roll", "pitch", "yaw", "alpha", "beta"), 10.0),
    "static_pressure": 2e5,
    "altitude": 2e4,
}
LEAST = {"static_pressure": 1e3}
"""Sizes that nothing which flies here reaches [SI, rad]: a message that holds more is damaged, and
one such number ruins a covariance."""
_ANY = 1e6


def measured(sample: Sample, channels: Sequence[str]) -> bool:
    """Whether a sample holds a number for each of `channels` that can be one."""
    return all(
        LEAST.get(name, 0.0) <= abs(sample.channels.get(name, math.nan)) <= MOST.get(name, _ANY)
        for name in channels
    )


class StreamChoice:
    """The most preferred stream that is still heard.

    Args:
        names: streams, best first.
        channels: what must be measured.

    Attributes:
        chosen: name of the stream in use; empty before any was heard.
    """

    def __init__(self, names: Sequence[str], channels: tuple[str, ...]) -> None:
        self._names = names
        self._heard: dict[str, float] = {}
        self.channels = channels
        self.chosen = ""

    def takes(self, sample: Sample, time: float) -> bool:
        """Whether this sample is to be used; `time` is its own [s]."""
        if sample.stream not in self._names or not measured(sample, self.channels):
            return False
        self._heard[sample.stream] = time
        self.chosen = next(
            name for name in self._names if time - self._heard.get(name, -math.inf) < FRESH_S
        )
        return sample.stream == self.chosen


class InertialChoice:
    """The fastest stream with rates and specific force; without any, one with rates alone.

    Attributes:
        chosen: name of the stream in use; empty before it is decided.
        has_accelerometer: whether specific force is measured.
    """

    def __init__(self) -> None:
        self._heard: dict[str, tuple[float, float, int]] = {}
        self.chosen = ""
        self.has_accelerometer = False

    def takes(self, sample: Sample, time: float) -> bool:
        """Whether this sample is to be used; `time` is its own [s]."""
        if sample.stream not in GYRO_STREAMS or not measured(sample, RATE):
            return False
        if sample.stream in IMU_STREAMS and not measured(sample, FORCE):
            return False
        first, last, count = self._heard.get(sample.stream, (time, time, 0))
        again = time - last > FRESH_S
        self._heard[sample.stream] = (time, time, 1) if again else (first, time, count + 1)
        silent = not self.chosen or time - self._heard[self.chosen][1] > FRESH_S
        if silent and any(end - begin >= LOOK_S for begin, end, _ in self._heard.values()):
            self._choose(time)
        return sample.stream == self.chosen

    def _choose(self, time: float) -> None:
        fresh = {
            name: round(count / max(last - first, 1e-3))
            for name, (first, last, count) in self._heard.items()
            if time - last < FRESH_S and count > 1
        }
        full = [name for name in IMU_STREAMS if name in fresh]
        rates_only = [name for name in GYRO_STREAMS if name in fresh]
        # `max` keeps the first of equals, and the names stand best first.
        self.chosen = max(full or rates_only, key=lambda name: fresh[name], default="")
        self.has_accelerometer = bool(full)
