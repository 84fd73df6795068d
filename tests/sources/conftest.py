"""Writes telemetry with pymavlink's encoder, the second implementation of the format."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as dialect

EPOCH_US = 1_790_000_000_000_000
"""An arrival time well after 2001, before which a stamp does not count as wall time."""


class Writer:
    """A .tlog in memory.

    Args:
        system: MAVLink system id of the sender.
        component: component id.
        version: 1 or 2 of the wire format.
        signed: whether frames carry a signature.
    """

    def __init__(
        self, system: int = 1, component: int = 1, *, version: int = 2, signed: bool = False
    ) -> None:
        self.records: list[tuple[int, bytes]] = []
        self._link = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self._force_v1 = version == 1
        if signed:
            self._link.signing.secret_key = bytes(range(32))
            self._link.signing.sign_outgoing = True

    def frame(self, name: str, **fields: object) -> bytes:
        message = message_class(name)(**(defaults(name) | fields))
        return bytes(message.pack(self._link, force_mavlink1=self._force_v1))

    def add(self, link_us: int, name: str, **fields: object) -> Writer:
        """Adds a message that arrives `link_us` after the start of the log."""
        self.records.append((EPOCH_US + link_us, self.frame(name, **fields)))
        return self

    def heartbeat(self, link_us: int = 0, **fields: object) -> Writer:
        plane = {"type": dialect.MAV_TYPE_FIXED_WING, "autopilot": 3, "base_mode": 128}
        return self.add(link_us, "HEARTBEAT", **(plane | fields))

    @property
    def data(self) -> bytes:
        """The log, in the order of arrival."""
        records = sorted(self.records, key=lambda record: record[0])
        return b"".join(struct.pack(">Q", t) + frame for t, frame in records)


def message_class(name: str) -> type:
    return next(c for c in dialect.mavlink_map.values() if c.msgname == name)


def defaults(name: str) -> dict[str, object]:
    """Zeros for every field of a message."""
    kind = message_class(name)
    values: dict[str, object] = {}
    for field, code, count in zip(
        kind.ordered_fieldnames, kind.native_format[1:], kind.array_lengths, strict=True
    ):
        if chr(code) in "sc":
            values[field] = b""
        else:
            zero = 0.0 if chr(code) in "fd" else 0
            values[field] = [zero] * count if count else zero
    return values


@pytest.fixture(scope="session")
def writer() -> type[Writer]:
    return Writer


@pytest.fixture
def save(tmp_path: Path) -> Callable[[bytes], Path]:
    """Saves bytes as a .tlog and returns its path."""

    def to_file(data: bytes) -> Path:
        path = tmp_path / "flight.tlog"
        path.write_bytes(data)
        return path

    return to_file
