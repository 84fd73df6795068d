"""What a group is asked as, and that the second flight is of the same aircraft."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_sysid.sitl import record
from tests.benchmarks import suggested
from tests.blind import fly, pairs
from tests.blind.fly import Recorded
from tests.blind.pairs import PAIRS


def entry(cause: str, probability: float, **parameters: dict[str, Any]) -> dict[str, Any]:
    return {"causes": [cause], "probability": probability, "parameters": parameters}


def group(*ranking: dict[str, Any]) -> dict[str, Any]:
    causes = [one["causes"][0] for one in ranking]
    return {
        **{"verdict": "ambiguous", "indistinguishable": causes, "ranking": list(ranking)},
        "separate": "aero_derivative:Cm_alpha,cg_shift",
    }


SHIFT = entry("cg_shift", 0.5, cg_x_chord={"value": 0.05, "sd": 0.01})
SLOPE = entry(
    "aero_derivative", 0.3, ratio={"value": 1.2, "sd": 0.1, "derivative": "Cm.alpha"}
)  # fmt: skip


NOTHING = {
    **{"verdict": "no_effect", "effects": [], "indistinguishable": [], "separate": None},
    "ranking": [{"causes": ["none"], "probability": 0.9, "parameters": {}}],
}


@pytest.mark.parametrize(
    ("first", "asked"),
    [
        (group(SLOPE, SHIFT), "aero_derivative:Cm_alpha,cg_shift"),
        (NOTHING, "cg_shift,aero_derivative:Cm_alpha"),
    ],
)
def test_a_pair_is_diagnosed_flown_again_and_kept(
    first: dict[str, Any], asked: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both flights hide the same; the second is later, and what is finished is not flown again."""
    said: list[tuple[object, ...]] = []
    flown = []

    def diagnose(
        recorded: Recorded, folder: Path, *, more: tuple[Path, ...] = ()
    ) -> tuple[dict[str, Any], float]:
        named = {"verdict": "effect", "effects": ["cg_shift"], "ranking": [SHIFT]}
        return (named if more else first), 1.0

    def command(*arguments: object) -> subprocess.CompletedProcess[str]:
        said.append(arguments)
        folder = Path(str(arguments[-1]))
        if arguments[0] == "suggest":
            folder.mkdir()
            plan = {
                "maneuvers": [
                    {
                        "name": "one",
                        "entry": {"airspeed": 18.0, "height": 90.0},
                        "duration_s": 1.0,
                        "csv": "one.csv",
                    }
                ],
                "sortie": {"steps": [{"maneuver": "one", "share": 0.5}]},
            }
            (folder / "suggest.json").write_text(json.dumps(plan))
            rows = "\n".join(f"{0.02 * row:.2f},{2.0 if row % 2 else 0.0}" for row in range(51))
            (folder / "one.csv").write_text(f"t,elevator\n{rows}\n")
        return subprocess.CompletedProcess([], 0, "", "")

    def fly_first(one: pairs.Draw, folder: Path) -> Recorded:
        folder.mkdir(parents=True)
        generator = np.random.default_rng(0)
        true = fly.equipped(one)
        (folder / "aircraft.toml").write_text(
            fly.aircraft_file.dumps(fly.believed(true, one.file, generator))
        )
        (folder / "scenario.toml").write_text(fly.scenario(one, true, generator))
        return Recorded(folder / "flight.tlog", folder / "aircraft.toml", departed=False)

    monkeypatch.setattr(fly, "fly", fly_first)
    monkeypatch.setattr(fly, "diagnose", diagnose)
    monkeypatch.setattr(fly, "command", command)
    monkeypatch.setattr(record, "run", lambda flight, record: flown.append(flight))
    for _ in range(2):
        pairs.main(["--only", "cg_shift", "--out", str(tmp_path)])
    assert [words[0] for words in said] == ["identify", "suggest"]
    assert asked in said[1]
    (second,) = flown
    shifted = next(one for one in PAIRS if one.cause == "cg_shift").hidden["cg_x_chord"]
    moved = (second.flown.mass.cg[0] - second.believed.mass.cg[0]) / (
        second.believed.geometry.mean_chord
    )
    assert moved == pytest.approx(shifted)
    (leg,) = second.legs
    (sent,) = leg.inputs
    assert max(sent.values) == pytest.approx(np.radians(1.0)), "half of it, as the sortie says"
    (held,) = tmp_path.glob("*.json")
    assert json.loads(held.read_text())["second"]["verdict"] == "effect"


def test_legs_go_out_and_back_with_two_runs_on_each() -> None:
    one = suggested.Run(20.0, 2.0, {"elevator": np.ones(101), "rudder": np.zeros(101)})
    made = suggested.legs([one] * 3, 80.0)
    assert [leg.name for leg in made] == ["run", "run", "turn", "run"]
    assert made[0].heading != made[3].heading
    assert [test.control for test in made[0].inputs] == ["elevator"]
    assert made[0].duration == pytest.approx(suggested.SETTLE + 2.0 + suggested.AFTER)
