"""Steps of a search: no longer than they may be, and what their slopes tell of the curvature."""

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


def bounded(
    curvature: Float[np.ndarray, "parameter parameter"],
    slope: Float[np.ndarray, " parameter"],
    longest: Float[np.ndarray, " parameter"],
) -> Float[np.ndarray, " parameter"]:
    """Newton's step, of which no part is longer than it may be.

    Parts that would be are held at their longest, and the others go where they balance with them
    there: cut short by itself, a part would leave behind what moves along with it.

    Args:
        curvature: of the objective, symmetric or not.
        slope: of minus the objective.
        longest: by which each parameter may move; infinite for any.
    """
    size = np.sqrt(np.abs(np.diagonal(curvature)))
    scaled, wanted = curvature / np.outer(size, size), slope / size
    move, free = np.zeros_like(slope), np.ones(slope.size, dtype=bool)
    while free.any():
        rest = wanted[free] - scaled[np.ix_(free, ~free)] @ move[~free]
        move[free] = np.linalg.solve(scaled[np.ix_(free, free)], rest)
        over = free & (np.abs(move) > longest * size)
        if not over.any():
            break
        move[over] = np.sign(move[over]) * (longest * size)[over]
        free &= ~over
    return move / size
