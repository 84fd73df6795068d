"""A planned maneuver and a planned sortie as documents."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gcs_sysid.aircraft import Envelope
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.maneuvers import design, information
from gcs_sysid.maneuvers.design import Maneuver
from gcs_sysid.maneuvers.information import Gain
from gcs_sysid.maneuvers.knowledge import Knowledge
from gcs_sysid.maneuvers.recipes import TURNS, Kind
from gcs_sysid.maneuvers.sortie import Sortie
from gcs_sysid.maneuvers.target import Target

SMALLEST = float(np.radians(0.03))
"""A control that moves less is not part of a maneuver [rad]."""
RECOVERY = "release the switch: the input ends and the attitude hold levels the wings"
SLOW = "; throttle open and nose down first where the airspeed is low"
SLOW_KINDS: tuple[Kind, ...] = ("deceleration", "glide", "wind-up turn", "throttle steps")


def moved(maneuver: Maneuver, names: tuple[str, ...]) -> tuple[str, ...]:
    """Inputs that a maneuver moves, `names` being those of its columns."""
    amplitude = np.abs(maneuver.added).max(axis=0)
    return tuple(name for name, size in zip(names, amplitude, strict=True) if size >= SMALLEST)


def entry(
    item: Maneuver,
    names: tuple[str, ...],
    *,
    target: Target,
    model: AeroModel,
    known: Knowledge,
    allowed: Envelope,
    worth: float,
    flown: int,
) -> dict[str, Any]:
    """One maneuver in the keys of the interface, and what its card says.

    Args:
        item: the maneuver.
        names: of its columns.
        target: what it is for.
        model: identified so far.
        known: nothing added to its fits yet.
        allowed: the envelope.
        worth: for the target and its flight time [1/s].
        flown: how often the sortie has it at full size.
    """
    reach = item.excursion
    inputs = moved(item, names)
    amplitude = np.abs(item.added).max(axis=0)
    gains = item.gains(model, known)
    asked = [name for name in target.coefficients if name in item.recipe.coefficients]
    asked = asked or list(target.coefficients)
    told = [name for name in gains if name in asked or name in item.recipe.coefficients]
    return {
        "name": item.name,
        "kind": item.recipe.kind,
        "target": {
            "coefficients": asked,
            "region": {name: list(reach.ranges[name]) for name in ("airspeed", "alpha", "beta")},
        },
        "controls": list(inputs),
        "amplitude": {name: float(amplitude[names.index(name)]) for name in inputs},
        "share_of_full_size": item.share,
        "duration_s": item.recipe.duration,
        "how": item.recipe.how,
        "entry": {
            **{"airspeed": item.airspeed, "height": item.height, "bank": 0.0},
            "holds": "attitude" if item.recipe.kind in TURNS else "heading",
        },
        "expected": {name: _expected(gains[name]) for name in told},
        "envelope": {
            **{name: list(values) for name, values in reach.ranges.items()},
            "violation_probability": reach.violation_probability,
            "left": reach.left,
            "flights": reach.flights,
        },
        "abort": abort(item, allowed),
        "recovery": RECOVERY + (SLOW if item.recipe.kind in SLOW_KINDS else ""),
        "worth": worth,
        "times_in_sortie": flown,
        "csv": f"{item.name}.csv",
    }


def _expected(one: Gain) -> dict[str, Any]:
    return {
        "sd_before": one.before,
        "sd_after": one.after,
        "spread": one.spread,
        "derivatives": {
            key: {"sd_before": before, "sd_after": after}
            for key, (before, after) in one.derivatives.items()
        },
    }


def abort(item: Maneuver, allowed: Envelope) -> dict[str, list[float]]:
    """Where to stop: half way between the farthest drawn aircraft and the limit [SI, rad]."""
    limits = {
        "airspeed": allowed.airspeed,
        "alpha": allowed.alpha,
        "beta": allowed.beta,
        "load_factor": allowed.load_factor,
        "bank": (-allowed.bank, allowed.bank),
    }
    found = {}
    for name, (low, high) in limits.items():
        values = getattr(item.flown, name)
        least, most = float(values.min()), float(values.max())
        found[name] = [0.5 * (low + max(least, low)), 0.5 * (high + min(most, high))]
    return {**found, "height_min": [allowed.height_min]}


def sortie(
    plan: Sortie, model: AeroModel, known: Knowledge, target: Target, gust: Mapping[str, Any]
) -> dict[str, Any]:
    """A whole flight in order, and what is known before and after it."""
    stays = {
        name: information.unchangeable(fit, known.of(name)) for name, fit in model.fits.items()
    }
    return {
        "minutes": plan.duration / 60.0,
        "gust": dict(gust),
        "steps": [
            {
                "maneuver": step.maneuver.name,
                "share": step.share,
                "leg": step.leg,
                "direction": step.direction,
                "begins_s": step.begins,
                "airspeed": step.maneuver.airspeed,
                "height": step.maneuver.height,
                "duration_s": step.maneuver.recipe.duration + design.AFTER,
                "worth": step.worth,
            }
            for step in plan.steps
        ],
        "derivatives": {
            name: {
                key: {
                    "value": float(model.fits[name].value[index]),
                    "sd_before": float(np.sqrt(plan.before[name][index, index])),
                    "sd_after": float(np.sqrt(plan.after[name][index, index])),
                    "sd_stays": float(stays[name][index]),
                }
                for index, key in enumerate(model.fits[name].keys)
            }
            for name in model.fits
        },
        "asked": list(target.coefficients),
    }
