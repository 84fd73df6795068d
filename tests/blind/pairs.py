"""Hard pairs of causes: one is hidden, and what `suggest --separate` plans is flown beside it.

    python -m tests.blind.pairs [--only cg_shift] [--file exact] [--seed 0] [--again] [--save]

A flight with one of two causes is diagnosed. Where the answer is a group, `suggest --separate` is
asked about the first two of that group, in the diagnosis's own words; where it is wrong, or nothing
was seen, about the pair, as somebody would who thinks of both. The sortie is flown by the same
aircraft, and both flights are diagnosed together. What is hidden goes to the simulator only.
Finished pairs are kept and not flown again.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from gcs_sysid.sitl import record
from gcs_sysid.sitl import scenario as scenarios
from tests.benchmarks import suggested, table
from tests.blind import campaign, fly, score
from tests.blind.draw import FILES, Draw, Fixed, draw, load
from tests.blind.fly import Recorded
from tests.blind.score import Score

USUAL = "five_percent"
"""How wrong the aircraft file is that the flights are diagnosed with."""
LATER = 3600
"""How long after the first flight the second begins [s]."""
MINUTES = 4.0
"""Flight time of the sortie that is asked for."""


@dataclass(frozen=True)
class Pair:
    """Two causes that are hard to tell apart, of which one is hidden.

    Attributes:
        hidden: entry of an effect file.
        rival: the other, for people.
        aircraft: that flies.
        asked: what somebody asks of `suggest --separate` who thinks of both.
    """

    hidden: Mapping[str, Any]
    rival: str
    aircraft: str
    asked: str

    @property
    def cause(self) -> str:
        """What is hidden."""
        return self.hidden["name"]


PAIRS = (
    Pair(
        {"name": "mass", "mass_ratio": 1.12},
        "lift slope",
        "aerosonde",
        "mass,aero_derivative:CZ_alpha",
    ),
    Pair(
        {"name": "aero_derivative", "derivative": "CZ.alpha", "ratio": 0.8},
        "mass",
        "aerosonde",
        "aero_derivative:CZ_alpha,mass",
    ),
    Pair(
        {"name": "cg_shift", "cg_x_chord": 0.06},
        "Cm_alpha",
        "ultra_stick_25e",
        "cg_shift,aero_derivative:Cm_alpha",
    ),
    Pair(
        {"name": "aero_derivative", "derivative": "Cm.alpha", "ratio": 1.2},
        "centre of gravity",
        "ultra_stick_25e",
        "aero_derivative:Cm_alpha,cg_shift",
    ),
    # All of Cm at once is the inertia's own direction: the largest part of it is asked about.
    Pair(
        {"name": "inertia", "Iyy_ratio": 1.3},
        "all of Cm",
        "aerosonde",
        "inertia:Iyy,aero_derivative:Cm_alpha",
    ),
    Pair(
        {"name": "airspeed_scale", "airspeed_scale": 0.1},
        "mass",
        "skywalker_x8",
        "airspeed_scale,mass",
    ),
    Pair(
        {"name": "mass", "mass_ratio": 0.88},
        "airspeed scale",
        "skywalker_x8",
        "mass,airspeed_scale",
    ),
    Pair(
        {"name": "surface_effectiveness", "control": "elevator", "ratio": 0.65},
        "actuator lag",
        "ultra_stick_25e",
        "surface_effectiveness:elevator,actuator_lag:elevator",
    ),
    Pair(
        {"name": "actuator_lag", "control": "elevator", "time_constant": 0.2},
        "elevator's effectiveness, damping",
        "ultra_stick_25e",
        "actuator_lag:elevator,surface_effectiveness:elevator",
    ),
    Pair(
        {"name": "thrust_scale", "ratio": 0.7}, "drag", "brumby_mk3", "thrust_scale,drag_increase"
    ),
    # A constant of Cm is the elevator's offset but for its lift; a shift of weight shows in both.
    Pair(
        {"name": "surface_offset", "control": "elevator", "offset": math.radians(4.0)},
        "Cm_0",
        "aerosonde",
        "surface_offset:elevator,cg_shift",
    ),
)
"""At the larger sizes that matter, but for a shift that is told apart at half: a flight of a minute
and a half with a file that is 5 % wrong finds nothing of a lift slope that is 12 % off."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Flies the pairs and prints a line for each."""
    asked = _parser().parse_args(arguments)
    pairs = [one for one in PAIRS if asked.only in (None, one.cause)]
    rows = [_row(*_finished(one, asked)) for one in pairs]
    table.show(
        "blind_pairs" if asked.file == USUAL else f"blind_pairs_{asked.file}",
        "Hard pairs of causes: what was said of a short flight, and, where that was not the one "
        "hidden and nothing else, with the sortie that `suggest --separate` planned"
        + ("" if asked.file == USUAL else f" (file {asked.file})"),
        (
            *("aircraft", "hidden", "rival", "said of the first flight", "asked to separate"),
            *("said of both flights", "right and alone"),
        ),
        rows,
    )
    return 0


def _finished(pair: Pair, asked: argparse.Namespace) -> tuple[Pair, Draw, dict[str, Any]]:
    """A pair's document; one that is kept is taken as it is, unless asked for again."""
    index = PAIRS.index(pair)
    fixed = Fixed(
        pair.cause, pair.aircraft, asked.file, "larger", short=True, effects=(pair.hidden,)
    )
    one = replace(draw(index, seed=asked.seed, fixed=fixed), plan="usual")
    of_file = "" if asked.file == USUAL else f"-{asked.file}"
    kept = asked.out / f"{index:02d}-{pair.cause}-{pair.aircraft}-{asked.seed}{of_file}.json"
    held = None if asked.again else campaign.read(kept, one)
    if held is None:
        cores = len(os.sched_getaffinity(0))
        flown = _flown(one, pair.asked, asked.out / kept.stem)
        held = {"draw": asdict(one), "cores": cores, **flown}
        campaign.write(kept, held)
    return pair, one, held


def _flown(one: Draw, in_mind: str, folder: Path) -> dict[str, Any]:
    """Both flights, as far as there is something to ask after the first; `in_mind` if it is not."""
    recorded = fly.fly(one, folder)
    if recorded.departed:
        return {"first": {"verdict": "not flown"}, "asked": None, "second": None}
    first, _ = fly.diagnose(recorded, folder / "first")
    asked = first.get("separate") or (None if score.score(one, first).alone else in_mind)
    found: dict[str, Any] = {"first": _kept(first), "asked": asked, "second": None}
    if asked is None:
        return found
    refused = _suggest(recorded, asked, folder)
    if refused:
        return {**found, "refused": refused}
    more = _second(one, folder)
    both, _ = fly.diagnose(recorded, folder / "both", more=(more,))
    return {**found, "second": _kept(both)}


def _suggest(recorded: Recorded, asked: str, folder: Path) -> str:
    """Plans the sortie in `suggest` of a folder; why not, where it is refused."""
    fly.run(
        *("identify", recorded.log, "--aircraft", recorded.aircraft, "--out", folder / "identify")
    )
    done = fly.command(
        *("suggest", "--model", folder / "identify", "--separate", asked),
        *("--minutes", MINUTES, "--out", folder / "suggest"),
    )
    return "" if done.returncode == 0 else done.stderr.strip()[-500:]


def _second(one: Draw, folder: Path) -> Path:
    """The log of the sortie, flown by the aircraft of the first flight and what is hidden in it."""
    document = json.loads((folder / "suggest" / "suggest.json").read_text(encoding="utf-8"))
    (planned,) = scenarios.load(folder / "scenario.toml").flights
    runs = suggested.sortie(document, folder / "suggest")
    height = document["maneuvers"][0]["entry"]["height"]
    legs = tuple(suggested.legs(runs, height))
    flight = replace(
        planned.flight,
        legs=legs,
        start=scenarios.start(legs[0]),
        seed=one.seed + 1,
        epoch_us=planned.flight.epoch_us + LATER * 1_000_000,
    )
    log = folder / "second.tlog"
    record.run(flight, record=log)
    return log


def _kept(diagnosis: Mapping[str, Any]) -> dict[str, Any]:
    return {key: diagnosis[key] for key in campaign.KEPT if key in diagnosis}


def _row(pair: Pair, one: Draw, held: Mapping[str, Any]) -> tuple[object, ...]:
    last: Score = score.score(one, held["second"] or held["first"])
    second = "" if held["second"] is None else score.said(held["second"])
    return (
        load(pair.aircraft).name,
        pair.cause,
        pair.rival,
        score.said(held["first"]),
        held.get("refused") or held["asked"] or "",
        second,
        "yes" if last.alone else "in a group" if last.grouped else "no",
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.blind.pairs")
    parser.add_argument("--only", choices=sorted({one.cause for one in PAIRS}))
    parser.add_argument("--file", choices=FILES, default=USUAL)
    parser.add_argument("--seed", type=int, default=0, help="of all flights")
    parser.add_argument("--again", action="store_true", help="repeat what is finished")
    parser.add_argument("--save", action="store_true", help="keep the table for the README")
    parser.add_argument("--out", type=Path, default=Path("out/pairs"))
    return parser


if __name__ == "__main__":
    sys.exit(main())
