"""Inertial samples that come more often than the motion asks for, averaged.

Onboard logs have two hundred samples a second and more. Airframes move at a few hertz; the rest is
vibration and noise, and everything that is worked out sample by sample costs four times as much.

The mean of k samples h apart shows a motion at ω as much weaker as sin(kx)/(k sin x), x = ωh/2: by
(ωkh)²/24 (1 − 1/k²) to second order. The second difference of the means, −(ωkh)² of the motion, is
added by as much again. What is left goes with (ωkh)⁴: 7e-5 of a motion with ωkh = 0.35, which is
2.8 Hz in steps of 20 ms.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

LONGEST = 0.02
"""Step of a mean [s]."""
APART = 1.5
"""Samples further apart than so many usual steps are not averaged together."""
BARELY = 0.1
"""Of a sample's step: so much more than what is asked for a mean may take, for clocks that are not
quite."""


def averaged(
    time: Float[np.ndarray, " sample"], values: Float[np.ndarray, "sample channel"]
) -> tuple[Float[np.ndarray, " mean"], Float[np.ndarray, "mean channel"]]:
    """Means of as many samples as `LONGEST` has room for; as they are where that is one.

    Args:
        time: when samples were taken, ascending [s].
        values: what they were.

    Returns:
        Times of the means, and what the motion was then.
    """
    steps = np.diff(time)
    usual = float(np.median(steps))
    together = int(LONGEST / usual + BARELY)
    if together < 2:
        return time, values
    begins = np.concatenate([[True], steps > APART * usual])
    piece = np.cumsum(begins)
    first = np.flatnonzero(begins)
    within = np.arange(time.size) - first[piece - 1]
    starts = np.flatnonzero(within % together == 0)
    counts = np.diff(starts, append=time.size)
    mean = np.add.reduceat(values, starts, axis=0) / counts[:, None]
    # A piece's last mean may be one of fewer samples, and nearer to the one before.
    whole = counts == together
    inside = np.zeros(starts.size, dtype=bool)
    inside[1:-1] = (piece[starts][:-2] == piece[starts][2:]) & whole[:-2] & whole[1:-1] & whole[2:]
    share = (1.0 - together**-2.0) / 24.0
    bent = mean[:-2] - 2.0 * mean[1:-1] + mean[2:]
    sharp = mean.copy()
    sharp[1:-1] -= np.where(inside[1:-1, None], share * bent, 0.0)
    return np.add.reduceat(time, starts) / counts, sharp
