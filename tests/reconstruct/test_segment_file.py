from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_sysid.errors import InputError
from gcs_sysid.reconstruct.segment_file import entries, parse
from gcs_sysid.reconstruct.segments import KINDS, Segment

EPOCH = 1_700_000_000_000_000
ENTRY = {"kind": "doublet", "start_s": 10.0, "duration_s": 5.0, "controls": ["elevator"]}


def read(*listed, last=1000.0):
    return parse(json.dumps(list(listed)), name="mine.json", epoch_us=EPOCH, last=last)


@given(
    st.lists(
        st.tuples(
            st.sampled_from(KINDS),
            st.floats(0.0, 3.0),
            st.floats(0.01, 60.0),
            st.lists(st.sampled_from(["elevator", "höhe"]), max_size=2),
            st.floats(5.0, 40.0) | st.just(float("nan")),
            st.sampled_from([None, True, False]),
        ),
        min_size=1,
        max_size=8,
    )
)
def test_what_is_written_is_what_is_read(listed):
    flown, clock = [], 0.0
    for number, (kind, pause, length, controls, speed, held_out) in enumerate(listed, start=3):
        start, clock = clock + pause, clock + pause + length
        flown.append(Segment(number, kind, start, clock, tuple(controls), speed, held_out))
    text = json.dumps({"maneuvers": entries(flown, epoch_us=EPOCH)})
    back = parse(text, name="inspect.json", epoch_us=EPOCH)
    for before, after in zip(flown, back, strict=True):
        assert (after.id, after.kind, after.controls) == (before.id, before.kind, before.controls)
        assert after.held_out == before.held_out
        assert after.start == pytest.approx(before.start, abs=1e-6)
        assert after.end == pytest.approx(before.end, abs=1e-6)
        assert after.airspeed == pytest.approx(before.airspeed, abs=1e-3, nan_ok=True)


def test_an_entry_told_not_to_be_used_is_left_out():
    kept = read(ENTRY, {**ENTRY, "start_s": 30.0, "use": False}, {**ENTRY, "start_s": 50.0})
    assert [item.start for item in kept] == [10.0, 50.0]


def test_entries_without_an_id_are_numbered_around_those_with_one():
    listed = read({**ENTRY, "start_s": 30.0}, {**ENTRY, "id": 1}, {**ENTRY, "start_s": 50.0})
    assert [(item.id, item.start) for item in listed] == [(1, 10.0), (2, 30.0), (3, 50.0)]


def test_times_may_stand_on_the_clock_of_the_log():
    (found,) = read({"kind": "turn", "start_us": EPOCH + 7_500_000, "end_us": EPOCH + 9_000_000})
    assert (found.start, found.end) == (7.5, 9.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"maneuvers": [,]}', "line 1"),
        ('{"manoeuvres": []}', "no list `maneuvers`"),
        ("[]", "no maneuver is left"),
        ("[3]", "maneuvers[0]: is no object"),
    ],
)
def test_text_that_is_no_list_is_refused(text, said):
    with pytest.raises(InputError) as caught:
        parse(text, name="mine.json", epoch_us=EPOCH)
    assert said in str(caught.value)
    assert str(caught.value).startswith("mine.json")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"kind": "looping"}, "maneuvers[0].kind: found 'looping'; write one of doublet"),
        ({"heldout": True}, "did you mean `held_out`?"),
        ({"held_out": "yes"}, "maneuvers[0].held_out: found 'yes'; write true or false"),
        ({"use": 1}, "maneuvers[0].use"),
        ({"start_s": None}, "no start"),
        ({"duration_s": None}, "no end"),
        ({"duration_s": -1.0}, "ends 1 s before it starts"),
        ({"start_s": "10"}, "maneuvers[0].start_s: found '10'; write a number"),
        ({"controls": "elevator"}, "maneuvers[0].controls"),
        ({"id": 1.5}, "maneuvers[0].id"),
        ({"start_us": EPOCH}, "`start_us` and `start_s` differ by 10.000 s; delete the one"),
        ({"start_us": EPOCH - 10**12}, "start_us: is not on the clock of this log; give the log"),
        ({"start_s": 998.0}, "998.0 to 1003.0 s is not within 0 to 1000.0 s"),
    ],
)
def test_a_mistake_is_named_with_its_entry_and_a_remedy(change, said):
    with pytest.raises(InputError) as caught:
        read({**ENTRY, **change})
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_overlapping_maneuvers_are_refused_by_both_their_places():
    with pytest.raises(InputError, match=r"maneuvers\[1\]: overlaps maneuvers\[0\] by 2.000 s"):
        read(ENTRY, {**ENTRY, "start_s": 13.0})


def test_two_maneuvers_of_one_id_are_refused():
    with pytest.raises(InputError, match="same `id`"):
        read({**ENTRY, "id": 4}, {**ENTRY, "id": 4, "start_s": 40.0})
