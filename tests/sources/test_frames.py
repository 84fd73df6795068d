from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gcs_sysid.sources.frames import Found, search


def find(data: bytes, prefix: int = 0) -> Found:
    return search(np.frombuffer(data, dtype=np.uint8), prefix=prefix)


def cut_out(data: bytes, found: Found) -> list[bytes]:
    frames = found.frames
    return [data[a:b] for a, b in zip(frames.start.tolist(), frames.end.tolist(), strict=True)]


def some_frames(writer: type, **how: object) -> list[bytes]:
    w = writer(**how)
    return [
        w.frame("ATTITUDE", time_boot_ms=1000, roll=0.1, yawspeed=-0.2),
        w.frame("HEARTBEAT", type=1, autopilot=3),
        w.frame("RAW_IMU", time_usec=10, xacc=254, yacc=253, zacc=-1000),
        w.frame("STATUSTEXT", severity=6, text=b"\xfd\xfe hello \xfe"),
        w.frame("PARAM_VALUE", param_id=b"ARSPD_RATIO", param_value=1.99, param_count=3),
    ]


def test_both_versions_and_signed_frames(writer: type) -> None:
    frames = [
        *some_frames(writer, version=1),
        *some_frames(writer, version=2),
        *some_frames(writer, signed=True),
    ]
    data = b"".join(frames)
    found = find(data)
    assert cut_out(data, found) == frames
    assert (found.bad_crc, found.unknown.start.size, found.garbage_bytes) == (0, 0, 0)
    assert found.rest == len(data)


def test_garbage_costs_only_itself(writer: type) -> None:
    one, two, *_ = some_frames(writer)
    data = b"abc" + one + b"\x00" * 7 + two + b"xy"
    found = find(data)
    assert cut_out(data, found) == [one, two]
    assert found.garbage_bytes == 12


def test_wrong_checksum_is_counted_once(writer: type) -> None:
    one, two, three, *_ = some_frames(writer)
    broken = bytearray(two)
    broken[11] ^= 0x10
    data = one + bytes(broken) + three
    found = find(data)
    assert cut_out(data, found) == [one, three]
    assert (found.bad_crc, found.garbage_bytes) == (1, 0)


def test_false_length_does_not_swallow_the_next_frame(writer: type) -> None:
    """A reader that believes the length byte loses the frames behind a damaged one."""
    one, two, three, *_ = some_frames(writer)
    broken = bytearray(two)
    broken[1] = 60
    data = one + bytes(broken) + three
    found = find(data)
    assert cut_out(data, found) == [one, three]


def test_unknown_messages_are_told_apart_from_damaged_ones(writer: type) -> None:
    one, two, *_ = some_frames(writer)
    unknown = bytearray(two)
    unknown[7:10] = (0xABCDEF).to_bytes(3, "little")
    data = one + bytes(unknown) + two
    found = find(data)
    assert cut_out(data, found) == [one, two]
    assert (found.bad_crc, found.unknown.start.tolist(), found.garbage_bytes) == (0, [len(one)], 0)


def test_frames_with_flags_that_nobody_knows_are_not_read(writer: type) -> None:
    one, two, *_ = some_frames(writer)
    odd = bytearray(two)
    odd[2] = 0x04
    data = one + bytes(odd) + one
    assert cut_out(data, find(data)) == [one, one]


def test_cut_tail_is_left_for_more(writer: type) -> None:
    one, two, *_ = some_frames(writer)
    for kept in range(1, len(two)):
        data = one + two[:kept]
        found = find(data)
        assert cut_out(data, found) == [one]
        assert found.rest == len(one)
        assert found.garbage_bytes == 0


def test_cut_stamp_of_a_log_is_a_cut_tail(writer: type) -> None:
    one, *_ = some_frames(writer)
    record = b"\x00\x06\x5b\xf1\x00\x00\x00\x01" + one
    for kept in range(1, len(record)):
        found = find(record + record[:kept], prefix=8)
        assert found.rest == len(record), kept
        assert found.frames.start.size == 1


def test_magic_bytes_in_a_stamp_start_no_frame(writer: type) -> None:
    """The microseconds of an arrival are any bytes, the start of a frame among them."""
    one, *_ = some_frames(writer)
    record = b"\xfe\x00\xfd\xfe\xfd\x01\xfe\xfd" + one
    found = find(record * 50, prefix=8)
    assert found.frames.start.size == 50
    assert found.garbage_bytes == 0


@given(data=st.binary(max_size=3000), prefix=st.sampled_from([0, 8]))
def test_every_byte_is_accounted_for(data: bytes, prefix: int) -> None:
    """Frames, damaged ones, garbage and the awaited rest make up the whole; nothing crashes."""
    magic = data.replace(b"\x01", b"\xfe").replace(b"\x02", b"\xfd")
    found = find(magic, prefix)
    whole = int(np.sum(found.frames.size + prefix) + np.sum(found.unknown.size + prefix))
    left = found.rest - whole - found.garbage_bytes
    smallest = 8 + prefix
    assert left >= smallest * found.bad_crc
    assert (left == 0) == (found.bad_crc == 0)


@given(flips=st.lists(st.tuples(st.integers(0, 10**6), st.integers(1, 255)), max_size=6))
def test_undamaged_frames_survive_damage_elsewhere(
    writer: type, flips: list[tuple[int, int]]
) -> None:
    frames = some_frames(writer) * 8
    data = bytearray(b"".join(frames))
    starts = np.cumsum([0, *(len(frame) for frame in frames)])
    damaged = set()
    for place, bits in flips:
        at = place % len(data)
        data[at] ^= bits
        damaged.add(int(np.searchsorted(starts, at, side="right")) - 1)
    found = set(find(bytes(data)).frames.start.tolist())
    intact = {int(starts[i]) for i in range(len(frames)) if i not in damaged}
    assert intact <= found
