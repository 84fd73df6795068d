"""How large the inputs of several controls may be relative to each other, by the linear model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy import linalg

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft, Envelope
from gcs_sysid.atmosphere import GRAVITY
from gcs_sysid.maneuvers.axes import THROTTLE, travel
from gcs_sysid.maneuvers.flown import STEP
from gcs_sysid.maneuvers.holding import SIZE, Linear
from gcs_sysid.model.trim import Trim

TRAVEL = 0.5
"""Largest part of a control's travel that an input uses."""
POWER = 0.4
"""Largest throttle input."""


def limiting(
    aircraft: Aircraft,
    allowed: Envelope,
    trim: Trim,
    linear: Linear,
    shapes: Float[np.ndarray, "sample input"],
    names: Sequence[str],
) -> Float[np.ndarray, " input"]:
    """The size of every input at which it alone reaches a limit, in small motions.

    Args:
        aircraft: with its controls' travel.
        allowed: the envelope.
        trim: where the maneuver begins.
        linear: small motions about it.
        shapes: one column an input in the order of the controls, throttle last; zero where unused.
        names: of these columns.
    """
    sizes = np.zeros(len(names))
    for index, name in enumerate(names):
        if not np.any(shapes[:, index]):
            continue
        alone = np.zeros_like(shapes)
        alone[:, index] = shapes[:, index]
        most = POWER if name == THROTTLE else TRAVEL * travel(aircraft, name)
        sizes[index] = min(most, 1.0 / max(_reach(allowed, trim, linear, alone), 1e-9))
    return sizes


def motion(
    linear: Linear, added: Float[np.ndarray, "sample input"]
) -> Float[np.ndarray, "sample nine"]:
    """Small motion under inputs added to what the hold commands."""
    count = added.shape[1]
    block = np.zeros((SIZE + count, SIZE + count))
    block[:SIZE, :SIZE], block[:SIZE, SIZE:] = linear.held, linear.inputs
    whole = linalg.expm(STEP * block)
    keep, push = whole[:SIZE, :SIZE], whole[:SIZE, SIZE:]
    state, rows = np.zeros(SIZE), np.zeros((added.shape[0], SIZE))
    for index, row in enumerate(added):
        rows[index] = state
        state = keep @ state + push @ row
    return rows


def _reach(
    allowed: Envelope, trim: Trim, linear: Linear, added: Float[np.ndarray, "sample input"]
) -> float:
    """Largest excursion over the way to the nearer limit."""
    body = np.asarray(frames.unrotate(trim.state.attitude, trim.state.velocity))
    speed, alpha, beta = (float(value) for value in frames.flow_angles(body))
    state = motion(linear, added)
    surfaces = added.copy()
    surfaces[:, :-1] -= state @ linear.gain.T
    slope = state @ linear.dynamics[2] + surfaces @ linear.inputs[2]
    load = (body[0] * state[:, 4] - slope) / GRAVITY
    parts = {
        allowed.alpha: (state[:, 2] / speed, alpha),
        allowed.beta: (state[:, 1] / speed, beta),
        allowed.load_factor: (load, 1.0),
        allowed.airspeed: (state[:, 0], speed),
        (-allowed.bank, allowed.bank): (state[:, 6], 0.0),
    }
    return max(
        float(np.abs(moved).max()) / max(min(pair[1] - at, at - pair[0]), 1e-3)
        for pair, (moved, at) in parts.items()
    )
