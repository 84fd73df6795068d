"""What intervals of least squares hold in gusts that nobody measured, with and without a file.

Flights of our own simulator, four airframes, in light and in strong gusts and without vanes; the
truth is in the aircraft file that flew. Derivatives are taken from the flight alone, and with a
file believed that is 5 % wrong in every value and says so. A control that answers gusts, and an
aircraft that turns into them, make errors go with what has none: see decision 0021.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid import aircraft_file, regressors  # noqa: E402 - needs the path above
from gcs_sysid.aircraft import Aircraft  # noqa: E402
from gcs_sysid.cli import numerics  # noqa: E402
from gcs_sysid.estimate import equation_error  # noqa: E402
from gcs_sysid.estimate.result import AeroModel, Prior  # noqa: E402
from tests.benchmarks import table  # noqa: E402
from tests.benchmarks.bench_filter_error import flown, read  # noqa: E402

AIRFRAMES = ("aerosonde", "brumby_mk3", "skywalker_x8", "ultra_stick_25e")
GUSTS = (0.02, 0.06)
"""One standard deviation over the airspeed at which an airframe cruises."""
SEEDS = range(8200, 8203)
WRONG = 0.05
INTERVAL = 1.96


def main() -> None:
    """Flies what was not flown before, and counts."""
    numerics.enable()
    folder, rows = ROOT / "out" / "intervals_in_gusts", []
    for gust in GUSTS:
        for name in AIRFRAMES:
            path = ROOT / "data" / "aircraft" / f"{name}.toml"
            aircraft = aircraft_file.load(path)
            cruise = float(np.mean(aircraft.envelope.airspeed))
            off: dict[str, list[float]] = {"alone": [], "file": []}
            for seed in SEEDS:
                where = folder / f"{name}-{gust}-{seed}"
                flown(where, seed, path, gust=gust * cruise)
                for kind, model in fitted(where, aircraft).items():
                    off[kind] += deviations(model, aircraft)
            rows.append((name, f"{gust * cruise:.1f}", len(SEEDS), *counted(off)))
    table.show(
        "intervals_in_gusts",
        "Least squares in gusts, no vanes: 95 % intervals of derivatives that hold the truth",
        (
            *("airframe", "gusts [m/s]", "flights"),
            *("flight alone: hold", "farthest [sd]"),
            *("with a file 5 % wrong: hold", "farthest with it [sd]"),
        ),
        rows,
    )


def fitted(folder: Path, aircraft: Aircraft) -> dict[str, AeroModel]:
    """The models of one flight: of it alone, and with a file believed."""
    one = read(folder / "flight.tlog", aircraft)
    structure = regressors.default_structure(aircraft)
    asked = ([one.samples], aircraft, structure, [one.pieces()])
    return {
        "alone": equation_error.fit(*asked),
        "file": equation_error.fit(*asked, prior=believed(aircraft, folder.name)),
    }


def believed(aircraft: Aircraft, name: str) -> dict[str, Prior]:
    """A file that is wrong in every value, each flight's otherwise, and says by how much."""
    generator = np.random.default_rng(list(name.encode()))
    return {
        name: Prior(
            {
                key: item.value * (1.0 + WRONG * float(generator.standard_normal()))
                for key, item in model.terms.items()
            },
            {key: WRONG * max(abs(item.value), 1e-6) for key, item in model.terms.items()},
        )
        for name, model in aircraft.aerodynamics.items()
    }


def deviations(model: AeroModel, aircraft: Aircraft) -> list[float]:
    """By how many of its deviations each derivative is off of the one that flew."""
    out = []
    for name, fit in model.fits.items():
        true = aircraft.aerodynamics[name].terms
        sizes = np.sqrt(np.diagonal(fit.covariance))
        for key, value, size in zip(fit.keys, fit.value, sizes, strict=True):
            if key != "1":
                flew = true[key].value if key in true else 0.0
                out.append(float(abs(value - flew) / size))
    return out


def counted(off: dict[str, list[float]]) -> list[str]:
    """Share that hold, and the farthest, of each kind."""
    cells = []
    for each in off.values():
        held = 100.0 * float(np.mean(np.array(each) < INTERVAL))
        cells += [f"{held:.0f} %", f"{max(each):.1f}"]
    return cells


if __name__ == "__main__":
    main()
