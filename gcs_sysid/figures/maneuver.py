"""A suggested maneuver: what is put in, and what the aircraft is expected to do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from gcs_sysid.figures.data import Axis, Band, Figure, Panel, Role, Rule, Series
from gcs_sysid.figures.reduce import limits
from gcs_sysid.figures.samples import Samples

DEGREES = float(np.degrees(1.0))
CHANNELS: Mapping[str, tuple[str, str, float, str]] = {
    "airspeed": ("airspeed V", "m/s", 1.0, "V"),
    "alpha": ("angle of attack α", "deg", DEGREES, "alpha"),
    "beta": ("sideslip β", "deg", DEGREES, "beta"),
    "load_factor": ("load factor", "g", 1.0, "load_factor"),
    "bank": ("bank φ", "deg", DEGREES, "phi"),
}
"""Label, unit for people, factor from SI, and the key of the document's limits."""
INPUTS: tuple[Role, ...] = ("first", "second")


def maneuver(
    table: Samples,
    number: int,
    entry: Mapping,
    allowed: Mapping[str, Sequence[float]] | None,
) -> Figure:
    """Inputs and expected motion of one maneuver.

    Args:
        table: of expected motions.
        number: of the maneuver in it.
        entry: the maneuver's document.
        allowed: limits of the envelope [m/s, rad, g].
    """
    rows = np.flatnonzero(np.asarray(table["maneuver"]) == number)
    time = np.asarray(table["t"], dtype=float)[rows]
    return Figure(
        name=f"maneuver-{entry['name'].replace(' ', '-')}",
        title=str(entry["name"]).replace("_", " "),
        caption="Input to add to trim and to what the autopilot commands; below, what the "
        "identified aircraft does with it and, as bands, all aircraft drawn from the model. "
        "Red lines: the envelope.",
        x=Axis("time", "s", (float(time[0]), float(time[-1]))),
        panels=(
            _inputs(table, rows, time, entry["controls"]),
            *(_motion(table, rows, time, name, allowed) for name in CHANNELS),
        ),
    )


def _inputs(
    table: Samples, rows: np.ndarray, time: Float[np.ndarray, " sample"], controls: Sequence[str]
) -> Panel:
    curves = [
        DEGREES * np.asarray(table[f"input_{place}"], dtype=float)[rows]
        for place in range(len(controls))
    ]
    return Panel(
        y=Axis("input", "deg", limits(*curves)),
        series=tuple(
            Series(name, time, curve, role)
            for name, curve, role in zip(controls, curves, INPUTS, strict=False)
        ),
        keyed=len(controls) > 1,
    )


def _motion(
    table: Samples,
    rows: np.ndarray,
    time: Float[np.ndarray, " sample"],
    name: str,
    allowed: Mapping[str, Sequence[float]] | None,
) -> Panel:
    label, unit, factor, key = CHANNELS[name]

    def of(column: str) -> Float[np.ndarray, " sample"]:
        return factor * np.asarray(table[column], dtype=float)[rows]

    mean, low, high = of(name), of(f"{name}_low"), of(f"{name}_high")
    bounds = [factor * value for value in (allowed or {}).get(key, ())]
    return Panel(
        y=Axis(label, unit, limits(low, high)),
        series=(Series("expected", time, mean, "predicted"),),
        bands=(Band("all drawn aircraft", time, low, high, "predicted"),),
        rules=tuple(Rule("y", value, "envelope", "limit") for value in bounds),
    )
