"""Curvature made to explain how the slope changed over a step."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

LEAST = 0.01
"""Where the slope changed by less than this share of what was expected, a step tells nothing."""


def updated(
    curvature: Float[np.ndarray, "parameter parameter"],
    step: Float[np.ndarray, " parameter"],
    change: Float[np.ndarray, " parameter"],
    *,
    least: float = 0.0,
) -> Float[np.ndarray, "parameter parameter"]:
    """The curvature after one update of Broyden, Fletcher, Goldfarb and Shanno.

    Nocedal & Wright, *Numerical Optimization*, 2nd ed. 2006, eq. 6.19; damped as in their
    procedure 18.2, after Powell.

    Args:
        curvature: of the objective, positive definite.
        step: that was taken.
        change: of the objective's gradient over it.
        least: share of what was expected that the change along the step counts as at least.
    """
    along = curvature @ step
    before, after = step @ along, step @ change
    if after <= LEAST * before:
        return curvature
    if after < least * before:
        share = (1.0 - least) * before / (before - after)
        change, after = share * change + (1.0 - share) * along, least * before
    return curvature - np.outer(along, along) / before + np.outer(change, change) / after
