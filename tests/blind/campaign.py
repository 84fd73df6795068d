"""Many blind flights, one file a draw: what is finished is not repeated.

    python -m tests.blind.campaign --count 200 --start 0 [--cause none] [--file exact] [--size half]
    python -m tests.blind.campaign --dozen
    python -m tests.blind.campaign --every

Draws are numbered; the same number is the same flight on any machine, so that a campaign may be cut
in parts and done in any order. Tables are of all draws asked for. What another version of the
program has said is not known for it: give a changed one a folder of its own, or `--again`.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tests.blind import fly, tables
from tests.blind.draw import AIRCRAFT, FILES, SIZES, Draw, Fixed, draw
from tests.blind.score import score
from tests.blind.sizes import CAUSES
from tests.blind.tables import Result

KEPT = (
    *("verdict", "cause", "probability", "ranking", "indistinguishable", "separating_maneuver"),
    *(
        "separate",
        "effects",
        "unlisted",
        "discrepancy",
        "gain",
        "detectable",
        "warnings",
        "timing",
        "message",
    ),
)
"""What of a diagnosis a campaign keeps."""

DOZEN = (
    *(Fixed("none", name, "exact") for name in ("aerosonde", "skywalker_x8")),
    Fixed("none", "ultra_stick_25e", "five_percent"),
    Fixed("mass", "aerosonde", "exact", "larger"),
    Fixed("cg_shift", "brumby_mk3", "exact", "larger"),
    Fixed("inertia", "ultra_stick_25e", "exact", "larger"),
    Fixed("airspeed_scale", "skywalker_x8", "exact", "larger"),
    Fixed("actuator_lag", "aerosonde", "exact", "larger"),
    Fixed("surface_effectiveness", "skywalker_x8", "five_percent", "larger"),
    Fixed("thrust_scale", "brumby_mk3", "exact", "larger"),
    Fixed("unlisted", "aerosonde", "exact", "larger"),
    Fixed("two", "aerosonde", "exact", "larger"),
)
"""The flights of `make blind`."""

EVERY = tuple(
    Fixed(cause, AIRCRAFT[index % len(AIRCRAFT)], "exact", "larger")
    for index, cause in enumerate(CAUSES)
)
"""Every cause once, at a size that nobody should miss."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly, diagnose and print; 1 where the dozen misses what is wanted of it."""
    asked = _parser().parse_args(arguments)
    if asked.dozen or asked.every:
        listed = DOZEN if asked.dozen else EVERY
        draws = [draw(i, seed=asked.seed, fixed=fixed) for i, fixed in enumerate(listed)]
    else:
        fixed = Fixed(asked.cause, asked.aircraft, asked.file, asked.size, short=asked.short)
        span = range(asked.start, asked.start + asked.count)
        draws = [draw(i, seed=asked.seed, fixed=fixed) for i in span]
    results = list(run(draws, asked.out, again=asked.again, bound=asked.bound, keep=asked.keep))
    flights = which(asked)
    if asked.dozen or asked.every:
        tables.one_by_one(results, flights)
    tables.right(results, flights)
    if not asked.dozen or asked.bound:
        tables.summary(results, flights)
    missed = tables.missed(results) if asked.dozen else ()
    for words in missed:
        sys.stderr.write(f"missed: {words}\n")
    return 1 if missed else 0


def which(asked: argparse.Namespace) -> tables.Flights:
    """What the tables are called: all that was asked for is part of it."""
    seed = [f"seed {asked.seed}"] if asked.seed else []
    if asked.dozen and not seed:
        return tables.DOZEN
    if asked.dozen or asked.every:
        parts = ["dozen" if asked.dozen else "every", *seed]
    else:
        fixed = [asked.cause, asked.aircraft, asked.file, asked.size]
        parts = [part for part in fixed if part] + (["short"] if asked.short else [])
        parts += [f"draws {asked.start} to {asked.start + asked.count - 1}", *seed]
    return tables.Flights("_" + "_".join(parts).replace(" ", "_"), ", ".join(parts))


def run(
    draws: Sequence[Draw],
    out: Path,
    *,
    again: bool = False,
    bound: bool = False,
    keep: bool = False,
) -> Iterator[Result]:
    """Results of draws in their order; what `out` holds is not flown, unless `again`.

    With `bound` each flight is diagnosed once more, with the file that knows everything; `keep`
    leaves the flights beside their results.
    """
    out.mkdir(parents=True, exist_ok=True)
    for number, one in enumerate(draws, start=1):
        kept = out / f"{name(one)}.json"
        held = None if again else read(kept, one)
        if held is None:
            folder = out / f"{kept.stem}.flight"
            try:
                held = _flown(one, folder, bound=bound)
            finally:
                if not keep:
                    shutil.rmtree(folder, ignore_errors=True)
            write(kept, held)
        result = _result(one, held)
        hidden = " + ".join(sorted(one.causes)) or "none"
        sys.stderr.write(f"{number}/{len(draws)}  {kept.stem}: {hidden} -> {result.score.said}\n")
        yield result


def name(one: Draw) -> str:
    """File name of a draw: what was fixed is part of it."""
    short = "-short" if one.short else ""
    return f"{one.index:05d}-{one.cause}-{one.aircraft}-{one.file}-{one.size}{short}"


def _result(one: Draw, held: dict[str, Any]) -> Result:
    diagnosis = held["diagnosis"]
    return Result(
        draw=one,
        score=score(one, diagnosis),
        seconds=held["seconds"],
        cores=held["cores"],
        departed=held["departed"],
        error=(diagnosis.get("gain") or {}).get("holdout_error_after"),
        least_error=held["least_error"],
    )


def _flown(one: Draw, folder: Path, *, bound: bool) -> dict[str, Any]:
    """A draw's document."""
    recorded = fly.fly(one, folder)
    diagnosis: dict[str, Any] = {"verdict": "not flown"}
    seconds, least = 0.0, None
    if not recorded.departed:
        diagnosis, seconds = fly.diagnose(recorded, folder / "diagnosis")
        least = fly.least_error(recorded, folder / "informed") if bound else None
    return {
        "draw": asdict(one),
        "departed": recorded.departed,
        "seconds": seconds,
        "cores": len(os.sched_getaffinity(0)),
        "least_error": least,
        "diagnosis": {key: diagnosis[key] for key in KEPT if key in diagnosis},
    }


def read(path: Path, one: Draw) -> dict[str, Any] | None:
    """What is held of a draw, unless it was another one then."""
    if not path.exists():
        return None
    held = json.loads(path.read_text(encoding="utf-8"))
    return held if held["draw"] == json.loads(json.dumps(asdict(one))) else None


def write(path: Path, document: dict[str, Any]) -> None:
    """At once, so that an interrupted campaign leaves no half of a file."""
    part = path.with_suffix(".part")
    part.write_text(json.dumps(document, indent=1), encoding="utf-8")
    part.replace(path)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.blind.campaign")
    parser.add_argument("--count", type=int, default=48, help="how many draws")
    parser.add_argument("--start", type=int, default=0, help="number of the first")
    parser.add_argument("--seed", type=int, default=0, help="of all draws")
    parser.add_argument("--cause", choices=(*CAUSES, "none", "unlisted", "two"))
    parser.add_argument("--aircraft", choices=AIRCRAFT)
    parser.add_argument("--file", choices=FILES)
    parser.add_argument("--size", choices=SIZES)
    parser.add_argument("--short", action="store_true", help="flights of a minute and a half")
    parser.add_argument("--dozen", action="store_true", help="the fixed flights of `make blind`")
    parser.add_argument("--every", action="store_true", help="every cause once, one line each")
    parser.add_argument(
        "--bound", action="store_true", help="also what the file that knows everything reaches"
    )
    parser.add_argument("--again", action="store_true", help="repeat what is finished")
    parser.add_argument("--keep", action="store_true", help="leave the flights there too")
    parser.add_argument("--save", action="store_true", help="keep the tables for the README")
    parser.add_argument("--out", type=Path, default=Path("out/campaign"))
    return parser


if __name__ == "__main__":
    sys.exit(main())
