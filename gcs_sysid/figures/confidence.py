"""Where in the envelope each coefficient is known: cells of angle of attack and sideslip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gcs_sysid.figures.data import Axis, Figure, Panel, Role, Series

_KINDS: tuple[tuple[str, str, Role], ...] = (
    ("", "known", "predicted"),
    ("noisy data", "noisy data", "second"),
    ("no data", "no data", "limit"),
)
NAMED = 8
"""Derivatives that the caption names."""


def maps(summary: Mapping) -> tuple[Figure, ...]:
    """One panel a coefficient, of the summary's `confidence`; nothing where it has none."""
    found = summary.get("confidence")
    if not found:
        return ()
    alpha, beta = (np.degrees(np.asarray(found[name], dtype=float)) for name in ("alpha", "beta"))
    panels = tuple(
        _panel(name, entry, alpha, beta) for name, entry in found["coefficients"].items()
    )
    return (
        Figure(
            name="confidence",
            title="Where the coefficients are known",
            caption=_caption(found),
            x=Axis("angle of attack α", "deg", (float(alpha[0]), float(alpha[-1]))),
            panels=panels,
        ),
    )


def _panel(name: str, entry: Mapping, alpha: np.ndarray, beta: np.ndarray) -> Panel:
    middles = [0.5 * (edges[1:] + edges[:-1]) for edges in (alpha, beta)]
    across, along = np.meshgrid(*middles, indexing="ij")
    reason = np.asarray(entry["reason"])
    series = []
    for kind, words, role in _KINDS:
        cells = reason == kind
        if cells.any():
            style = "points" if kind else "cross"
            series.append(Series(words, across[cells], along[cells], role, style))
    return Panel(
        y=Axis(f"{name}: sideslip β", "deg", (float(beta[0]), float(beta[-1]))),
        series=tuple(series),
    )


def _caption(found: Mapping) -> str:
    """How to read it, and what is known least."""
    words = (
        "Each mark is a cell of the envelope, everything else as in trim. A coefficient is known "
        f"where one standard deviation is below {100.0 * float(found['level']):.0f} % of its "
        "spread in the flights."
    )
    whole = [one for one in found["low"] if one["derivative"] is None]
    if whole:
        worst = max(whole, key=lambda one: one["share_of_cells"])
        words += (
            f" Least is known of {worst['coefficient']}: {100.0 * worst['share_of_cells']:.0f} % "
            f"of the cells are low in confidence for {worst['reason']}."
        )
    else:
        words += " All of them are known throughout."
    return words + _slopes(found["low"])


def _slopes(low: Sequence[Mapping]) -> str:
    """Derivatives that are low in confidence somewhere, those in the most cells first."""
    share: dict[str, float] = {}
    for one in low:
        if one["derivative"] is not None:
            name = f"{one['coefficient']}_{one['derivative']}"
            share[name] = share.get(name, 0.0) + one["share_of_cells"]
    if not share:
        return " So are their derivatives."
    most = sorted(share, key=lambda name: -share[name])
    named = ", ".join(f"{name} ({100.0 * share[name]:.0f} %)" for name in most[:NAMED])
    rest = f" and {len(most) - NAMED} more" if len(most) > NAMED else ""
    return f" Derivatives low in confidence, by share of the cells: {named}{rest}."
