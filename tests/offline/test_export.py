"""Linear models and JSBSim models on disk, read by the tools that they are for."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import io

from gcs_sysid import aircraft_file
from gcs_sysid.atmosphere import GRAVITY
from gcs_sysid.cli import entry
from gcs_sysid.maneuvers.information import lasting
from gcs_sysid.model import eigenmodes
from gcs_sysid.model.eigenmodes import Uncertain
from gcs_sysid.offline import export, linear_models, model_store, tested
from gcs_sysid.offline.model_store import StoredModel
from gcs_sysid.sitl import jsbsim_xml
from gcs_sysid.sitl.jsbsim_aircraft import JsbsimAircraft, Start
from tests.model.made_linear import AIRSPEED, flying
from tests.offline import made_models


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """An aircraft file, and a model of some of its coefficients."""
    out = tmp_path_factory.mktemp("export")
    aircraft = flying()
    (out / "made.toml").write_text(aircraft_file.dumps(aircraft), encoding="utf-8")
    model_store.save(out / "found" / "model", StoredModel(made_models.model(), aircraft, 0.0, []))
    return out


@pytest.fixture(scope="module")
def exported(folder):
    target = folder / "made.json"
    arguments = ["export", "--aircraft", str(folder / "made.toml"), "--to", "control"]
    speeds = ["--airspeed", str(AIRSPEED), "--airspeed", "25"]
    assert entry.main([*arguments, *speeds, "--out", str(target)]) == 0
    return json.loads(target.read_text(encoding="utf-8"))


def test_python_control_loads_it_without_this_program(exported) -> None:
    """Its own poles are the modes told."""
    control = pytest.importorskip("control")
    slow, fast = exported["models"]
    system = control.ss(
        slow["A"], slow["B"], slow["C"], slow["D"],
        states=slow["states"], inputs=slow["inputs"], outputs=slow["outputs"],
    )  # fmt: skip
    told = [complex(r["real"], r["imag"]) for mode in slow["modes"] for r in mode["roots"]]
    np.testing.assert_allclose(np.sort_complex(system.poles()), np.sort_complex(np.array(told)))
    assert slow["airspeed"] == AIRSPEED
    assert fast["airspeed"] == 25.0
    short = {mode["name"]: mode for mode in slow["modes"]}["short period"]
    faster = {mode["name"]: mode for mode in fast["modes"]}["short period"]
    ratio = faster["frequency"]["value"] / short["frequency"]["value"]
    assert ratio == pytest.approx(25.0 / AIRSPEED, rel=0.02)


def test_matlab_has_the_same(folder, exported) -> None:
    target = folder / "made.mat"
    export.write(exported, "matlab", target)
    models = io.loadmat(target, squeeze_me=True)["models"]
    for read, one in zip(models, exported["models"], strict=True):
        for name in ("A", "B", "C", "D", "A_sd", "B_sd", "trim_states"):
            np.testing.assert_allclose(read[name], one[name])
        assert list(read["states"]) == one["states"]
        assert list(read["input_units"]) == one["input_units"]
        assert [str(mode["name"]) for mode in read["modes"]] == [m["name"] for m in one["modes"]]
        assert float(read["bank"]) == 0.0
        assert float(read["load_factor"]) == pytest.approx(1.0, rel=0.02)


def test_matlab_has_every_mode_of_the_model_with_its_intervals(folder, exported) -> None:
    """Numbers and deviations as of the linear model itself; NaN where there are none."""
    target = folder / "modes.mat"
    export.write(exported, "matlab", target)
    read = io.loadmat(target, squeeze_me=True)["models"][0]["modes"]
    _, (linear,) = linear_models.models(
        folder / "made.toml", None, airspeeds=[AIRSPEED], height=100.0
    )
    modes = eigenmodes.modes(linear)
    assert {mode.name for mode in modes} == {
        "short period", "phugoid", "roll", "dutch roll", "spiral",
    }  # fmt: skip
    for there, mode in zip(read, modes, strict=True):
        assert str(there["name"]) == mode.name
        for name, wanted in (("frequency", mode.frequency), ("damping", mode.damping)):
            if np.isnan(wanted.value):
                assert np.isnan(float(there[name])), (mode.name, name)
            else:
                _same(there[name], wanted)
        told = np.atleast_1d(there["time_constants"])
        for one, wanted in zip(told, mode.time_constants, strict=True):
            _same(one, wanted)
        assert bool(there["stable"]) == mode.stable
        for root, value, deviation in zip(
            np.atleast_1d(there["roots"]), mode.roots, mode.root_deviations, strict=True
        ):
            assert complex(float(root["real"]), float(root["imag"])) == pytest.approx(value)
            assert (float(root["real_sd"]), float(root["imag_sd"])) == pytest.approx(deviation)


def _same(there: np.ndarray, wanted: Uncertain) -> None:
    assert wanted.deviation > 0.0
    assert float(there["value"]) == pytest.approx(wanted.value, rel=1e-9)
    assert float(there["sd"]) == pytest.approx(wanted.deviation, rel=1e-6)


def test_a_turn_and_a_climb_are_written_with_their_condition(folder, capsys) -> None:
    target = folder / "turn.json"
    arguments = ["export", "--aircraft", str(folder / "made.toml"), "--to", "control"]
    condition = ["--airspeed", str(AIRSPEED), "--bank", "30", "--climb", "4"]
    assert entry.main([*arguments, *condition, "--out", str(target)]) == 0
    assert "at 20.0 m/s, 100 m, bank 30°, climb 4.0°:" in capsys.readouterr().out
    [one] = json.loads(target.read_text(encoding="utf-8"))["models"]
    assert np.rad2deg([one["bank"], one["climb"]]) == pytest.approx([30.0, 4.0])
    assert one["turn_rate"] == pytest.approx(GRAVITY * np.tan(one["bank"]) / AIRSPEED, rel=0.02)
    # Of what is felt in the aircraft, whose nose points up, a little is along it.
    assert one["load_factor"] == pytest.approx(1.0 / np.cos(np.pi / 6.0), rel=0.03)
    state = dict(zip(one["states"], one["trim_states"], strict=True))
    assert state["phi"] == pytest.approx(one["bank"])
    body = [state["p"], state["q"], state["r"]]
    assert np.linalg.norm(body) == pytest.approx(one["turn_rate"])
    assert {mode["name"] for mode in one["modes"]} >= {"short period", "roll", "dutch roll"}
    assert all(value >= 0.0 for row in one["A_sd"] for value in row)


def test_what_was_identified_has_its_own_intervals(folder, capsys) -> None:
    """sd of M_q is that of Cm_qhat, without the error of inertia, which cancels."""
    target = folder / "found.json"
    arguments = ["export", "--model", str(folder / "found"), "--to", "control", "--json"]
    assert entry.main([*arguments, "--airspeed", "25", "--out", str(target)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads(target.read_text(encoding="utf-8"))
    [one] = document["models"]
    fit = made_models.model().fits["Cm"]
    place = fit.keys.index("qhat")
    own = np.sqrt((fit.covariance - lasting(fit))[place, place]) / abs(fit.value[place])
    q = one["states"].index("q")
    assert one["A_sd"][q][q] / abs(one["A"][q][q]) == pytest.approx(own, rel=0.05)


def test_jsbsim_flies_the_identified_coefficients(folder) -> None:
    """What JSBSim computes from the file is what the model says, to 1e-6."""
    target = folder / "found.xml"
    arguments = ["export", "--model", str(folder / "found"), "--to", "jsbsim"]
    assert entry.main([*arguments, "--out", str(target)]) == 0
    described = tested.load(None, folder / "found").aircraft
    assert target.read_text(encoding="utf-8") == jsbsim_xml.model_xml(described)
    flying_there = JsbsimAircraft(
        described, start=Start(airspeed=20.0, elevation=0.0, height=200.0, alpha=0.05)
    )
    fdm = flying_there._fdm
    values = {"alpha": 0.06, "beta": 0.03, "elevator": -0.05, "aileron": 0.04, "rudder": 0.0}
    for name in ("elevator", "aileron", "rudder"):
        fdm[jsbsim_xml.control_property(name)] = values[name]
    for name, value in (("alpha-rad", 0.06), ("beta-rad", 0.03), ("vt-fps", 20.0 / 0.3048)):
        fdm[f"ic/{name}"] = value
    for name, value in (("p", 0.4), ("q", 0.3), ("r", -0.2)):
        fdm[f"ic/{name}-rad_sec"] = value
    fdm.run_ic()
    speed, shape = fdm["velocities/vt-fps"] * 0.3048, described.geometry
    flow = {
        "alpha": fdm["aero/alpha-rad"],
        "beta": fdm["aero/beta-rad"],
        "phat": 0.4 * shape.wing_span / (2.0 * speed),
        "qhat": 0.3 * shape.mean_chord / (2.0 * speed),
        "rhat": -0.2 * shape.wing_span / (2.0 * speed),
        **{name: values[name] for name in ("elevator", "aileron", "rudder")},
    }
    wanted = made_models.model().predict(
        {name: np.array([value]) for name, value in flow.items()}, measured=False
    )
    for name, prediction in wanted.items():
        told = fdm[jsbsim_xml.coefficient_property(name)]
        assert told == pytest.approx(float(prediction.mean[0]), rel=1e-6, abs=1e-6), name


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--to", "control"], "--model DIR"),
        (["--aircraft", "made.toml", "--to", "control", "--airspeed", "90"], "cannot fly level"),
        (
            ["--aircraft", "made.toml", "--to", "control", "--airspeed", "20", "--climb", "40"],
            "cannot fly straight with a climb angle of 40°",
        ),
        (["--aircraft", "made.toml", "--to", "control", "--out", "made.toml"], "both read and"),
    ],
)
def test_what_cannot_be_is_one_line(folder, monkeypatch, capsys, options, word) -> None:
    monkeypatch.chdir(folder)
    assert entry.main(["export", *options]) in (1, 2)
    told = capsys.readouterr().err
    assert word in told
    assert told.count("\n") == 1


def test_modes_in_the_summary_are_those_of_the_exported_model(folder) -> None:
    _, (linear,) = linear_models.models(None, folder / "found", airspeeds=[AIRSPEED], height=100.0)
    exported = linear_models.document(linear)
    stored = model_store.load(folder / "found")
    told = linear_models.modes(stored, AIRSPEED, 100.0, exported["density"])
    assert told["reason"] is None
    assert told["modes"] == exported["modes"]


def test_what_cannot_fly_level_has_no_modes_and_says_why(folder) -> None:
    stored = model_store.load(folder / "found")
    glider = replace(stored, aircraft=replace(stored.aircraft, propulsion=()))
    assert "cannot fly level" in linear_models.modes(glider, AIRSPEED, 100.0, 1.2)["reason"]
    bare = replace(stored, aircraft=replace(stored.aircraft, aerodynamics={}))
    told = linear_models.modes(bare, AIRSPEED, 100.0, 1.2)
    assert told["modes"] == []
    assert told["reason"].startswith("nothing is known of")
    lost = linear_models.modes(stored, float("nan"), 100.0, 1.2)
    assert lost["reason"].startswith("no steady flight")
