"""The documents of `suggest` for a made-up model."""

from __future__ import annotations

import base64
import csv
import json
import re
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_sysid import atmosphere
from gcs_sysid.cli import reports
from gcs_sysid.errors import InputError, RefusedError, UsageError
from gcs_sysid.figures.maneuver import confidence
from gcs_sysid.maneuvers import information
from gcs_sysid.offline import model_store, suggest, suggestion_flown, suggestion_map
from gcs_sysid.offline.model_store import StoredModel
from gcs_sysid.offline.suggestion_target import Question, chosen
from gcs_sysid.report.suggest import findings
from tests.dashboard.browser import CHROMIUM, Browser
from tests.estimate.made_sensing import sensing
from tests.maneuvers.made_model import aircraft, model


def saved(folder: Path, **changes: object) -> Path:
    made = replace(aircraft(), **changes)
    model_store.save(folder / "model", StoredModel(model(), made, 0.0, []))
    return folder


def run(folder: Path, out: Path, **asked: object) -> dict:
    question = Question(**{"confidence": 0.01, "gust": 0.3, "minutes": 3.0, **asked})
    return suggest.run(folder, question, out=out, progress=lambda _text, _share: None)


@pytest.fixture(scope="module")
def planned(tmp_path_factory) -> Iterator[tuple[dict, Path]]:
    """Plans for Cm at one airspeed: others would be the same again."""
    folder = tmp_path_factory.mktemp("suggest")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(suggest, "SPEEDS", (0.45,))
        patch.setattr(suggest, "LISTED", 4)
        yield run(saved(folder), folder / "out", target="Cm"), folder / "out"


def test_maneuvers_have_the_keys_of_the_interface(planned) -> None:
    document, out = planned
    listed = json.loads((out / "maneuvers.json").read_text())
    assert listed == document["maneuvers"]
    assert len(listed) >= 4
    for item in listed:
        assert item["target"]["coefficients"] == ["Cm"]
        turning = item["kind"] in ("wind-up turn", "coupled rolls")
        assert item["entry"]["holds"] == ("attitude" if turning else "heading")
        assert set(item["target"]["region"]) == {"airspeed", "alpha", "beta"}
        expected = item["expected"]["Cm"]
        assert 0.0 < expected["sd_after"] < expected["sd_before"]
        low, high = item["envelope"]["alpha"]
        assert -0.1 < low < high < 0.2
        assert item["envelope"]["flights"] == 512
        assert 0.0 < item["envelope"]["violation_probability"] <= 0.01
        low, high = item["abort"]["alpha"]
        assert -0.1 <= low < high <= 0.2
        assert item["entry"]["airspeed"] == pytest.approx(13.0 + 0.45 * 22.0)
        assert item["recovery"]
    worth = [item["worth"] for item in listed]
    assert worth == sorted(worth, reverse=True)


def test_the_csv_is_the_input_in_degrees(planned) -> None:
    document, out = planned
    for item in document["maneuvers"]:
        with (out / item["csv"]).open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert list(rows[0]) == ["t", *item["controls"]]
        time = np.array([float(row["t"]) for row in rows])
        np.testing.assert_allclose(np.diff(time), 0.02, atol=1e-9)
        assert time[-1] == pytest.approx(item["duration_s"], abs=0.02)
        for name in item["controls"]:
            value = np.array([float(row[name]) for row in rows])
            factor = 1.0 if name == "throttle" else np.degrees(1.0)
            most = factor * item["amplitude"][name]
            assert np.abs(value).max() == pytest.approx(most, abs=1e-3)


def test_the_sortie_is_made_of_listed_maneuvers_in_time(planned) -> None:
    document, _ = planned
    plan = document["sortie"]
    names = {item["name"] for item in document["maneuvers"]}
    assert plan["steps"]
    assert {step["maneuver"] for step in plan["steps"]} <= names
    begins = [step["begins_s"] for step in plan["steps"]]
    assert begins == sorted(begins)
    assert plan["minutes"] <= 3.0
    for terms in plan["derivatives"].values():
        assert all(one["sd_after"] <= one["sd_before"] * (1 + 1e-9) for one in terms.values())


def test_the_report_has_a_card_for_every_maneuver(planned) -> None:
    document, out = planned
    text = reports.sheet("suggest", document, out / "maneuvers.parquet")
    assert "elevator" in text
    assert len(text.splitlines()) <= 10
    page = (out / "report.html").read_text(encoding="utf-8")
    for item in document["maneuvers"]:
        assert f'id="card-{item["name"]}"' in page
    assert "How well Cm is known" in page
    assert "Recovery: release the switch" in page


def test_what_is_told_first_to_fly_is_what_the_sortie_flies(planned) -> None:
    """What one run tells most of is named, as a share of the value itself."""
    document, _ = planned
    told = [item.text for item in findings(document) if item.topic == "Fly"]
    taken = [item for item in document["maneuvers"] if item["times_in_sortie"]]
    assert len(told) == min(len(taken), 4)
    for text, item in zip(told, taken, strict=False):
        name, before, after = re.search(r"Cm_(\S+) from ([\d.]+) to ([\d.]+) %", text).groups()
        assert float(after) < float(before)
        for when, said in (("sd_before", before), ("sd_after", after)):
            sd = item["expected"]["Cm"]["derivatives"][name][when]
            value = abs(document["sortie"]["derivatives"]["Cm"][name]["value"])
            assert float(said) == pytest.approx(100.0 * sd / value, rel=0.06)
    unknown = json.loads(json.dumps(document))
    unknown["sortie"]["derivatives"]["Cm"][name]["value"] = 0.0
    last = [item.text for item in findings(unknown) if item.topic == "Fly"][-1]
    assert f"Cm_{name} " not in last
    none = {**document, "maneuvers": [{**one, "times_in_sortie": 0} for one in taken]}
    assert len([item for item in findings(none) if item.topic == "Fly"]) == min(len(taken), 4)


def test_what_no_flight_takes_away_is_said_once_and_runs_are_told_beside_it(planned) -> None:
    """An inertia that is known to 30 %: every derivative of Cm stays unsure by that."""
    document, _ = planned
    assert "Stays" not in {item.topic for item in findings(document)}
    hidden = json.loads(json.dumps(document))
    terms = hidden["sortie"]["derivatives"]["Cm"]
    taken = [item for item in hidden["maneuvers"] if item["times_in_sortie"]]
    for key, one in terms.items():
        one["sd_stays"] = 0.3 * abs(one["value"])
        for told in (one, *(item["expected"]["Cm"]["derivatives"][key] for item in taken)):
            for when in ("sd_before", "sd_after"):
                told[when] = float(np.hypot(told[when], one["sd_stays"]))
    found = findings(hidden)
    (text,) = [item.text for item in found if item.topic == "Stays"]
    assert text.startswith("30 % of Cm, whatever is flown")
    told, before = (
        [item.text for item in of if item.topic == "Fly"] for of in (found, findings(document))
    )
    assert told == before


def test_the_map_marks_what_is_aimed_at_without_a_region_too(planned) -> None:
    """As far as the sortie's own maneuvers for Cm go in angle of attack."""
    document, _ = planned
    entry = document["confidence_map"]["Cm"]
    assert (entry["along"], entry["asked"]) == ("alpha", None)
    flown = {step["maneuver"] for step in document["sortie"]["steps"]}
    reach = [one["envelope"]["alpha"] for one in document["maneuvers"] if one["name"] in flown]
    low, high = min(one[0] for one in reach), max(one[1] for one in reach)
    assert entry["planned"] == pytest.approx([low, high])
    drawn = {rule.name: rule.value for rule in confidence("Cm", entry, 0.1).panels[0].rules}
    assert drawn["planned from"] == pytest.approx(np.degrees(low))
    assert drawn["planned to"] == pytest.approx(np.degrees(high))
    asked = confidence("Cm", {**entry, "asked": [0.01, 0.05]}, 0.1).panels[0].rules
    assert {"region from", "region to"} <= {rule.name for rule in asked}
    assert "planned from" not in {rule.name for rule in asked}


def test_the_edge_of_what_may_be_flown_is_asked_about_too(planned) -> None:
    """By hand: √(xᵀ Σ x) of Cm's terms along the angles that the load factor leaves."""
    document, _ = planned
    made, level = aircraft(), document["conditions"][0]
    fit, lift = model().fits["Cm"], model().fits["CZ"]
    assert made.envelope is not None
    alpha = np.linspace(*made.envelope.alpha, 61)
    pressure = 0.5 * atmosphere.density(np.array(level["height"])) * level["airspeed"] ** 2
    load = -(lift.value[0] + lift.value[1] * alpha) * pressure * made.geometry.wing_area
    load /= made.mass.mass * 9.80665
    rows = np.column_stack(
        [np.ones(61), alpha, np.zeros(61), np.full(61, level["controls"]["elevator"])]
    )
    sd = np.sqrt(np.sum((rows @ fit.covariance) * rows, axis=1))
    assert document["unsure"]["Cm"]["sd_reachable"] == pytest.approx(sd.max(), rel=1e-3)
    tight = replace(made.envelope, load_factor=(0.3, 1.7))
    inside = (load >= 0.3) & (load <= 1.7)
    assert 5 < inside.sum() < 56
    flow = {"alpha": 0.0, "beta": 0.0, "qhat": 0.0, "qbar": float(pressure), **level["controls"]}
    known = information.nothing(model())
    found = suggestion_map.changeable(model(), known, "Cm", made, tight, flow)
    assert found == pytest.approx(sd[inside].max(), rel=1e-3)
    assert found < 0.9 * sd.max()


def test_two_causes_are_told_apart_by_what_is_planned(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(suggest, "SPEEDS", (0.45,))
    monkeypatch.setattr(suggest, "LISTED", 1)
    asked = "surface_effectiveness:elevator,inertia:Iyy"
    document = run(saved(tmp_path), tmp_path / "out", separate=asked, minutes=1.0)
    assert document["maneuvers"][0]["target"]["coefficients"] == ["Cm"]
    told = document["separate"]
    assert told["causes"] == "surface_effectiveness elevator or inertia Iyy"
    assert told["unit"] == "1"
    assert told["sd_after"] < 0.8 * told["sd_before"]
    assert "Separates" in {item.topic for item in findings(document)}


def test_a_model_of_the_filter_is_planned_for_by_what_that_hears(tmp_path, monkeypatch) -> None:
    """The same maneuvers, less sure of what the sensors hide; without it nothing is foretold."""
    monkeypatch.setattr(suggest, "SPEEDS", (0.45,))
    monkeypatch.setattr(suggest, "LISTED", 1)
    of_filter = StoredModel(model(), aircraft(), 0.0, [], inside_filter=True)
    model_store.save(tmp_path / "old" / "model", of_filter)
    with pytest.raises(RefusedError, match="a version that did not keep"):
        run(tmp_path / "old", tmp_path / "out", target="Cn")
    model_store.save(tmp_path / "new" / "model", replace(of_filter, sensing=sensing()))
    document = run(tmp_path / "new", tmp_path / "out", target="Cn", minutes=1.0)
    assert document["sortie"]["steps"]
    told = document["sortie"]["derivatives"]["Cn"]
    for key in ("beta", "rhat", "rudder"):
        assert told[key]["sd_after"] < 0.6 * told[key]["sd_before"], key
    rougher = run(tmp_path / "new", tmp_path / "out", target="Cn", minutes=1.0, gust=1.0)
    known = rougher["sortie"]["derivatives"]["Cn"]
    assert known["beta"]["sd_after"] > 1.2 * told["beta"]["sd_after"]


def test_what_the_model_has_no_term_for_needs_its_flights(tmp_path) -> None:
    with pytest.raises(InputError, match=r"no samples\.parquet beside it"):
        run(saved(tmp_path), tmp_path / "out", separate="thrust_scale,drag_increase")


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_every_card_is_one_printed_page(planned, tmp_path) -> None:
    document, out = planned
    if not (out / "report.html").exists():
        reports.sheet("suggest", document, out / "maneuvers.parquet")
    with closing(Browser((out / "report.html").as_uri(), tmp_path / "profile")) as browser:
        browser.until(
            "document.readyState == 'complete' && document.querySelectorAll('.card').length > 0"
            " && !document.querySelector('[data-figure]:not([data-drawn])')"
        )
        browser.evaluate(
            "for (const each of document.querySelectorAll('header, nav, footer, #cards > h2, "
            "#cards > .lead, main > section:not(#cards)')) each.style.display = 'none';"
            "document.getElementById('cards').style.padding = '0'"
        )
        pages = {}
        for item in document["maneuvers"]:
            browser.evaluate(
                "for (const each of document.querySelectorAll('.card')) "
                f"each.style.display = each.id == 'card-{item['name']}' ? '' : 'none'"
            )
            printed = browser.call("Page.printToPDF", preferCSSPageSize=True)["data"]
            found = re.findall(rb"/Type\s*/Page\b", base64.b64decode(printed))
            pages[item["name"]] = len(found)
    assert pages == {item["name"]: 1 for item in document["maneuvers"]}


def test_what_was_promised_is_held_against_what_was_achieved(planned, tmp_path) -> None:
    """A model twice as sure as promised: ratios of a half."""
    document, out = planned
    promised = document["sortie"]["derivatives"]
    better = model()
    fits = {
        name: replace(
            fit,
            covariance=np.diag([(0.5 * promised[name][key]["sd_after"]) ** 2 for key in fit.keys]),
        )
        for name, fit in better.fits.items()
    }
    found = suggestion_flown.compared(out, replace(better, fits=fits))
    assert found["achieved_over_predicted"] == pytest.approx(0.5)
    assert all(row["moved_by_sd"] == 0.0 for row in found["derivatives"])
    with pytest.raises(InputError, match="holds no planned sortie"):
        suggestion_flown.compared(tmp_path, better)


def test_a_model_that_is_sure_enough_needs_nothing(planned) -> None:
    unsure = {"Cm": {"sd": 0.02, "sd_reachable": 0.03, "spread": 1.0}}
    assert suggest._wanted(Question(confidence=0.01), unsure)
    far = {"Cm": {"sd": 0.02, "sd_reachable": 0.12, "spread": 1.0}}
    assert suggest._wanted(Question(confidence=0.1), far)
    assert not suggest._wanted(Question(confidence=0.1), unsure)
    assert suggest._wanted(Question(confidence=0.1, target="Cm"), unsure)
    assert suggest._wanted(Question(confidence=0.1, region="alpha=1:2"), unsure)
    document, _ = planned
    found = findings({**document, "maneuvers": []})
    assert [item.topic for item in found] == ["Nothing to fly"]
    assert "without what no flight changes" in found[0].text


def test_without_an_envelope_nothing_is_suggested(tmp_path) -> None:
    with pytest.raises(RefusedError, match=r"no \[envelope\]"):
        run(saved(tmp_path, envelope=None), tmp_path / "out")


def test_what_can_be_asked_for() -> None:
    level = {"alpha": 0.05, "qhat": 0.0, "elevator": 0.0, "V": 20.0}
    assert chosen(model(), None, None, level).coefficients == ("Cl", "Cm", "Cn")
    assert chosen(model(), "CZ", None, level).coefficients == ("CZ",)
    [form] = chosen(model(), "Cm.qhat", None, level).questions["Cm"]
    assert form.argmax() == 2 * 4 + 2
    region = chosen(model(), "Cm", "alpha=6:8", level).region
    np.testing.assert_allclose(region["alpha"], np.radians([6.0, 8.0]))
    with pytest.raises(UsageError, match="CX, CY, CZ, Cl, Cm, Cn; name"):
        chosen(model(), "CD", None, level)
    with pytest.raises(UsageError, match="no pair of limits"):
        chosen(model(), "Cm", "alpha=6", level)


def test_gusts_are_those_of_the_flight(tmp_path) -> None:
    folder = saved(tmp_path)
    assert suggest._gust(folder / "model", None)["source"] == "assumed"
    told = {"reconstruction": {"gust_sd": {"value": 0.7}}}
    (folder / "summary.json").write_text(json.dumps(told))
    assert suggest._gust(folder / "model", None)["value"] == 0.7
    assert suggest._gust(folder, 1.5) == {"value": 1.5, "source": "asked for"}
