"""A flight that is not what its aircraft file says, listened to from its first frame on."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate.file_prior import file_prior
from gcs_sysid.live.listen import LIVE
from gcs_sysid.live.session import Clock, Session
from gcs_sysid.live.station import Compiled, Station
from gcs_sysid.offline import documents
from gcs_sysid.sitl import record, scenario
from gcs_sysid.sources.link import Chunk, Mailbox
from gcs_sysid.sources.recorder import Recorder

pytestmark = pytest.mark.slow
ROOT = Path(__file__).resolve().parents[2]
HIDDEN = ROOT / "replay/weak_elevator/scenario.toml"
RATIO = 0.65
"""Of what the file says, the elevator acts with: the scenario's hidden effect."""
LEGS = 2
"""Of the flight: the first has doublets of every control."""
MICRO = 1e-6


@pytest.fixture(scope="module")
def frames() -> list[tuple[int, bytes]]:
    """Arrival times [µs] and frames."""
    whole = scenario.load(HIDDEN).flights[0].flight
    flown = record.fly(replace(whole, legs=whole.legs[:LEGS]))
    return [(frame.arrival_us, frame.data) for frame in flown.frames]


def heard(frames: list[tuple[int, bytes]], aircraft: Aircraft, out: Path) -> list[dict]:
    """What `live.json` held, once a second of the flight."""
    now, told = [frames[0][0]], []
    clock = Clock(seconds=lambda: now[0] * MICRO, us=lambda: now[0])

    def publish(document) -> None:
        documents.write_json(out / LIVE, document)
        told.append(json.loads((out / LIVE).read_text(encoding="utf-8")))

    station = Station(
        aircraft,
        Compiled(aircraft),
        prior=file_prior(aircraft),
        vehicle=None,
        clock_us=clock.us,
    )
    mailbox = Mailbox()
    with Recorder(out / "recording.tlog") as recorder:
        session = Session(
            "a log",
            mailbox=mailbox,
            recorder=recorder,
            station=station,
            publish=publish,
            clock=clock,
        )
        session.ready.set()
        for link_us, frame in frames:
            now[0] = link_us
            mailbox.put(Chunk(frame, link_us))
            session.turn()
    return told


@pytest.fixture(scope="module")
def believed() -> Aircraft:
    """A simulation that has been validated, but for the elevator."""
    return aircraft_file.load(ROOT / "replay/ultra_stick_25e.toml")


def test_a_weak_elevator_is_told_with_axis_time_and_cause(frames, believed, tmp_path) -> None:
    told = heard(frames, believed, tmp_path)
    assert {name for one in told for name in one["departures"]} == {"Cm"}
    first = next(one for one in told if one["departures"])
    departure = first["departures"]["Cm"]
    # Told after three windows, the first of which began it.
    assert first["time_us"] - 5e6 < departure["since_us"] < first["time_us"]
    assert abs(departure["deviations"]) >= 3.0
    named = [one for one in told if one["causes"]]
    assert named[0]["time_us"] - departure["since_us"] < 10e6, "from the first maneuver"
    for one in named:
        # A derivative that is wrong by itself says the same about Cm.
        found = {(cause["cause"], cause["about"]): cause for cause in one["causes"]}
        weak = found[("surface_effectiveness", "elevator")]
        assert weak["probability"] > 0.4
        assert abs(weak["size"] - (RATIO - 1.0)) < 3.0 * weak["sd"]
        assert set(found) <= {
            ("surface_effectiveness", "elevator"),
            ("aero_derivative", "Cm_elevator"),
        }


def test_the_same_flight_with_an_honest_file_departs_nowhere(frames, believed, tmp_path) -> None:
    servos = tuple(
        replace(one, effectiveness=RATIO) if one.surface == "elevator" else one
        for one in believed.servos
    )
    told = heard(frames, replace(believed, servos=servos), tmp_path)
    assert sum(bool(one["coefficients"]) for one in told) > 20, "it was looked at"
    assert [one["departures"] for one in told if one["departures"]] == []
    assert [one["causes"] for one in told if one["causes"]] == []
