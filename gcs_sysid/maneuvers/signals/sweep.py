"""A sine whose frequency grows from cycle to cycle.

Frequency grows exponentially, so that every octave takes as long (Tischler & Remple, *Aircraft and
Rotorcraft System Identification*, 2nd ed. 2012, section 5.11).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

TAPER = 0.08
"""Part of the duration over which it grows, and again over which it dies away."""


def sweep(
    first: float, last: float, duration: float, time: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " sample"]:
    """A frequency sweep of amplitude one.

    Args:
        first: frequency at the beginning [Hz].
        last: at the end [Hz].
        duration: [s].
        time: [s]; zero outside.
    """
    ratio = np.log(last / first)
    phase = 2.0 * np.pi * first * duration / ratio * np.expm1(ratio * time / duration)
    edge = np.clip(np.minimum(time, duration - time) / (TAPER * duration), 0.0, 1.0)
    inside = (time >= 0.0) & (time <= duration)
    return np.where(inside, np.sin(phase) * 0.5 * (1.0 - np.cos(np.pi * edge)), 0.0)
