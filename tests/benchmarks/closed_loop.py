"""Closed loop: a first weak flight, a suggestion, its flight in gusts, and what it brought.

`make bench-maneuvers` runs all of it, days of one core;
`make bench-maneuvers BENCH="--aircraft ultra_stick_25e --seeds 1"` a part of it. What is finished
is kept in `--out`, a file an aircraft and seed, and not flown again. Every arm flies as long, turns
and straight flight between inputs counted, and is identified together with the same first flight,
as `identify` does it without options:

- `suggested`: the sortie of `suggest`;
- `untuned`: 3-2-1-1 and doublets with steps of half a second and 3°, whatever the aircraft;
- `well-timed`: 3-2-1-1 and doublets timed by the aircraft's modes, as large as `suggested` may be;
- `d-optimal`: orthogonal multisines on all controls, as large as these may be, chosen by the
  determinant of the information alone, without what is known already.

Time in the air is what flying costs, and in gusts straight flight teaches too: with inputs as long
for all, many short ones would fly three times as long as a few long ones. How long the inputs of
each arm are is in the table.

`--rounds 3` flies whole sorties instead, one suggested after the other was identified, until
`suggest --confidence 0.1` has nothing to ask for, and tells how far that was true each time; with
`--save` rows of aircraft that are not asked for stay.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid.cli import numerics  # noqa: E402 - the tests' helpers are found from ROOT

numerics.keep_linear_algebra_in_one_thread()
numerics.enable()
numerics.keep_freed_memory()

from gcs_sysid import aircraft_file  # noqa: E402
from gcs_sysid.aircraft import Aircraft, Value  # noqa: E402
from gcs_sysid.estimate.result import AeroModel  # noqa: E402
from gcs_sysid.maneuvers import design, flown, information, recipes  # noqa: E402
from gcs_sysid.maneuvers.design import Condition, Maneuver  # noqa: E402
from gcs_sysid.maneuvers.flown import LANES  # noqa: E402
from gcs_sysid.maneuvers.knowledge import Added, Knowledge  # noqa: E402
from gcs_sysid.maneuvers.target import Target  # noqa: E402
from gcs_sysid.offline import (  # noqa: E402
    identify,
    model_store,
    suggest,
    suggestion_hold,
    suggestion_target,
)
from gcs_sysid.offline.suggestion_target import Question  # noqa: E402
from gcs_sysid.sitl import record, scenario  # noqa: E402
from gcs_sysid.sitl.flight import Flight  # noqa: E402
from gcs_sysid.sitl.inputs import TestInput  # noqa: E402
from gcs_sysid.sitl.plan import Leg  # noqa: E402
from gcs_sysid.sources.registry import open_recording  # noqa: E402
from tests.benchmarks import closed_loop_scores, suggested, table  # noqa: E402
from tests.benchmarks.suggested import Run  # noqa: E402

DATA = ROOT / "data" / "aircraft"
ALL = ("ultra_stick_25e", "brumby_mk3", "skywalker_x8", "aerosonde", "ad1_00")
ARMS = ("suggested", "untuned", "well-timed", "d-optimal")
MINUTES = 2.3
"""Of flight in every arm, turns and settling included: a minute of multisines."""
GUST = 0.5
"""Vertical gusts [m/s], that of a moderate breeze."""
CONFIDENCE = 0.1
"""Asked for in rounds: one deviation over the variation of a coefficient."""
WRONG = 0.15
"""By how much the file's derivatives are wrong, one relative standard deviation."""


class Planned(NamedTuple):
    """What an arm flies.

    Attributes:
        legs: of its flight.
        foretold: what each of its inputs should teach; None where nobody says.
    """

    legs: list[Leg]
    foretold: list[Added] | None


class Known(NamedTuple):
    """What arms are planned from.

    Attributes:
        believed: the aircraft as its file has it.
        model: of the first flight.
        conditions: level flights that maneuvers begin in, the middle airspeed first.
        target: of the suggestion.
        document: the suggestion.
        folder: with everything that was written.
        seed: of the campaign.
    """

    believed: Aircraft
    model: AeroModel
    conditions: list[Condition]
    target: Target
    document: dict[str, Any]
    folder: Path
    seed: int


def main() -> None:
    """Flies the arms and prints a table for all aircraft."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--aircraft", nargs="*", default=list(ALL))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--arms", nargs="*", choices=ARMS, default=list(ARMS))
    parser.add_argument("--rounds", type=int, default=0)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "closed_loop")
    parser.add_argument("--save", action="store_true")
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    if chosen.rounds:
        _show_rounds(chosen)
        return
    rows, compared, every = [], [], []
    for name in chosen.aircraft:
        seeds = [
            _finished(chosen.out / f"{name}-{seed}.json", name, seed, chosen.arms)
            for seed in range(chosen.seeds)
        ]
        every += seeds
        rows += [_row(name, arm, seeds) for arm in chosen.arms]
        compared.append((name, len(seeds), *(_over(seeds, arm, "sd") for arm in ARMS[1:])))
    compared.append(("all", len(every), *(_over(every, arm, "sd") for arm in ARMS[1:])))
    table.show(
        "suggested_maneuvers",
        f"Moment derivatives after {MINUTES} minutes of flight in gusts of {GUST} m/s, beside a "
        f"first one; means over {chosen.seeds} seeds; sd is without what no flight changes, "
        "mass, inertia and the moments' lag",
        (
            "aircraft",
            "inputs",
            "minutes flown",
            "of inputs",
            "error",
            "sd",
            "sd with lag",
            "suggested / this: error",
            "sd",
            "achieved / foretold sd",
            "outside the envelope",
            "limits broken",
            "inside the filter",
        ),
        rows,
    )
    table.show(
        "suggested_over",
        "Deviation of the moments' primary derivatives after suggested inputs over that after "
        "others, in no more flight",
        ("aircraft", "first flights", *ARMS[1:]),
        compared,
    )


def _row(name: str, arm: str, seeds: Sequence[dict[str, dict]]) -> tuple[object, ...]:
    scores = [one[arm] for one in seeds]
    ratios = [score["ratio"] for score in scores if score["ratio"] is not None]
    limits = sorted({limit for score in scores for limit in score["limits"]})
    inside = sum(score["method"] == "filter_error" for score in scores)
    return (
        name,
        arm,
        *(
            f"{np.mean([score[what] for score in scores]):.1f}"
            for what in ("minutes", "input_minutes")
        ),
        f"{100.0 * np.mean([score['error'] for score in scores]):.2f} %",
        f"{100.0 * np.mean([score['sd'] for score in scores]):.2f} %",
        f"{100.0 * np.mean([score['sd_with_lag'] for score in scores]):.2f} %",
        *(_over(seeds, arm, what) for what in ("error", "sd")),
        f"{np.median(ratios):.2f}" if ratios else "",
        f"{sum(score['left'] for score in scores)} of {sum(score['runs'] for score in scores)}",
        ", ".join(limits),
        f"{inside} of {len(scores)}",
    )


def _over(seeds: Sequence[dict[str, dict]], arm: str, what: str) -> str:
    """Mean of the suggested inputs over that of others; nothing where one was not flown."""
    if arm == "suggested" or not all({"suggested", arm} <= one.keys() for one in seeds):
        return ""
    ours, theirs = (np.mean([one[which][what] for one in seeds]) for which in ("suggested", arm))
    return f"{ours / theirs:.2f}"


def _short(value: object) -> object:
    return round(value, 4) if isinstance(value, float) else value


def _finished(kept: Path, name: str, seed: int, arms: Sequence[str]) -> dict[str, dict]:
    """Scores by arm; those that a file holds are not flown, and each is written as it comes."""
    scores = json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else {}
    missing = [arm for arm in arms if arm not in scores]
    for arm, score in _campaign(name, seed, missing):
        scores[arm] = score
        part = kept.with_suffix(".part")
        part.write_text(json.dumps(scores, indent=1), encoding="utf-8")
        part.replace(kept)
        shown = {key: _short(value) for key, value in score.items()}
        print(name, seed, arm, shown, flush=True)
    return scores


def _campaign(name: str, seed: int, arms: Sequence[str]) -> Iterator[tuple[str, dict]]:
    if not arms:
        return
    believed = aircraft_file.load(DATA / f"{name}.toml")
    real = _real(believed, np.random.default_rng(1000 + seed))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "aircraft.toml").write_text(aircraft_file.dumps(believed))
        first = folder / "first.tlog"
        record.run(flight(believed, real, weak(believed), seed), record=first)
        _identify([first], folder, folder / "before")
        known = _known(believed, folder, seed)
        for arm in arms:
            yield arm, _flown_and_scored(arm, known, real)


def _show_rounds(chosen: argparse.Namespace) -> None:
    rows = []
    for name in chosen.aircraft:
        for seed in range(chosen.seeds):
            kept = chosen.out / f"{name}-{seed}-{chosen.rounds}-rounds.json"
            if not kept.exists():
                found = list(_rounds(name, seed, chosen.rounds))
                kept.write_text(json.dumps(found, indent=1), encoding="utf-8")
            told = json.loads(kept.read_text(encoding="utf-8"))
            rows += [(name, seed, place, *one.values()) for place, one in enumerate(told)]
    table.show(
        "suggested_rounds",
        f"Whole sorties, one after the other, until `suggest --confidence {CONFIDENCE}` asks for "
        "nothing; before each, and after the last",
        (
            "aircraft",
            "seed",
            "flown",
            "by",
            "error",
            "sd",
            "sd over spread",
            "reachable and sure (but for what no flight changes)",
            "minutes of next",
        ),
        table.beside("suggested_rounds", rows, ALL),
    )


def _rounds(name: str, seed: int, most: int) -> Iterator[dict[str, str]]:
    """What is known before each sortie, and after the last."""
    believed = aircraft_file.load(DATA / f"{name}.toml")
    real = _real(believed, np.random.default_rng(1000 + seed))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "aircraft.toml").write_text(aircraft_file.dumps(believed))
        logs, legs = [], weak(believed)
        for number in range(most + 1):
            logs.append(folder / f"{number}.tlog")
            record.run(flight(believed, real, legs, 20 * seed + number), record=logs[-1])
            model, out = folder / f"model{number}", _made(folder / f"suggest{number}")
            _identify(logs, folder, model)
            asked = Question(confidence=CONFIDENCE, seed=seed)
            document = suggest.run(model, asked, out=out, progress=_silent)
            scored = closed_loop_scores.score(model_store.load(model).model, real, None)
            told = {
                "method": json.loads((model / "summary.json").read_text())["method"]["name"],
                "error": f"{100.0 * scored['error']:.2f} %",
                "sd": f"{100.0 * scored['sd']:.2f} %",
                "unsure": ", ".join(
                    f"{key} {100.0 * one['sd'] / one['spread']:.1f} %"
                    for key, one in document["unsure"].items()
                ),
                "sure": closed_loop_scores.sure(document, real, CONFIDENCE),
                "minutes": f"{document['sortie']['minutes']:.1f}",
            }
            print(name, seed, number, told, flush=True)
            yield told
            if not document["sortie"]["steps"]:
                return
            legs = _flown(suggested.sortie(document, out), believed)


def _flown_and_scored(arm: str, known: Known, real: Aircraft) -> dict[str, Any]:
    """What an arm brought; where nothing is suggested, what is known without a second flight."""
    folder, believed, planned = known.folder, known.believed, _planned(arm, known)
    foretold, out = None, folder / "before"
    outside: dict[str, Any] = {"left": 0, "runs": 0, "limits": []}
    if planned.legs:
        log, out = folder / f"{arm}.tlog", folder / arm
        number = 7000 + 10 * known.seed + ARMS.index(arm)
        truth = record.run(flight(believed, real, planned.legs, number), record=log).truth
        _identify([folder / "first.tlog", log], folder, out)
        outside = closed_loop_scores.excursions(truth, open_recording(log), planned.legs, believed)
        if planned.foretold is not None:
            foretold = closed_loop_scores.foretell(known.model, _added(known, planned.foretold))
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    method = summary["method"]["name"]
    scored = closed_loop_scores.score(model_store.load(out).model, real, foretold)
    return {**scored, **outside, **_minutes(planned.legs), "method": method}


def _added(known: Known, flown: Sequence[Added]) -> Knowledge:
    """What is known of the first flight's model once these maneuvers were flown."""
    found = information.nothing(known.model, known.conditions[0].heard)
    for more in flown:
        found = found.with_more(more)
    return found


def _minutes(legs: Sequence[Leg]) -> dict[str, float]:
    """Of flight, and of inputs."""
    inputs = sum(max((test.duration for test in leg.inputs), default=0.0) for leg in legs)
    return {"minutes": _seconds(legs) / 60.0, "input_minutes": inputs / 60.0}


def _seconds(legs: Sequence[Leg]) -> float:
    return sum(leg.duration for leg in legs)


def _known(believed: Aircraft, folder: Path, seed: int) -> Known:
    """The suggestion after the first flight, and the level flights that it is planned from."""
    document = suggest.run(
        folder / "before",
        Question(target=None, confidence=1e-3, minutes=MINUTES, seed=seed),
        out=_made(folder / "suggest"),
        progress=_silent,
    )
    stored = model_store.load(folder / "before")
    aircraft = suggest._aircraft(stored, folder / "before")
    gust = suggest._gust(folder / "before", None)["value"]
    generator = np.random.default_rng(seed)
    drawn = flown.draws(aircraft, stored.model, generator, LANES * design.TRIALS)
    sensed = None if stored.sensing is None else stored.sensing.in_gusts(gust)
    hold = suggestion_hold.found(folder / "before", stored.model, aircraft)
    conditions, _ = suggest._conditions(
        aircraft, stored.model, sensed, hold, drawn, gust, generator, _silent
    )
    target = suggestion_target.chosen(stored.model, None, None, {})
    return Known(believed, stored.model, conditions, target, document, folder, seed)


def _real(believed: Aircraft, generator: np.random.Generator) -> Aircraft:
    """The aircraft that flies: every derivative off by its own part."""
    aerodynamics = {
        name: replace(
            model,
            terms={
                key: Value(item.value * (1.0 + WRONG * generator.standard_normal()), item.sigma)
                for key, item in model.terms.items()
            },
        )
        for name, model in believed.aerodynamics.items()
    }
    return replace(believed, aerodynamics=aerodynamics)


def flight(believed: Aircraft, real: Aircraft, legs: Sequence[Leg], seed: int) -> Flight:
    """In the gusts of all of these flights, from the targets of the first leg."""
    return Flight(
        believed=believed,
        flown=real,
        legs=tuple(legs),
        start=scenario.start(legs[0]),
        wind=scenario.wind(math.radians(200.0), 3.0, GUST),
        seed=seed,
    )


def _identify(logs: list[Path], folder: Path, out: Path) -> None:
    """As the command does it without options."""
    identify.run(
        logs,
        folder / "aircraft.toml",
        prior="file",
        segments=None,
        vehicle=None,
        stepwise=False,
        method="auto",
        out=_made(out),
        progress=_silent,
    )


def weak(believed: Aircraft) -> list[Leg]:
    """Small doublets at one airspeed, a minute and a half."""
    low, high = closed_loop_scores.envelope(believed).airspeed
    speed = low + 0.45 * (high - low)
    inputs = [
        TestInput(name, "doublet", 4.0 + 6.0 * index, 1.0, math.radians(2.0))
        for index, name in enumerate(believed.control_names)
    ]
    height = closed_loop_scores.envelope(believed).height_min + 60.0
    return [
        Leg("out", 24.0, speed, height, 0.0, inputs=tuple(inputs)),
        Leg("turn", 14.0, speed, height, math.radians(170.0)),
        Leg("back", 24.0, speed, height, math.radians(170.0), inputs=tuple(inputs)),
    ]


def _planned(arm: str, known: Known) -> Planned:
    """What an arm flies, and what that should teach."""
    believed = known.believed
    if arm == "suggested":
        return _suggested(known)
    if arm == "untuned":
        runs = _untuned(believed)
        return Planned(_flown([runs[place] for place in _filling(runs)], believed), None)
    wanted = ("multistep", "doublet") if arm == "well-timed" else ("all_multisine",)
    pool = _pool(known, wanted)
    if arm == "d-optimal":
        pool = [max(pool, key=_determinant)]
    names = (*believed.control_names, "throttle")
    runs = [
        Run(
            item.airspeed,
            item.recipe.duration,
            {name: item.added[:, place] for place, name in enumerate(names)},
        )
        for item in pool
    ]
    order = _filling(runs)
    flown = _flown([runs[place] for place in order], believed)
    return Planned(flown, [pool[place].taught for place in order])


def _suggested(known: Known) -> Planned:
    """The sortie's maneuvers at full size, from their files, as long as time lasts."""
    document = known.document
    names = [step["maneuver"] for step in document["sortie"]["steps"] if step["share"] == 1.0]
    entries = {item["name"]: item for item in document["maneuvers"]}
    runs = [
        Run(
            entries[name]["entry"]["airspeed"],
            entries[name]["duration_s"],
            suggested.columns(known.folder / "suggest" / entries[name]["csv"]),
        )
        for name in names
    ]
    order = _filling(runs)
    taught = {names[place]: _taught(known, entries[names[place]]) for place in order}
    flown = _flown([runs[place] for place in order], known.believed)
    return Planned(flown, [taught[names[place]] for place in order])


def _taught(known: Known, entry: dict[str, Any]) -> Added:
    """What a listed maneuver should teach: its recipe is sized again, and made as small as it is.

    A document tells that of a coefficient's own deviations only, and of a sortie as a whole.
    """
    before = information.nothing(known.model, known.conditions[0].heard)
    for at in known.conditions:
        for make in suggest.considered(at, known.target, before, 60.0 * MINUTES):
            recipe = make()
            if recipe is None or f"{recipe.name}_{at.trim.airspeed:.0f}mps" != entry["name"]:
                continue
            one = design.sized(at, recipe)
            if isinstance(one, Maneuver):
                return one.taught.smaller(entry["share_of_full_size"] / one.share)
    raise ValueError(f"no recipe for {entry['name']}")


def _filling(runs: Sequence[Run]) -> list[int]:
    """Places of so many of the runs, over and over, that flying them takes `MINUTES`."""
    taken: list[int] = []
    for place in itertools.cycle(range(len(runs))):
        longer = [*taken, place]
        if _seconds(suggested.legs([runs[one] for one in longer], 0.0)) > 60.0 * MINUTES:
            break
        taken = longer
    return taken


def _untuned(believed: Aircraft) -> list[Run]:
    """Both inputs on one control after the other."""
    low, high = closed_loop_scores.envelope(believed).airspeed
    speed = low + 0.45 * (high - low)
    shapes = ((1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0), (1.0, -1.0))
    steps = [np.repeat(shape, 25) * math.radians(3.0) for shape in shapes]
    return [
        Run(speed, suggested.STEP * step.size, {name: step})
        for name in believed.control_names
        for step in steps
    ]


def _pool(known: Known, wanted: Sequence[str]) -> list[Maneuver]:
    """Maneuvers of these names at the middle airspeed, as safe as the suggested ones."""
    generator = np.random.default_rng(known.seed)
    at = known.conditions[0]
    made = []
    for recipe in recipes.every(at.place()):
        if any(recipe.name.endswith(name) for name in wanted):
            one = design.sized(at, recipe)
            if isinstance(one, Maneuver):
                one = design.proved(at, one, generator)
            if isinstance(one, Maneuver):
                made.append(one)
    return made


def _determinant(item: Maneuver) -> float:
    """Of XᵀX a second, as textbooks have it: noise is white, whatever else is unknown."""
    total = 0.0
    for name in ("Cl", "Cm", "Cn"):
        rows = item.flown.alpha.shape[1] * item.reach[name].mean
        total += np.linalg.slogdet(rows + 1e-9)[1]
    return total / item.recipe.duration


def _flown(runs: Sequence[Run], believed: Aircraft) -> list[Leg]:
    return suggested.legs(runs, closed_loop_scores.envelope(believed).height_min + 60.0)


def _made(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    return folder


def _silent(_text: str, _share: float) -> None:
    """Nobody watches a benchmark's progress."""


if __name__ == "__main__":
    main()
