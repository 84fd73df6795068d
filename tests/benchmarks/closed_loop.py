"""Closed loop: a first weak flight, a suggestion, its flight in gusts, and what it brought.

`make bench-maneuvers` runs all of it, days of one core;
`make bench-maneuvers BENCH="--aircraft ultra_stick_25e --seeds 1"` a part that takes minutes. Every
arm gets the same time of inputs at the same limits, and is identified together with the same first
flight:

- `suggested`: the sortie of `suggest`;
- `untuned`: 3-2-1-1 and doublets with steps of half a second and 3°, whatever the aircraft;
- `well-timed`: 3-2-1-1 and doublets timed by the aircraft's modes, as large as `suggested` may be;
- `d-optimal`: orthogonal multisines on all controls, as large as these may be, chosen by the
  determinant of the information alone, without what is known already.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid.cli import numerics  # noqa: E402 - the tests' helpers are found from ROOT

numerics.keep_linear_algebra_in_one_thread()
numerics.enable()

from gcs_sysid import aircraft_file  # noqa: E402
from gcs_sysid.aircraft import Aircraft, Value  # noqa: E402
from gcs_sysid.maneuvers import design, recipes  # noqa: E402
from gcs_sysid.maneuvers.design import Maneuver  # noqa: E402
from gcs_sysid.offline import identify, model_store, suggest  # noqa: E402
from gcs_sysid.offline.suggestion_target import Question  # noqa: E402
from gcs_sysid.sitl import record, scenario  # noqa: E402
from gcs_sysid.sitl.flight import Flight  # noqa: E402
from gcs_sysid.sitl.inputs import TestInput  # noqa: E402
from gcs_sysid.sitl.plan import Leg  # noqa: E402
from tests.benchmarks import table  # noqa: E402

DATA = ROOT / "data" / "aircraft"
ALL = ("ultra_stick_25e", "brumby_mk3", "skywalker_x8", "ad1_00")
ARMS = ("suggested", "untuned", "well-timed", "d-optimal")
TIME = 60.0
"""Of inputs in every arm [s]."""
MINUTES = 2.3
"""Of flight, turns and settling included: a minute of multisines, and what is foretold is of it."""
GUST = 0.5
"""Vertical gusts [m/s], that of a moderate breeze."""
WRONG = 0.15
"""By how much the file's derivatives are wrong, one relative standard deviation."""
PRIMARY = {
    "Cl": ("phat", "aileron", "beta"),
    "Cm": ("alpha", "qhat", "elevator"),
    "Cn": ("beta", "rhat", "rudder"),
}
"""Derivatives of the moments that are scored, where the aircraft has them."""


def main() -> None:
    """Flies the arms and prints a table for each aircraft."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--aircraft", nargs="*", default=list(ALL))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--arms", nargs="*", default=list(ARMS))
    parser.add_argument("--save", action="store_true")
    chosen = parser.parse_args()
    rows = []
    for name in chosen.aircraft:
        scores = {arm: [] for arm in chosen.arms}
        for seed in range(chosen.seeds):
            for arm, score in _campaign(name, seed, chosen.arms).items():
                scores[arm].append(score)
                print(name, seed, arm, {key: _short(value) for key, value in score.items()})
        rows += [_row(name, arm, scores[arm]) for arm in chosen.arms]
    table.show(
        "suggested_maneuvers",
        f"Moment derivatives after {TIME:.0f} s of inputs in gusts of {GUST} m/s, beside a first "
        f"flight; means over {chosen.seeds} seeds",
        ("aircraft", "inputs", "error", "sd", "achieved / foretold sd", "outside the envelope"),
        rows,
    )


def _row(name: str, arm: str, scores: Sequence[dict]) -> tuple[object, ...]:
    ratios = [score["ratio"] for score in scores if score["ratio"] is not None]
    return (
        name,
        arm,
        f"{100.0 * np.mean([score['error'] for score in scores]):.1f} %",
        f"{100.0 * np.mean([score['sd'] for score in scores]):.1f} %",
        f"{np.median(ratios):.2f}" if ratios else "",
        f"{sum(score['left'] for score in scores)} of {sum(score['runs'] for score in scores)}",
    )


def _short(value: object) -> object:
    return round(value, 4) if isinstance(value, float) else value


def _campaign(name: str, seed: int, arms: Sequence[str]) -> dict[str, dict]:
    believed = aircraft_file.load(DATA / f"{name}.toml")
    real = _real(believed, np.random.default_rng(1000 + seed))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "aircraft.toml").write_text(aircraft_file.dumps(believed))
        first = folder / "first.tlog"
        record.run(_flight(believed, real, _weak(believed), seed), record=first)
        _identify([first], folder, folder / "before")
        document = suggest.run(
            folder / "before",
            Question(target=None, confidence=1e-3, minutes=MINUTES, seed=seed),
            out=_made(folder / "suggest"),
            progress=_silent,
        )
        found = {}
        for number, arm in enumerate(arms):
            legs, foretold = _legs(arm, document, folder, believed, seed)
            log = folder / f"{arm}.tlog"
            path = record.run(
                _flight(believed, real, legs, 7000 + 10 * seed + number), record=log
            ).truth
            _identify([first, log], folder, folder / arm)
            found[arm] = _score(folder / arm, real, foretold) | _excursions(path, legs, believed)
    return found


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


def _flight(believed: Aircraft, real: Aircraft, legs: Sequence[Leg], seed: int) -> Flight:
    return Flight(
        believed=believed,
        flown=real,
        legs=tuple(legs),
        start=scenario.start(legs[0]),
        wind=scenario.wind(math.radians(200.0), 3.0, GUST),
        seed=seed,
    )


def _identify(logs: list[Path], folder: Path, out: Path) -> None:
    identify.run(
        logs,
        folder / "aircraft.toml",
        prior="file",
        segments=None,
        vehicle=None,
        stepwise=False,
        out=_made(out),
        progress=_silent,
    )


def _weak(believed: Aircraft) -> list[Leg]:
    """Small doublets at one airspeed, a minute and a half."""
    low, high = believed.envelope.airspeed
    speed = low + 0.45 * (high - low)
    inputs = [
        TestInput(name, "doublet", 4.0 + 6.0 * index, 1.0, math.radians(2.0))
        for index, name in enumerate(believed.control_names)
    ]
    height = believed.envelope.height_min + 60.0
    return [
        Leg("out", 24.0, speed, height, 0.0, inputs=tuple(inputs)),
        Leg("turn", 14.0, speed, height, math.radians(170.0)),
        Leg("back", 24.0, speed, height, math.radians(170.0), inputs=tuple(inputs)),
    ]


def _legs(
    arm: str, document: dict, folder: Path, believed: Aircraft, seed: int
) -> tuple[list[Leg], dict | None]:
    """Legs of an arm, and the deviations that were foretold of it."""
    if arm == "suggested":
        names = [step["maneuver"] for step in document["sortie"]["steps"] if step["share"] == 1.0]
        entries = {item["name"]: item for item in document["maneuvers"]}
        taken = _for_a_minute([(entries[name]["duration_s"], name) for name in names])
        items = [
            (entries[name], _columns(folder / "suggest" / entries[name]["csv"])) for name in taken
        ]
        runs = [
            (entry["entry"]["airspeed"], entry["duration_s"], columns) for entry, columns in items
        ]
        return _flown(runs, believed), document["sortie"]["derivatives"]
    if arm == "untuned":
        return _flown(_untuned(believed), believed), None
    wanted = ("multistep", "doublet") if arm == "well-timed" else ("all_multisine",)
    pool = _planned(folder, wanted, seed)
    if arm == "d-optimal":
        pool = [max(pool, key=_determinant)]
    order = _for_a_minute([(item.recipe.duration, index) for index, item in enumerate(pool)] * 40)
    names = (*believed.control_names, "throttle")
    runs = [
        (
            pool[index].airspeed,
            pool[index].recipe.duration,
            {name: pool[index].added[:, place] for place, name in enumerate(names)},
        )
        for index in order
    ]
    return _flown(runs, believed), None


def _for_a_minute(items: Sequence[tuple[float, object]]) -> list:
    """So many of the items, over and over, that their inputs take `TIME`."""
    taken, used = [], 0.0
    for duration, item in [*items] * 20:
        if used + duration > TIME:
            break
        taken.append(item)
        used += duration
    return taken


def _columns(path: Path) -> dict[str, np.ndarray]:
    head, *rows = path.read_text().splitlines()
    values = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    names = head.split(",")
    return {
        name: values[:, place] * (1.0 if name == "throttle" else math.radians(1.0))
        for place, name in enumerate(names)
        if name != "t"
    }


def _untuned(believed: Aircraft) -> list[tuple[float, float, dict[str, np.ndarray]]]:
    low, high = believed.envelope.airspeed
    speed = low + 0.45 * (high - low)
    one = np.repeat([1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0], 25) * math.radians(3.0)
    two = np.repeat([1.0, -1.0], 25) * math.radians(3.0)
    runs, used, index = [], 0.0, 0
    while True:
        shape = one if index % 2 == 0 else two
        name = believed.control_names[(index // 2) % len(believed.control_names)]
        duration = 0.02 * shape.size
        if used + duration > TIME:
            return runs
        runs.append((speed, duration, {name: shape}))
        used, index = used + duration, index + 1


def _planned(folder: Path, wanted: Sequence[str], seed: int) -> list[Maneuver]:
    """Maneuvers of these names at the middle airspeed, as safe as the suggested ones."""
    stored = model_store.load(folder / "before")
    generator = np.random.default_rng(seed)
    aircraft = suggest._aircraft(stored, folder / "before")
    gust = suggest._gust(folder / "before", None)["value"]
    found, _ = suggest._conditions(aircraft, stored.model, gust, generator, _silent)
    at = found[0]
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
    total = 0.0
    for name in ("Cl", "Cm", "Cn"):
        total += np.linalg.slogdet(item.rows[name].added.information + 1e-9)[1]
    return total / item.recipe.duration


def _flown(
    runs: Sequence[tuple[float, float, dict[str, np.ndarray]]], believed: Aircraft
) -> list[Leg]:
    """Two runs a leg, legs out and back."""
    height = believed.envelope.height_min + 60.0
    legs: list[Leg] = []
    for place in range(0, len(runs), 2):
        heading = math.radians(0.0 if place % 4 == 0 else 170.0)
        if place:
            legs.append(Leg("turn", 14.0, runs[place][0], height, heading))
        for airspeed, duration, columns in runs[place : place + 2]:
            inputs = tuple(
                TestInput(
                    name, "samples", 5.0, 0.02 * values.size, 1.0, values=tuple(map(float, values))
                )
                for name, values in columns.items()
                if np.abs(values).max() > 0.0
            )
            legs.append(Leg("run", duration + 8.0, airspeed, height, heading, inputs=inputs))
    return legs


def _score(folder: Path, real: Aircraft, foretold: dict | None) -> dict:
    """Error and deviation over the size of each primary derivative, root mean square."""
    model = model_store.load(folder).model
    errors, deviations, ratios = [], [], []
    for name, keys in PRIMARY.items():
        fit = model.fits.get(name)
        for key in keys:
            if fit is None or key not in fit.keys or key not in real.aerodynamics[name].terms:
                continue
            index = fit.keys.index(key)
            true = real.aerodynamics[name].terms[key].value
            errors.append(abs(float(fit.value[index]) - true) / abs(true))
            deviations.append(float(fit.deviation[index]) / abs(true))
            if foretold is not None:
                ratios.append(float(fit.deviation[index]) / foretold[name][key]["sd_after"])
    return {
        "error": float(np.mean(errors)),
        "sd": float(np.mean(deviations)),
        "ratio": float(np.median(ratios)) if ratios else None,
    }


def _excursions(truth: record.Truth, legs: Sequence[Leg], believed: Aircraft) -> dict:
    """Runs during which the aircraft left the envelope in truth."""
    allowed = believed.envelope
    limits = {"V": allowed.airspeed, "alpha": allowed.alpha, "beta": allowed.beta}
    limits["phi"] = (-allowed.bank, allowed.bank)
    left = runs = 0
    begins = 0.0
    for leg in legs:
        rows = slice(round(50.0 * begins), round(50.0 * (begins + leg.duration)))
        begins += leg.duration
        if not leg.inputs:
            continue
        runs += 1
        outside = False
        for name, (low, high) in limits.items():
            values = truth.column(name)[rows]
            outside |= bool(np.any((values < low) | (values > high)))
        left += outside
    return {"left": left, "runs": runs}


def _made(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    return folder


def _silent(_text: str, _share: float) -> None:
    """Nobody watches a benchmark's progress."""


if __name__ == "__main__":
    main()
