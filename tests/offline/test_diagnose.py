"""The whole diagnosis on flights of the simulated aircraft, one with an effect hidden in it.

The aircraft flies in calm air with vanes for a minute and a half. What is hidden stands in the
simulator only; the finding side gets the recording and the aircraft file.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.aircraft_toml.section import Section
from gcs_sysid.cli import entry, numerics, reports
from gcs_sysid.errors import RefusedError, UsageError
from gcs_sysid.offline import diagnose, investigation, simulate, tested
from gcs_sysid.offline.leads import Lead, RestlessError
from gcs_sysid.report import sheet
from gcs_sysid.report.diagnose import findings
from tests.offline.test_investigation import Asked

pytest.importorskip("jsbsim", reason="needs the extra `sitl`")

from gcs_sysid.sitl import plan, record, scenario
from gcs_sysid.sitl.effects import catalogue
from gcs_sysid.sitl.flight import Flight

ROOT = Path(__file__).resolve().parents[2]
SHIFT = 0.10
"""Centre of gravity forward of where the file has it [mean chords]."""


def believed() -> Aircraft:
    """The Ultra Stick with aerodynamics known to a tenth."""
    file = aircraft_file.load(ROOT / "data" / "aircraft" / "ultra_stick_25e.toml")
    models = {
        name: replace(
            model,
            terms={
                key: replace(item, sigma=0.1 * abs(item.value)) for key, item in model.terms.items()
            },
        )
        for name, model in file.aerodynamics.items()
    }
    return replace(file, aerodynamics=models)


def silent(*_: object) -> None:
    """Progress that nobody watches."""


def diagnosed(folder: Path, name: str, effects: list[dict], seed: int) -> dict:
    file = believed()
    legs = plan.standard(file)[:4]
    made = Flight(
        believed=file,
        flown=file,
        legs=legs,
        start=scenario.start(legs[0]),
        wind=scenario.wind(1.0, 3.0, 0.0),
        seed=seed,
    )
    made = catalogue.hide(made, [Section("effect.toml", "", effect) for effect in effects])
    record.run(made, record=folder / f"{name}.tlog")
    aircraft_file.save(file, folder / "aircraft.toml")
    return diagnose.run(
        [folder / f"{name}.tlog"],
        aircraft=folder / "aircraft.toml",
        model=None,
        holdout=None,
        vehicle=None,
        segments=None,
        out=folder / name,
        progress=silent,
        method="coefficients",
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("diagnosed")


@pytest.fixture(scope="module")
def hidden(folder) -> dict:
    return diagnosed(folder, "hidden", [{"name": "cg_shift", "cg_x_chord": SHIFT}], 31)


@pytest.fixture(scope="module")
def clean(folder) -> dict:
    return diagnosed(folder, "clean", [], 32)


@pytest.mark.slow
def test_a_hidden_effect_is_found_and_sized(hidden) -> None:
    assert hidden["verdict"] == "effect"
    assert hidden["cause"] == "cg_shift"
    assert hidden["effects"] == hidden["indistinguishable"] == ["cg_shift"]
    assert hidden["ranking"][0]["log_bayes_factor"] > np.log(20.0)
    found = hidden["ranking"][0]["parameters"]["cg_x_chord"]
    assert found["unit"] == "mean chords"
    assert abs(found["value"] - SHIFT) < 3.0 * found["sd"]
    gain = hidden["gain"]
    assert gain["holdout_nlpd_after"] < gain["holdout_nlpd_before"]
    assert gain["holdout_error_after"] < gain["holdout_error_before"]
    assert hidden["discrepancy"]["Cm"]["after"] < 0.5 * hidden["discrepancy"]["Cm"]["before"]


@pytest.mark.slow
def test_a_simulation_that_the_filter_cannot_follow_accuses_nobody(
    hidden, folder, monkeypatch
) -> None:
    """Coefficients would: seen with a file whose servos were ten times too quick, they made a mass
    and a centre of gravity of it at 99 %."""

    def lost(*_given: object, **_named: object) -> None:
        raise RestlessError("hidden.tlog", [Lead("departures.offset.0", -0.04, 0.009, "rad")])

    monkeypatch.setattr(diagnose.gust_diagnosis, "diagnosed", lost)
    found = diagnose.run(
        [folder / "hidden.tlog"],
        aircraft=folder / "aircraft.toml",
        model=None,
        holdout=None,
        vehicle=None,
        segments=None,
        out=folder / "lost",
        progress=silent,
        method="filter",
    )
    assert found["verdict"] == "insufficient_data"
    assert found["effects"] == []
    # Coefficients favour a cause, and nothing being wrong is not what is said either.
    assert found["ranking"][0]["causes"] == ["cg_shift"]
    assert found["probability"] < 0.1
    assert "cannot follow" in findings(found)[0].text
    assert found["unlisted"] is None
    assert any("found no rest" in text for text in found["warnings"])
    (lead,) = found["stands_out"]
    assert (lead["label"], lead["off"]) == ("the offset of the elevator", -0.04)
    # The file stays as it is, and so does what it is off by.
    gain = found["gain"]
    assert gain["holdout_error_after"] == gain["holdout_error_before"]
    assert gain["holdout_nlpd_after"] == gain["holdout_nlpd_before"]
    assert aircraft_file.load(folder / "lost" / "aircraft-extended.toml").mass.cg == (0.0, 0.0, 0.0)


@pytest.mark.slow
def test_who_stops_it_keeps_what_is_known(hidden, folder, monkeypatch, capsys) -> None:
    """Stopped while the second favourite is put to the test: see `Question`."""
    monkeypatch.setattr(investigation, "Asked", Asked)
    monkeypatch.setattr(numerics, "keep_freed_memory", lambda: None)
    out = folder / "stopped"
    flight, file = str(folder / "hidden.tlog"), str(folder / "aircraft.toml")
    assert entry.main(["diagnose", flight, "--aircraft", file, "--out", str(out)]) == 130
    said = capsys.readouterr().err
    assert said == f"gcs-sysid: stopped; what was known by then is in {out / 'diagnosis.json'}\n"
    assert [path.name for path in out.iterdir()] == ["diagnosis.json"]
    found = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    assert found["complete"] is False
    assert hidden["complete"] is True
    assert set(found["ranking"][0]["causes"]) == {"mass", "cg_shift"}
    assert found["flights"] == hidden["flights"]
    assert (found["verdict"], found["effects"]) == ("insufficient_data", [])
    assert "stopped before the end" in found["warnings"][0]


@pytest.mark.slow
def test_another_flight_judges_and_takes_no_part(hidden, clean, folder, monkeypatch) -> None:
    """By the filter, which gives up here, and then by coefficients."""
    asked = []

    def lost(_aircraft: object, _flights: object, *given: object, **_named: object) -> None:
        asked.append([list(each) for each in given[:2]])
        raise RefusedError("hidden.tlog", "the model lost the aircraft", fix="check the signs")

    monkeypatch.setattr(investigation, "investigate", lost)
    found = diagnose.run(
        [folder / "hidden.tlog"],
        aircraft=folder / "aircraft.toml",
        model=None,
        holdout=folder / "clean.tlog",
        vehicle=None,
        segments=None,
        out=folder / "apart",
        progress=silent,
        method="filter",
    )
    of_flight = [[], []]
    for item in found["maneuvers"]:
        of_flight[item["flight"]].append(item)
    assert [len(each) for each in of_flight] == [len(one["maneuvers"]) for one in (hidden, clean)]
    assert [{item["held_out"] for item in each} for each in of_flight] == [{False}, {True}]
    assert asked == [[[True, False], [item["id"] for item in of_flight[1]]]]
    table = pq.read_table(folder / "apart" / "residuals.parquet")
    assert set(table["flight"].to_pylist()) == {0, 1}


@pytest.mark.slow
def test_the_extended_file_holds_the_effect_and_nothing_else(hidden, folder) -> None:
    extended = aircraft_file.load(folder / "hidden" / "aircraft-extended.toml")
    file = aircraft_file.load(folder / "aircraft.toml")
    found = hidden["ranking"][0]["parameters"]["cg_x_chord"]["value"]
    assert extended.mass.cg[0] == pytest.approx(found * file.geometry.mean_chord, rel=1e-6)
    unmoved = replace(extended, mass=replace(extended.mass, cg=file.mass.cg))
    assert aircraft_file.dumps(unmoved) == aircraft_file.dumps(file)


@pytest.mark.slow
def test_the_patch_holds_what_changed_and_nothing_else(hidden, clean, folder) -> None:
    text = (folder / "hidden" / "aircraft-extended.patch").read_text(encoding="utf-8")
    assert text.splitlines() == hidden["changes"]
    assert hidden["changes"][:2] == ["--- aircraft.toml", "+++ aircraft-extended.toml"]
    added = [line for line in hidden["changes"][2:] if line.startswith(("+", "-"))]
    assert added
    assert all(line[1:].startswith("cg = ") for line in added)
    assert clean["changes"] == []
    assert (folder / "clean" / "aircraft-extended.patch").read_text(encoding="utf-8") == ""


@pytest.mark.slow
def test_the_extended_file_flies_the_flight_better(hidden, folder) -> None:
    """`simulate` reads back what `diagnose` wrote, and pitches as measured with it."""
    scores = {}
    for name, file in (
        ("believed", folder / "aircraft.toml"),
        ("extended", folder / "hidden" / "aircraft-extended.toml"),
    ):
        scores[name] = simulate.run(
            folder / "hidden.tlog",
            aircraft=file,
            model=None,
            vehicle=None,
            segments=None,
            out=folder / name,
            progress=silent,
        )
    before, after = (scores[name]["channels"]["alpha"] for name in ("believed", "extended"))
    assert after["rms"] < 0.5 * before["rms"]
    assert after["pass"]
    # What is left is the error of the size, which is known to a tenth only.
    assert len(scores["extended"]["departures"]) < 0.5 * len(scores["believed"]["departures"])
    first = scores["believed"]["departures"][0]
    table = pq.read_table(folder / "believed" / "simulated.parquet")
    rows = {name: table[name].to_numpy() for name in table.column_names}
    # Elevator in all lines of a multisine, for longest: nothing moves more.
    of = next(one for one in scores["believed"]["maneuvers"] if one["id"] == first["maneuver"])
    assert (of["kind"], first["channel"]) == ("multisine", "theta")
    assert first["region"].startswith("multisine at 15 m/s, alpha ")
    assert of["start_s"] <= first["t_s"] <= of["start_s"] + of["duration_s"]
    # It is when theta leaves its tolerance: the table has every other instant.
    window = rows["window"][np.argmin(np.abs(rows["t"] - first["t_s"]))]
    one = rows["window"] == window
    error = np.abs(rows["theta"] - rows["theta_measured"])[one]
    left = rows["t"][one][error > first["tolerance"]]
    assert first["t_s"] == pytest.approx(left[0], abs=0.0101)
    assert abs(first["size"]) == pytest.approx(error.max(), rel=0.02)
    before, after = (scores[name]["coefficients"]["Cm"] for name in ("believed", "extended"))
    assert after["rms"] < 0.5 * before["rms"]
    moved = scores["extended"]["frequency"]["q"]
    assert moved["band_hz"][0] < 1.0 < moved["band_hz"][1]
    assert moved["gain"] == pytest.approx(1.0, abs=0.15)
    text = reports.sheet("simulate", scores["believed"], folder / "believed" / "simulated.parquet")
    assert "departs" in text
    page = (folder / "believed" / "report.html").read_text(encoding="utf-8")
    assert len(page) > 1e5
    assert "In frequency" in page
    assert "band, Hz" in page


@pytest.mark.slow
def test_a_clean_flight_accuses_nobody(clean) -> None:
    assert clean["verdict"] in ("no_effect", "insufficient_data")
    assert clean["cause"] == "none"
    assert clean["effects"] == []
    assert clean["unlisted"] is None
    assert clean["ranking"][0]["causes"] == ["none"]
    assert clean["gain"]["holdout_nlpd_after"] == clean["gain"]["holdout_nlpd_before"]


@pytest.mark.slow
def test_documents_and_report(hidden, folder) -> None:
    out = folder / "hidden"
    assert json.loads((out / "diagnosis.json").read_text()) == hidden
    table = pq.read_table(out / "residuals.parquet")
    assert {"time_us", "Cm_before", "Cm_after", "Cm_measured"} <= set(table.column_names)
    text = reports.sheet("diagnose", hidden, out / "residuals.parquet")
    assert len(text.splitlines()) <= 10
    assert "mean chords forward" in text
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Explanations" in page
    assert "aircraft-extended.toml" in page
    assert "The file put right" in page
    assert "+cg = " in page


@pytest.mark.slow
def test_findings_of_a_clean_flight_name_nobody(clean) -> None:
    text = sheet.lines(findings(clean), clean["warnings"], "report.html")
    assert "Cause" not in text
    assert text.splitlines()[-1].endswith("report.html")


def test_there_must_be_one_simulation_to_test(tmp_path) -> None:
    with pytest.raises(UsageError, match="either --aircraft FILE or --model DIR"):
        tested.load(None, None)
    with pytest.raises(UsageError, match="either --aircraft FILE or --model DIR"):
        tested.load(tmp_path, tmp_path)


def test_a_file_without_aerodynamics_is_no_simulation(tmp_path) -> None:
    aircraft_file.save(replace(believed(), aerodynamics={}), tmp_path / "bare.toml")
    with pytest.raises(RefusedError, match="no simulation to test"):
        tested.load(tmp_path / "bare.toml", None)


def test_several_flights_need_no_segments_file(tmp_path) -> None:
    log = tmp_path / "flight.tlog"
    shutil.copy(__file__, log)
    with pytest.raises(UsageError, match="--segments goes with one LOG"):
        diagnose.run(
            [log, log],
            aircraft=log,
            model=None,
            holdout=None,
            vehicle=None,
            segments=log,
            out=tmp_path,
            progress=silent,
            method="coefficients",
        )
