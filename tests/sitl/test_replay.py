"""The scenarios of replay/: whole, and expecting what they hide."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.diagnose.catalogue import OF_COEFFICIENTS
from gcs_sysid.offline import scenario as expectations
from gcs_sysid.sitl import scenario
from gcs_sysid.sitl.effects import catalogue
from tests.sitl import examples

REPLAY = examples.ROOT / "replay"
FOLDERS = sorted(path.parent for path in REPLAY.glob("*/scenario.toml"))


@pytest.fixture(params=FOLDERS, ids=lambda folder: folder.name)
def folder(request) -> Path:
    return request.param


def test_a_scenario_is_named_like_its_folder_and_can_be_run(folder):
    planned = scenario.load(folder / "scenario.toml")
    assert planned.name == folder.name
    logs = {flight.name: Path(f"{flight.name}.tlog") for flight in planned.flights}
    expected = expectations.expected(folder)
    runs = expectations.plan(expected, logs, planned.aircraft, Path("out"))
    assert runs
    assert all(run.expected.data for run in runs if run.command != "identify")


def test_flights_differ_in_seed_and_time(folder):
    flights = [planned.flight for planned in scenario.load(folder / "scenario.toml").flights]
    assert len({flight.seed for flight in flights}) == len(flights)
    assert len({flight.epoch_us for flight in flights}) == len(flights)


def test_what_is_to_be_diagnosed_is_what_is_hidden(folder):
    """In calm air the causes that coefficients know are named; of others nobody is accused."""
    expected = expectations.expected(folder).data.get("diagnose")
    if expected is None:
        return
    hidden = hidden_in(folder)
    known = set(OF_COEFFICIENTS) & set(hidden)
    if not hidden:
        assert expected == {"verdict": "no_effect"}
    elif not known:
        silent = {"cause": {"one_of": ["none", "unlisted"]}}
        assert expected == silent or expected["verdict"] == "unlisted_effect"
    else:
        assert expected["verdict"] == "effect"
        found = expected["effects"]
        assert set(found["holds"] if isinstance(found, dict) else found) == known
        for place in expected.get("ranking", {}).values():
            for name, wanted in place["parameters"].items():
                assert wanted["value"] == hidden[expected["cause"]][name]
                assert wanted["within"] <= 0.25 * abs(wanted["value"])


def test_every_effect_is_hidden_alone_in_some_scenario():
    alone = [next(iter(found)) for found in map(hidden_in, FOLDERS) if len(found) == 1]
    assert set(alone) == set(catalogue.EFFECTS)


def hidden_in(folder: Path) -> dict[str, dict]:
    """Effects of a scenario with their parameters."""
    flights = scenario.load(folder / "scenario.toml").flights
    return {effect["name"]: effect["parameters"] for effect in flights[0].told["effects"]}


def test_the_trusted_aircraft_is_the_published_one_but_for_its_sigmas():
    trusted = aircraft_file.load(REPLAY / "ultra_stick_25e.toml")
    published = examples.ultra_stick()
    assert dataclasses.replace(trusted, aerodynamics={}) == dataclasses.replace(
        published, aerodynamics={}
    )
    assert values(trusted) == values(published)
    assert trusted.aerodynamics["Cm"].terms["alpha"].sigma == pytest.approx(0.05 * 0.723)


def values(aircraft: Aircraft) -> dict[str, dict[str, float]]:
    return {
        name: {key: term.value for key, term in model.terms.items()}
        for name, model in aircraft.aerodynamics.items()
    }
