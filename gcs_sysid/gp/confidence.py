"""Where in the envelope the aerodynamics are known, and where not for want of what.

The envelope is cut into cells of angle of attack and sideslip, everything else as in trim. A cell
is low in confidence where one standard deviation of a coefficient, or of what a derivative times
the usual spread of its variable adds to it, exceeds a share of the coefficient's own spread. If the
flights were there the data are too noisy; otherwise there are none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from gcs_sysid.estimate.result import AeroModel

LEVEL = 0.1
"""Share of a coefficient's spread from which a cell is low in confidence."""
CELLS = (8, 8)
SHORTEST = 1.0
"""A cell with less flight than this [s] in it counts as never visited."""
Reason = Literal["", "no data", "noisy data"]
REASONS: tuple[Reason, ...] = ("", "no data", "noisy data")


@dataclass(frozen=True)
class Flown:
    """What the flights visited.

    Attributes:
        values: regressors of every sample, by name.
        measured: coefficients, by name; NaN where there are none.
        step: sample interval [s].
    """

    values: Mapping[str, Float[np.ndarray, " sample"]]
    measured: Mapping[str, Float[np.ndarray, " sample"]]
    step: float


@dataclass(frozen=True)
class Quantity:
    """A coefficient or derivative over the cells.

    Attributes:
        coefficient: its name.
        variable: of the derivative; None for the coefficient itself.
        mean: in every cell.
        deviation: one standard deviation of it.
        share: of the coefficient's spread that this is.
        reason: index into `REASONS`.
    """

    coefficient: str
    variable: str | None
    mean: Float[np.ndarray, "alpha beta"]
    deviation: Float[np.ndarray, "alpha beta"]
    share: Float[np.ndarray, "alpha beta"]
    reason: Int[np.ndarray, "alpha beta"]


@dataclass(frozen=True)
class Map:
    """Confidence over the envelope.

    Attributes:
        alpha: edges of the cells [rad].
        beta: edges of the cells [rad].
        held: what all other variables stand at.
        seconds: of flight in every cell.
        quantities: all coefficients and derivatives.
    """

    alpha: Float[np.ndarray, " edge"]
    beta: Float[np.ndarray, " edge"]
    held: Mapping[str, float]
    seconds: Float[np.ndarray, "alpha beta"]
    quantities: tuple[Quantity, ...]


def over_envelope(
    model: AeroModel,
    flown: Flown,
    *,
    alpha: tuple[float, float],
    beta: tuple[float, float],
    level: float = LEVEL,
) -> Map:
    """The map of a model.

    Args:
        model: polynomial, with Gaussian processes or without.
        flown: what its flights visited.
        alpha: limits of the envelope [rad].
        beta: limits of the envelope [rad].
        level: share of a coefficient's spread from which a cell is low in confidence.
    """
    edges = [
        np.linspace(*ends, count + 1) for ends, count in zip((alpha, beta), CELLS, strict=True)
    ]
    seconds = (
        flown.step * np.histogram2d(flown.values["alpha"], flown.values["beta"], bins=edges)[0]
    )
    middles = [0.5 * (one[1:] + one[:-1]) for one in edges]
    grid = np.meshgrid(*middles, indexing="ij")
    held = {name: float(np.median(flown.values[name])) for name in model.variables}
    asked = {name: np.full(grid[0].size, value) for name, value in held.items()}
    asked |= {"alpha": grid[0].ravel(), "beta": grid[1].ravel()}
    quantities = []
    predicted = model.predict(asked, measured=False)
    for name, found in predicted.items():
        spread = max(float(np.nanstd(flown.measured[name])), 1e-12)
        own = np.sqrt(np.maximum(found.deviation**2 - model.discrepancy(name) ** 2, 0.0))
        quantities.append(_quantity(name, None, found.mean, own, own / spread, seconds, level))
        for variable in model.depends_on(name):
            if variable not in flown.values:
                continue
            slope = model.derivative(name, variable, asked)
            share = slope.deviation * float(np.std(flown.values[variable])) / spread
            quantities.append(
                _quantity(name, variable, slope.mean, slope.deviation, share, seconds, level)
            )
    held = {name: value for name, value in held.items() if name not in ("alpha", "beta")}
    return Map(edges[0], edges[1], held, seconds, tuple(quantities))


def _quantity(
    name: str,
    variable: str | None,
    mean: Float[np.ndarray, " cell"],
    deviation: Float[np.ndarray, " cell"],
    share: Float[np.ndarray, " cell"],
    seconds: Float[np.ndarray, "alpha beta"],
    level: float,
) -> Quantity:
    shape = seconds.shape
    low: Bool[np.ndarray, "alpha beta"] = share.reshape(shape) > level
    visited = seconds >= SHORTEST
    reason = np.where(low, np.where(visited, 2, 1), 0)
    parts = (mean.reshape(shape), deviation.reshape(shape), share.reshape(shape), reason)
    return Quantity(name, variable, *parts)


def document(found: Map, level: float = LEVEL) -> dict:
    """The map for `summary.json`: edges [rad], matrices over alpha (rows) and beta (columns).

    `low` lists, for every quantity and reason, the share of the cells and the box they lie in.
    """
    coefficients: dict[str, dict] = {}
    derivatives: dict[str, dict[str, dict]] = {}
    low = []
    for one in found.quantities:
        entry = {
            "mean": one.mean,
            "sd": one.deviation,
            "share_of_spread": one.share,
            "reason": [[REASONS[cell] for cell in row] for row in one.reason],
        }
        if one.variable is None:
            coefficients[one.coefficient] = entry
        else:
            derivatives.setdefault(one.coefficient, {})[one.variable] = entry
        low += [_low(found, one, code) for code in (1, 2) if np.any(one.reason == code)]
    return {
        "level": level,
        "alpha": found.alpha,
        "beta": found.beta,
        "held": dict(found.held),
        "seconds": found.seconds,
        "coefficients": coefficients,
        "derivatives": derivatives,
        "low": low,
    }


def _low(found: Map, one: Quantity, code: int) -> dict:
    rows, columns = np.nonzero(one.reason == code)
    return {
        "coefficient": one.coefficient,
        "derivative": one.variable,
        "reason": REASONS[code],
        "share_of_cells": float(np.mean(one.reason == code)),
        "alpha": [float(found.alpha[rows.min()]), float(found.alpha[rows.max() + 1])],
        "beta": [float(found.beta[columns.min()]), float(found.beta[columns.max() + 1])],
        "worst_share_of_spread": float(one.share[one.reason == code].max()),
    }
