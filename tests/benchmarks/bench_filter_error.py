"""Filter error against truth: flow angles, coefficients, intervals of derivatives, and time.

Without options the flight of known truth beside the checkout, its aerodynamics ignored. With
`--flights N` that many flights of our own simulator, each with its own gusts, wind and sensors;
long, so run it apart. Results of flights that were fitted before are kept in `--folder`.

`--told` is what the estimator is told of the aircraft: nothing of its aerodynamics; all of them
30 % too large or too small, each by lot, and so uncertain; or nothing, and a mass and inertias that
are wrong as well, and said to be: they are found with the rest. What a flight sees is C/m and C/I:
what is scored is C times true/found, and how far mass and inertias are off is told apart.
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
from gcs_sysid.estimate.filter_error import Fit  # noqa: E402
from gcs_sysid.estimate.result import Prior  # noqa: E402
from gcs_sysid.offline import aided_fit, flight, maneuver_choice  # noqa: E402
from gcs_sysid.offline.aided_fit import UnsettledError  # noqa: E402
from gcs_sysid.offline.flight import Flight  # noqa: E402
from gcs_sysid.offline.identify import file_prior  # noqa: E402
from gcs_sysid.sources.registry import open_recording  # noqa: E402
from tests.benchmarks import table  # noqa: E402

CASES = ROOT.parent / "shared" / "cases"
OWN = ROOT / "data" / "aircraft" / "aerosonde.toml"
SETTLED = 5.0
"""Seconds at both ends that are not scored."""
Z95 = 1.96
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


def found_by(fits: Sequence[Fit], *, body: bool) -> Found:
    """What fits of flights that follow each other found."""
    fit = fits[-1]
    values, count = in_common.values(fit.unknowns.means), fit.bound.shape[0]
    keys = list(fit.keys[:count])
    if not body:
        bound = np.linalg.inv(sum(np.linalg.inv(each.bound) for each in fits))
        return Found(keys, values, fit.covariance, bound, fit.timing, {})
    jacobian, scaled = np.zeros((count, values.size)), np.zeros(count)
    for row, (name, _) in enumerate(keys):
        part = fit.keys.index((in_common.BODY, PARTS[name]))
        assumed = COARSE_MASS if name in FORCES else COARSE_INERTIA
        over = assumed * (1.0 + values[part])
        scaled[row], jacobian[row, row] = values[row] / over, 1.0 / over
        jacobian[row, part] = -values[row] * assumed / over**2
    sizes = np.sqrt(np.diagonal(fit.covariance))
    told_of = {}
    for part in dict.fromkeys(PARTS.values()):
        assumed = COARSE_MASS if part == "mass" else COARSE_INERTIA
        place = fit.keys.index((in_common.BODY, part))
        told_of[part] = [assumed * (1.0 + values[place]), assumed * sizes[place]]
    covariance = jacobian @ fit.covariance @ jacobian.T
    unknown = np.full_like(fit.bound, np.nan)
    return Found(keys, scaled, covariance, unknown, unknown[0], told_of)


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


def scored(
    folders: Sequence[Path], other: Path, aircraft: Aircraft, known_of: Told, seed: int
) -> dict[str, Any]:
    """Fits flights, and compares with their true aircraft."""
    flights = [
        flight.read(
            folder / "flight.tlog",
            known_of.aircraft,
            vehicle=None,
            segments=maneuver_choice.chooser(None, known_of.aircraft),
            delay=None,
            progress=lambda *_: None,
            measured=True,
        )
        for folder in folders
    ]
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
    found = found_by(known_by.fits, body=known_of.body)
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


def shown(name: str, title: str, every: Sequence[dict[str, Any]], *, at_once: int = 1) -> None:
    """Prints errors beside bounds, flow angles, and how many intervals hold.

    Each result is of so many flights `at_once`.

    What a mean is off is told apart, rms over the flights: a constant of the angle of attack and a
    constant vertical wind are one freedom.
    """
    results = [result for result in every if "unsettled" not in result]
    rows = []
    for coefficient in COEFFICIENTS:
        each = [result["coefficients"][coefficient] for result in results]
        error, bound = (np.mean([item[key] for item in each]) for key in ("error", "bound"))
        off = np.sqrt(np.mean([item["mean"] ** 2 for item in each]))
        rows.append(
            (coefficient, f"{error:.1f}", _known(bound), _known(error / bound), f"{off:.1f}")
        )
    for words, names in (("forces", FORCES), ("moments", MOMENTS)):
        error, bound = (
            np.mean([r["coefficients"][c][key] for r in results for c in names])
            for key in ("error", "bound")
        )
        rows.append((words, f"{error:.1f}", _known(bound), _known(error / bound), ""))
    table.show(
        f"{name}_models",
        f"{title}: error on another flight in % of the spread, beside the Cramér–Rao bound",
        ("", "error", "bound", "ratio", "mean off"),
        rows,
    )
    off = {
        key: np.array(
            [
                (r["derivatives"][key][0] - r["derivatives"][key][2]) / r["derivatives"][key][1]
                for r in results
            ]
        )
        for key in results[0]["derivatives"]
    }

    timed = [result for result in results if "timing" in result]

    def wider(of: Sequence[dict[str, Any]], *, without_lag: bool) -> dict[str, float]:
        """Stated deviation over the bound of each derivative, median of flights."""
        shares: dict[str, list[float]] = {key: [np.nan] for key in off}
        for result in of:
            for key, (_, size, _, least) in result["derivatives"].items():
                late = result["timing"][key] if without_lag else 0.0
                shares[key].append(np.sqrt(size**2 - late**2) / least)
        return {key: float(np.nanmedian(each)) for key, each in shares.items()}

    over = wider(results, without_lag=False), wider(timed, without_lag=True)
    pooled = np.concatenate(list(off.values()))
    alpha, beta = np.mean([result["flow"] for result in results], axis=0)
    fewest, at = min((float(np.mean(np.abs(z) < Z95)), key) for key, z in off.items())
    cores = sorted({result["cores"] for result in results})
    table.show(
        f"{name}_intervals",
        f"{title}: flow angles, intervals and time",
        (
            "flights",
            "with a number",
            "alpha [°]",
            "beta [°]",
            "95 % intervals that hold",
            "fewest",
            f"s a fit, cores: {', '.join(map(str, cores))}",
        ),
        [
            (
                at_once * len(every),
                at_once * len(results),
                f"{alpha:.2f}",
                f"{beta:.2f}",
                f"{100.0 * np.mean(np.abs(pooled) < Z95):.0f} %",
                f"{100.0 * fewest:.0f} % ({at})",
                f"{np.median([result['seconds'] for result in results]):.0f}",
            )
        ],
    )
    table.show(
        f"{name}_gusts",
        f"{title}: rotation of the air by passing gusts, times the span, about the axis",
        ("axis", "found", "sd", "MIL-F-8785C"),
        [
            (
                axis,
                *(
                    f"{np.mean([r['turning'][axis][part] for r in results]):.3f}"
                    for part in (0, 1, 2)
                ),
            )
            for axis in results[0]["turning"]
        ],
    )
    table.show(
        f"{name}_derivatives",
        f"{title}: mean and spread of (found − true)/sd, share within 95 %, sd over the bound; "
        f"and that without a millisecond of the moments' lag, {len(timed)} flights",
        ("derivative", "mean", "spread", "hold", "sd", "without lag"),
        [
            *(
                (
                    key,
                    f"{z.mean():+.2f}",
                    f"{z.std():.2f}",
                    f"{100.0 * np.mean(np.abs(z) < Z95):.0f} %",
                    *(_known(part[key], 2) for part in over),
                )
                for key, z in off.items()
            ),
            ("largest", "", "", "", *(_known(max(part.values()), 2) for part in over)),
        ],
    )
    asked = [result["lacking"] for result in results if "lacking" in result]
    if asked:
        shares = [share for each in asked for *_, share in each]
        table.show(
            f"{name}_lacking",
            f"{title}: terms asked for of which the aircraft has none",
            ("flights", "where a term was asked for", "the largest would move"),
            [
                (
                    len(asked),
                    sum(bool(each) for each in asked),
                    f"{100.0 * max(shares, default=0.0):.0f} %",
                )
            ],
        )
    if results[0].get("body"):
        table.show(
            f"{name}_body",
            f"{title}: mass and inertias over true ones, mean of the flights",
            ("part", "told", "found", "spread", "sd"),
            [
                (
                    part,
                    f"{COARSE_MASS if part == 'mass' else COARSE_INERTIA:.2f}",
                    *(f"{number:.3f}" for number in (each[:, 0].mean(), each[:, 0].std())),
                    f"{each[:, 1].mean():.3f}",
                )
                for part in results[0]["body"]
                for each in [np.array([result["body"][part] for result in results])]
            ],
        )


def _known(number: float, digits: int = 1) -> str:
    return f"{number:.{digits}f}" if np.isfinite(number) else "–"


def flown(folder: Path, seed: int, description: Path) -> None:
    """Flies one of our own, unless it was flown before."""
    if (folder / "truth.npz").exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    command = [sys.executable, "-m", "gcs_sysid", "sitl", "--aircraft", str(description)]
    command += ["--record", str(folder / "flight.tlog"), "--truth", str(folder / "truth.npz")]
    command += ["--seed", str(seed), "--gust", f"{rng.uniform(1.2, 1.9):.2f}"]
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
    if not asked.flights:
        if not CASES.is_dir():
            print("filter error: no flights of known truth beside the checkout")
            return
        aircraft = aircraft_file.load(CASES / "clean" / "aircraft.toml")
        known_of = told(asked.told, aircraft, 0)
        result = scored([CASES / "clean"], CASES / "clean_second", aircraft, known_of, 0)
        shown("filter_error", f"Filter error on clean, {WORDS[asked.told]}", [result])
        return
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
        results.append(json.loads(kept.read_text()))
        print(f"flight {seed}: {results[-1].get('seconds', 0.0):.0f} s", flush=True)
    name = f"filter_error_{asked.told}" + ("_vanes" if asked.vanes else "") + several
    words = f"{asked.flights} own flights" + (" with vanes" if asked.vanes else "")
    if several:
        words += f", {asked.together} fitted at once"
    shown(name, f"{words}, {WORDS[asked.told]}", results, at_once=asked.together)


if __name__ == "__main__":
    main()
