from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from types import ModuleType

import numpy as np
import pytest

from gcs_sysid.figures.samples import has_coefficient
from gcs_sysid.report import identify, predict
from gcs_sysid.report.content import content, control_names

EVIL = '"><script>alert(1)</script>&lt;.tlog'


class Page(HTMLParser):
    """A page taken apart: text outside scripts, attributes, and the scripts themselves."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.text = ""
        self.attributes: list[tuple[str, str, str]] = []
        self.scripts: list[str] = []
        self.inside = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.inside = tag
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        self.inside = ""

    def handle_data(self, data: str) -> None:
        if self.inside == "script":
            self.scripts[-1] += data
        elif self.inside != "style":
            self.text += data

    @property
    def payload(self) -> dict:
        return json.loads(self.scripts[0])

    @property
    def words(self) -> str:
        return " ".join(self.text.split())


@pytest.fixture(scope="module")
def html(samples: dict[str, np.ndarray], summary: dict) -> str:
    return identify.render(summary, samples)


@pytest.fixture(scope="module")
def page(html: str) -> Page:
    return Page(html)


def test_nothing_is_loaded_from_elsewhere(page: Page, html: str) -> None:
    loading = {"src", "href", "srcset", "data", "action", "poster", "xlink:href"}
    links = [value for _, name, value in page.attributes if name in loading]
    assert links
    assert all(value.startswith("#") for value in links)
    style = html[html.index("<style>") : html.index("</style>")]
    assert "url(" not in style
    assert "@import" not in style
    assert "default-src 'none'" in html
    assert "http" not in page.scripts[0] + page.scripts[2]


def test_plotly_is_in_the_page_once(page: Page) -> None:
    assert len(page.scripts) == 3
    assert [script.startswith("/**\n* plotly.js") for script in page.scripts] == [
        False, True, False,
    ]  # fmt: skip


def test_every_placed_figure_is_in_the_payload_and_the_other_way_round(page: Page) -> None:
    placed = [value for _, name, value in page.attributes if name == "data-figure"]
    assert sorted(placed) == sorted(page.payload["figures"])
    assert len(set(placed)) == len(placed)


def test_identifiers_are_unique(page: Page) -> None:
    names = [value for _, name, value in page.attributes if name == "id"]
    assert len(set(names)) == len(names)


def test_links_inside_the_page_lead_somewhere(page: Page) -> None:
    names = {value for _, name, value in page.attributes if name == "id"}
    links = {value[1:] for _, name, value in page.attributes if name == "href"}
    assert links <= names


def test_every_warning_and_open_question_is_there(page: Page, summary: dict) -> None:
    for warning in summary["warnings"]:
        assert warning in page.words
    for question in summary["cannot_tell"]:
        assert all(question[part] in page.words for part in ("what", "why", "fly"))


def test_provenance_is_there(page: Page, summary: dict) -> None:
    for flight in summary["flights"]:
        assert flight["source"] in page.words
        assert flight["sha256"] in page.words
    assert summary["program"] in page.words
    assert "total10.3 s" in page.words.replace("total ", "total")


def test_derivatives_stand_beside_the_files(page: Page, summary: dict) -> None:
    rows = sum(len(entries) for entries in summary["derivatives"].values())
    strips = [value for tag, name, value in page.attributes if tag == "svg" and name == "class"]
    assert strips.count("strip") == rows + 3
    assert "\u22120.158 ± 0.0" in page.words or "\u22120.1580 ± 0.0" in page.words


def test_modes_stand_with_their_intervals(page: Page) -> None:
    """The spiral's root is 0.0174 ± 0.0214 1/s: slower than 1/0.0388 s, whichever way."""
    told = page.words.partition("falls to 37 %")[0]
    assert "short period14.5 ± 1.1 rad/s0.836 ± 0.0590.785 s0.0826 ± 0.0067 sstable" in told
    assert "spiral–––over 26 seither" in told
    assert "phugoid" in told.partition("12.6 s")[0]
    assert page.words.count("diverges") == 1


def test_compatibility_speaks(page: Page, summary: dict) -> None:
    for channel in summary["compatibility"]["channels"].values():
        assert channel["verdict"] in page.words
    assert summary["compatibility"]["verdict"] in page.words
    assert "SERVO_OUTPUT_RAW66" in page.words.replace(" ", "")
    assert "lag 210 ± 20 ms" in page.words
    assert "Before any aerodynamics" in page.words


def test_a_check_inside_the_filter_says_so(samples: dict[str, np.ndarray], summary: dict) -> None:
    inside = summary | {"compatibility": summary["compatibility"] | {"filter": "aided"}}
    words = Page(identify.render(inside, samples)).words
    assert "Inside the aided filter" in words
    assert "Before any aerodynamics" not in words


def test_names_from_the_outside_are_escaped(samples: dict[str, np.ndarray], summary: dict) -> None:
    hostile = summary | {
        "aircraft": EVIL,
        "flights": [summary["flights"][0] | {"source": EVIL, "sha256": EVIL}],
        "warnings": [EVIL],
        "maneuvers": [item | {"kind": EVIL} for item in summary["maneuvers"]],
        "cannot_tell": [{"what": EVIL, "why": EVIL, "fly": EVIL}],
        "coefficients": summary["coefficients"] | {"CX": {"refused": EVIL, "samples": 0}},
    }
    page = Page(identify.render(hostile, samples))
    assert len(page.scripts) == 3
    assert "alert" not in page.scripts[2]
    assert page.words.count(EVIL) >= 8
    assert page.payload["figures"]


def test_refused_coefficients_say_why_wherever_they_would_be(
    samples: dict[str, np.ndarray], summary: dict
) -> None:
    reason = "no accelerometer in the log; send RAW_IMU at 25 Hz"
    blind = {
        name: np.full(values.size, np.nan) if name.startswith("CX") else values
        for name, values in samples.items()
    }
    changed = summary | {
        "coefficients": summary["coefficients"] | {"CX": {"refused": reason, "samples": 0}}
    }
    page = Page(identify.render(changed, blind))
    assert page.words.count(reason) >= 3
    drawn = page.payload["figures"]
    assert not any(name.startswith("residual") and name.endswith("CX") for name in drawn)
    notes = [note["text"] for note in drawn["coefficients-0"]["layout"]["annotations"]]
    assert any("refused" in note for note in notes)


def test_a_coefficient_without_samples_is_refused_even_if_the_summary_forgot(
    samples: dict[str, np.ndarray], summary: dict
) -> None:
    without = {name: values for name, values in samples.items() if not name.startswith("Cn")}
    assert "no sample of this flight" in Page(identify.render(summary, without)).words


def test_lone_samples_do_not_make_a_curve(samples: dict[str, np.ndarray]) -> None:
    lone = np.where(np.arange(samples["t"].size) == 7, samples["Cn"], np.nan)
    assert not has_coefficient(samples | {"Cn": lone}, "Cn")
    assert has_coefficient(samples, "Cn")


def test_arrays_in_a_summary_are_as_good_as_lists(
    samples: dict[str, np.ndarray], summary: dict
) -> None:
    wind = {"value": np.array([1.0, 2.0, 0.0]), "sd": np.full(3, 0.1), "unit": "m/s"}
    changed = summary | {"reconstruction": summary["reconstruction"] | {"wind_ned": wind}}
    assert "wind toward east2.00 ± 0.20 m/s" in Page(identify.render(changed, samples)).words


def test_several_flights_have_figures_each(example: ModuleType) -> None:
    table = example.joined(example.flight(60.0), example.flight(60.0, number=1))
    made = example.summary(table)
    page = Page(identify.render(made, table))
    assert {"coefficients-0", "coefficients-1", "states-0", "states-1"} <= set(
        page.payload["figures"]
    )
    for flight in made["flights"]:
        assert flight["source"] in page.words


def test_a_prediction_has_no_derivatives_and_all_maneuvers_are_unseen(
    example: ModuleType, samples: dict[str, np.ndarray]
) -> None:
    origin = {"flights": [{"source": "the_teacher.tlog", "sha256": "c0ffee"}]}
    made = example.summary(samples, command="predict") | {"model": origin}
    page = Page(predict.render(made, samples | {"held_out": np.zeros(samples["t"].size, bool)}))
    assert "Prediction report" in page.words
    assert "the_teacher.tlog c0ffee" in page.words
    assert "derivatives are determined" not in page.words
    assert ("section", "id", "derivatives") not in page.attributes
    shapes = page.payload["figures"]["coefficients-0"]["layout"]["shapes"]
    marked = [shape for shape in shapes if shape["type"] == "rect"]
    assert len(marked) == len(made["maneuvers"])
    assert all("held_out" in shape["fillcolor"] for shape in marked)


def test_a_summary_with_only_what_it_must_have_still_makes_a_page(
    samples: dict[str, np.ndarray], summary: dict
) -> None:
    needed = ("program", "command", "aircraft", "flights", "coefficients", "maneuvers")
    bare = {name: summary[name] for name in needed} | {"maneuvers": []}
    still = samples | {"maneuver": np.full(samples["t"].size, -1)}
    page = Page(identify.render(bare, still | {"held_out": np.zeros(samples["t"].size, bool)}))
    assert "No compatibility check was recorded" in page.words
    assert ("section", "id", "maneuvers") not in page.attributes


def test_a_ten_minute_flight_stays_under_eight_megabytes(example: ModuleType) -> None:
    table = example.flight(600.0)
    html = identify.render(example.summary(table), table)
    assert len(html.encode()) < 8_000_000


def test_controls_are_those_the_summary_names(
    samples: dict[str, np.ndarray], summary: dict
) -> None:
    assert control_names(summary, samples) == ("elevator", "aileron", "rudder")
    assert control_names(summary | {"trim": None, "maneuvers": []}, samples) == ()


def test_close_ups_are_held_out_maneuvers_only(
    samples: dict[str, np.ndarray], summary: dict
) -> None:
    shown = content(summary, samples, unseen=False).close_ups
    held_out = {f"maneuver-0-{item['id']}" for item in summary["maneuvers"] if item["held_out"]}
    assert {figure.name for figure in shown} <= held_out
    assert shown


def test_colours_of_the_page_know_light_dark_and_print(html: str) -> None:
    style = html[html.index("<style>") : html.index("</style>")]
    assert "prefers-color-scheme: dark" in style
    assert "@media print" in style
    used = set(re.findall(r"var\(--(\w+)\)", html[: html.index('<script id="payload"')]))
    assert used - {"c"} <= set(re.findall(r"--(\w+):", style))
