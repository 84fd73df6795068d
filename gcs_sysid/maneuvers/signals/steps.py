"""Plateaus with edges that a servo can follow: doublet, 2-1-1, 3-2-1-1, pulses.

References:
    3-2-1-1: Hamel & Jategaonkar, J. Aircraft 33 (1996) 9.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

DOUBLET = (1.0, 1.0)
TWO_ONE_ONE = (2.0, 1.0, 1.0)
THREE_TWO_ONE_ONE = (3.0, 2.0, 1.0, 1.0)
PULSE = (1.0,)


def steps(
    shares: Sequence[float],
    duration: float,
    time: Float[np.ndarray, " sample"],
    *,
    rise: float = 0.0,
) -> Float[np.ndarray, " sample"]:
    """Plateaus of alternating sign, the first one up.

    Args:
        shares: length of each, in shares of the duration.
        duration: of the whole, edges included [s].
        time: [s]; zero outside.
        rise: time that an edge from zero takes; one from plateau to plateau takes as long and is
            twice as steep. With 0 it jumps [s].
    """
    whole = duration - rise
    ends = whole * np.cumsum(shares) / np.sum(shares)
    edges = np.concatenate([[0.0], ends])
    signs = np.array([(-1.0) ** index for index in range(len(shares))])
    jumps = np.diff(np.concatenate([[0.0], signs, [0.0]]))
    if rise > 0.0:
        part = np.clip((time[:, None] - edges) / rise, 0.0, 1.0)
    else:
        part = (time[:, None] >= edges).astype(float)
    return part @ jumps


def rise_time(amplitude: float, time_constant: float, rate_limit: float | None) -> float:
    """Time of an edge that a servo follows: two time constants, and within its rate [s].

    Args:
        amplitude: of the plateau [rad].
        time_constant: of the servo [s].
        rate_limit: of the servo [rad/s]; None for none. Edges between plateaus go twice as fast.
    """
    limited = 2.0 * amplitude / rate_limit if rate_limit else 0.0
    return max(2.0 * time_constant, limited)
