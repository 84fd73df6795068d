"""Changes of the derivatives that pass for a change of the flow angles, which nobody measured.

Without vanes α′ = α + ε r, for any regressor r of the motion in pitch, is as good a flow angle as α
itself but for what the gusts then look like. All coefficients together absorb it: the derivatives
move by ε times the projection of r ∂C/∂α on the terms of C. Each by itself would be seen at once,
together hardly: these are the directions in which a likelihood is nearly flat, and in which the
difference of large numbers decides how flat.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from gcs_sysid import regressors
from gcs_sysid.estimate import basis

ANGLES: Mapping[str, tuple[str, ...]] = {
    "alpha": (regressors.CONSTANT, "alpha", "qhat"),
    "beta": (regressors.CONSTANT, "beta"),
}
"""What each angle may be disguised by. On a flight in gusts the curvature along others (sideslip by
rates, both by controls) was within a few per cent of the information."""
RANGE: Mapping[str, float] = {"phat": 0.1, "qhat": 0.01, "rhat": 0.03}
ANGLE_RANGE = 0.1
SAMPLES = 300
FOLLOWED = 0.5
"""A coefficient whose terms follow less than this share of the change stays as it is."""


def directions(
    keys: Sequence[tuple[str, str]],
    values: Float[np.ndarray, " term"],
    controls: Sequence[str],
) -> Float[np.ndarray, "direction term"]:
    """One row a disguise that the terms can follow.

    Args:
        keys: coefficient and regressor of each derivative.
        values: the derivatives.
        controls: names of the controls.
    """
    flow = _flow(controls)
    found = []
    for angle, partners in ANGLES.items():
        for partner in partners:
            moved = _moved(keys, values, controls, flow, angle, partner)
            if np.any(moved != 0.0):
                found.append(moved)
    return np.array(found).reshape(-1, len(keys))


def _flow(controls: Sequence[str]) -> dict[str, Float[np.ndarray, " sample"]]:
    rng = np.random.default_rng(0)
    names = (*regressors.VARIABLES, *controls)
    drawn = {name: RANGE.get(name, ANGLE_RANGE) * rng.uniform(-1.0, 1.0, SAMPLES) for name in names}
    return {**drawn, regressors.CONSTANT: np.ones(SAMPLES)}


def _moved(
    keys: Sequence[tuple[str, str]],
    values: Float[np.ndarray, " term"],
    controls: Sequence[str],
    flow: Mapping[str, Float[np.ndarray, " sample"]],
    angle: str,
    partner: str,
) -> Float[np.ndarray, " term"]:
    """Change of every derivative when `angle` is read as itself plus `partner`."""
    by = basis.columns((partner,), controls, flow)[:, 0]
    moved = np.zeros(len(keys))
    for name in dict.fromkeys(name for name, _ in keys):
        rows = [index for index, key in enumerate(keys) if key[0] == name]
        terms = tuple(keys[index][1] for index in rows)
        slope = basis.slopes(terms, controls, flow, angle) @ values[rows]
        columns = basis.columns(terms, controls, flow)
        wanted = slope * by
        share, *_ = np.linalg.lstsq(columns, wanted, rcond=None)
        if np.sum((columns @ share) ** 2) > FOLLOWED * np.sum(wanted**2):
            moved[rows] = np.where(np.abs(share) > 1e-9, share, 0.0)
    return moved
