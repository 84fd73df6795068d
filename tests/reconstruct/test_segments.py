from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_sysid.reconstruct.airborne import airborne
from gcs_sysid.reconstruct.segments import INPUTS, KINDS, LONGEST, Segment, find, split
from tests.reconstruct.made_flights import Input, flight, without

SURFACES = ("servo1", "servo2", "servo4")


def inputs_found(recording):
    return [item for item in find(recording) if item.kind in INPUTS]


@pytest.mark.parametrize("kind", ["doublet", "multistep", "multisine", "sweep"])
@pytest.mark.parametrize("control", SURFACES)
@pytest.mark.parametrize("seed", [1, 2])
def test_finds_an_input_on_top_of_feedback(kind, control, seed):
    flown = Input(kind, 50.0, control)
    (found,) = inputs_found(flight([flown], seed=seed))
    assert (found.kind, found.controls) == (kind, (control,))
    assert found.start == pytest.approx(flown.start - 1.0, abs=0.7)
    assert flown.start + flown.length <= found.end + 0.7 < flown.start + flown.length + 6.0


@pytest.mark.parametrize("kind", ["doublet", "multistep", "multisine"])
@pytest.mark.parametrize("control", SURFACES)
def test_finds_an_open_loop_input_much_smaller_than_the_feedback_around_it(kind, control):
    flown = Input(kind, 50.0, control, size=30.0)
    found = inputs_found(flight([flown], feedback=80.0, open_loop=True))
    assert [(item.kind, item.controls) for item in found] == [(kind, (control,))]


def test_finds_a_throttle_doublet_flown_with_the_throttle_in_hand():
    flown = Input("throttle", 50.0, "throttle", size=150.0)
    (found,) = inputs_found(flight([flown], open_loop=True))
    assert (found.kind, found.controls) == ("throttle", ("throttle",))


def test_an_input_on_three_surfaces_at_once_is_one_maneuver():
    flown = [Input("multisine", 50.0, name) for name in SURFACES]
    (found,) = inputs_found(flight(flown))
    assert found.kind == "multisine"
    assert set(found.controls) == set(SURFACES)


@pytest.mark.parametrize("feedback", [1.0, 10.0, 60.0])
@pytest.mark.parametrize("seed", range(4))
def test_a_feedback_law_at_work_is_no_test_input(feedback, seed):
    assert not inputs_found(flight(feedback=feedback, turns=[(30.0, 45.0)], seed=seed))


def test_lost_servo_samples_make_no_steps_out_of_a_multisine():
    """Held samples in a smooth input look like jumps; a multisine came out as a multistep."""
    recording = flight([Input("multisine", 50.0, "servo2")], feedback=40.0, open_loop=True)
    stream = recording.streams["SERVO_OUTPUT_RAW"]
    kept = np.random.default_rng(7).random(stream.count // 5 + 1).repeat(5)[: stream.count] > 0.4
    lossy = replace(
        stream,
        time=stream.time[kept],
        link_time=stream.link_time[kept],
        channels={name: values[kept] for name, values in stream.channels.items()},
    )
    found = inputs_found(replace(recording, streams={**recording.streams, lossy.name: lossy}))
    assert [item.kind for item in found] == ["multisine"]


def test_cuts_an_ordinary_flight_into_turns_and_legs():
    turns = [(20.0, 30.0), (60.0, 75.0), (95.0, 105.0)]
    found = find(flight(turns=turns, duration=140.0))
    flown = [(item.start, item.end) for item in found if item.kind == "turn"]
    assert np.array(flown) == pytest.approx(np.array(turns), abs=1.0)
    assert {item.kind for item in found} == {"turn", "steady"}
    assert all(5.0 <= item.duration <= LONGEST for item in found)
    assert sum(item.duration for item in found) == pytest.approx(140.0, abs=0.5)


def test_a_slow_deceleration_is_told_from_a_landing():
    recording = flight(duration=100.0, gust=0.0)
    hud = recording.streams["VFR_HUD"]
    slowing = 22.0 - 8.0 * np.clip((hud.time - 40.0) / 20.0, 0.0, 1.0)
    slowing += 8.0 * np.clip((hud.time - 62.0) / 4.0, 0.0, 1.0)
    slower = replace(hud, channels={**hud.channels, "airspeed": slowing})
    found = find(replace(recording, streams={**recording.streams, "VFR_HUD": slower}))
    (approach,) = [item for item in found if item.kind == "stall-approach"]
    assert (approach.start, approach.end) == pytest.approx((40.0, 60.0), abs=2.5)


def test_a_flight_is_from_lift_off_to_landing():
    ((start, end),) = airborne(flight(duration=150.0, airborne=(30.0, 120.0)))
    assert (start, end) == pytest.approx((30.0, 120.0), abs=1.5)


def test_a_log_that_begins_and_ends_in_the_air_is_flown_to_its_edges():
    ((start, end),) = airborne(flight(duration=60.0))
    assert (start, end) == pytest.approx((0.0, 60.0), abs=0.3)


def test_without_airspeed_speed_over_ground_tells_the_flight():
    recording = without(flight(duration=150.0, airborne=(30.0, 120.0)), "VFR_HUD")
    ((start, end),) = airborne(recording)
    assert (start, end) == pytest.approx((30.0, 120.0), abs=1.5)
    assert find(recording)


def test_a_pitot_tube_that_jumps_on_the_ground_is_no_flight():
    """An airspeed sensor reads 50 m/s for three seconds while it starts up."""
    recording = flight(duration=150.0, airborne=(40.0, 120.0))
    hud = recording.streams["VFR_HUD"]
    speed = np.where((hud.time > 1.0) & (hud.time < 4.0), 50.0, hud.channels["airspeed"])
    jumping = replace(hud, channels={**hud.channels, "airspeed": speed})
    ((start, _),) = airborne(replace(recording, streams={**recording.streams, "VFR_HUD": jumping}))
    assert start > 35.0


def test_a_moment_without_airspeed_at_the_top_of_a_loop_is_no_landing():
    recording = flight(duration=100.0)
    hud = recording.streams["VFR_HUD"]
    speed = np.where(np.abs(hud.time - 50.0) < 1.0, 0.0, hud.channels["airspeed"])
    looped = replace(hud, channels={**hud.channels, "airspeed": speed})
    assert len(airborne(replace(recording, streams={**recording.streams, "VFR_HUD": looped}))) == 1


def test_standing_on_the_ground_is_no_flight():
    recording = flight(duration=60.0, airborne=(500.0, 600.0))
    assert airborne(recording) == ()
    assert find(recording) == ()


@settings(max_examples=15)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["doublet", "multistep", "multisine"]),
            st.floats(5.0, 90.0),
            st.sampled_from(SURFACES),
        ),
        max_size=4,
    ),
    st.lists(st.floats(0.0, 110.0), max_size=3),
    st.floats(0.0, 30.0),
)
def test_maneuvers_are_in_order_apart_and_inside_the_flight(inputs, turns, lift_off):
    recording = flight(
        [Input(*item) for item in inputs],
        turns=[(start, start + 8.0) for start in turns],
        airborne=(lift_off, 115.0),
    )
    found = find(recording)
    flights = airborne(recording)
    assert [item.id for item in found] == list(range(1, len(found) + 1))
    assert all(item.kind in KINDS and item.duration > 0.0 for item in found)
    for first, second in itertools.pairwise(found):
        assert first.end <= second.start + 1e-9
    for item in found:
        assert any(start - 1e-9 <= item.start and item.end <= end + 1e-9 for start, end in flights)


# Plain tuples: runtime type checks use `random`, which hypothesis forbids inside a strategy.
MANEUVERS = st.lists(
    st.tuples(
        st.sampled_from(KINDS),
        st.sampled_from([("elevator",), ("aileron",), ("aileron", "rudder")]),
        st.floats(10.0, 30.0) | st.just(float("nan")),
        st.sampled_from([None, None, None, True, False]),
    ),
    max_size=25,
)


def segments(listed, *, free=False):
    return [
        Segment(i, kind, 10.0 * i, 10.0 * i + 8.0, controls, speed, None if free else held_out)
        for i, (kind, controls, speed, held_out) in enumerate(listed, start=1)
    ]


@given(MANEUVERS, st.randoms(use_true_random=False))
def test_a_split_is_complete_and_depends_on_nothing_but_the_maneuvers(listed, random):
    flown = segments(listed)
    fit, held = split(flown)
    assert sorted((*fit, *held)) == [item.id for item in flown]
    shuffled = list(flown)
    random.shuffle(shuffled)
    assert split(shuffled) == (fit, held)
    for item in flown:
        if item.held_out is not None:
            assert (item.id in held) == item.held_out


@given(MANEUVERS)
def test_every_kind_flown_often_enough_is_in_both_parts(listed):
    flown = segments(listed, free=True)
    fit, held = (set(part) for part in split(flown))
    for kind in KINDS:
        ids = {item.id for item in flown if item.kind == kind}
        assert not ids or ids & fit
        if len(ids) > 1 and kind not in INPUTS:
            assert ids & held
    for control in ("elevator", "aileron", "rudder"):
        ids = {item.id for item in flown if item.kind in INPUTS and control in item.controls}
        assert not ids or ids & fit, "a control lost its last input to the held-out part"


def test_of_three_airspeeds_the_middle_one_is_held_out():
    flown = [
        Segment(number, "doublet", 20.0 * number, 20.0 * number + 5.0, (control,), speed)
        for number, (control, speed) in enumerate(
            (c, v) for v in (16.0, 20.0, 25.0) for c in ("elevator", "aileron", "rudder")
        )
    ]
    _, held = split(flown)
    assert {flown[i].airspeed for i in held} == {20.0}
    assert {flown[i].controls for i in held} == {("elevator",), ("aileron",), ("rudder",)}


def test_nothing_is_held_out_when_nothing_is_asked_for():
    flown = [Segment(i, "steady", 10.0 * i, 10.0 * i + 9.0) for i in range(6)]
    assert split(flown, held_out=0.0) == (tuple(range(6)), ())
