"""The published comparison's figure 5.11 drawn anew: a stretch of an unseen flight, foretold.

Measured coefficients as points, what really acted as a line, and with their 95 % bands what the
global part alone says and what it says together with the local part.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.figures.data import SIGMAS_95
from tests.benchmarks.thesis_data import Flight

LONGEST = 20.0
"""Of the stretch [s]."""
DRAWN = {
    "global only, zero mean": ("#fdae6b", "#a63603"),
    "combined, zero mean": ("#9ecae1", "#08519c"),
}
"""Colour of the band and of the line of each method."""
Method = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def draw(
    methods: Mapping[str, Method], flight: Flight, inputs: Sequence[str], begins: float, to: Path
) -> None:
    """Draws the stretch that begins so many seconds into a flight.

    Args:
        methods: mean and standard deviation of the six coefficients at inputs, by name.
        flight: that none of them has seen.
        inputs: names.
        begins: time in the flight [s].
        to: the picture; its suffix is the format.
    """
    time = flight.table["t"]
    rows = np.flatnonzero((time >= begins) & (time < begins + LONGEST))
    time, where = time[rows], flight.inputs(inputs)[rows]
    # Lines are not drawn over what lies between maneuvers.
    gaps = np.flatnonzero(np.diff(time) > 0.5) + 1
    mpl.rcParams |= {"svg.hashsalt": "gcs_sysid", "font.size": 9.0}
    figure, axes = plt.subplots(3, 2, figsize=(10.0, 7.5), sharex=True, layout="constrained")
    said = {name: methods[name](where) for name in DRAWN}
    for index, (name, panel) in enumerate(zip(COEFFICIENTS, axes.T.ravel(), strict=True)):
        measured, noise = flight.measured[rows, index], flight.noise[rows, index]
        # As a picture: thousands of points as text are megabytes.
        panel.plot(
            *(time, measured, "."), ms=2.0, color="#888888", label="measured", rasterized=True
        )
        for method, (band, line) in DRAWN.items():
            mean, deviation = (part[:, index] for part in said[method])
            half = SIGMAS_95 * np.hypot(deviation, noise)
            parts = (time, mean - half, mean + half, mean)
            t, low, high, middle = (np.insert(part, gaps, np.nan) for part in parts)
            panel.fill_between(t, low, high, color=band, alpha=0.45, lw=0)
            panel.plot(t, middle, color=line, lw=1.2, label=f"{method}, 95 % band")
        true = flight.true_values[rows, index]
        panel.plot(np.insert(time, gaps, np.nan), np.insert(true, gaps, np.nan), "k--", lw=0.8,
                   label="what acted")  # fmt: skip
        panel.set_ylabel(f"{name} [1]")
    for panel in axes[-1]:
        panel.set_xlabel("time [s]")
    shown = axes[0, 0].get_legend_handles_labels()
    figure.legend(*shown, loc="outside upper center", ncols=4, fontsize=8.0, frameon=False)
    to.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(to, dpi=110, metadata={"Date": None} if to.suffix == ".svg" else None)
    plt.close(figure)
