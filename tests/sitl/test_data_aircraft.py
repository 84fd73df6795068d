"""Every aircraft in `data/` flies, is described in the manifest, and answers its controls."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.sitl import plan, record, scenario
from gcs_sysid.sitl.flight import Flight
from gcs_sysid.sitl.inputs import TestInput
from gcs_sysid.sitl.jsbsim_aircraft import Start
from gcs_sysid.sitl.link import Link
from gcs_sysid.sitl.slopes import slopes, trim
from tests.sitl import examples

AIRCRAFT = sorted((examples.ROOT / "data" / "aircraft").glob("*.toml"))


@pytest.mark.parametrize("path", AIRCRAFT, ids=lambda path: path.stem)
def test_it_flies_level_and_rolls_right(path):
    aircraft = aircraft_file.load(path)
    assert aircraft.envelope is not None
    leg = plan.standard(aircraft)[4]
    test = TestInput(
        "aileron", "step", 3.0, 0.4, plan.amplitudes(slopes(aircraft, leg.airspeed))["aileron"]
    )
    level = dataclasses.replace(leg, duration=4.0, heading=0.0, inputs=(test,))
    start = Start(airspeed=level.airspeed, height=level.height)
    flight = Flight(aircraft, aircraft, (level,), start=start, link=Link(loss=0.0))
    truth = record.fly(flight).truth
    steady = slice(0, 150)
    low, high = aircraft.envelope.alpha
    assert low < truth.column("alpha")[steady].min() < truth.column("alpha")[steady].max() < high
    bank = truth.column("phi")[steady] - trim(aircraft, level.airspeed).bank
    assert np.abs(bank).max() < math.radians(5.0)
    assert truth.column("V")[steady] == pytest.approx(level.airspeed, rel=0.1)
    assert truth.column("p")[150:175].max() > 0.1


@pytest.mark.parametrize("path", AIRCRAFT, ids=lambda path: path.stem)
def test_it_turns_and_is_shaken_in_gusty_wind_and_stays_in_its_envelope(path):
    """12 kt of wind and the turbulence that comes with it (MIL-F-8785C)."""
    aircraft = aircraft_file.load(path)
    envelope = aircraft.envelope
    assert envelope is not None
    turn, shaken = plan.standard(aircraft)[6:8]
    legs = (
        dataclasses.replace(turn, duration=7.0),
        dataclasses.replace(shaken, duration=9.0),
    )
    flight = Flight(
        aircraft,
        aircraft,
        legs,
        start=Start(airspeed=turn.airspeed, height=turn.height, heading=turn.heading - 2.0),
        wind=scenario.wind(1.0, 6.2, 0.62),
        seed=3,
    )
    truth = record.fly(flight).truth
    airspeed = truth.column("V")
    assert envelope.airspeed[0] < airspeed.min() < airspeed.max() < envelope.airspeed[1]
    # Gusts of three sigma add 0.62·3/V to the angle of attack.
    margin = 3.0 * 0.62 / turn.airspeed
    assert truth.column("alpha").max() < envelope.alpha[1] + margin
    assert truth.column("alpha").min() > envelope.alpha[0] - margin
    assert np.abs(truth.column("phi")).max() < envelope.bank + math.radians(15.0)
    assert airspeed[-250:].mean() == pytest.approx(turn.airspeed, rel=0.07)


def test_the_manifest_describes_every_aircraft():
    manifest = (examples.ROOT / "data" / "MANIFEST.md").read_text(encoding="utf-8")
    headings = [line for line in manifest.splitlines() if line.startswith("## aircraft/")]
    for path in AIRCRAFT:
        assert any(path.name in heading for heading in headings), path.name


def test_published_slopes_of_the_flying_wing_reach_body_axes():
    """Against the published polars at small angles, both ways round."""
    aircraft = aircraft_file.load(examples.ROOT / "data" / "aircraft" / "skywalker_x8.toml")
    terms = {name: model.terms for name, model in aircraft.aerodynamics.items()}
    for alpha in (-0.05, 0.0, 0.08):
        lift, drag = 0.0867 + 4.0203 * alpha, 0.0197 + 0.0791 * alpha + 1.0555 * alpha**2
        CX = -drag * math.cos(alpha) + lift * math.sin(alpha)
        CZ = -lift * math.cos(alpha) - drag * math.sin(alpha)
        x = {key: value.value for key, value in terms["CX"].items()}
        z = {key: value.value for key, value in terms["CZ"].items()}
        # Left out are terms of third order, and one of second order of CZ: 0.04·α².
        assert x["1"] + x["alpha"] * alpha + x["alpha^2"] * alpha**2 == pytest.approx(CX, abs=2e-3)
        assert z["1"] + z["alpha"] * alpha == pytest.approx(CZ, abs=2e-3)
