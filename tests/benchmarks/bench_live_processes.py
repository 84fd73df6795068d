"""What Gaussian processes learn beside a flight, judged on another one, and what they cost.

The first of the bundled flights goes through a station as `listen` has it, at so many times its
own speed; the second, of another wind and other gusts, only gives the flow at which both models are
asked. Truth is the polynomial that flew, at the flow of that second flight as the live filter has
it: a constant angle of attack or sideslip that the filter has wrong is in the mean difference.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path

if "NPROC" not in os.environ:
    # As the program runs.
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "NPROC": "1"}
    os.execv(sys.executable, [sys.executable, *sys.argv])

import numpy as np
import table

from gcs_sysid import aircraft_file, regressors
from gcs_sysid.aircraft import COEFFICIENTS, Aircraft
from gcs_sysid.cli import numerics
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.estimate.file_prior import file_prior
from gcs_sysid.live import envelope_map, processes, warming
from gcs_sysid.live.coefficients import KEPT
from gcs_sysid.live.station import Compiled, Station
from gcs_sysid.sources import tlog
from gcs_sysid.sources.stream import FrameStream

ROOT = Path(__file__).resolve().parents[2]
FLIGHTS = ROOT / "data" / "flights"
SPEED = 4.0
Z95 = 1.96
Values = dict[str, np.ndarray]


def main() -> None:
    numerics.enable()
    aircraft = aircraft_file.load(ROOT / "data" / "aircraft" / "ultra_stick_25e.toml")
    compiled = Compiled(aircraft)
    warming.warm(aircraft, compiled)
    other = _flow(_flown(aircraft, compiled, "demo_second", 0.0, believing=True)[1])
    true = _truth(aircraft, other)
    rows, costs = [], []
    for words, believing in (("the file", True), ("nothing", False)):
        station, _, cost = _flown(aircraft, compiled, "demo", SPEED, believing=believing)
        costs.append((words, *cost, station.processes.count))
        found = [_processes(station, part) for part in _parts(other)]
        learned = {
            name: tuple(np.concatenate([one[kind][name] for one in found]) for kind in range(3))
            for name in COEFFICIENTS
        }
        first = _first_model(station, other)
        for name in COEFFICIENTS:
            cells = [words, name]
            value, _, lack = learned[name]
            alone = np.mean(np.abs(value - true[name]) < Z95 * lack)
            for value, deviation in (learned[name][:2], first[name]):
                off, spread = value - true[name], np.std(true[name])
                hold = np.mean(np.abs(off) < Z95 * deviation)
                cells += [
                    f"{100 * np.std(off) / spread:.1f}",
                    f"{100 * np.mean(off) / spread:+.1f}",
                ]
                cells += [f"{100 * np.median(deviation) / spread:.1f}", f"{100 * hold:.0f} %"]
            rows.append((*cells, f"{100 * alone:.0f} %"))
    table.show(
        "live_processes",
        "Taught by one flight live, asked at another's flow: error (without and of its mean), one "
        "stated deviation in % of the coefficient's spread, and 95 % intervals that hold; of "
        "Gaussian processes, then of the first model; last those of the processes that hold where "
        "errors of flow and file are not counted as lasting",
        ("mean", "", *("error", "mean", "sd", "hold") * 2, "alone"),
        rows,
    )
    table.show(
        "live_processes_cost",
        f"The same, at {SPEED:.0f} times the flight's own speed: a message's whole cost",
        ("mean", "p50", "p99", "99.9 %", "samples"),
        costs,
    )


def _flown(
    aircraft: Aircraft, compiled: Compiled, name: str, speed: float, *, believing: bool
) -> tuple[Station, list[Samples], tuple[str, ...]]:
    """A station after a flight, its windows, and percentiles of a message's cost."""
    windows: list[Samples] = []

    def seen(one: object) -> None:
        if isinstance(one, Samples):
            windows.append(one)

    now = [0]
    station = Station(
        aircraft,
        compiled,
        prior=file_prior(aircraft) if believing else None,
        vehicle=None,
        clock_us=lambda: now[0],
        observer=seen,
    )
    stream, effort, begun = FrameStream(), [], time.perf_counter()
    frames = tlog.frames((FLIGHTS / f"{name}.tlog").read_bytes())
    for at, frame in frames:
        now[0] = at
        ahead = (at - frames[0][0]) * 1e-6 / max(speed, 1e-9) - (time.perf_counter() - begun)
        if speed and ahead > 0.0:
            time.sleep(ahead)
        before = time.perf_counter()
        station.receive(stream.feed(frame, at))
        station.work(2**62)
        effort.append(1e3 * (time.perf_counter() - before))
    station.processes.close()
    most = np.percentile(effort, (50.0, 99.0, 99.9))
    return station, windows, tuple(f"{one:.1f} ms" for one in most)


def _flow(windows: list[Samples]) -> Values:
    names = windows[0].regressors
    return {
        name: np.concatenate([np.asarray(one.regressors[name])[KEPT] for one in windows])
        for name in names
    }


def _parts(values: Values) -> list[Values]:
    count, step = next(iter(values.values())).size, processes.AT_ONCE
    return [
        {name: value[first : first + step] for name, value in values.items()}
        for first in range(0, count, step)
    ]


def _processes(station: Station, values: Values) -> tuple[Values, Values, Values]:
    found = station.processes.at(values)
    assert found is not None, station.processes.phase
    return dict(found.value), dict(found.deviation), dict(found.lack)


def _first_model(station: Station, values: Values) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    controls = station.aircraft.control_names
    solved = station.model.solutions()
    spread = envelope_map.of_first_model(solved, controls)(values)
    return {
        name: (
            _polynomial(dict(zip(one.keys, one.value, strict=True)), controls, values),
            spread[name],
        )
        for name, one in solved.items()
    }


def _truth(aircraft: Aircraft, values: Values) -> Values:
    flew = json.loads((FLIGHTS / "demo_truth.json").read_text())["flown"]["aerodynamics"]
    out = {}
    for name in COEFFICIENTS:
        terms = {key: one.value for key, one in aircraft.aerodynamics[name].terms.items()}
        out[name] = _polynomial({**terms, **flew.get(name, {})}, aircraft.control_names, values)
    return out


def _polynomial(terms: dict[str, float], controls: tuple[str, ...], values: Values) -> np.ndarray:
    total = np.zeros_like(next(iter(values.values())))
    for key, value in terms.items():
        total += float(value) * regressors.evaluate(
            regressors.parse(key, controls=controls), values
        )
    return total


if __name__ == "__main__":
    main()
