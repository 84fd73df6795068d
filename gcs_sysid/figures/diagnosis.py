"""What a diagnosis shows: residuals before and after the cause, and how probable each cause is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.figures.coefficients import TIME
from gcs_sysid.figures.data import Axis, Figure, Panel, Series, Span
from gcs_sysid.figures.reduce import broken_at_holes, extreme_indices, limits
from gcs_sysid.figures.samples import Samples, column

_AVERAGED = 0.2
"""Residuals are shown as running means over this [s]: noise would hide what is off."""


def residuals(
    table: Samples,
    *,
    flight: int,
    spans: tuple[Span, ...],
    changed: bool,
    bins: int,
    source: str = "",
) -> Figure:
    """Measured less predicted over one flight, before and after the cause is put right.

    The difference of the two is the cause's signature: what it explains of the residual.

    Args:
        table: of residuals.
        flight: its number.
        spans: its maneuvers.
        changed: whether a cause was named, so that there is an after.
        bins: bins that each curve is reduced to.
        source: which flight it is, where there are several.
    """
    rows = np.flatnonzero(np.asarray(table["flight"]) == flight)
    time = column(table, "t")[rows]
    names = [
        name for name in COEFFICIENTS if np.isfinite(column(table, f"{name}_before")[rows]).any()
    ]
    return Figure(
        name=f"residuals-{flight}",
        title="Measured less predicted" + (f": {source}" if source else ""),
        caption="What the simulation leaves of each coefficient, running means over "
        f"{_AVERAGED:.1f} s"
        + (
            ", what is left once the cause is put right, and the cause's signature: what that "
            "takes away."
            if changed
            else "."
        ),
        x=Axis(TIME, "s", (float(time[0]), float(time[-1]))),
        panels=tuple(_panel(table, rows, time, name, changed, bins) for name in names),
        spans=spans,
        link=f"flight-{flight}",
    )


def _panel(
    table: Samples, rows: np.ndarray, time: np.ndarray, name: str, changed: bool, bins: int
) -> Panel:
    wide = max(1, round(_AVERAGED / float(np.median(np.diff(time)))))
    kernel = np.ones(wide) / wide
    shown: dict[str, np.ndarray] = {}
    for label in ("before", "after") if changed else ("before",):
        shown[label] = np.convolve(column(table, f"{name}_{label}")[rows], kernel, mode="same")
    if changed:
        shown["signature"] = shown["before"] - shown["after"]
    when, curves = broken_at_holes(time, tuple(shown.values()))
    kept = extreme_indices(curves, bins=bins)
    roles = {"before": "measured", "after": "predicted", "signature": "third"}
    return Panel(
        y=Axis(name, "1", limits(*curves, around=(0.0,))),
        series=tuple(
            Series(label, when[kept], curve[kept], roles[label])  # ty: ignore[invalid-argument-type]
            for label, curve in zip(shown, curves, strict=True)
        ),
    )


def probabilities(ranking: Sequence[Mapping], labels: Sequence[str]) -> Figure:
    """How probable each set of causes is, the first on top.

    Args:
        ranking: entries of the document, most probable first.
        labels: of them.
    """
    places = np.arange(1.0, len(ranking) + 1.0)
    values = np.array([float(item["probability"]) for item in ranking])
    return Figure(
        name="probabilities",
        title="Probability of each explanation",
        caption="The most probable first.",
        x=Axis("probability", "1", (0.0, 1.0)),
        panels=(
            Panel(
                y=Axis("explanation", "1", (len(ranking) + 0.6, 0.4), tuple(labels)),
                series=(Series("probability", values, places, "predicted", style="rows"),),
            ),
        ),
        size="small",
    )
