from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.generator.mavcrc import x25crc

from gcs_sysid.sources.checksum import checksum


@given(
    bodies=st.integers(1, 264).flatmap(
        lambda n: st.lists(st.binary(min_size=n, max_size=n), min_size=1, max_size=5)
    ),
    extra=st.integers(0, 255),
)
def test_agrees_with_pymavlink(bodies: list[bytes], extra: int) -> None:
    found = checksum(
        np.frombuffer(b"".join(bodies), dtype=np.uint8).reshape(len(bodies), -1),
        np.full(len(bodies), extra, dtype=np.uint8),
    )
    expected = [x25crc(bytearray(body + bytes([extra]))).crc for body in bodies]
    assert found.tolist() == expected


def test_published_check_value() -> None:
    """CRC-16/MCRF4XX of "123456789" is 0x6F91 (catalogue of parametrised CRC algorithms)."""
    body = np.frombuffer(b"12345678", dtype=np.uint8).reshape(1, -1)
    last = np.frombuffer(b"9", dtype=np.uint8)
    assert checksum(body, last)[0] == 0x6F91
