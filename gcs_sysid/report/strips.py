"""A strip laid out for a small inline SVG: where its bars and ticks go."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_sysid.figures.data import Interval, Strip

WIDTH = 200.0
_MARGIN = 5.0
_FILE_HEIGHT = 14.0
_BAR_HEIGHT = 5.0
_THINNEST = 0.8


@dataclass(frozen=True)
class Bar:
    """A horizontal bar, lengths in the drawing's units; `style` names its classes."""

    style: str
    x: float
    width: float
    height: float


@dataclass(frozen=True)
class Tick:
    """A vertical tick."""

    style: str
    x: float


@dataclass(frozen=True)
class Layout:
    """Everything to draw in a box `WIDTH` wide; `zero` is None when zero is off the scale."""

    zero: float | None
    bars: tuple[Bar, ...]
    ticks: tuple[Tick, ...]
    description: str


def laid_out(strip: Strip) -> Layout:
    """Places of a strip's parts. Colours are the page's, so it follows light, dark and print."""
    low, high = strip.limits
    return Layout(
        zero=_place(strip, 0.0) if low <= 0.0 <= high else None,
        bars=tuple(_bar(strip, item) for item in strip.intervals),
        ticks=tuple(Tick(mark.role, _place(strip, mark.value)) for mark in strip.marks),
        description=strip.description,
    )


def _place(strip: Strip, value: float) -> float:
    low, high = strip.limits
    inside = min(max(value, low), high)
    return _MARGIN + (inside - low) / (high - low) * (WIDTH - 2.0 * _MARGIN)


def _bar(strip: Strip, item: Interval) -> Bar:
    left, right = _place(strip, item.low), _place(strip, item.high)
    return Bar(
        style=f"{item.role} {'inner' if item.emphasis else 'outer'}",
        x=left,
        width=max(right - left, _THINNEST),
        height=_FILE_HEIGHT if item.role == "file" else _BAR_HEIGHT,
    )
