"""A frame alone in its datagram is the frame that a search finds, and what it says is the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gcs_sysid.sources import single, tlog
from gcs_sysid.sources.decode import decode
from gcs_sysid.sources.frames import search

ROOT = Path(__file__).resolve().parents[2]
FLIGHT = [frame for _, frame in tlog.frames((ROOT / "data/flights/demo.tlog").read_bytes())[:3000]]


def same(frame: bytes) -> None:
    found = single.found(frame)
    assert found is not None
    content = np.frombuffer(frame, dtype=np.uint8)
    whole = search(content)
    for name in ("start", "size", "header", "length", "id"):
        assert getattr(found.frames, name) == getattr(whole.frames, name)
    assert (found.bad_crc, found.garbage_bytes, found.rest) == (0, 0, len(frame))
    told = single.decoded(frame, found, 77)
    searched = decode(content, whole.frames, np.array([77]))
    assert list(told) == list(searched)
    for key, table in told.items():
        other = searched[key]
        assert (table.order, table.link_us) == (other.order, other.link_us)
        assert list(table.fields) == list(other.fields)
        for name, values in table.fields.items():
            assert values.dtype == other.fields[name].dtype
            np.testing.assert_array_equal(values, other.fields[name])


def test_every_frame_of_a_flight_is_the_same_both_ways() -> None:
    for frame in FLIGHT:
        same(frame)


@given(st.integers(0, len(FLIGHT) - 1), st.data())
def test_what_is_damaged_cut_or_longer_is_left_to_the_search(number: int, data: st.DataObject):
    frame = FLIGHT[number]
    place = data.draw(st.integers(0, len(frame) - 1))
    flipped = bytearray(frame)
    flipped[place] ^= 1 << data.draw(st.integers(0, 7))
    for piece in (frame[:place], frame + b"\0", frame + frame, bytes(flipped)):
        found = single.found(piece)
        # A flip that makes another valid frame must be one that the search proves as well.
        if found is not None:
            same(piece)
        else:
            alone = search(np.frombuffer(piece, dtype=np.uint8))
            assert alone.frames.start.size != 1 or alone.garbage_bytes or alone.rest < len(piece)


def test_version_1_frames_are_known_too(writer: type) -> None:
    frame = FLIGHT[0]
    body = bytes([frame[1], *frame[4:7], frame[7]]) + frame[10 : 10 + frame[1]]
    whole = search(np.frombuffer(b"\xfe" + body + b"\0\0", dtype=np.uint8))
    assert whole.bad_crc == 1
    assert single.found(b"\xfe" + body + b"\0\0") is None
    from gcs_sysid.sources.checksum import checksum
    from gcs_sysid.sources.layouts import crc_extras

    crc = int(checksum(np.frombuffer(body, np.uint8)[None], crc_extras()[[frame[7]]])[0])
    same(b"\xfe" + body + crc.to_bytes(2, "little"))
