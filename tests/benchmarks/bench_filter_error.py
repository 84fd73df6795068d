"""Filter error against truth: flow angles, coefficients, intervals of derivatives, and time.

Without options the flight of known truth beside the checkout, its aerodynamics ignored. With
`--flights N` that many flights of our own simulator, each with its own gusts, wind and sensors;
long, so run it apart. Results of flights that were fitted before are kept in `--folder`.

`--told` is what the estimator is told of the aircraft: nothing of its aerodynamics; all of them
30 % too large or too small, each by lot, and so uncertain; or nothing, and a mass and inertias that
are wrong as well, and said to be: they are found with the rest. What a flight sees is C/m and C/I:
what is scored is C times true/found, and how far mass and inertias are off is told apart. Beside it
stands the bound of the same flight with mass and inertias held at the true ones, where the flight
was also fitted so (`--told ignored`).
With `--vanes` the aircraft has flow vanes. With `--together` so many flights are fitted at once.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid import aircraft_file, regressors  # noqa: E402 - found from ROOT
from gcs_sysid.aircraft import COEFFICIENTS, FORCES, MOMENTS, Aircraft  # noqa: E402
from gcs_sysid.cli import numerics  # noqa: E402
from gcs_sysid.estimate import basis, in_common  # noqa: E402
from gcs_sysid.estimate.file_prior import file_prior  # noqa: E402
from gcs_sysid.estimate.filter_error import Fit  # noqa: E402
from gcs_sysid.estimate.result import Prior  # noqa: E402
from gcs_sysid.offline import aided_fit, flight, maneuver_choice  # noqa: E402
from gcs_sysid.offline.aided_fit import AidedFlights, UnsettledError  # noqa: E402
from gcs_sysid.offline.flight import Flight  # noqa: E402
from gcs_sysid.sources.registry import open_recording  # noqa: E402
from tests.benchmarks import filter_error_tables  # noqa: E402

CASES = ROOT.parent / "shared" / "cases"
OWN = ROOT / "data" / "aircraft" / "aerosonde.toml"
SETTLED = 5.0
"""Seconds at both ends that are not scored."""
WRONG = 0.3
COARSE_MASS, COARSE_INERTIA = 1.08, 0.8
"""Assumed over true."""
COARSE_SIGMA = (0.1, 0.25)
"""One deviation of both, as the coarse file says, relative."""
WORDS = {
    "ignored": "aerodynamics ignored",
    "wrong": "aerodynamics wrong",
    "coarse": "aerodynamics ignored, mass and inertia coarse",
}
ASSUMED = {"mass": COARSE_MASS, **dict.fromkeys(("Ixx", "Iyy", "Izz"), COARSE_INERTIA)}
"""Of each part of the body, as the coarse file says, over true."""
PARTS = dict.fromkeys(FORCES, "mass") | dict(zip(MOMENTS, ("Ixx", "Iyy", "Izz"), strict=True))
"""What each coefficient is seen over."""
VANES = """
[vanes]
position = [0.9, 0.0, 0.0]
"""
Columns = dict[str, np.ndarray]


class Told(NamedTuple):
    """What the estimator is told: file and prior, and what it is to find itself.

    Attributes:
        aircraft: its file.
        prior: beliefs about its derivatives.
        body: whether mass and inertias are to be found.
    """

    aircraft: Aircraft
    prior: Mapping[str, Prior] | None
    body: bool = False


class Found(NamedTuple):
    """Derivatives found, each over what it is seen over where that is not known.

    Attributes:
        keys: coefficient and regressor of each.
        value: of each.
        covariance: of them.
        bound: Cramér–Rao of the same; NaN where it is not known.
        timing: one deviation of each by the lag of the moments alone; likewise.
        body: by part of the body: found over true, and one deviation.
    """

    keys: list[tuple[str, str]]
    value: np.ndarray
    covariance: np.ndarray
    bound: np.ndarray
    timing: np.ndarray
    body: dict[str, list[float]]


def found_by(known: AidedFlights, *, body: bool) -> Found:
    """What the filter found of all flights."""
    derivatives, count = known.derivatives, known.fits[0].bound.shape[0]
    keys, values, every = derivatives.keys, derivatives.value, derivatives.covariance
    if not body:
        bound = np.linalg.inv(sum(np.linalg.inv(each.bound) for each in known.fits))
        return Found(list(keys), values, every, bound, np.abs(derivatives.late), {})
    jacobian, scaled = np.zeros((count, values.size)), np.zeros(count)
    for row, (name, _) in enumerate(keys[:count]):
        part = keys.index((in_common.BODY, PARTS[name]))
        assumed = ASSUMED[PARTS[name]]
        over = assumed * (1.0 + values[part])
        scaled[row], jacobian[row, row] = values[row] / over, 1.0 / over
        jacobian[row, part] = -values[row] * assumed / over**2
    sizes = np.sqrt(np.diagonal(every))
    told_of = {}
    for part, assumed in ASSUMED.items():
        place = keys.index((in_common.BODY, part))
        told_of[part] = [assumed * (1.0 + values[place]), assumed * sizes[place]]
    unknown = np.full((count, count), np.nan)
    covariance = jacobian @ every @ jacobian.T
    return Found(list(keys[:count]), scaled, covariance, unknown, unknown[0], told_of)


def told(kind: str, aircraft: Aircraft, seed: int) -> Told:
    """The description of a kind; see above."""
    if kind == "ignored":
        return Told(aircraft, None)
    if kind == "coarse":
        mass, inertias = aircraft.mass, ("Ixx", "Iyy", "Izz", "Ixz", "Ixy", "Iyz")
        coarse = replace(
            mass,
            mass=COARSE_MASS * mass.mass,
            mass_sigma=COARSE_SIGMA[0],
            inertia_sigma=COARSE_SIGMA[1],
            **{name: COARSE_INERTIA * getattr(mass, name) for name in inertias},
        )
        return Told(replace(aircraft, mass=coarse), None, body=True)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], size=200).tolist()
    prior = {
        name: Prior(
            {key: value * (1.0 + WRONG * signs.pop()) for key, value in item.value.items()},
            {key: WRONG * abs(value) for key, value in item.value.items()},
        )
        for name, item in file_prior(aircraft).items()
    }
    return Told(aircraft, prior)


def known(folder: Path) -> Columns:
    """Truth by column, and `time` in seconds of the recording."""
    with np.load(folder / "truth.npz") as file:
        columns = {str(name): file["rows"][:, i] for i, name in enumerate(file["cols"])}
        begun = int(file["t0_us"])
    epoch = open_recording(folder / "flight.tlog").epoch_us
    return {**columns, "time": columns["t"] + (begun - epoch) * 1e-6}


def flow_errors(found: Flight, true: Columns) -> list[float]:
    """Error of angle of attack and sideslip, rms [deg]."""
    states = found.reconstruction
    time = states.time
    inside = (time > time[0] + SETTLED) & (time < time[-1] - SETTLED)
    return [
        float(
            np.rad2deg(
                np.sqrt(np.mean((each - np.interp(time, true["time"], true[name]))[inside] ** 2))
            )
        )
        for name, each in (("alpha", states.alpha), ("beta", states.beta))
    ]


def true_flow(aircraft: Aircraft, true: Columns) -> Columns:
    """True regressors of a flight."""
    shape, half = aircraft.geometry, 0.5 / true["V"]
    return {
        **{name: true[name] for name in ("alpha", "beta", "V", *aircraft.control_names)},
        "phat": true["p_air"] * shape.wing_span * half,
        "qhat": true["q_air"] * shape.mean_chord * half,
        "rhat": true["r_air"] * shape.wing_span * half,
        "1": np.ones_like(half),
    }


def model_errors(aircraft: Aircraft, found: Found, true: Columns) -> dict[str, dict[str, float]]:
    """100·std(model − true)/std(true) on another flight, and what the bound leaves of it.

    Args:
        aircraft: with its true aerodynamics.
        found: derivatives.
        true: columns of the other flight.
    """
    flow, out = true_flow(aircraft, true), {}
    for name in COEFFICIENTS:
        rows = [index for index, key in enumerate(found.keys) if key[0] == name]
        keys = tuple(found.keys[index][1] for index in rows)
        columns = basis.columns(keys, aircraft.control_names, flow)
        terms = aircraft.aerodynamics[name].terms
        modelled = columns @ found.value[rows]
        flew = basis.columns(tuple(terms), aircraft.control_names, flow) @ np.array(
            [item.value for item in terms.values()]
        )
        spread = float(np.std(flew))
        bound = found.bound[np.ix_(rows, rows)]
        least = np.trace(np.cov(columns.T, bias=True).reshape(len(rows), -1) @ bound)
        out[name] = {
            "error": 100.0 * float(np.std(modelled - flew)) / spread,
            "mean": 100.0 * float(np.mean(modelled - flew)) / spread,
            "bound": 100.0 * float(np.sqrt(least)) / spread,
        }
    return out


def read(log: Path, aircraft: Aircraft) -> Flight:
    """A flight as `identify` reads it."""
    return flight.read(
        log,
        aircraft,
        vehicle=None,
        segments=maneuver_choice.chooser(None, aircraft),
        delay=None,
        progress=lambda *_: None,
        measured=True,
    )


def scored(
    folders: Sequence[Path], other: Path, aircraft: Aircraft, known_of: Told, seed: int
) -> dict[str, Any]:
    """Fits flights, and compares with their true aircraft."""
    flights = [read(folder / "flight.tlog", known_of.aircraft) for folder in folders]
    structure = regressors.default_structure(aircraft)
    begun = clock.perf_counter()
    known_by = aided_fit.identify(
        *(flights, known_of.aircraft, structure, known_of.prior, (), lambda *_: None),
        body=known_of.body,
    )
    seconds = clock.perf_counter() - begun
    if known_by.unsettled:
        raise UnsettledError(known_by.unsettled)
    fit = known_by.fits[-1]
    found = found_by(known_by, body=known_of.body)
    flow = [
        flow_errors(one, known(folder))
        for one, folder in zip(known_by.flights, folders, strict=True)
    ]
    derivatives = {}
    for (name, key), value, size, least in zip(
        found.keys,
        found.value.tolist(),
        np.sqrt(np.diagonal(found.covariance)).tolist(),
        np.sqrt(np.diagonal(found.bound)).tolist(),
        strict=True,
    ):
        item = aircraft.aerodynamics[name].terms.get(key)
        flew = item.value if item is not None else 0.0
        derivatives[f"{name}_{key}"] = [value, size, flew, least]
    return {
        "seed": seed,
        "seconds": seconds,
        "cores": len(os.sched_getaffinity(0)),
        "flow": np.mean(flow, axis=0).tolist(),
        "coefficients": model_errors(aircraft, found, known(other)),
        "derivatives": derivatives,
        "timing": dict(zip(derivatives, found.timing.tolist(), strict=True)),
        "turning": turning(aircraft, fit),
        "body": found.body,
        "lacking": [
            [one.coefficient, one.key, one.evidence, one.share] for one in known_by.lacking
        ],
    }


def turning(aircraft: Aircraft, fit: Fit) -> dict[str, list[float]]:
    """How gusts turn the air: found, one deviation, and by MIL-F-8785C, each times the span."""
    span = aircraft.geometry.wing_span
    found, sure = (item.log_noise.turbulence.coupling for item in (fit.unknowns, fit.deviation))
    wanted = (np.pi / 4.0, np.pi / 3.0)
    return {
        axis: [span * abs(float(one)), span * float(size), spec]
        for axis, one, size, spec in zip(("across", "down"), found, sure, wanted, strict=True)
    }


def flown(folder: Path, seed: int, description: Path, *, gust: float | None = None) -> None:
    """Flies one of our own in wind and gusts of its own, or in these [m/s], unless it was flown."""
    if (folder / "truth.npz").exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    own = rng.uniform(1.2, 1.9)
    command = [sys.executable, "-m", "gcs_sysid", "sitl", "--aircraft", str(description)]
    command += ["--record", str(folder / "flight.tlog"), "--truth", str(folder / "truth.npz")]
    command += ["--seed", str(seed), "--gust", f"{own if gust is None else gust:.2f}"]
    command += ["--wind", f"{rng.uniform(0.0, 360.0):.0f}", f"{rng.uniform(2.0, 7.0):.1f}"]
    subprocess.run(command, check=True, capture_output=True)


def described(folder: Path, *, vanes: bool) -> Path:
    """The file of our own aircraft, with vanes or as it is."""
    if not vanes:
        return OWN
    path = folder / "aircraft.toml"
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(OWN.read_text() + VANES)
    return path


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--flights", type=int, default=0)
    parser.add_argument("--seed", type=int, default=7000, help="of the first flight")
    parser.add_argument("--told", choices=("ignored", "wrong", "coarse"), default="ignored")
    parser.add_argument("--vanes", action="store_true")
    parser.add_argument("--together", type=int, default=1, help="flights that are fitted at once")
    parser.add_argument("--folder", type=Path, default=ROOT / "out" / "filter_error")
    parser.add_argument("--save", action="store_true")
    asked = parser.parse_args()
    numerics.enable()
    numerics.keep_freed_memory()
    if asked.flights:
        _own(asked)
    elif CASES.is_dir():
        _shared(asked.told)
    else:
        print("filter error: no flights of known truth beside the checkout")


def _shared(kind: str) -> None:
    """The flight of known truth beside the checkout; told nothing, its tables have no suffix."""
    aircraft = aircraft_file.load(CASES / "clean" / "aircraft.toml")
    result = scored([CASES / "clean"], CASES / "clean_second", aircraft, told(kind, aircraft, 0), 0)
    filter_error_tables.shown(
        "filter_error" + ("" if kind == "ignored" else f"_clean_{kind}"),
        f"Filter error on clean, {WORDS[kind]}",
        [result],
        assumed=ASSUMED,
    )


def _own(asked: argparse.Namespace) -> None:
    """Flights of our own simulator, flown and fitted unless they were before."""
    base = asked.folder / "vanes" if asked.vanes else asked.folder
    description = described(base, vanes=asked.vanes)
    aircraft = aircraft_file.load(description)
    other = base / "other"
    flown(other, asked.seed - 1, description)
    results = []
    several = f"_{asked.together}_together" if asked.together > 1 else ""
    for seed in range(asked.seed, asked.seed + asked.flights, asked.together):
        folders = [base / str(seed + number) for number in range(asked.together)]
        for number, folder in enumerate(folders):
            flown(folder, seed + number, description)
        kept = folders[0] / f"{asked.told}{several}.json"
        if not kept.exists():
            known_of = told(asked.told, aircraft, seed)
            try:
                result = scored(folders, other, aircraft, known_of, seed)
            except UnsettledError as error:
                result = {"seed": seed, "unsettled": str(error)}
            kept.write_text(json.dumps(result))
        found = json.loads(kept.read_text())
        if asked.told == "coarse":
            found = with_bound_held(found, folders[0] / f"ignored{several}.json")
        results.append(found)
        print(f"flight {seed}: {found.get('seconds', 0.0):.0f} s", flush=True)
    name = f"filter_error_{asked.told}" + ("_vanes" if asked.vanes else "") + several
    words = f"{asked.flights} own flights" + (" with vanes" if asked.vanes else "")
    if several:
        words += f", {asked.together} fitted at once"
    filter_error_tables.shown(
        name,
        f"{words}, {WORDS[asked.told]}",
        results,
        at_once=asked.together,
        assumed=ASSUMED,
        bound="bound with mass and inertia known" if asked.told == "coarse" else "bound",
    )


def with_bound_held(result: dict[str, Any], known_body: Path) -> dict[str, Any]:
    """A fit that sought the body, with the bounds of the same flight fitted with the true one.

    What a flight sees is C/m and C/I, and it is these that are scored: a file that knows the body
    is the same question with the body held. Without such a fit bounds stay unknown.
    """
    if "unsettled" in result or not known_body.exists():
        return result
    held = json.loads(known_body.read_text())
    if "unsettled" in held:
        return result
    return {
        **result,
        "coefficients": {
            name: {**item, "bound": held["coefficients"][name]["bound"]}
            for name, item in result["coefficients"].items()
        },
        "derivatives": {
            key: [*item[:3], held["derivatives"][key][3]]
            for key, item in result["derivatives"].items()
        },
    }


if __name__ == "__main__":
    main()
