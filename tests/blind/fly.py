"""Flies a draw to a recording and has it diagnosed, both by the program and as a stranger would.

What is hidden goes to the simulated aircraft in a scenario file; `diagnose` is given the recording
and the aircraft file, and nothing else.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft, CoefficientModel, Value, Vanes
from gcs_sysid.sitl.plan import Leg
from tests.blind import plans
from tests.blind.draw import Draw, load
from tests.blind.informed import informed

WRONG = 0.05
"""Sigma of the errors of a file that is wrong, relative."""

DEFAULT_SIGMA = 0.1
"""What an aircraft file means that says nothing of its own."""

PATIENCE = 1800.0
"""How long a command may take before it counts as failed [s]: ten times what is wanted of it."""

_NOISE = {
    "accelerometer": 0.12,
    "attitude": 0.0003,
    "attitude_drift": 0.006,
    "heading_drift": 0.009,
    "dynamic_pressure": 8.0,
    "static_pressure": 1.0,
    "velocity": 0.08,
    "velocity_drift": 0.0,
    "position_drift": 0.5,
}
_UPSET = {"phi": math.radians(85.0), "beta": math.radians(35.0), "alpha": math.radians(30.0)}
"""Angles beyond which control was lost [rad]."""

_SPEEDS = (0.65, 1.25)
"""Shares of the envelope's lowest and highest airspeed beyond which it was lost as well."""


@dataclass(frozen=True)
class Recorded:
    """A flown draw.

    Attributes:
        log: its recording.
        aircraft: the file to be tested.
        departed: whether it came to grief.
        informed: the file that knows everything, where there can be one.
    """

    log: Path
    aircraft: Path
    departed: bool
    informed: Path | None = None


def fly(draw: Draw, folder: Path) -> Recorded:
    """Fly a draw; everything is left in `folder`, the truth too."""
    folder.mkdir(parents=True, exist_ok=True)
    generator = np.random.default_rng([draw.seed, 1])
    true = equipped(draw)
    (folder / "aircraft.toml").write_text(
        aircraft_file.dumps(believed(true, draw.file, generator)), encoding="utf-8"
    )
    (folder / "scenario.toml").write_text(scenario(draw, true, generator), encoding="utf-8")
    run("sitl", "--scenario", folder / "scenario.toml", "--out", folder)
    told = informed(folder / "scenario.toml")
    if told is not None:
        aircraft_file.save(told, folder / "informed.toml")
    return Recorded(
        log=folder / "flight.tlog",
        aircraft=folder / "aircraft.toml",
        departed=_departed(folder, true),
        informed=None if told is None else folder / "informed.toml",
    )


def diagnose(
    recorded: Recorded, folder: Path, *, more: Sequence[Path] = ()
) -> tuple[dict[str, Any], float]:
    """The diagnosis of a recording and of `more` of the aircraft, and the seconds that it took.

    A command that fails gives the verdict `failed` and its message.
    """
    begun = time.monotonic()
    asked = ("diagnose", recorded.log, *more, "--aircraft", recorded.aircraft, "--out", folder)
    try:
        done = command(*asked)
    except subprocess.TimeoutExpired:
        return {"verdict": "failed", "message": f"no answer in {PATIENCE:.0f} s"}, PATIENCE
    seconds = time.monotonic() - begun
    if done.returncode != 0:
        return {"verdict": "failed", "message": done.stderr.strip()[-500:]}, seconds
    return json.loads((folder / "diagnosis.json").read_text(encoding="utf-8")), seconds


def equipped(draw: Draw) -> Aircraft:
    """The true aircraft of a draw but for what is hidden; its vanes, if any, sit at the pitot."""
    true = load(draw.aircraft)
    return replace(true, vanes=Vanes(position=true.pitot.position)) if draw.vanes else true


def least_error(recorded: Recorded, folder: Path) -> float | None:
    """Error on what took no part of the file that knows everything."""
    if recorded.informed is None:
        return None
    diagnosis, _ = diagnose(replace(recorded, aircraft=recorded.informed), folder)
    gain = diagnosis.get("gain") or {}
    return gain.get("holdout_error_before")


def believed(true: Aircraft, file: str, generator: np.random.Generator) -> Aircraft:
    """The aircraft file that is tested: the truth, or 5 % wrong in every value and saying so."""
    exact = file == "exact"

    def value(old: Value) -> Value:
        error = generator.normal(0.0, WRONG)
        found = old.value if exact else (1.0 + error) * old.value
        return Value(found, (DEFAULT_SIGMA if exact else WRONG) * abs(found))

    def model(old: CoefficientModel) -> CoefficientModel:
        return replace(old, terms={key: value(term) for key, term in old.terms.items()})

    found = {name: model(old) for name, old in true.aerodynamics.items()}
    return replace(true, aerodynamics=found)


def scenario(draw: Draw, true: Aircraft, generator: np.random.Generator) -> str:
    """The scenario's text: what flies, what is hidden, small ordinary biases, wind and noise."""
    legs = plans.legs(true, draw.plan, short=draw.short)
    low = draw.plan == "low"
    # Near the ground height must be known to a part of the span, and gusts be survived.
    gust = draw.gust * plans.airspeeds(true)[1] * (0.5 if low else 1.0)
    noise = _NOISE | ({"position_drift": 0.03 * true.geometry.wing_span} if low else {})
    document: dict[str, Any] = {
        "schema": 1,
        "name": f"blind {draw.index}",
        "aircraft": "aircraft.toml",
        "flown": {
            "imu": {
                "gyro": {"bias": _biases(0.15, generator)},
                "accelerometer": {"bias": _biases(0.05, generator)},
            },
            "aerodynamics": {
                name: {key: term.value for key, term in model.terms.items()}
                for name, model in true.aerodynamics.items()
            },
        },
        "effects": list(draw.effects),
        "flights": [
            {
                "name": "flight",
                "record": "flight.tlog",
                "truth": "truth.npz",
                "seed": draw.seed,
                "wind": {
                    "from": round(float(generator.uniform(0.0, 360.0)), 1),
                    "speed": round(0.15 * plans.airspeeds(true)[1], 2),
                    "gust": gust,
                },
                "noise": noise,
                "legs": [_leg(leg) for leg in legs],
            }
        ],
    }
    flight = document["flights"][0]
    lines = [f"{key} = {_toml(value)}" for key, value in document.items() if key != "flights"]
    lines += ["", "[[flights]]", "begins = 2026-10-06T09:00:00Z"]
    lines += [f"{key} = {_toml(value)}" for key, value in flight.items()]
    return "\n".join(lines) + "\n"


def _biases(sigma: float, generator: np.random.Generator) -> list[float]:
    """Ordinary biases of a sensor's axes, none beyond two sigma."""
    return np.clip(generator.normal(0.0, sigma, 3), -2.0 * sigma, 2.0 * sigma).tolist()


def _leg(leg: Leg) -> dict[str, Any]:
    inputs = []
    for test in leg.inputs:
        entry = asdict(test)
        del entry["values"]
        if test.kind != "multisine":
            del entry["lines"]
        entry["amplitude_deg"] = math.degrees(entry.pop("amplitude"))
        inputs.append(entry)
    angles = {key: math.degrees(getattr(leg, key)) for key in ("heading", "bank")}
    return {**asdict(leg), **angles, "inputs": inputs}


def _toml(value: Any) -> str:
    """A value as TOML on one line."""
    if isinstance(value, Mapping):
        entries = (f"{json.dumps(key)} = {_toml(one)}" for key, one in value.items())
        return "{ " + ", ".join(entries) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml(one) for one in value) + "]"
    return json.dumps(value)


def _departed(folder: Path, aircraft: Aircraft) -> bool:
    """Whether the aircraft was lost control of: then nobody asks what is wrong with its file."""
    with np.load(folder / "truth.npz") as truth:
        columns = [str(name) for name in truth["cols"]]
        rows = truth["rows"]
    largest = {name: np.abs(rows[:, columns.index(name)]).max() for name in _UPSET}
    upset = any(largest[name] > limit for name, limit in _UPSET.items())
    airspeed = rows[:, columns.index("V")]
    low, high = aircraft.envelope.airspeed if aircraft.envelope else (0.0, math.inf)
    slow, fast = airspeed.min() < _SPEEDS[0] * low, airspeed.max() > _SPEEDS[1] * high
    return bool(upset or slow or fast)


def command(*arguments: object) -> subprocess.CompletedProcess[str]:
    """The program as its users start it, and what it said."""
    return subprocess.run(
        [sys.executable, "-m", "gcs_sysid", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE,
    )


def run(*arguments: object) -> None:
    """The same, of what must not fail."""
    done = command(*arguments)
    if done.returncode != 0:
        raise RuntimeError(f"{arguments[0]} failed: {done.stderr.strip()[-500:]}")
