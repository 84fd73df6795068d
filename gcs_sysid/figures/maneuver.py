"""A suggested maneuver: what is put in, and what the aircraft is expected to do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from gcs_sysid.figures.data import Axis, Band, Figure, Panel, Role, Rule, Series
from gcs_sysid.figures.reduce import limits
from gcs_sysid.figures.samples import Samples

DEGREES = float(np.degrees(1.0))
CHANNELS: Mapping[str, tuple[str, str, float]] = {
    "airspeed": ("airspeed V", "m/s", 1.0),
    "alpha": ("angle of attack α", "deg", DEGREES),
    "beta": ("sideslip β", "deg", DEGREES),
    "load_factor": ("load factor", "g", 1.0),
    "bank": ("bank φ", "deg", DEGREES),
}
"""Label, unit for people and factor from SI."""
INPUTS: tuple[Role, ...] = ("first", "second", "third", "fourth")
THROTTLE = "throttle"


def maneuver(table: Samples, number: int, entry: Mapping) -> Figure:
    """Inputs and expected motion of one maneuver.

    Args:
        table: of expected motions.
        number: of the maneuver in it.
        entry: the maneuver's document, with where to `abort` [m/s, rad, g].
    """
    rows = np.flatnonzero(np.asarray(table["maneuver"]) == number)
    time = np.asarray(table["t"], dtype=float)[rows]
    return Figure(
        name=f"maneuver-{entry['name'].replace(' ', '-')}",
        title="Input and expected motion",
        caption="Input to add to trim and to what the autopilot commands; below, what the "
        "identified aircraft does in calm air and, as bands, all that were drawn from the model "
        "in the gusts reckoned with. Red lines: stop there.",
        x=Axis("time", "s", (float(time[0]), float(time[-1]))),
        panels=(
            *_inputs(table, rows, time, entry["controls"]),
            *(_motion(table, rows, time, name, entry["abort"]) for name in CHANNELS),
        ),
    )


_KNOWN: dict[str, tuple[str, Role]] = {
    "before": ("now", "measured"),
    "after": ("after the sortie", "predicted"),
    "stays": ("whatever is flown", "reference"),
}
"""Curves of a map of what is known, by the document's names."""


def confidence(name: str, entry: Mapping, level: float) -> Figure:
    """Deviation over variation of one coefficient along a flow angle, before and after.

    Args:
        name: of the coefficient.
        entry: its part of the document's map.
        level: of confidence that is asked for.
    """
    along = CHANNELS[entry["along"]][0]
    x = DEGREES * np.asarray(entry["x"], dtype=float)
    curves = {part: 100.0 * np.asarray(entry[part], dtype=float) for part in _KNOWN}
    rules = [Rule("y", 100.0 * level, "asked for", "limit")]
    aimed = ("region", entry["asked"]) if entry["asked"] else ("planned", entry.get("planned"))
    for words, pair in (("flown", entry["flown"]), aimed):
        for value, end in zip(pair or (), ("from", "to"), strict=False):
            at = DEGREES * value
            if x[0] < at < x[-1]:
                rules.append(Rule("x", at, f"{words} {end}"))
    return Figure(
        name=f"confidence-{name}",
        title=f"How well {name} is known",
        caption="One standard deviation over the coefficient's variation, everything else as in "
        "level flight. Outside of what was flown it says too little. Mass, inertia, thrust and the "
        "moments' lag leave unsure what no flight takes away. Marked as well: the region "
        "asked about, or how far the maneuvers planned for it go.",
        x=Axis(along, "deg", (float(x[0]), float(x[-1]))),
        panels=(
            Panel(
                y=Axis("sd over variation", "%", limits(*curves.values(), around=(0.0,))),
                series=tuple(
                    Series(words, x, curves[part], role) for part, (words, role) in _KNOWN.items()
                ),
                rules=tuple(rules),
            ),
        ),
        size="small",
    )


def _inputs(
    table: Samples, rows: np.ndarray, time: Float[np.ndarray, " sample"], controls: Sequence[str]
) -> tuple[Panel, ...]:
    """Deflections in one panel, the throttle in one of its own."""
    panels = []
    for unit, factor, chosen in (
        ("deg", DEGREES, [name for name in controls if name != THROTTLE]),
        ("%", 100.0, [name for name in controls if name == THROTTLE]),
    ):
        if not chosen:
            continue
        curves = [
            factor * np.asarray(table[f"input_{list(controls).index(name)}"], dtype=float)[rows]
            for name in chosen
        ]
        label = THROTTLE if unit == "%" else "input"
        panels.append(
            Panel(
                y=Axis(label, unit, limits(*curves)),
                series=tuple(
                    Series(name, time, curve, role)
                    for name, curve, role in zip(chosen, curves, INPUTS, strict=False)
                ),
                keyed=len(chosen) > 1,
            )
        )
    return tuple(panels)


def _motion(
    table: Samples,
    rows: np.ndarray,
    time: Float[np.ndarray, " sample"],
    name: str,
    stop: Mapping[str, Sequence[float]],
) -> Panel:
    label, unit, factor = CHANNELS[name]

    def of(column: str) -> Float[np.ndarray, " sample"]:
        return factor * np.asarray(table[column], dtype=float)[rows]

    mean, low, high = of(name), of(f"{name}_low"), of(f"{name}_high")
    bounds = [factor * value for value in stop.get(name, ())]
    return Panel(
        y=Axis(label, unit, limits(low, high)),
        series=(Series("expected", time, mean, "predicted"),),
        bands=(Band("all drawn aircraft", time, low, high, "predicted"),),
        rules=tuple(Rule("y", value, "stop", "limit") for value in bounds),
    )
