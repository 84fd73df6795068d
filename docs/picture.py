"""Draws the README's picture: `python docs/picture.py RUN TRUTH`.

RUN is the folder that `identify` wrote, TRUTH the record of what flew beside the bundled flight.
Left: a coefficient on maneuvers held out of the fit, measured and predicted. Right: derivatives
with their intervals, over the aircraft file's values, and what really flew.
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


def draw(run: Path, truth: Path, to: Path = PICTURE) -> None:
    """Draws a run of `identify` on a flight whose truth is known."""
    flown = json.loads(truth.read_text(encoding="utf-8"))["flown"]["aerodynamics"]
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    columns = parquet.read_table(run / "samples.parquet")
    samples = {name: columns[name].to_numpy() for name in columns.column_names}
    mpl.rcParams |= {"svg.hashsalt": "gcs_sysid", "font.size": 9.0}
    figure, (history, intervals) = plt.subplots(
        1, 2, figsize=(9.0, 3.4), width_ratios=(3, 2), layout="constrained"
    )
    _history(history, samples)
    _intervals(intervals, summary, flown)
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


def _intervals(axes: plt.Axes, summary: Mapping, flown: Mapping) -> None:
    """Derivatives over the file's values: 1 means that flight and file agree."""
    found = summary["derivatives"]
    entries = [
        (coefficient, name, found[coefficient][name])
        for coefficient, name in SHOWN
        if found.get(coefficient, {}).get(name, {}).get("file")
    ]
    rows = np.arange(len(entries))
    file = np.array([entry["file"] for _, _, entry in entries])
    value = np.array([entry["value"] for _, _, entry in entries]) / file
    half = INTERVAL * np.array([entry["sd"] for _, _, entry in entries]) / np.abs(file)
    truth = [flown.get(c, {}).get(name, entry["file"]) for c, name, entry in entries] / file
    axes.errorbar(
        value, rows, xerr=half, fmt="o", ms=4, color="#08519c", capsize=2, lw=1, label="found"
    )
    axes.plot(truth, rows, "x", color="#d94801", ms=6, label="flown")
    axes.axvline(1.0, color="#444444", lw=0.8)
    axes.set_yticks(rows, [f"{coefficient}_{name}" for coefficient, name, _ in entries])
    axes.invert_yaxis()
    axes.set(xlabel="derivative over aircraft file's, 95 % interval", xlim=(0.0, 2.0))
    axes.legend(loc="upper right", frameon=False)


if __name__ == "__main__":
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
