"""A simulation beside the measured flight: every channel over time, window by window."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from gcs_sysid.figures.data import SIGMAS_95, Axis, Band, Figure, Panel, Series
from gcs_sysid.figures.reduce import extreme_indices, limits
from gcs_sysid.figures.samples import Samples

DEGREES = float(np.degrees(1.0))
CHANNELS: Mapping[str, tuple[str, str, float]] = {
    "V": ("airspeed V", "m/s", 1.0),
    "alpha": ("angle of attack α", "deg", DEGREES),
    "beta": ("sideslip β", "deg", DEGREES),
    "p": ("roll rate p", "deg/s", DEGREES),
    "q": ("pitch rate q", "deg/s", DEGREES),
    "r": ("yaw rate r", "deg/s", DEGREES),
    "phi": ("bank φ", "deg", DEGREES),
    "theta": ("pitch θ", "deg", DEGREES),
}
"""Label, unit for people, and factor from SI."""


def history(table: Samples, *, bins: int) -> Figure:
    """All channels over a flight.

    Args:
        table: of simulated windows, in the order of time.
        bins: bins that each curve is reduced to.
    """
    window = np.asarray(table["window"])
    # A row that is no number after each window keeps lines from running into the next.
    breaks = np.flatnonzero(np.diff(window)) + 1
    time = np.insert(np.asarray(table["t"], dtype=float), breaks, table["t"][breaks])
    return Figure(
        name="simulation",
        title="Measured and simulated",
        caption="Each window begins with the measured state and then flies on the measured "
        "controls alone. Bands: what the aircraft file's sigmas and the state at the beginning "
        "leave open, 95 %.",
        x=Axis("time since the log started", "s", (float(time[0]), float(time[-1]))),
        panels=tuple(_panel(table, name, time, breaks, bins) for name in CHANNELS),
        link="simulation",
    )


def _panel(
    table: Samples, name: str, time: Float[np.ndarray, " sample"], breaks: np.ndarray, bins: int
) -> Panel:
    label, unit, factor = CHANNELS[name]

    def broken(column: str) -> Float[np.ndarray, " sample"]:
        return np.insert(factor * np.asarray(table[column], dtype=float), breaks, np.nan)

    measured, simulated = broken(f"{name}_measured"), broken(name)
    spread = SIGMAS_95 * broken(f"{name}_sd")
    lower, upper = simulated - spread, simulated + spread
    kept = extreme_indices((measured, simulated, lower, upper), bins=bins)
    return Panel(
        y=Axis(label, unit, limits(measured, simulated)),
        series=(
            Series("measured", time[kept], measured[kept], "measured"),
            Series("simulated", time[kept], simulated[kept], "predicted"),
        ),
        bands=(Band("simulated, 95 %", time[kept], lower[kept], upper[kept], "predicted"),),
    )
