"""What the kinematic reconstruction leaves of error, beside what it says of itself."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.benchmarks import table  # noqa: E402 - found from ROOT
from tests.reconstruct import truth  # noqa: E402 - found from ROOT

DEGREES = {"alpha": "°", "beta": "°", "phi": "°", "theta": "°", "psi": "°"}
SHOWN = ("V", "alpha", "beta", "wind_north", "wind_east", "wind_down", "phi", "theta", "psi")


def flights() -> Iterator[tuple[str, Path, Path, Path]]:
    """Name, log, aircraft file and truth of every flight whose truth is known."""
    cases = ROOT.parent / "shared" / "cases"
    for folder in sorted(cases.iterdir()) if cases.is_dir() else ():
        if (folder / "truth.npz").is_file():
            yield (folder.name, folder / "flight.tlog", folder / "aircraft.toml",
                   folder / "truth.npz")  # fmt: skip
    for known in sorted((ROOT / "data" / "flights").glob("*_truth.npz")):
        log = known.with_name(known.name.replace("_truth.npz", ".tlog"))
        yield log.stem, log, ROOT / "data" / "aircraft" / "ultra_stick_25e.toml", known


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    rows = []
    for number, (name, *files) in enumerate(flights()):
        if number == 0:  # compiles, so that no flight's time holds that
            truth.compare(*files)
        found = truth.compare(*files)
        minutes = np.ptp(found.states.time) / 60.0
        for index, quantity in enumerate(SHOWN):
            factor = np.rad2deg(1.0) if quantity in DEGREES else 1.0
            rows.append(
                (
                    name if index == 0 else "",
                    f"{quantity} [{DEGREES.get(quantity, 'm/s')}]",
                    f"{factor * found.rms(quantity):.2f}",
                    f"{factor * found.stated(quantity):.2f}",
                    f"{100.0 * found.coverage(quantity):.0f} %",
                    f"{found.seconds / minutes:.1f}" if index == 0 else "",
                )
            )
    if not rows:
        print("reconstruction: no flight with known truth beside the checkout")
        return
    table.show(
        "reconstruction",
        "Kinematic reconstruction against truth (no vanes; the filter-error model is to better it)",
        ("flight", "quantity", "rms error", "its own sd", "within 2 sd (wanted: 95 %)",
         "s per minute flown"),
        rows,
    )  # fmt: skip


if __name__ == "__main__":
    main()
