"""Which causes are named in the flights of `replay/`, each with one thing hidden, in calm air.

Minutes a flight; what was diagnosed before is kept in `--out`, so that it can be stopped.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.benchmarks import table  # noqa: E402 - found from ROOT

REPLAY = ROOT / "replay"
AMONG = 3
"""A group of more than so many causes names nobody."""


def scenarios() -> dict[str, dict[str, Any]]:
    """Scenarios whose flights a simulation is held against, by name."""
    found = {}
    for path in sorted(REPLAY.glob("*/scenario.toml")):
        expected = tomllib.loads((path.parent / "expected.toml").read_text(encoding="utf-8"))
        if "diagnose" in expected:
            found[path.parent.name] = tomllib.loads(path.read_text(encoding="utf-8"))
    return found


def diagnosed(name: str, scenario: dict[str, Any], out: Path) -> dict[str, Any]:
    """What `diagnose` says of a scenario's first flight, its second taking no part."""
    kept = out / "diagnose" / "diagnosis.json"
    if not kept.exists():
        flights = out / "flights"
        _program("sitl", "--scenario", REPLAY / name / "scenario.toml", "--out", flights)
        aircraft = (REPLAY / name / scenario["aircraft"]).resolve()
        names = [item["name"] for item in scenario["flights"]]
        held = ["--holdout", flights / f"{names[1]}.tlog"] if len(names) > 1 else []
        log = flights / f"{names[0]}.tlog"
        _program("diagnose", log, "--aircraft", aircraft, *held, "--out", kept.parent)
    return json.loads(kept.read_text(encoding="utf-8"))


def _program(*arguments: object) -> None:
    words = [sys.executable, "-m", "gcs_sysid", *map(str, arguments)]
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)


def hidden(scenario: dict[str, Any]) -> tuple[str, ...]:
    """Effects that the scenario hides."""
    return tuple(effect["name"] for effect in scenario.get("effects", ()))


def judged(wanted: tuple[str, ...], found: dict[str, Any]) -> str:
    """Whether what was named is what was hidden."""
    if wanted in ((), ("unlisted",)):
        right = {(): "no_effect", ("unlisted",): "unlisted_effect"}[wanted]
        return "right" if found["verdict"] == right else "wrong"
    if found["verdict"] == "effect":
        return "right" if set(found["effects"]) == set(wanted) else "wrong"
    group = found["indistinguishable"]
    among = found["verdict"] == "ambiguous" and set(wanted) <= set(group)
    return "in a group" if among and len(group) <= AMONG else "not found"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", nargs="*")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "causes")
    parser.add_argument("--save", action="store_true")
    asked = parser.parse_args()
    rows, answers = [], []
    for name, scenario in scenarios().items():
        if asked.only and name not in asked.only:
            continue
        found = diagnosed(name, scenario, asked.out / name)
        wanted, best = hidden(scenario), found["ranking"][0]
        answers.append(judged(wanted, found))
        sizes = ", ".join(
            f"{key} {item['value']:.3g} ± {item['sd']:.2g}"
            for key, item in best["parameters"].items()
        )
        named = ", ".join(found["effects"]) or found["verdict"]
        share = f"{100.0 * best['probability']:.0f} %"
        rows.append((name, ", ".join(wanted) or "nothing", named, share, sizes, answers[-1]))
        print(*rows[-1], file=sys.stderr, flush=True)
    table.show(
        "causes",
        f"Named in four minutes of calm air with one thing hidden: {answers.count('right')} of "
        f"{len(answers)} right",
        ("flight", "hidden", "named", "probability of the best", "its size, one sd", ""),
        rows,
    )


if __name__ == "__main__":
    main()
