from __future__ import annotations

import base64
import itertools
import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import plotly.graph_objects
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_sysid.figures.data import Axis, Band, Figure, Panel, Rule, Series, Span
from gcs_sysid.report.content import content
from gcs_sysid.report.palette import LIGHT
from gcs_sysid.report.plotly_figure import legend, specification, spread

X = np.arange(4.0)


def figure(**changes: Any) -> Figure:
    panel = Panel(
        y=Axis("Cm", "1", (-1.0, 1.0)),
        series=(Series("measured", X, X / 4.0, "measured"),),
        bands=(Band("measured, 95 %", X, X - 1.0, X + 1.0, "measured"),),
        rules=(Rule("y", 0.0, ""),),
    )
    values = {
        "name": "f", "title": "t", "caption": "c", "x": Axis("time", "s", (0.0, 3.0)),
        "panels": (panel, panel), "spans": (Span("doublet 1", 1.0, 2.0, "held_out"),),
    } | changes  # fmt: skip
    return Figure(**values)


def painted(node: Any) -> Any:
    if isinstance(node, str):
        return re.sub(r"@\{(\w+)/[\d.]+\}", lambda match: LIGHT[match[1]], node)
    if isinstance(node, list):
        return [painted(item) for item in node]
    if isinstance(node, dict):
        return {key: painted(item) for key, item in node.items()}
    return node


def numbers(array: dict) -> np.ndarray:
    return np.frombuffer(base64.b64decode(array["bdata"]), dtype="<f4")


def test_every_figure_of_a_report_is_valid_for_plotly(
    samples: dict[str, np.ndarray], summary: dict
) -> None:
    refused = summary | {
        "coefficients": summary["coefficients"] | {"CX": {"refused": "no accelerometer"}}
    }
    for shown in content(refused, samples, unseen=False).figures:
        made = painted(specification(shown))
        checked = plotly.graph_objects.Figure(data=made["data"], layout=made["layout"])
        assert "@{" not in json.dumps(made["layout"])
        assert len(checked.data) == len(made["data"])


def test_a_specification_carries_the_samples() -> None:
    made = specification(figure())
    line = next(trace for trace in made["data"] if trace["name"] == "measured")
    np.testing.assert_array_equal(numbers(line["y"]), np.float32(X / 4.0))


def test_a_band_is_closed_and_parted_at_gaps() -> None:
    lower = np.array([0.0, 0.0, np.nan, 0.0, 0.0, np.nan, 0.0])
    band = Band("b", np.arange(7.0), lower, lower + 1.0, "measured")
    panel = Panel(y=Axis("a", "m", (0.0, 1.0)), bands=(band,))
    trace = specification(figure(panels=(panel,)))["data"][0]
    x, y = numbers(trace["x"]), numbers(trace["y"])
    assert np.isnan(x).nonzero()[0].tolist() == np.isnan(y).nonzero()[0].tolist() == [4, 9]
    assert x[:4].tolist() == [0.0, 1.0, 1.0, 0.0]
    assert y[5:9].tolist() == [1.0, 1.0, 0.0, 0.0]


def test_panels_do_not_overlap_and_headings_fit_between() -> None:
    layout = specification(figure(panels=figure().panels * 4))["layout"]
    domains = [layout["yaxis" if n == 1 else f"yaxis{n}"]["domain"] for n in range(1, 9)]
    inner = layout["height"] - layout["margin"]["t"] - layout["margin"]["b"]
    for upper, lower in itertools.pairwise(domains):
        assert (upper[0] - lower[1]) * inner == pytest.approx(26.0)
    assert domains[0][1] == pytest.approx(1.0)
    assert domains[-1][0] == pytest.approx(0.0, abs=1e-9)


def test_units_are_on_every_axis_that_has_one() -> None:
    panel = Panel(y=Axis("airspeed V", "m/s", (0.0, 1.0)), series=(Series("e", X, X, "first"),))
    layout = specification(figure(panels=(panel,)))["layout"]
    assert layout["xaxis"]["title"]["text"] == "time, s"
    assert any(note["text"].endswith("m/s") for note in layout["annotations"])


def test_held_out_stretches_are_shaded_and_named() -> None:
    layout = specification(figure())["layout"]
    shaded = [shape for shape in layout["shapes"] if shape["type"] == "rect"]
    assert [(shape["x0"], shape["x1"]) for shape in shaded] == [(1.0, 2.0)]
    assert any(note["text"] == "doublet 1" for note in layout["annotations"])


def test_a_refusal_stands_where_the_curve_would() -> None:
    panel = Panel(y=Axis("CX", "1", (-1.0, 1.0)), refusal="no accelerometer <b>")
    layout = specification(figure(panels=(panel,)))["layout"]
    note = next(item for item in layout["annotations"] if "refused" in item["text"])
    low, high = layout["yaxis"]["domain"]
    assert low < note["y"] < high
    assert "no accelerometer &lt;b&gt;" in note["text"]


def test_names_stand_where_numbers_would_with_room_for_them() -> None:
    names = ("cg_shift and surface_effectiveness (elevator)", "<b>")
    panel = Panel(
        y=Axis("explanation", "1", (2.6, 0.4), names),
        series=(Series("probability", X[:2], X[1:3], "predicted", "rows"),),
    )
    made = specification(figure(panels=(panel,)))
    axis, [bar] = made["layout"]["yaxis"], made["data"]
    assert axis["tickvals"] == [1, 2]
    assert axis["ticktext"] == ["cg_shift and surface_effectiveness<br>(elevator)", "&lt;b&gt;"]
    assert axis["range"] == [2.6, 0.4]
    assert bar["orientation"] == "h"
    assert made["layout"]["margin"]["l"] > 180.0
    # Capitals are wider: the first letters of this one stood beyond the edge.
    loud = replace(panel, y=Axis("explanation", "1", (1.6, 0.4), ("time_skew SERVO_OUTPUT_RAW",)))
    assert specification(figure(panels=(loud,)))["layout"]["margin"]["l"] > 205.0
    made = painted(made)
    assert plotly.graph_objects.Figure(data=made["data"], layout=made["layout"])


def test_names_cannot_inject_markup() -> None:
    evil = '<a href="https://example.org">x</a>'
    panel = Panel(y=Axis(evil, evil, (0.0, 1.0)), series=(Series(evil, X, X, "first"),), keyed=True)
    made = specification(figure(panels=(panel,), spans=(Span(evil, 0.0, 1.0, "held_out"),)))
    assert "<a" not in json.dumps(made)


def test_the_legend_leaves_out_what_a_heading_names() -> None:
    keyed = Panel(
        y=Axis("rates", "deg/s", (0.0, 1.0)), series=(Series("roll", X, X, "first"),), keyed=True
    )
    names = [entry.name for entry in legend(figure(panels=(*figure().panels, keyed)))]
    assert names == ["measured", "measured, 95 %", "maneuver held out"]
    assert legend(figure(panels=(keyed,), spans=())) == ()


@settings(deadline=None)
@given(st.lists(st.floats(0.0, 100.0)).map(sorted), st.floats(0.0, 5.0))
def test_spread_names_keep_their_order_and_distance(places: list[float], gap: float) -> None:
    moved = spread(places, gap=gap)
    assert all(new >= old for new, old in zip(moved, places, strict=True))
    # A rounding of the sum of two numbers up to a few hundred.
    assert all(b - a >= gap - 1e-9 for a, b in itertools.pairwise(moved))


def test_names_of_upright_rules_stay_inside_the_panel_and_neighbours_apart() -> None:
    """They had stood above it, over its heading, and over each other."""
    rules = tuple(Rule("x", value, name) for value, name in ((2.0, "b"), (1.0, "a"), (2.1, "c")))
    panel = Panel(y=Axis("sd", "%", (0.0, 1.0)), rules=(Rule("y", 0.5, "asked for"), *rules))
    shapes = specification(figure(panels=(panel,), spans=()))["layout"]["shapes"]
    places = {
        shape["label"]["text"]: (shape["label"]["textposition"], shape["label"].get("xanchor"))
        for shape in shapes
    }
    assert places["a"] == places["c"] == ("end", "right")
    assert places["b"] == ("start", "left")
    assert places["asked for"] == ("end", None)
