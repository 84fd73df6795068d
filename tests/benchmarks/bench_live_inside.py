"""The aerodynamics inside the filter beside the flight, against truth: gusts, no vanes.

Flights of `bench_filter_error.py --told wrong`: an Aerosonde of our own simulator whose file has
every derivative 30 % too large or too small, by lot, and says so. Each goes through a station as
`listen` has it, the filter in the same process: the minute that is fitted is fitted at once, which
live takes a minute or two more. Judged on another of these flights, at the air that the aircraft
felt. Mass and inertia are as the file has them, which it is told to be sure of: intervals are those
of what a flight tells. Minutes a flight; results are kept in out/live_inside.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time as clock
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
if "NPROC" not in os.environ:
    # As the program runs.
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "NPROC": "1"}
    os.execv(sys.executable, [sys.executable, *sys.argv])
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402 - found from ROOT, computed as the program does

from gcs_sysid import aircraft_file, regressors  # noqa: E402
from gcs_sysid.aircraft import FORCES, MOMENTS, Aircraft  # noqa: E402
from gcs_sysid.cli import numerics  # noqa: E402
from gcs_sysid.live import inside_fit, warming  # noqa: E402
from gcs_sysid.live.inside import Inside  # noqa: E402
from gcs_sysid.live.inside_fit import Found, Task  # noqa: E402
from gcs_sysid.live.inside_known import Known  # noqa: E402
from gcs_sysid.live.regression import Solution, TermEstimate  # noqa: E402
from gcs_sysid.live.station import Compiled, Station  # noqa: E402
from gcs_sysid.sources import tlog  # noqa: E402
from gcs_sysid.sources.stream import FrameStream  # noqa: E402
from tests.benchmarks import table  # noqa: E402
from tests.benchmarks.bench_filter_error import OWN, Columns, flown, known, told, true_flow  # noqa: E402

FIRST = 7003
"""Seed of the first flight, as there; by those before it `inside.AGEING_S` was chosen."""
OTHER = 7099
"""On which all are judged."""
WITHIN = 1.96
SCORED = ("after a minute", "at the end", "first model")
Terms = Mapping[str, Mapping[str, TermEstimate]]


def errors(aircraft: Aircraft, found: Terms, true: Columns) -> dict[str, float]:
    """100·std(model − true)/std(true) on another flight, forces and moments each in the mean."""
    flow, each = true_flow(aircraft, true), {}
    for name, terms in found.items():
        modelled = sum(
            term.value
            * regressors.evaluate(regressors.parse(key, controls=aircraft.control_names), flow)
            for key, term in terms.items()
        )
        each[name] = 100.0 * float(np.std(modelled - true[name]) / np.std(true[name]))
    return {
        "forces": float(np.mean([each[name] for name in FORCES])),
        "moments": float(np.mean([each[name] for name in MOMENTS])),
    }


def normalised(aircraft: Aircraft, found: Terms) -> list[float]:
    """Errors of the derivatives in their deviations."""
    return [
        (term.value - getattr(aircraft.aerodynamics[name].terms.get(key), "value", 0.0))
        / term.deviation
        for name, terms in found.items()
        for key, term in terms.items()
    ]


def _terms(found: Mapping[str, Solution]) -> Terms:
    return {name: one.terms() for name, one in found.items()}


def listened(folder: Path, seed: int, aircraft: Aircraft, compiled: Compiled) -> dict[str, Any]:
    """One flight through a station."""
    flown(folder, seed, OWN)
    true, fits = known(folder), []
    sure = replace(aircraft, mass=replace(aircraft.mass, mass_sigma=0.0, inertia_sigma=0.0))
    believed = told("wrong", sure, seed)

    def fit(task: Task) -> Found | None:
        fits.append(inside_fit.fitted(task))
        return fits[-1]

    now = [0]
    station = Station(
        believed.aircraft,
        compiled,
        prior=believed.prior,
        vehicle=None,
        clock_us=lambda: now[0],
        inside=Inside(believed.aircraft, believed.prior, fit=fit),
    )
    stream, second, flow, begun, used = FrameStream(), 0.0, [], {}, 0.0
    for time_us, frame in tlog.frames((folder / "flight.tlog").read_bytes()):
        now[0] = time_us
        before, count = clock.process_time(), len(fits)
        station.receive(stream.feed(frame, time_us))
        station.work(time_us + 10**9)
        if len(fits) == count:
            used += clock.process_time() - before
        inside = station.inside.known if time_us * 1e-6 > second else Known()
        newest = inside.newest
        if newest is None:
            continue
        second = time_us * 1e-6 + 1.0
        begun = begun or _terms(inside.derivatives)
        at = newest.time + (station.rows.epoch_us or 0) * 1e-6
        kinematic = station.newest.flow if station.newest is not None else np.full(3, np.nan)
        flow.append([newest.time, at, *newest.flow, *newest.deviation, *kinematic])
    rows = np.array(flow)
    right = np.stack(
        [np.interp(rows[:, 0], true["time"], true[name]) for name in ("V", "alpha", "beta")], axis=1
    )
    off, plain = rows[:, 2:5] - right, rows[:, 8:11] - right
    last = station.inside.known
    ended = _terms(last.derivatives)
    terms = dict(zip(SCORED, (begun, ended, station.model.estimates()), strict=True))
    return {
        "seed": seed,
        "fits": len(fits),
        "fit_s": [None if one is None else one.seconds for one in fits],
        "lost": last.lost,
        "core": used / float(rows[-1, 0]),
        "flow": np.sqrt(np.mean(off**2, axis=0)).tolist(),
        "kinematic": np.sqrt(np.mean(plain**2, axis=0)).tolist(),
        "held": np.mean(np.abs(off) < WITHIN * rows[:, 5:8], axis=0).tolist(),
        "terms": {
            words: {
                name: {key: [one.value, one.deviation] for key, one in each.items()}
                for name, each in found.items()
            }
            for words, found in terms.items()
        },
    }


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--flights", type=int, default=3)
    parser.add_argument("--first", type=int, default=FIRST, help="seed of the first flight")
    parser.add_argument("--folder", type=Path, default=ROOT / "out" / "live_inside")
    parser.add_argument("--save", action="store_true")
    asked = parser.parse_args()
    numerics.enable()
    aircraft = aircraft_file.load(OWN)
    compiled = Compiled(aircraft)
    warming.warm(aircraft, compiled)
    flown(asked.folder / str(OTHER), OTHER, OWN)
    other, results = known(asked.folder / str(OTHER)), []
    for number in range(asked.flights):
        folder = asked.folder / str(asked.first + number)
        path = folder / "result.json"
        if not path.exists():
            found = listened(folder, asked.first + number, aircraft, compiled)
            path.write_text(json.dumps(found))
        results.append(json.loads(path.read_text()))
        print(f"flight {number + 1} of {asked.flights}", flush=True)
    rows = []
    for words in SCORED:
        each = [
            {
                name: {key: TermEstimate(*pair) for key, pair in terms.items()}
                for name, terms in one["terms"][words].items()
            }
            for one in results
        ]
        off = [errors(aircraft, one, other) for one in each]
        z = np.array([part for one in each for part in normalised(aircraft, one)])
        rows.append(
            (
                words,
                *(f"{np.mean([one[kind] for one in off]):.1f} %" for kind in ("forces", "moments")),
                f"{max(max(one.values()) for one in off):.1f} %",
                f"{100 * np.mean(np.abs(z) < WITHIN):.0f} %",
                f"{np.sqrt(np.mean(z**2)):.2f}",
            )
        )
    table.show(
        "live_inside",
        f"Derivatives beside the flight, in gusts without vanes, told a file 30 % wrong: error on "
        f"another flight, {len(results)} flights of four minutes",
        ("", "forces", "moments", "worst", "95 % intervals hold", "(found − true)/sd, rms"),
        rows,
    )
    flow = [
        (
            words,
            *(
                f"{scale * np.sqrt(np.mean([one[kind][axis] ** 2 for one in results])):.2f}"
                for axis, scale in enumerate((1.0, 180.0 / np.pi, 180.0 / np.pi))
            ),
            held,
        )
        for words, kind, held in (
            (
                "inside the filter",
                "flow",
                " / ".join(
                    f"{100 * np.mean([one['held'][axis] for one in results]):.0f} %"
                    for axis in range(3)
                ),
            ),
            ("kinematics alone", "kinematic", ""),
        )
    ]
    table.show(
        "live_inside_flow",
        "Airspeed and flow angles beside these flights, rms error, from when the minute is fitted",
        ("", "airspeed [m/s]", "angle of attack [°]", "sideslip [°]", "95 % intervals hold"),
        flow,
    )
    print(
        f"of one core {100 * np.mean([one['core'] for one in results]):.0f} %, a fit took "
        f"{np.mean([part for one in results for part in one['fit_s'] if part]):.0f} s, "
        f"{sum(one['fits'] for one in results)} fits, lost {sum(one['lost'] for one in results)}"
    )


if __name__ == "__main__":
    main()
