"""A figure's data as a plotly.js specification, colours left as placeholders for the page.

Panels lie above each other on one x axis; each has its heading (quantity, unit, and the names of
its curves in their colours) above it, where it cannot hide data. Legends are the page's.
"""

from __future__ import annotations

import base64
import textwrap
from dataclasses import dataclass
from html import escape
from typing import Literal

import numpy as np
from jaxtyping import Float

from gcs_sysid.figures.data import Axis, Band, Figure, Panel, Rule, Series, Span
from gcs_sysid.report import labels
from gcs_sysid.report.palette import token

_FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"
_BOTTOM = 44.0
_HEADING = 26.0
_FLAG = 5.0
_LETTER = 5.9
_CAPITAL = 8.3
_LONGEST_NAME = 26
_LEFT = 52.0
_TICK_LINE = 42
"""Letters of a line of a name beside the y axis."""
_LINE = {"wide": 1.2, "small": 1.0}
_DASH = {"reference": "2px,2px", "limit": "5px,3px"}


@dataclass(frozen=True)
class Legend:
    """One entry of a figure's legend: what it is called and what it looks like."""

    name: str
    role: str
    shape: str


def specification(figure: Figure) -> dict:
    """`data`, `layout`, `link` and `size` for the page's script."""
    heights = [_panel_height(figure)] * len(figure.panels)
    inner = sum(heights) + _HEADING * (len(heights) - 1)
    top = _HEADING + _FLAG + _names_height(figure)
    domains = _domains(heights, inner)
    layout = _base_layout(figure, height=top + inner + _BOTTOM, top=top)
    data: list[dict] = []
    for number, (panel, domain) in enumerate(zip(figure.panels, domains, strict=True), start=1):
        layout[_key("yaxis", number)] = _y_axis(panel, domain)
        layout["annotations"] += _heading(panel, domain[1], number) + _refusal(panel, domain)
        layout["shapes"] += _rules(panel.rules, number)
        data += [_band(band, number) for band in panel.bands]
        data += [_series(series, number, panel.y.unit, figure.size) for series in panel.series]
    layout["shapes"] += [_span(span, flag=_FLAG / inner) for span in figure.spans]
    layout["shapes"] += [
        _refused_ground(domain)
        for panel, domain in zip(figure.panels, domains, strict=True)
        if panel.refusal is not None
    ]
    layout["annotations"] += _span_names(figure)
    if not data:
        data.append({"x": list(figure.x.limits), "y": [None, None], "hoverinfo": "skip"})
    return {"data": data, "layout": layout, "link": figure.link, "size": figure.size}


def legend(figure: Figure) -> tuple[Legend, ...]:
    """What the page writes beside the figure; curves named in a panel's heading are left out."""
    entries: dict[str, Legend] = {}
    for panel in figure.panels:
        if panel.keyed or panel.refusal is not None:
            continue
        for series in panel.series:
            entries.setdefault(series.name, Legend(series.name, series.role, series.style))
        for band in panel.bands:
            entries.setdefault(band.name, Legend(band.name, band.role, "band"))
        for rule in panel.rules:
            if rule.name == "limit":
                entries.setdefault("limit", Legend("aircraft file's limit", "limit", "dashes"))
    for span in figure.spans:
        name = "held out" if span.role == "held_out" else "fitted"
        entries.setdefault(span.role, Legend(f"maneuver {name}", span.role, "span"))
    return tuple(entries.values()) if len(entries) > 1 else ()


def _names_height(figure: Figure) -> float:
    """Room [px] above the first heading for the upright names of held-out stretches."""
    longest = max(
        (len(_short(span)) for span in figure.spans if span.role == "held_out"), default=0
    )
    return _LETTER * longest + 6.0 if longest else 0.0


def _short(span: Span) -> str:
    return textwrap.shorten(span.name, _LONGEST_NAME, placeholder="…")


def _panel_height(figure: Figure) -> float:
    if figure.size == "wide":
        return 112.0
    return 210.0 if len(figure.panels) == 1 else 84.0


def _domains(heights: list[float], inner: float) -> list[tuple[float, float]]:
    domains = []
    upper = inner
    for height in heights:
        domains.append((max((upper - height) / inner, 0.0), upper / inner))
        upper -= height + _HEADING
    return domains


def _key(name: str, number: int) -> str:
    return name if number == 1 else f"{name}{number}"


def _base_layout(figure: Figure, *, height: float, top: float) -> dict:
    single = len(figure.panels) == 1
    return {
        "height": height,
        "margin": {"l": _left(figure), "r": 10, "t": top, "b": _BOTTOM},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": _FONT, "size": 12, "color": token("muted")},
        "showlegend": False,
        "hovermode": "closest" if single else "x unified",
        "hoversubplots": "axis",
        "hoverlabel": {
            "bgcolor": token("raised"),
            "bordercolor": token("line"),
            "font": {"family": _FONT, "size": 12, "color": token("ink")},
        },
        "bargap": 0.06,
        "modebar": {
            "bgcolor": "rgba(0,0,0,0)",
            "color": token("muted", 0.6),
            "activecolor": token("ink"),
        },
        "xaxis": _x_axis(figure.x, len(figure.panels)),
        "annotations": [],
        "shapes": [],
    }


def _left(figure: Figure) -> float:
    """Room [px] beside the y axis for numbers, or for names."""
    names = [name for panel in figure.panels for name in panel.y.names]
    longest = max((_width(line) for name in names for line in _lines(name)), default=0.0)
    return max(_LEFT, longest + 24.0)


def _width(line: str) -> float:
    """Of words as they stand beside an axis [px]: names of messages are all capitals."""
    return sum(_CAPITAL if letter.isupper() else _LETTER for letter in line)


def _lines(name: str) -> list[str]:
    return textwrap.wrap(name, _TICK_LINE)


def _ticks(axis: Axis) -> dict:
    """Names in place of numbers, where the axis has them."""
    if not axis.names:
        return {}
    texts = ["<br>".join(map(escape, _lines(name))) for name in axis.names]
    return {
        "tickvals": list(range(1, len(texts) + 1)),
        "ticktext": texts,
        "showgrid": False,
        "zeroline": False,
    }


def _x_axis(axis: Axis, panels: int) -> dict:
    return {
        "range": list(axis.limits),
        "anchor": _key("y", panels),
        "title": {"text": escape(_with_unit(axis)), "font": {"size": 12}, "standoff": 8},
        "ticks": "outside",
        "ticklen": 4,
        "tickcolor": token("line"),
        "linecolor": token("line"),
        "showline": True,
        "gridcolor": token("grid"),
        "zeroline": False,
        "hoverformat": ".2f",
        "unifiedhovertitle": {"text": f"%{{x:.2f}} {_unit(axis.unit)}"},
        "nticks": 12,
    }


def _y_axis(panel: Panel, domain: tuple[float, float]) -> dict:
    refused = panel.refusal is not None
    return {
        "domain": list(domain),
        "range": list(panel.y.limits),
        "anchor": "x",
        "nticks": 5,
        "gridcolor": token("grid"),
        "zeroline": not refused,
        "zerolinecolor": token("line"),
        "zerolinewidth": 1,
        "showticklabels": not refused,
        "showgrid": not refused,
        "exponentformat": "power",
        "fixedrange": refused,
        **_ticks(panel.y),
    }


def _unit(unit: str) -> str:
    return "" if unit == "1" else unit


def _with_unit(axis: Axis) -> str:
    return f"{axis.label}, {axis.unit}" if _unit(axis.unit) else axis.label


def _heading(panel: Panel, at: float, number: int) -> list[dict]:
    unit = f", {escape(panel.y.unit)}" if _unit(panel.y.unit) else ""
    text = f"<b>{labels.coefficient(panel.y.label)}</b>{unit}"
    if panel.keyed:
        text += "".join(
            f'   <span style="color:{token(series.role)}">\u2501 {escape(series.name)}</span>'
            for series in panel.series
        )
    shift = 1.0 + (_FLAG if number == 1 else 0.0)
    return [
        _note(
            text, x=0.0, y=at, xanchor="left", yanchor="bottom", yshift=shift, colour=token("ink")
        )
    ]


def _refusal(panel: Panel, domain: tuple[float, float]) -> list[dict]:
    if panel.refusal is None:
        return []
    reason = textwrap.shorten(panel.refusal, 240, placeholder=" …")
    text = "<br>".join(["<b>refused</b>", *textwrap.wrap(escape(reason), 50)])
    middle = 0.5 * (domain[0] + domain[1])
    return [_note(text, x=0.5, y=middle, xanchor="center", yanchor="middle", colour=token("muted"))]


def _note(
    text: str,
    *,
    x: float,
    y: float,
    xanchor: str,
    yanchor: str,
    colour: str,
    yshift: float = 0.0,
) -> dict:
    return {
        "text": text,
        "x": x,
        "y": y,
        "xref": "paper",
        "yref": "paper",
        "xanchor": xanchor,
        "yanchor": yanchor,
        "yshift": yshift,
        "showarrow": False,
        "align": xanchor if xanchor != "center" else "center",
        "font": {"size": 12, "color": colour},
    }


def _refused_ground(domain: tuple[float, float]) -> dict:
    ground = _rectangle("paper", 0.0, 1.0, "paper", domain[0], domain[1])
    return {**ground, "fillcolor": token("raised")}


def _rules(rules: tuple[Rule, ...], number: int) -> list[dict]:
    """Names of upright rules stand inside the panel, in turn above on the left, below on the right.

    Two that are near each other so never share a place.
    """
    upright = sorted((rule for rule in rules if rule.axis == "x"), key=lambda rule: rule.value)
    lower = upright[1::2]
    return [_rule(rule, number, "start" if rule in lower else "end") for rule in rules]


def _rule(rule: Rule, number: int, end: Literal["start", "end"]) -> dict:
    y_axis = _key("y", number)
    place = (
        {"xref": "x", "x0": rule.value, "x1": rule.value}
        | {"yref": f"{y_axis} domain", "y0": 0.0, "y1": 1.0}
        if rule.axis == "x"
        else {"yref": y_axis, "y0": rule.value, "y1": rule.value}
        | {"xref": "x domain", "x0": 0.0, "x1": 1.0}
    )
    label = {
        "text": "" if rule.name == "limit" else escape(rule.name),
        "textposition": end,
        "font": {"size": 11, "color": token("muted")},
    }
    if rule.axis == "x":
        # By itself plotly.js centres the text of an upright line on the line's end.
        sides = {"end": ("right", "bottom"), "start": ("left", "top")}
        label["xanchor"], label["yanchor"] = sides[end]
    return {
        "type": "line",
        "layer": "above" if rule.name else "below",
        "line": {"color": token(rule.role), "width": 1, "dash": _DASH[rule.role]},
        "label": label,
        **place,
    }


def _rectangle(xref: str, x0: float, x1: float, yref: str, y0: float, y1: float) -> dict:
    return {
        "type": "rect",
        "layer": "below",
        "line": {"width": 0},
        "xref": xref,
        "x0": x0,
        "x1": x1,
        "yref": yref,
        "y0": y0,
        "y1": y1,
    }


def _span(span: Span, *, flag: float) -> dict:
    if span.role == "held_out":
        whole = _rectangle("x", span.start, span.end, "paper", 0.0, 1.0)
        return {**whole, "fillcolor": token("held_out", 0.17)}
    above = _rectangle("x", span.start, span.end, "paper", 1.0, 1.0 + flag)
    return {**above, "fillcolor": token("fitted", 0.8)}


def _span_names(figure: Figure) -> list[dict]:
    """Names of the held-out stretches, upright above the panels, pushed apart where they crowd."""
    spans = [span for span in figure.spans if span.role == "held_out"]
    width = figure.x.limits[1] - figure.x.limits[0]
    places = spread([0.5 * (span.start + span.end) for span in spans], gap=0.014 * width)
    return [
        {
            "text": escape(_short(span)),
            "x": place,
            "y": 1.0,
            "xref": "x",
            "yref": "paper",
            "yanchor": "bottom",
            "yshift": _HEADING + _FLAG - 4.0,
            "textangle": -90,
            "showarrow": False,
            "font": {"size": 11, "color": token("held_out")},
        }
        for span, place in zip(spans, places, strict=True)
    ]


def spread(places: list[float], *, gap: float) -> list[float]:
    """Places in rising order moved to the right where needed to be at least `gap` apart."""
    moved: list[float] = []
    for place in places:
        moved.append(max(place, moved[-1] + gap) if moved else place)
    return moved


def _series(series: Series, number: int, unit: str, size: str) -> dict:
    trace = {
        "x": _thirty_two_bits(series.x),
        "y": _thirty_two_bits(series.y),
        "name": escape(series.name),
        "xaxis": "x",
        "yaxis": _key("y", number),
        "hovertemplate": f"%{{y:.4~g}} {escape(_unit(unit))}",
    }
    return trace | _look(series, width=_LINE[size])


def _look(series: Series, *, width: float) -> dict:
    colour = token(series.role)
    if series.style in ("bars", "rows"):
        bar = {"type": "bar", "marker": {"color": token(series.role, 0.55), "line": {"width": 0}}}
        lying = {"orientation": "h", "hovertemplate": "%{x:.3f}"}
        return bar if series.style == "bars" else bar | lying
    if series.style == "points":
        marker = {"size": 3, "color": token(series.role, 0.55), "line": {"width": 0}}
        return {
            "type": "scatter",
            "mode": "markers",
            "marker": marker,
            "hoverinfo": "skip",
            "hovertemplate": None,
        }
    if series.style == "cross":
        marker = {"size": 15, "symbol": "cross-thin", "line": {"width": 2.5, "color": colour}}
        return {"type": "scatter", "mode": "markers", "marker": marker}
    line = {"color": colour, "width": width}
    if series.style == "dashes":
        line |= {"dash": "dash", "width": 1.2}
    return {"type": "scatter", "mode": "lines", "line": line, "connectgaps": False}


def _band(band: Band, number: int) -> dict:
    x, y = _outline(band)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": _thirty_two_bits(x),
        "y": _thirty_two_bits(y),
        "name": escape(band.name),
        "fill": "toself",
        "fillcolor": token(band.role, 0.22),
        "line": {"width": 0},
        "hoverinfo": "skip",
        "xaxis": "x",
        "yaxis": _key("y", number),
    }


def _outline(
    band: Band,
) -> tuple[Float[np.ndarray, " vertex"], Float[np.ndarray, " vertex"]]:
    """Closed outlines, one per gapless stretch, parted by not-a-number."""
    valid = np.isfinite(band.lower) & np.isfinite(band.upper)
    cuts = np.flatnonzero(np.diff(valid.astype(int)) != 0) + 1
    x, y = [], []
    for rows in np.split(np.arange(valid.size), cuts):
        if rows.size < 2 or not valid[rows[0]]:
            continue
        x += [band.x[rows], band.x[rows][::-1], [np.nan]]
        y += [band.upper[rows], band.lower[rows][::-1], [np.nan]]
    if not x:
        return np.zeros(0), np.zeros(0)
    return np.concatenate(x), np.concatenate(y)


def _thirty_two_bits(values: Float[np.ndarray, " point"]) -> dict:
    """plotly.js's binary array: single precision is seven digits, far below a pixel."""
    raw = np.asarray(values, dtype="<f4").tobytes()
    return {"dtype": "f4", "bdata": base64.b64encode(raw).decode("ascii")}
