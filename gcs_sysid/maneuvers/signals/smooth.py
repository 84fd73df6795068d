"""Slow shapes without corners: for what is flown as a succession of steady states."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def push_pull(duration: float, time: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " sample"]:
    """Down and up again, once: a push-over and a pull-up, each a raised cosine."""
    return cycles(1, duration, time)


def cycles(
    count: int, duration: float, time: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " sample"]:
    """Raised cosines of alternating sign, so many pairs: a roller-coaster.

    Value and slope are zero between them and at both ends.
    """
    phase = 2.0 * count * np.clip(time / duration, 0.0, 1.0)
    sign = np.where(np.floor(phase) % 2 == 0, 1.0, -1.0)
    return sign * 0.5 * (1.0 - np.cos(2.0 * np.pi * phase))


def plateau(
    duration: float, ramp: float, time: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " sample"]:
    """Up over `ramp` [s], hold, down over as long; half cosines.

    Args:
        duration: of the whole [s].
        ramp: of each flank, at most half of it [s].
        time: [s]; zero outside.
    """
    edge = np.clip(np.minimum(time, duration - time) / ramp, 0.0, 1.0)
    return 0.5 * (1.0 - np.cos(np.pi * edge))


def winding(
    duration: float, release: float, time: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " sample"]:
    """Slowly up to one, then released over `release` [s]: a wind-up turn's pull."""
    up = np.clip(time / (duration - release), 0.0, 1.0)
    down = np.clip((duration - time) / release, 0.0, 1.0)
    rising = 0.5 * (1.0 - np.cos(np.pi * up))
    return np.minimum(rising, 0.5 * (1.0 - np.cos(np.pi * down)))
