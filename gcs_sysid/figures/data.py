"""What a figure shows, without how it is drawn.

Every axis says its unit, every curve its role. A role is what a thing means (measured, predicted,
held out of the fit); the drawing side gives it a colour for light and dark paper.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

SIGMAS_95 = 1.959964
"""Half width of a central 95 % interval of a normal distribution, in standard deviations."""

Role = Literal[
    "measured",
    "predicted",
    "file",
    "fitted",
    "held_out",
    "first",
    "second",
    "third",
    "fourth",
    "reference",
    "limit",
]
Style = Literal["line", "dashes", "points", "cross", "bars", "rows"]
"""Bars stand on the x axis, rows lie along it from the y axis."""


@dataclass(frozen=True)
class Axis:
    """A quantity on an axis: its name, its unit ("1" for a ratio) and the range to show.

    Attributes:
        label: name of the quantity.
        unit: of it.
        limits: range to show; the larger first to turn the axis round.
        names: what stands at 1, 2, … where the axis has things on it and not a quantity.
    """

    label: str
    unit: str
    limits: tuple[float, float]
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Series:
    """One curve or cloud; NaN in `y` breaks the line."""

    name: str
    x: Float[np.ndarray, " point"]
    y: Float[np.ndarray, " point"]
    role: Role
    style: Style = "line"


@dataclass(frozen=True)
class Band:
    """An interval along x; NaN in `lower` and `upper` breaks it."""

    name: str
    x: Float[np.ndarray, " point"]
    lower: Float[np.ndarray, " point"]
    upper: Float[np.ndarray, " point"]
    role: Role


@dataclass(frozen=True)
class Span:
    """A named stretch of the x axis, for instance a maneuver."""

    name: str
    start: float
    end: float
    role: Role


@dataclass(frozen=True)
class Rule:
    """A straight line across a panel at `value` of one axis."""

    axis: Literal["x", "y"]
    value: float
    name: str
    role: Role = "reference"


@dataclass(frozen=True)
class Panel:
    """One pair of axes; the x axis belongs to the figure.

    Attributes:
        y: the quantity.
        series: curves, drawn in this order over the bands.
        bands: intervals, drawn first.
        rules: straight lines.
        keyed: whether the names of the curves belong into this panel's own heading.
        refusal: why there is nothing to draw; None where there is.
    """

    y: Axis
    series: tuple[Series, ...] = ()
    bands: tuple[Band, ...] = ()
    rules: tuple[Rule, ...] = ()
    keyed: bool = False
    refusal: str | None = None


@dataclass(frozen=True)
class Figure:
    """Panels above each other on one x axis.

    Attributes:
        name: identifier, unique in a report.
        title: what is shown, for a reader.
        caption: how to read it, with what it says where that can be computed.
        x: the shared axis.
        panels: from top to bottom.
        spans: stretches of the x axis marked in every panel.
        link: figures of the same link zoom together; empty for none.
        size: "wide" fills the page, "small" stands beside others.
    """

    name: str
    title: str
    caption: str
    x: Axis
    panels: tuple[Panel, ...]
    spans: tuple[Span, ...] = ()
    link: str = ""
    size: Literal["wide", "small"] = "wide"


@dataclass(frozen=True)
class Interval:
    """A stretch on a strip; `emphasis` separates the inner from the outer interval of one thing."""

    low: float
    high: float
    role: Role
    emphasis: bool


@dataclass(frozen=True)
class Mark:
    """A point on a strip."""

    value: float
    role: Role


@dataclass(frozen=True)
class Strip:
    """Intervals and points on one line with its own scale, small enough for a table's cell.

    Attributes:
        limits: ends of the scale; always includes everything marked.
        intervals: drawn in this order.
        marks: drawn over the intervals.
        description: the same in words, for readers who do not see it.
    """

    limits: tuple[float, float]
    intervals: tuple[Interval, ...]
    marks: tuple[Mark, ...]
    description: str
