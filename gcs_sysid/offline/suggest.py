"""`suggest`: maneuvers for what a model is least sure of, inside the aircraft's envelope."""

from __future__ import annotations

import json
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs_sysid import atmosphere, parallel
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import RefusedError, UsageError
from gcs_sysid.estimate import innovation_spectrum
from gcs_sysid.estimate.innovation_spectrum import Sensing
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.maneuvers import (
    design,
    flown,
    holding,
    information,
    recipes,
    separation,
    sortie,
    tuned,
)
from gcs_sysid.maneuvers.axes import THROTTLE
from gcs_sysid.maneuvers.design import Condition, Maneuver, Refusal
from gcs_sysid.maneuvers.flown import LANES, Drawn, Simulator
from gcs_sysid.maneuvers.flown_hold import FlownHold
from gcs_sysid.maneuvers.knowledge import Knowledge
from gcs_sysid.maneuvers.recipes import Recipe
from gcs_sysid.maneuvers.separation import Separation
from gcs_sysid.maneuvers.sortie import Sortie
from gcs_sysid.maneuvers.target import Target
from gcs_sysid.model import trim
from gcs_sysid.model.trim import Trim
from gcs_sysid.offline import (
    documents,
    model_store,
    parquet_file,
    samples_table,
    suggestion_entries,
    suggestion_exports,
    suggestion_files,
    suggestion_flown,
    suggestion_fly,
    suggestion_hold,
    suggestion_map,
    suggestion_target,
    summary,
    tested,
)
from gcs_sysid.offline.model_store import StoredModel
from gcs_sysid.offline.suggestion_fly import Flight
from gcs_sysid.offline.suggestion_target import Question

Progress = Callable[[str, float], None]

ABOVE = 50.0
"""Height [m] above the lowest allowed at which maneuvers are planned."""
SPEEDS = (0.45, 0.25, 0.7)
"""Where in the envelope's airspeeds they are planned, the middle first."""
ASSUMED_GUST = 0.5
"""Horizontal gust intensity where no flight says one [m/s]: a light breeze over flat country."""
LISTED = 8
"""Maneuvers that are proved safe and listed, beside those of the sortie."""


def run(model_dir: Path, question: Question, *, out: Path, progress: Progress) -> dict[str, Any]:
    """Plans maneuvers; writes `maneuvers.json`, `suggest.json`, one CSV each, `maneuvers.parquet`.

    Args:
        model_dir: an identified model.
        question: what to plan for.
        out: directory for the results.
        progress: told what is being done.

    Returns:
        The document of the run, which holds the list of `maneuvers.json`.

    Raises:
        InputError: the model cannot be used, or no maneuver is safe.
        UsageError: a target that the model does not have.
    """
    started = clock.perf_counter()
    if question.fly is not None:
        suggestion_fly.check(question.fly, beyond=question.fly_beyond)
    home = None if question.home is None else suggestion_exports.home(question.home)
    stored = model_store.load(model_dir)
    aircraft = _aircraft(stored, model_dir)
    if stored.inside_filter and stored.sensing is None:
        raise RefusedError(
            str(model_dir),
            "was identified by a version that did not keep what its filter had to go by",
            fix="run `gcs-sysid identify` again",
        )
    generator = np.random.default_rng(question.seed)
    gust = _gust(model_dir, question.gust)
    pair = None
    if question.separate is not None:
        pair = suggestion_target.causes(stored.model, aircraft, question.separate)
    progress("finding level flight", 0.02)
    drawn = flown.draws(aircraft, stored.model, generator, LANES * design.TRIALS)
    sensed = None if stored.sensing is None else stored.sensing.in_gusts(gust["value"])
    hold = suggestion_hold.found(model_dir, stored.model, aircraft)
    conditions, refused = _conditions(
        aircraft, stored.model, sensed, hold, drawn, gust["value"], generator, progress
    )
    model, target = stored.model, None
    if pair is not None:
        target, model = suggestion_target.separating(
            stored,
            pair,
            lambda: samples_table.flown(model_dir, stored.model),
            conditions[0].heard,
        )
        conditions = [replace(one, model=model) for one in conditions]
    known = information.nothing(model, conditions[0].heard)
    if target is None:
        target = suggestion_target.chosen(
            model, question.target, question.region, _level(conditions[0])
        )
    budget = 60.0 * question.minutes
    candidates, more = _sized(conditions, target, known, budget, progress)
    refused += more
    if not candidates:
        raise RefusedError(
            aircraft.name,
            f"no maneuver for {target.words} is safe: {refused[0].reason if refused else 'none'}",
            fix="widen [envelope] where the aircraft allows it, or fly in calmer air",
        )
    unsure = _unsure(model, known, [item for item, _ in candidates], target, conditions[0])
    kept: list[tuple[float, Maneuver]] = []
    before = sortie.covariances(model, known)
    plan = Sortie((), 0.0, before, before)
    if _wanted(question, unsure):
        progress("proving that they are safe", 0.7)
        kept, plan, late = _chosen(target, model, known, candidates, budget, generator)
        refused += late
    names = (*aircraft.control_names, THROTTLE)
    listed = _listed(kept, plan, names, target, model, known, aircraft)
    for _, item in kept:
        documents.write_text(out / f"{item.name}.csv", suggestion_files.csv(item, names))
    suggestion_exports.write(
        out, [item for _, item in kept], listed, aircraft, conditions[0].axes, names
    )
    documents.write_text(out / "maneuvers.json", documents.dump_json(listed) + "\n")
    table = suggestion_files.motions([item for _, item in kept], names)
    parquet_file.write(out / "maneuvers.parquet", table)
    document = {
        **summary.header("suggest", aircraft, "model"),
        "model": {"source": str(model_dir), "flights": stored.provenance},
        "flights": [],
        "confidence": question.confidence,
        "target": question.target,
        "separate": _separated(model, known, plan, target),
        "region": {name: list(pair) for name, pair in target.region.items()},
        "gust": gust,
        "hold": suggestion_hold.described(hold, conditions[0]),
        "conditions": [_condition(item) for item in conditions],
        "unsure": unsure,
        "maneuvers": listed,
        "confidence_map": suggestion_map.confidence(
            model,
            known,
            plan,
            target,
            conditions[0].allowed,
            _level(conditions[0]),
            {name: item["spread"] for name, item in unsure.items()},
        ),
        "sortie": suggestion_entries.sortie(plan, model, known, target, gust),
        "poor_model": sortie.poor(stored.model),
        "refused": [{"name": item.name, "reason": item.reason} for item in refused],
        "fly": None,
        "flown": None
        if question.flown is None
        else suggestion_flown.compared(question.flown, stored.model),
        "limits": summary.limits(aircraft),
        "warnings": _warnings(gust),
        "timing": {"total_s": clock.perf_counter() - started},
    }
    if question.fly is not None and kept:
        progress("flying", 0.0)
        ready = _flight(kept[0][1], listed[0], conditions, question.fly_share)
        document["fly"] = suggestion_fly.on(question.fly, ready, progress=progress)
    documents.write_json(out / "suggest.json", document)
    if home is not None:
        suggestion_exports.missions(out, document["sortie"]["steps"], home)
    return documents.plain(document)


def _aircraft(stored: StoredModel, model_dir: Path) -> Aircraft:
    """The aircraft that the model describes; what was not identified stays as its file says."""
    if stored.aircraft.envelope is None:
        raise RefusedError(
            str(model_dir / "aircraft.toml"),
            "has no [envelope], so nothing says how far a maneuver may go",
            fix="add it to the aircraft file and identify again",
        )
    found = tested.with_model(stored.aircraft, stored.model)
    return replace(found, aerodynamics={**stored.aircraft.aerodynamics, **found.aerodynamics})


def _gust(model_dir: Path, asked: float | None) -> dict[str, Any]:
    """Intensity of the gusts to reckon with [m/s], and who says so."""
    if asked is not None:
        return {"value": asked, "source": "asked for"}
    for folder in (model_dir, model_dir.parent):
        path = folder / "summary.json"
        if path.is_file():
            told = json.loads(path.read_text(encoding="utf-8"))
            value = ((told.get("reconstruction") or {}).get("gust_sd") or {}).get("value")
            if value is not None:
                return {"value": float(value), "source": "the flight that the model is from"}
    return {"value": ASSUMED_GUST, "source": "assumed"}


def _warnings(gust: Mapping[str, Any]) -> list[str]:
    if gust["source"] != "assumed":
        return []
    return [
        f"no flight says how strong the gusts are: {gust['value']} m/s are assumed; give --gust"
    ]


def _conditions(
    aircraft: Aircraft,
    model: AeroModel,
    sensed: Sensing | None,
    hold: FlownHold | None,
    drawn: Drawn,
    gust: float,
    generator: np.random.Generator,
    progress: Progress,
) -> tuple[list[Condition], list[Refusal]]:
    """Level flights at several airspeeds, without those that are not safe by themselves."""
    if aircraft.envelope is None:
        raise ValueError("checked before")
    simulator = Simulator(aircraft)
    found, refused = [], []
    low, high = aircraft.envelope.airspeed
    for number, share in enumerate(SPEEDS):
        airspeed = low + share * (high - low)
        progress(f"level flight at {airspeed:.0f} m/s", 0.05 + 0.05 * number)
        try:
            level = _trim(aircraft, airspeed)
        except UsageError as error:
            refused.append(Refusal(f"{airspeed:.0f} m/s", str(error)))
            continue
        heard = None
        if sensed is not None:
            heard = innovation_spectrum.spectrum(aircraft, level, sensed, tuple(model.fits))
        at = design.condition(
            *(aircraft, model, simulator, drawn, level),
            **{"gust": gust, "generator": generator, "heard": heard, "hold": hold},
        )
        limit = design.unsafe_level_flight(at)
        if limit is None:
            found.append(at)
            continue
        reason = (
            f"level flight at {airspeed:.0f} m/s leaves the envelope ({limit}) by itself in gusts "
            f"of {gust:.1f} m/s, or by what is not known of the aircraft"
        )
        refused.append(Refusal(f"{airspeed:.0f} m/s", reason))
    if not found:
        raise RefusedError(
            aircraft.name,
            refused[0].reason,
            fix="fly in calmer air (--gust), or widen [envelope] where the aircraft allows it",
        )
    return found, refused


def _trim(aircraft: Aircraft, airspeed: float) -> Trim:
    if aircraft.envelope is None:
        raise ValueError("checked before")
    height = aircraft.envelope.height_min + ABOVE
    return trim.find(aircraft, airspeed, height, float(atmosphere.density(np.array(height))))


def _level(at: Condition) -> dict[str, float]:
    """Every variable of a model in level flight."""
    values = flown.regressor_values(at.aircraft, at.trim.density, at.still)
    return {name: float(value[0]) for name, value in values.items()}


def considered(
    at: Condition, target: Target, known: Knowledge, budget: float
) -> Iterator[Callable[[], Recipe | None]]:
    """Every recipe at a condition, made when it is called for.

    Those that any target is flown with are at hand; the one that is made for this target takes
    seconds, in which others can be tried.

    Args:
        at: where they begin.
        target: what is to be known better.
        known: what is known so far.
        budget: flight time that there is [s].
    """
    for recipe in recipes.every(at.place()):
        yield lambda made=recipe: made
    yield lambda: tuned.recipe(at, tuned.probed(at), target, known, budget)


def _sized(
    conditions: Sequence[Condition],
    target: Target,
    known: Knowledge,
    budget: float,
    progress: Progress,
) -> tuple[list[tuple[Maneuver, Condition]], list[Refusal]]:
    """Every recipe that excites what is asked for, as large as it is safe."""
    found, refused = [], []

    def jobs() -> Iterator[tuple[Condition, Callable[[], Recipe | None]]]:
        for number, at in enumerate(conditions):
            share = number / len(conditions)
            for count, make in enumerate(considered(at, target, known, budget), 1):
                words = f"maneuver {count} at {at.trim.airspeed:.0f} m/s"
                progress(words, 0.2 + 0.5 * share)
                yield at, make

    def tried(
        job: tuple[Condition, Callable[[], Recipe | None]],
    ) -> tuple[Maneuver | Refusal | None, Condition]:
        at, make = job
        recipe = make()
        if recipe is None or not set(recipe.coefficients) & set(target.coefficients):
            return None, at
        return design.sized(at, recipe), at

    for one, at in parallel.ahead(tried, jobs()):
        if isinstance(one, Refusal):
            refused.append(one)
        elif one is not None:
            found.append((one, at))
    return found, refused


def _chosen(
    target: Target,
    model: AeroModel,
    known: Knowledge,
    candidates: Sequence[tuple[Maneuver, Condition]],
    budget: float,
    generator: np.random.Generator,
) -> tuple[list[tuple[float, Maneuver]], Sortie, list[Refusal]]:
    """The sortie and the best single maneuvers, all of them proved safe."""
    places = {item.name: at for item, at in candidates}
    pool = [item for item, _ in candidates]
    # Weighed once: of these dozens only those that are proved smaller change.
    rates = {item.name: rate for rate, item in sortie.ranked(target, model, known, pool)}
    proved: dict[str, Maneuver] = {}
    refused: list[Refusal] = []
    while True:
        plan = sortie.planned(target, model, known, pool, budget=budget)
        best = sorted(pool, key=lambda item: -rates[item.name])[:LISTED]
        wanted = [step.maneuver for step in plan.steps] + best
        open_ones = {item.name: item for item in wanted if item.name not in proved}
        if not open_ones:
            break
        for name, item in open_ones.items():
            one = design.proved(places[name], item, generator)
            if isinstance(one, Refusal):
                refused.append(one)
                pool = [other for other in pool if other is not item]
                break
            proved[name] = one
            pool = [one if other is item else other for other in pool]
            if one.share < item.share:
                # Another may be worth more now.
                ((rates[name], _),) = sortie.ranked(target, model, known, [one])
                break
    kept = {item.name for item in wanted}
    ranked = [(rates[item.name], item) for item in pool if item.name in kept]
    return sorted(ranked, key=lambda pair: -pair[0]), plan, refused


def _wanted(question: Question, unsure: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether anything is to be planned: what was asked for by name, sure or not."""
    if {question.target, question.region, question.separate} != {None}:
        return True
    return any(
        max(item["sd"], item["sd_reachable"]) > question.confidence * item["spread"]
        for item in unsure.values()
    )


def _separated(
    model: AeroModel, start: Knowledge, plan: Sortie, target: Target
) -> dict[str, Any] | None:
    """How well the first cause's size is known whatever the second's, before and after."""
    if not isinstance(target, Separation):
        return None
    known = [start]
    for step in plan.steps:
        known.append(known[-1].with_more(step.maneuver.taught, share=step.share))
    before, after = (
        separation.apart(model, one, target.pair) ** -0.5 for one in (known[0], known[-1])
    )
    return {
        **{"causes": target.words, "unit": target.unit},
        **{"sd_before": before, "sd_after": after},
    }


def _listed(
    kept: Sequence[tuple[float, Maneuver]],
    plan: Sortie,
    names: tuple[str, ...],
    target: Target,
    model: AeroModel,
    known: Knowledge,
    aircraft: Aircraft,
) -> list[dict[str, Any]]:
    if aircraft.envelope is None:
        raise ValueError("checked before")
    return [
        suggestion_entries.entry(
            item,
            names,
            target=target,
            model=model,
            known=known,
            allowed=aircraft.envelope,
            worth=worth,
            flown=sum(step.maneuver is item and step.share == 1.0 for step in plan.steps),
        )
        for worth, item in kept
    ]


def _flight(
    item: Maneuver, entry: Mapping[str, Any], conditions: Sequence[Condition], share: float
) -> Flight:
    """A maneuver with what holds the aircraft while it is flown.

    From the ground that is the hold that is assumed: over a link a tighter one would swing.
    """
    at = next(one for one in conditions if one.trim.airspeed == item.airspeed)
    held = holding.linearised(at.aircraft, at.trim)
    return Flight(at.aircraft, at.axes, at.trim, held, item.name, item.added, entry["abort"], share)


def _unsure(
    model: AeroModel,
    known: Knowledge,
    candidates: Sequence[Maneuver],
    target: Target,
    at: Condition,
) -> dict[str, dict[str, Any]]:
    """How sure the model is of each coefficient in the maneuver that varies it most.

    And where it is least sure of all that can be reached from level flight, of what flying changes.
    """
    found, level = {}, _level(at)
    for name in target.coefficients:
        widest = max(candidates, key=lambda item: item.reach[name].spread)
        one = widest.gains(model, known)[name]
        found[name] = {
            "sd": one.before,
            "spread": one.spread,
            "in": widest.name,
            "sd_reachable": suggestion_map.changeable(
                model, known, name, at.aircraft, at.allowed, level
            ),
            "derivatives": {key: {"sd": sd[0]} for key, sd in one.derivatives.items()},
        }
    return found


def _condition(at: Condition) -> dict[str, Any]:
    frequencies = at.linear.frequencies()
    return {
        "airspeed": at.trim.airspeed,
        "height": at.height,
        "controls": dict(zip(at.aircraft.control_names, at.trim.controls, strict=True)),
        "settings": list(at.trim.settings),
        "frequencies": {
            "short_period": frequencies.pitch,
            "roll": frequencies.roll,
            "dutch_roll": frequencies.yaw,
        },
    }
