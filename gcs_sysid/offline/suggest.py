"""`suggest`: maneuvers for what a model is least sure of, inside the aircraft's envelope."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs_sysid import atmosphere
from gcs_sysid.aircraft import MOMENTS
from gcs_sysid.errors import RefusedError, UsageError
from gcs_sysid.maneuvers import design, flown, holding
from gcs_sysid.maneuvers.design import KINDS, Condition, Maneuver
from gcs_sysid.maneuvers.flown import STEP, Simulator
from gcs_sysid.model import trim
from gcs_sysid.offline import documents, model_store, summary, tested
from gcs_sysid.offline.model_store import StoredModel

Progress = Callable[[str, float], None]

ABOVE = 50.0
"""Height [m] above the lowest allowed at which maneuvers are planned."""
SPEED = 0.45
"""Where in the envelope's airspeeds they are planned."""
CHANNELS = ("airspeed", "alpha", "beta", "load_factor", "bank")


def run(
    model_dir: Path,
    *,
    confidence: float,
    target: str | None,
    seed: int,
    out: Path,
    progress: Progress,
) -> dict[str, Any]:
    """Plans maneuvers; writes `maneuvers.json`, `suggest.json`, one CSV each, `maneuvers.parquet`.

    Args:
        model_dir: an identified model.
        confidence: a coefficient is unsure where its deviation exceeds this part of its variation.
        target: the moment coefficient to plan for; None takes all that are unsure.
        seed: of the aircraft drawn from the model's posterior.
        out: directory for the results.
        progress: told what is being done.

    Returns:
        The document of the run, which holds the list of `maneuvers.json`.

    Raises:
        InputError: the model cannot be used.
        UsageError: a target that is no moment of the model.
    """
    started = clock.perf_counter()
    stored = model_store.load(model_dir)
    targets = _targets(stored, target, model_dir)
    progress("finding level flight", 0.1)
    at = _condition(stored, model_dir, np.random.default_rng(seed))
    planned: list[Maneuver] = []
    grouped = design.groups(at.aircraft, stored.model, targets)
    for index, (controls, coefficients) in enumerate(grouped.items()):
        for kind in KINDS:
            progress(f"{' and '.join(controls)} {kind}", 0.2 + 0.7 * index / len(grouped))
            planned.append(design.suggest(at, controls, coefficients, kind))
    kept = [item for item in planned if target is not None or _unsure(item, confidence)]
    kept.sort(key=lambda item: -item.worth)
    listed = [_entry(item) for item in kept]
    for item in kept:
        documents.write_text(out / f"{item.name}.csv", _csv(item))
    documents.write_text(out / "maneuvers.json", documents.dump_json(listed) + "\n")
    documents.write_table(out / "maneuvers.parquet", _table(kept))
    document = {
        **summary.header("suggest", at.aircraft, "model"),
        "model": {"source": str(model_dir), "flights": stored.provenance},
        "flights": [],
        "confidence": confidence,
        "target": target,
        "condition": {
            "airspeed": at.trim.airspeed,
            "height": -float(at.trim.state.position[2]),
            "controls": dict(zip(at.aircraft.control_names, at.trim.controls, strict=True)),
        },
        "unsure": _unsure_now(planned),
        "maneuvers": listed,
        "limits": summary.limits(at.aircraft),
        "warnings": [],
        "timing": {"total_s": clock.perf_counter() - started},
    }
    documents.write_json(out / "suggest.json", document)
    return documents.plain(document)


def _targets(stored: StoredModel, target: str | None, model_dir: Path) -> tuple[str, ...]:
    known = tuple(name for name in MOMENTS if name in stored.model.fits)
    if target is None:
        return known
    if target not in known:
        raise UsageError(
            f"--target {target}: {model_dir} has the moment coefficients "
            f"{', '.join(known) or 'none'}; name one of them"
        )
    return (target,)


def _condition(stored: StoredModel, model_dir: Path, generator: np.random.Generator) -> Condition:
    allowed = stored.aircraft.envelope
    if allowed is None:
        raise RefusedError(
            str(model_dir / "aircraft.toml"),
            "has no [envelope], so nothing says how far a maneuver may go",
            fix="add it to the aircraft file and identify again",
        )
    found = tested.with_model(stored.aircraft, stored.model)
    every = {**stored.aircraft.aerodynamics, **found.aerodynamics}
    aircraft = replace(found, aerodynamics=every)
    height = allowed.height_min + ABOVE
    low, high = allowed.airspeed
    level = trim.find(
        aircraft,
        low + SPEED * (high - low),
        height,
        float(atmosphere.density(np.array(height))),
    )
    linear = holding.linearised(aircraft, level)
    drawn = flown.draws(aircraft, stored.model, generator)
    simulator = Simulator(aircraft, level, linear, drawn)
    return Condition(aircraft, stored.model, allowed, level, linear, simulator)


def _unsure(item: Maneuver, confidence: float) -> bool:
    """Whether any coefficient of a maneuver is less sure than asked for."""
    gains = [item.gains[name] for name in item.coefficients]
    return any(one.before > confidence * one.spread for one in gains)


def _unsure_now(planned: list[Maneuver]) -> dict[str, dict[str, Any]]:
    """How sure the model is of each coefficient in the multisine for it, and of its terms."""
    found = {}
    for item in planned:
        if item.kind != "multisine":
            continue
        for name in item.coefficients:
            one = item.gains[name]
            found[name] = {
                "sd": one.before,
                "spread": one.spread,
                "derivatives": {key: {"sd": sd[0]} for key, sd in one.derivatives.items()},
            }
    return found


def _entry(item: Maneuver) -> dict[str, Any]:
    """One maneuver in the keys of the interface."""
    reach = item.excursion
    amplitude = np.abs(item.added).max(axis=0)
    return {
        "name": item.name,
        "kind": item.kind,
        "target": {
            "coefficients": list(item.coefficients),
            "region": {name: list(reach.ranges[name]) for name in ("airspeed", "alpha", "beta")},
        },
        "controls": list(item.controls),
        "amplitude": dict(zip(item.controls, amplitude, strict=True)),
        "duration_s": item.duration,
        "expected": {
            name: {
                "sd_before": one.before,
                "sd_after": one.after,
                "spread": one.spread,
                "derivatives": {
                    key: {"sd_before": before, "sd_after": after}
                    for key, (before, after) in one.derivatives.items()
                },
            }
            for name, one in item.gains.items()
        },
        "envelope": {
            **{name: list(values) for name, values in reach.ranges.items()},
            "violation_probability": reach.violation_probability,
        },
        "worth": item.worth,
        "csv": f"{item.name}.csv",
    }


def _csv(item: Maneuver) -> str:
    """Time [s] and one column a control [deg], to be added to trim and the autopilot's command."""
    rows = [",".join(("t", *item.controls))]
    for when, values in zip(item.time, np.degrees(item.added) + 0.0, strict=True):
        rows.append(",".join((f"{when:.3f}", *(f"{value:.4f}" for value in values))))
    return "\n".join(rows) + "\n"


def _table(kept: list[Maneuver]) -> dict[str, np.ndarray]:
    """What is flown in each maneuver, for drawing: the mean, and the range of all drawn."""
    parts = []
    for number, item in enumerate(kept):
        count = item.flown.alpha.shape[1]
        part: dict[str, np.ndarray] = {
            "maneuver": np.full(count, number),
            "t": STEP * np.arange(count),
        }
        for place in range(2):
            column = np.full(count, np.nan)
            if place < len(item.controls):
                column[: item.time.size] = item.added[:, place]
            part[f"input_{place}"] = column
        for name in CHANNELS:
            values = getattr(item.flown, name)
            part[name] = values[0]
            part[f"{name}_low"], part[f"{name}_high"] = values.min(axis=0), values.max(axis=0)
        parts.append(part)
    names = parts[0] if parts else ("maneuver", "t")
    return {
        name: np.concatenate([part[name] for part in parts]) if parts else np.zeros(0)
        for name in names
    }
