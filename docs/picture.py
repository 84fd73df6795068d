"""Draws the README's picture: `python docs/picture.py RUN` with the folder `identify` wrote.

Left: a coefficient on maneuvers held out of the fit, measured and predicted. Right: derivatives
with their intervals beside the aircraft file's values.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pyarrow.parquet as parquet
from matplotlib import pyplot as plt

PICTURE = Path(__file__).with_name("picture.svg")
COEFFICIENT = "Cm"
SHOWN = (
    ("CZ", "alpha"), ("CY", "beta"), ("Cl", "beta"), ("Cl", "phat"), ("Cl", "aileron"),
    ("Cm", "alpha"), ("Cm", "qhat"), ("Cm", "elevator"), ("Cn", "beta"), ("Cn", "rudder"),
)  # fmt: skip
INTERVAL = 1.96  # sds on either side that hold 95 % of a normal distribution
LONGEST = 30.0  # s of flight in the left panel


def draw(run: Path, to: Path = PICTURE) -> None:
    """Draws a run of `identify`."""
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    columns = parquet.read_table(run / "samples.parquet")
    samples = {name: columns[name].to_numpy() for name in columns.column_names}
    mpl.rcParams |= {"svg.hashsalt": "gcs_sysid", "font.size": 9.0}
    figure, (history, intervals) = plt.subplots(
        1, 2, figsize=(9.0, 3.4), width_ratios=(3, 2), layout="constrained"
    )
    _history(history, samples)
    _intervals(intervals, summary)
    figure.savefig(to, metadata={"Date": None})


def _history(axes: plt.Axes, samples: Mapping[str, np.ndarray]) -> None:
    """Held-out maneuvers end to end: what was measured, and the prediction with its band."""
    rows = np.flatnonzero(samples["held_out"])
    step = np.median(np.diff(samples["t"]))
    rows = rows[: int(LONGEST / step)]
    time = np.arange(rows.size) * step
    joints = time[1:][np.diff(rows) > 1]
    mean, sd = samples[COEFFICIENT][rows], samples[f"{COEFFICIENT}_sd"][rows]
    measured, noise = (samples[f"{COEFFICIENT}_measured{end}"][rows] for end in ("", "_sd"))
    half = INTERVAL * np.hypot(sd, noise)
    axes.fill_between(time, mean - half, mean + half, color="#9ecae1", lw=0, label="95 % band")
    axes.plot(time, measured, color="#444444", lw=0.7, label="measured")
    axes.plot(time, mean, color="#08519c", lw=1.2, label="predicted")
    for joint in joints:
        axes.axvline(joint, color="#bbbbbb", lw=0.6, ls=":")
    axes.set(
        xlabel="time in maneuvers held out of the fit [s]", ylabel=COEFFICIENT, xlim=(0.0, time[-1])
    )
    axes.legend(loc="upper right", ncols=3, frameon=False)


def _intervals(axes: plt.Axes, summary: Mapping) -> None:
    """Derivatives over the file's values: 1 means that flight and file agree."""
    found = summary["derivatives"]
    entries = [
        (f"{coefficient}_{name}", found[coefficient][name])
        for coefficient, name in SHOWN
        if found.get(coefficient, {}).get(name, {}).get("file")
    ]
    for row, (_, entry) in enumerate(entries):
        value, half = entry["value"] / entry["file"], INTERVAL * entry["sd"] / abs(entry["file"])
        axes.errorbar(value, row, xerr=half, fmt="o", ms=4, color="#08519c", capsize=2, lw=1)
    axes.axvline(1.0, color="#444444", lw=0.8)
    axes.set_yticks(range(len(entries)), [name for name, _ in entries])
    axes.invert_yaxis()
    axes.set(xlabel="derivative over aircraft file's, 95 % interval", xlim=(-0.5, 2.5))


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
