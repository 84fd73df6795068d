"""The finder against flights where somebody wrote down what was flown."""

from __future__ import annotations

import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.reconstruct.airborne import airborne
from gcs_sysid.reconstruct.segments import INPUTS, find, split
from gcs_sysid.sources.registry import open_recording
from tests.reconstruct.flown_events import events, recall_and_precision

pytestmark = pytest.mark.shared


@pytest.mark.parametrize("flight", ["A", "B"])
def test_finds_every_input_of_an_autopilot_that_wrote_down_its_own(shared, flight):
    folder = shared / "data" / "arduplane_sitl"
    recording = open_recording(folder / f"{flight}.tlog")
    aircraft = aircraft_file.load(folder / "aircraft.toml")
    # The recording's clock begins when the vehicle booted, to a few milliseconds.
    flown = events(folder / f"{flight}_events.json")
    recall, precision = recall_and_precision(flown, find(recording, aircraft))
    assert recall >= 0.95
    assert precision >= 0.95


@pytest.mark.parametrize("case", ["clean", "clean_second", "cg_shift", "airspeed_scale"])
def test_finds_the_inputs_of_a_gusty_simulated_flight(shared, case):
    folder = shared / "cases" / case
    aircraft = aircraft_file.load(folder / "aircraft.toml")
    recording = open_recording(folder / "flight.tlog")
    found = find(recording, aircraft)
    ((start, end),) = airborne(recording, aircraft)
    minutes = round((end - start) / 60.0)
    assert end - start == pytest.approx(60.0 * minutes, abs=1.0)
    by_kind = {kind: [item for item in found if item.kind == kind] for kind in INPUTS}
    # Each minute: one stepped input on each surface, then a multisine on all three.
    assert len(by_kind["multisine"]) == minutes
    assert all(len(item.controls) == 3 for item in by_kind["multisine"])
    assert len(by_kind["doublet"]) + len(by_kind["multistep"]) == 3 * minutes
    assert not by_kind["sweep"]
    assert not by_kind["throttle"]


@pytest.mark.parametrize(
    ("log", "flown"),
    [("umn_thor/thor_flight75.tlog", 368.0), ("solarsurfer/flight3.tlog", 265.0)],
)
def test_an_ordinary_autopilot_flight_is_cut_into_turns_and_legs(shared, log, flown):
    recording = open_recording(shared / "data" / log)
    found = find(recording)
    assert sum(end - start for start, end in airborne(recording)) == pytest.approx(flown, abs=8.0)
    assert not [item for item in found if item.kind in INPUTS]
    assert all(4.9 <= item.duration <= 60.0 for item in found)
    assert sum(item.duration for item in found) == pytest.approx(flown, abs=8.0)
    fit, held = split(found)
    for kind in ("turn", "steady", "climb"):
        ids = {item.id for item in found if item.kind == kind}
        assert ids & set(fit)
        assert ids & set(held)


def test_hovering_is_not_flying_on_the_wing(shared):
    recording = open_recording(shared / "data" / "quadplane_sitl" / "vtol.tlog")
    ((start, end),) = airborne(recording)
    assert (start, end) == pytest.approx((41.0, 130.0), abs=3.0)
