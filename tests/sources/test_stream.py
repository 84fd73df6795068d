from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_sysid.sources.stream import FrameStream


def frames(writer: type) -> list[bytes]:
    w = writer()
    return [
        w.frame("ATTITUDE", time_boot_ms=1000 + i, roll=0.1 * i, yawspeed=-0.2) for i in range(10)
    ]


@settings(max_examples=20)
@given(cuts=st.lists(st.integers(0, 400), max_size=20))
def test_pieces_make_the_same_frames(writer: type, cuts: list[int]) -> None:
    sent = frames(writer)
    data = b"".join(sent)
    stream = FrameStream()
    received: list[bytes] = []
    places = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    for a, b in pairwise(places):
        received += stream.feed(data[a:b], 0).raw()
    assert received == sent
    assert stream.lost == {"bad_crc": 0, "unknown": 0, "garbage_bytes": 0}


def test_losses_add_up(writer: type) -> None:
    one, two, *_ = frames(writer)
    broken = bytearray(one)
    broken[-1] ^= 1
    stream = FrameStream()
    for piece in (b"???" + one, bytes(broken) + two, b"!!" + two):
        stream.feed(piece, 0)
    assert stream.lost == {"bad_crc": 1, "unknown": 0, "garbage_bytes": 5}


def test_frames_of_unknown_messages_are_handed_on_raw(writer: type) -> None:
    """A recording keeps what this version cannot read."""
    one, two, *_ = frames(writer)
    unknown = bytearray(one)
    unknown[7:10] = b"\xef\xcd\xab"
    stream = FrameStream()
    batch = stream.feed(one + bytes(unknown) + two, 77)
    assert batch.raw() == [one, bytes(unknown), two]
    assert stream.lost["unknown"] == 1
    (table,) = batch.tables().values()
    assert table.count == 2
    assert set(table.link_us.tolist()) == {77}


def test_noise_does_not_pile_up() -> None:
    rng = np.random.default_rng(8)
    stream = FrameStream()
    for _ in range(50):
        noise = rng.integers(0, 256, 1000, dtype=np.uint8).tobytes()
        assert len(stream.feed(noise, 0).data) < 1000 + 300
