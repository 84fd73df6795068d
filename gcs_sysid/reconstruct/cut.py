"""Inertial data that were cut to whole steps towards zero, and what they are on average instead.

MAVLink carries rates in thousandths of a radian a second and forces in thousandths of g. ArduPilot
cuts the rest off; others round. What is cut is too small by half a step on average, 0.03 °/s and
0.005 m/s², whichever way the aircraft turns: a turn of a minute comes out 1.7° short, as with a
scale error that is larger the slower the turn.

Which of the two a stream does shows where it passes through zero within a few samples: cut, 0
stands for an interval two steps wide and is there as often as −1 and 1 together; rounded, it is
there half as often. The sum of the logarithms of 1/2 over 1/3 for every 0 and of 1/2 over 2/3 for
every ±1 tells them apart.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from jaxtyping import Float
from scipy.ndimage import uniform_filter1d

from gcs_sysid.atmosphere import GRAVITY
from gcs_sysid.recording import Stream

STREAMS = ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3")
"""Messages of whole numbers."""
CHANNELS = ("p", "q", "r", "acc_x", "acc_y", "acc_z")
STEPS = np.array([1e-3] * 3 + [1e-3 * GRAVITY] * 3)
"""Of angular rate [rad/s] and specific force [m/s²]."""
ENOUGH = float(np.log(1000.0))
"""Evidence from which a stream counts as cut [nat]."""
ZERO, ONE = float(np.log(3.0 / 2.0)), float(np.log(3.0 / 4.0))
WINDOW = 25
"""Samples over which the sign is averaged: half a second at 50 Hz."""
BATCH = 100
"""Samples that are looked at together as they come."""
WHOLE = 1e-3
"""A value further than this share of a step from a whole one was not sent as a whole number."""


def evidence(values: Float[np.ndarray, "sample channel"]) -> float:
    """That values were cut rather than rounded [nat]; minus infinity where they are not whole.

    Args:
        values: one sample after the other, in the order of `CHANNELS`.
    """
    steps = values / STEPS
    whole = np.round(steps)
    if np.any(np.abs(steps - whole) > WHOLE):
        return -np.inf
    before, now, after = whole[:-2], whole[1:-1], whole[2:]
    # Standing still, a sensor that reports zeros passes through nothing.
    through = (before * after < 0.0) & (np.minimum(np.abs(before), np.abs(after)) > 1.0)
    zeros, ones = np.sum(through & (now == 0.0)), np.sum(through & (np.abs(now) == 1.0))
    return float(ZERO * zeros + ONE * ones)


def was_cut(stream: Stream) -> bool:
    """Whether a stream's rates and forces were cut."""
    if stream.name not in STREAMS or not stream.has(*CHANNELS):
        return False
    values = np.stack([np.asarray(stream.channels[name]) for name in CHANNELS], axis=-1)
    return evidence(values[np.isfinite(values).all(axis=-1)]) > ENOUGH


def restored(
    values: Float[np.ndarray, "sample axis"], step: Float[np.ndarray, " axis"]
) -> Float[np.ndarray, "sample axis"]:
    """What values that were cut are on average: half a step farther from zero, where that is clear.

    Near zero noise changes their sign from sample to sample, and half a step each time would only
    make more of it: the mean of the sign counts, over the `WINDOW` samples around.
    """
    signs = np.sign(np.round(values / step))
    return values + 0.5 * step * uniform_filter1d(signs, WINDOW, axis=0, mode="nearest")


class Watch:
    """The same of samples that come one by one, with the `WINDOW` samples that came last."""

    def __init__(self) -> None:
        self._waiting: list[Float[np.ndarray, " channel"]] = []
        self._signs: deque[Float[np.ndarray, " channel"]] = deque(maxlen=WINDOW)
        self._evidence = 0.0

    @property
    def cut(self) -> bool:
        """Whether what came so far was cut."""
        return self._evidence > ENOUGH

    def restored(self, values: Float[np.ndarray, " channel"]) -> Float[np.ndarray, " channel"]:
        """Adds a sample; returns it with what is missing, once it is known to have been cut."""
        self._signs.append(np.sign(np.round(values / STEPS)))
        self._waiting.append(values)
        if len(self._waiting) == BATCH:
            self._evidence += evidence(np.stack(self._waiting))
            self._waiting = self._waiting[-2:]
        if not self.cut:
            return values
        return values + 0.5 * STEPS * np.mean(self._signs, axis=0)
