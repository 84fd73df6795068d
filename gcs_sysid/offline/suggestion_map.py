"""Where in the envelope a model is sure, before and after a sortie."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gcs_sysid.aircraft import Envelope
from gcs_sysid.estimate import basis
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.maneuvers import information
from gcs_sysid.maneuvers.information import Covariances
from gcs_sysid.maneuvers.knowledge import Knowledge
from gcs_sysid.maneuvers.recipes import ALONG
from gcs_sysid.maneuvers.sortie import Sortie
from gcs_sysid.maneuvers.target import Target

POINTS = 61


def confidence(
    model: AeroModel,
    known: Knowledge,
    plan: Sortie,
    target: Target,
    allowed: Envelope,
    level: Mapping[str, float],
    spread: Mapping[str, float],
) -> dict[str, dict[str, Any]]:
    """Each coefficient's deviation over its variation, along the flow angle that it hangs on most.

    Everything else stays as in level flight. Beyond what has been flown the polynomial's own
    deviation says too little; `flown` tells where that begins. `stays` is what of it no flight
    takes away. What is aimed at is `asked`, the
    region where one is, and `planned`, how far the sortie's maneuvers for the coefficient go.

    Args:
        model: identified so far.
        known: what was added to its fits before the sortie.
        plan: the sortie.
        target: what it is for.
        allowed: the envelope.
        level: every variable in level flight.
        spread: variation of each coefficient.
    """
    stays = {
        name: plan.before[name] - information.changeable(fit, known.of(name))
        for name, fit in model.fits.items()
    }
    found = {}
    for name in target.coefficients:
        along = "alpha" if name in ALONG else "beta"
        low, high = getattr(allowed, along)
        values = {key: np.full(POINTS, value) for key, value in level.items()}
        values[along] = np.linspace(low, high, POINTS)
        found[name] = {
            "along": along,
            "x": values[along],
            "before": _deviation(model, name, values, plan.before) / spread[name],
            "after": _deviation(model, name, values, plan.after) / spread[name],
            "stays": _deviation(model, name, values, stays) / spread[name],
            "flown": _flown(model, name, along),
            "asked": list(target.region[along]) if along in target.region else None,
            "planned": _planned(plan, name, along),
        }
    return found


def _planned(plan: Sortie, name: str, along: str) -> list[float] | None:
    """Range of a flow angle in the sortie's maneuvers for a coefficient; None where it has none."""
    reach = [
        step.maneuver.excursion.ranges[along]
        for step in plan.steps
        if name in step.maneuver.recipe.coefficients
    ]
    return [min(low for low, _ in reach), max(high for _, high in reach)] if reach else None


def _deviation(
    model: AeroModel, name: str, values: Mapping[str, np.ndarray], covariances: Covariances
) -> np.ndarray:
    rows = basis.columns(model.fits[name].keys, model.controls, values)
    return np.sqrt(np.maximum(np.sum((rows @ covariances[name]) * rows, axis=1), 0.0))


def _flown(model: AeroModel, name: str, along: str) -> list[float] | None:
    """Range of a flow angle in the flights of the model; None where no term holds it alone."""
    for fit in (model.fits[name], *model.fits.values()):
        if along in fit.keys:
            index = fit.keys.index(along)
            return [float(fit.lowest[index]), float(fit.highest[index])]
    return None
