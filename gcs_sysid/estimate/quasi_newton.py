"""Steps of a search: no longer than they may be, and what their slopes tell of the curvature."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

TRIES = 50
"""Times that parts of a step are held and let go at most; a handful is usual."""
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


def corrected(
    matrix: Float[np.ndarray, "parameter parameter"],
    step: Float[np.ndarray, " parameter"],
    left: Float[np.ndarray, " parameter"],
    metric: Float[np.ndarray, "parameter parameter"],
) -> Float[np.ndarray, "parameter parameter"]:
    """The slope of equations after one update of Broyden (Math. Comp. 19, 1965).

    Of all that explain what the last step did, the one nearest by a metric: equations that are not
    the gradient of anything have no curvature that could be kept symmetric.

    Args:
        matrix: minus the slope of the equations, as believed.
        step: that was taken.
        left: the equations where it led, less what the matrix had foretold.
        metric: of steps, positive definite.
    """
    along = metric @ step
    return matrix - np.outer(left, along) / (step @ along)


def bounded(
    curvature: Float[np.ndarray, "parameter parameter"],
    slope: Float[np.ndarray, " parameter"],
    longest: Float[np.ndarray, " parameter"],
) -> Float[np.ndarray, " parameter"]:
    """The best step of which no part is longer than it may be.

    Parts that would be are held at their longest, and the others go where they balance with them
    there: cut short by itself, a part would leave behind what moves along with it. What is held and
    pulled back is let go again: two that are seen as a difference may both be too long at first,
    and held so they would lead where nothing is gained. (The primal-dual active sets of
    Hintermüller, Ito & Kunisch, SIAM J. Optimization 13, 2003.) Where that goes round, as it may if
    the curvature is not positive, the last try is cut: all who ask take a step only if it gains.

    A parameter without any curvature stays: nothing is known of how far it would go.

    Args:
        curvature: of the objective, symmetric or not.
        slope: of minus the objective.
        longest: by which each parameter may move; infinite for any.
    """
    known = np.diagonal(curvature) != 0.0
    if not known.all():
        step = np.zeros(slope.size)
        step[known] = bounded(curvature[np.ix_(known, known)], slope[known], longest[known])
        return step
    size = np.sqrt(np.abs(np.diagonal(curvature)))
    scaled, wanted, most = curvature / np.outer(size, size), slope / size, longest * size
    # At which of its ends each part is held; 0 where it is free.
    ends = np.zeros(slope.size)
    for _ in range(TRIES):
        held = ends != 0.0
        move = np.zeros(slope.size)
        move[held] = ends[held] * most[held]
        rest = wanted[~held] - scaled[np.ix_(~held, held)] @ move[held]
        move[~held] = np.linalg.solve(scaled[np.ix_(~held, ~held)], rest)
        pull = wanted - scaled @ move
        over = np.where(np.abs(move) > most, np.sign(move), 0.0)
        now = np.where(held, np.where(ends * pull < 0.0, 0.0, ends), over)
        if np.array_equal(now, ends):
            break
        ends = now
    return np.clip(move, -most, most) / size
