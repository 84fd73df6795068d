"""Where in the envelope a model is sure, before and after a sortie."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gcs_sysid.aircraft import Aircraft, Envelope
from gcs_sysid.atmosphere import GRAVITY
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
    takes away. What is aimed at is `asked`, the region where one is, and `planned`, how far the
    sortie's maneuvers for the coefficient go.

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
        along, values = _along(name, allowed, level)
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


def changeable(
    model: AeroModel,
    known: Knowledge,
    name: str,
    aircraft: Aircraft,
    allowed: Envelope,
    level: Mapping[str, float],
) -> float:
    """Largest deviation of a coefficient where the aircraft may go, of what flying can change.

    That is every flow angle that its envelope allows, as far as the lift there is a load factor
    that it allows too.

    Args:
        model: identified so far.
        known: what was added to its fits.
        name: of the coefficient.
        aircraft: with the model's mean as its aerodynamics.
        allowed: its envelope.
        level: every variable in level flight.
    """
    along, values = _along(name, allowed, level)
    sure = {name: information.changeable(model.fits[name], known.of(name))}
    found = _deviation(model, name, values, sure)
    if along == "alpha" and "CZ" in model.fits:
        fit = model.fits["CZ"]
        lift = -(basis.columns(fit.keys, model.controls, values) @ fit.value)
        weight = aircraft.mass.mass * GRAVITY
        load = lift * level["qbar"] * aircraft.geometry.wing_area / weight
        low, high = allowed.load_factor
        inside = (load >= low) & (load <= high)
        found = found[inside] if inside.any() else found
    return float(found.max())


def _along(
    name: str, allowed: Envelope, level: Mapping[str, float]
) -> tuple[str, dict[str, np.ndarray]]:
    """The flow angle that a coefficient hangs on most, and variables over all that is allowed."""
    along = "alpha" if name in ALONG else "beta"
    low, high = getattr(allowed, along)
    values = {key: np.full(POINTS, value) for key, value in level.items()}
    return along, {**values, along: np.linspace(low, high, POINTS)}


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
