"""An aircraft that nobody here made: JSBSim's Cessna 172, asked, flown, recorded and identified."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import jsbsim
import numpy as np
import pytest

from data.scripts import jsbsim_shipped
from data.scripts.jsbsim_shipped import Derived
from gcs_sysid import aircraft_file
from gcs_sysid.errors import UsageError
from gcs_sysid.sitl import record, scenario, units
from gcs_sysid.sitl.jsbsim_aircraft import STEP, Start, Wind
from gcs_sysid.sitl.shipped import ShippedAircraft
from gcs_sysid.sitl.truth import Truth

MODEL = "c172p"


def published(name: str) -> float:
    """The constant of one of the model's own coefficients."""
    file = Path(jsbsim.get_default_root_dir()) / "aircraft" / MODEL / f"{MODEL}.xml"
    for function in ElementTree.parse(file).iter("function"):
        if function.get("name") == f"aero/coefficient/{name}":
            return float(list(function.iter("value"))[-1].text or "")
    raise KeyError(name)


@pytest.fixture(scope="module")
def derived() -> Derived:
    return jsbsim_shipped.derive(MODEL, airspeed=52.0)


def test_its_file_has_no_aerodynamics_and_is_read_back(derived, tmp_path):
    assert not derived.told.aerodynamics
    aircraft_file.save(derived.told, tmp_path / "aircraft.toml")
    read = aircraft_file.load(tmp_path / "aircraft.toml")
    assert read.mass == derived.told.mass
    assert read.propulsion[0].thrust == derived.told.propulsion[0].thrust
    assert read.geometry.wing_area == pytest.approx(174.0 * units.FOOT**2, rel=1e-3)
    # 1500 lb empty, a pilot of 180 lb and 200 lb of fuel.
    assert read.mass.mass == pytest.approx(1880.0 * units.SLUG / units.JSBSIM_SLUG_WEIGHT, rel=1e-3)
    elevator = next(servo for servo in read.servos if servo.surface == "elevator")
    assert np.degrees(elevator.deflection) == pytest.approx([-28.0, 0.0, 23.0], abs=0.02)


def test_derivatives_asked_of_it_are_those_of_its_own_file(derived):
    """About the centre of gravity, 2.8 cm ahead of and 55 cm below the model's own point."""
    terms = {
        name: {key: value.value for key, value in model.terms.items()}
        for name, model in derived.flown.aerodynamics.items()
    }
    assert terms["Cl"]["aileron"] == pytest.approx(published("ClDa"), rel=1e-3)
    assert terms["Cn"]["aileron"] == pytest.approx(published("Cnda"), rel=1e-3)
    assert terms["CY"]["rudder"] == pytest.approx(published("CYdr"), rel=1e-3)
    arm = 21.66 * units.INCH / derived.told.geometry.wing_span
    roll = published("Clp") + arm * terms["CY"]["phat"]
    assert terms["Cl"]["phat"] == pytest.approx(roll, rel=3e-3)
    # Placed with a pitch rate, alpha turns with it; the lift by both has a lever of 2.8 cm.
    damping = published("Cmq") + published("Cmadot")
    assert terms["Cm"]["qhat"] == pytest.approx(damping, rel=0.01)
    sideways = published("Cldr") + arm * published("CYdr")
    assert terms["Cl"]["rudder"] == pytest.approx(sideways, rel=3e-3)


def test_surfaces_stand_where_they_are_told(derived):
    flying = ShippedAircraft(MODEL, start=Start(airspeed=50.0), wind=Wind(), seed=0)
    wanted = {"elevator": -0.11, "aileron": 0.07, "rudder": 0.2}
    flying.advance(wanted, [0.5])
    flying.advance(wanted, [0.5])
    found = [
        flying.property(f"fcs/{name}-pos-rad") for name in ("elevator", "left-aileron", "rudder")
    ]
    assert found == pytest.approx(list(wanted.values()), rel=1e-9)


def test_its_forces_move_it(derived):
    """Coefficients and thrust are all there is beside weight: Newton's second law along y and z."""
    flying = ShippedAircraft(MODEL, start=Start(airspeed=50.0, alpha=0.02), wind=Wind(), seed=0)
    for _ in range(round(2.0 / STEP)):
        flying.advance({"elevator": 0.03, "rudder": 0.05}, [0.6])
    state = flying.state()
    scale = state.qbar * 174.0 * units.FOOT**2
    assert state.CZ * scale == pytest.approx(state.force_z, rel=1e-3)
    assert state.CX * scale + flying.thrusts()[0] == pytest.approx(state.force_x, rel=1e-2)
    assert abs(state.CY) > 0.003


def test_an_aircraft_that_is_not_there_is_refused():
    with pytest.raises(UsageError, match="aircraft `c1`"):
        ShippedAircraft("c1", start=Start(), wind=Wind(), seed=0)


@pytest.fixture(scope="module")
def recorded(derived, tmp_path_factory) -> tuple[Path, Truth]:
    """Three quarters of a minute at one airspeed: the folder of log and file, and the truth."""
    folder = tmp_path_factory.mktemp(MODEL)
    whole = jsbsim_shipped.flight(derived, MODEL, wind=scenario.wind(4.7, 4.0, 0.0), seed=0)
    legs = (dataclasses.replace(whole.legs[5], duration=24.0), whole.legs[7])
    short = dataclasses.replace(
        whole,
        legs=legs,
        start=dataclasses.replace(scenario.start(legs[0]), heading=legs[0].heading),
    )
    truth = record.run(short, record=folder / "flight.tlog").truth
    aircraft_file.save(derived.told, folder / "aircraft.toml")
    return folder, truth


def test_the_truth_of_a_flight_holds_the_derivatives_of_its_own_file(derived, recorded):
    """Least squares on what really happened; its elevator stands in the propeller's stream."""
    at = recorded[1].column
    geometry = derived.told.geometry
    chord, span = (length / (2.0 * at("V")) for length in (geometry.mean_chord, geometry.wing_span))
    thrust = at("thrust") / (at("qbar") * geometry.wing_area)
    turning = np.gradient(at("alpha"), 0.02) * chord
    pitch = [at("alpha"), at("q_air") * chord, turning, at("elevator"), at("elevator") * thrust]
    found = fitted(at("Cm"), pitch)
    # Linear in the thrust here, the square of an induced velocity there; lift has a small lever.
    assert found[1] == pytest.approx(published("Cmq"), rel=0.05)
    assert found[2] == pytest.approx(published("Cmadot"), rel=0.10)
    assert found[3] == pytest.approx(published("Cmde"), rel=0.05)
    assert found[4] < -2.0
    rates = [at(name) * span for name in ("p_air", "r_air")]
    roll = fitted(at("Cl"), [at("beta"), *rates, at("aileron"), at("rudder")])
    terms = derived.flown.aerodynamics["Cl"].terms
    assert roll[1] == pytest.approx(terms["phat"].value, rel=0.05)
    assert roll[3] == pytest.approx(published("ClDa"), rel=0.05)


def fitted(values, columns):
    """Least squares with a constant; the coefficients of the columns."""
    design = np.stack([np.ones_like(values), *columns], axis=1)
    return np.linalg.lstsq(design, values, rcond=None)[0][1:]


@pytest.fixture(scope="module")
def identified(recorded) -> dict[str, Any]:
    """What `identify` makes of the recording, as a user has it."""
    folder, _ = recorded
    command = [sys.executable, "-m", "gcs_sysid", "identify", "flight.tlog", "--prior", "none"]
    command += ["--aircraft", "aircraft.toml", "--out", "out"]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=280, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "out" / "summary.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_identified_it_has_the_derivatives_of_its_own_file(derived, identified):
    """Within three standard deviations, and none of them wide."""
    terms = {
        name: {key: value.value for key, value in model.terms.items()}
        for name, model in derived.flown.aerodynamics.items()
    }
    found = identified["derivatives"]
    for coefficient, key, widest in (
        ("CZ", "alpha", 0.10),
        ("CY", "beta", 0.10),
        ("CY", "rudder", 0.10),
        ("Cl", "phat", 0.20),
        ("Cl", "aileron", 0.20),
        ("Cm", "alpha", 0.20),
        ("Cn", "beta", 0.20),
    ):
        value, sd = (found[coefficient][key][name] for name in ("value", "sd"))
        wanted = terms[coefficient][key]
        assert sd < widest * abs(wanted), (coefficient, key)
        # Beside the scatter: its own tables bend over the angles flown, by up to 4 %.
        assert abs(value - wanted) < 3.0 * sd + 0.04 * abs(wanted), (coefficient, key)
