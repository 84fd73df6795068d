"""Signatures made by pymavlink, the second implementation, and judged here."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as dialect

from gcs_sysid.errors import SourceError
from gcs_sysid.sources.signing import Signatures, load_key
from gcs_sysid.sources.stream import FrameStream

KEY = hashlib.sha256(b"correct horse").digest()


def sender(*, key: bytes = KEY, link: int = 0, system: int = 1, since: int = 10**12):
    vehicle = dialect.MAVLink(None, srcSystem=system, srcComponent=1)
    vehicle.signing.secret_key = key
    vehicle.signing.sign_outgoing = True
    vehicle.signing.link_id = link
    vehicle.signing.timestamp = since
    return vehicle


def beat(vehicle) -> bytes:
    message = dialect.MAVLink_heartbeat_message(1, 3, 128, 0, 4, 3)
    return bytes(message.pack(vehicle))


def received(stream: FrameStream, data: bytes) -> int:
    return len(stream.feed(data, 0).raw())


def test_only_good_signatures_are_let_through() -> None:
    stream = FrameStream(signatures=Signatures(KEY))
    plain = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    good, forger = sender(), sender(key=bytes(32))
    data = beat(good) + beat(plain) + beat(forger) + beat(good)
    assert received(stream, data) == 2
    assert stream.lost["unsigned"] == 1
    assert stream.lost["bad_signature"] == 1


def test_a_frame_played_again_is_left_out() -> None:
    stream = FrameStream(signatures=Signatures(KEY))
    frame = beat(sender())
    assert received(stream, frame) == 1
    assert received(stream, frame) == 0
    assert stream.lost["bad_signature"] == 1


def test_each_link_and_system_counts_its_own_time() -> None:
    stream = FrameStream(signatures=Signatures(KEY))
    data = beat(sender(since=10**12)) + beat(sender(link=1, since=10**12 - 1000))
    data += beat(sender(system=2, since=10**12 - 5_000_000))
    assert received(stream, data) == 3
    assert received(stream, beat(sender(system=3, since=10**12 - 7_000_000))) == 0


def test_without_a_key_everything_is_taken() -> None:
    assert received(FrameStream(), beat(sender(key=bytes(32)))) == 1


@pytest.mark.parametrize(
    "content", [KEY, KEY.hex().encode(), KEY.hex().upper().encode() + b"\n", b"correct horse\n"]
)
def test_a_key_is_bytes_digits_or_a_passphrase(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "key"
    path.write_bytes(content)
    assert load_key(path) == KEY


def test_a_file_without_a_key(tmp_path: Path) -> None:
    path = tmp_path / "key"
    path.write_bytes(b" \n")
    with pytest.raises(SourceError, match="holds no key"):
        load_key(path)
    with pytest.raises(SourceError, match="cannot be read"):
        load_key(tmp_path / "missing")
