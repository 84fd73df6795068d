"""From CAN frames to DroneCAN transfers: short ones in one frame, long ones put together.

The identifier (29 bits) holds priority, data type and source; the last byte of each frame whether
it begins or ends a transfer, a bit that alternates, and the transfer's number (DroneCAN
specification, "CAN bus transport layer"). A long transfer begins with its checksum.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from gcs_sysid.sources.can.dsdl import LAYOUTS

_BEGIN, _END, _TOGGLE, _NUMBER = 0x80, 0x40, 0x20, 0x1F
_SERVICE = 0x80
_LONGEST = 512
"""Bytes of a transfer beyond which it is damaged: the types that are read have fewer than 130."""


@dataclass(frozen=True)
class CanFrame:
    """A frame: when it arrived [µs], its identifier of 29 bits, its data."""

    time_us: int
    id: int
    data: bytes


@dataclass(frozen=True)
class Transfer:
    """A message of a node: when its first frame arrived, its type, who sent it, its fields."""

    time_us: int
    type: int
    node: int
    payload: bytes


@dataclass
class _Building:
    time_us: int
    number: int
    toggle: int = _TOGGLE
    data: bytearray = field(default_factory=bytearray)


class Transfers:
    """Puts transfers together from frames, however these come in pieces.

    Attributes:
        lost: what could not be used, by reason.
    """

    def __init__(self) -> None:
        self._building: dict[int, _Building] = {}
        self.lost = {"can_unknown": 0, "can_bad_crc": 0, "can_truncated": 0}

    def feed(self, frames: Iterable[CanFrame]) -> list[Transfer]:
        """Transfers of the known types that these frames complete, in order."""
        found = (self._one(frame) for frame in frames if frame.data and not frame.id & _SERVICE)
        return [one for one in found if one is not None]

    def end(self) -> None:
        """Counts what will not be completed any more."""
        self.lost["can_truncated"] += len(self._building)
        self._building.clear()

    def _one(self, frame: CanFrame) -> Transfer | None:
        kind, node = (frame.id >> 8) & 0xFFFF, frame.id & 0x7F
        if kind not in LAYOUTS or not node:
            self.lost["can_unknown"] += 1
            return None
        tail = frame.data[-1]
        if tail & _BEGIN:
            return self._begun(frame, kind, node, tail)
        one = self._building.get(frame.id)
        if one is None or not _continues(one, tail):
            self.lost["can_truncated"] += 1
            self._building.pop(frame.id, None)
            return None
        one.data += frame.data[:-1]
        one.toggle ^= _TOGGLE
        return self._ended(frame.id, kind, node) if tail & _END else None

    def _begun(self, frame: CanFrame, kind: int, node: int, tail: int) -> Transfer | None:
        self.lost["can_truncated"] += self._building.pop(frame.id, None) is not None
        if tail & _END:
            return Transfer(frame.time_us, kind, node, frame.data[:-1])
        one = self._building[frame.id] = _Building(frame.time_us, tail & _NUMBER)
        one.data += frame.data[:-1]
        return None

    def _ended(self, identifier: int, kind: int, node: int) -> Transfer | None:
        one = self._building.pop(identifier)
        payload = bytes(one.data[2:])
        if checksum(LAYOUTS[kind].signature, payload) == one.data[0] | one.data[1] << 8:
            return Transfer(one.time_us, kind, node, payload)
        self.lost["can_bad_crc"] += 1
        return None


def transfers(frames: Iterable[CanFrame]) -> tuple[list[Transfer], dict[str, int]]:
    """Transfers of the known types in order, and what could not be used, by reason."""
    whole = Transfers()
    found = whole.feed(frames)
    whole.end()
    return found, whole.lost


def _continues(one: _Building, tail: int) -> bool:
    fits = len(one.data) < _LONGEST
    return fits and tail & _NUMBER == one.number and tail & _TOGGLE == one.toggle


def checksum(signature: int, payload: bytes) -> int:
    """CRC-16-CCITT (0x1021, start 0xFFFF) over the type's signature and the payload."""
    crc = 0xFFFF
    for byte in signature.to_bytes(8, "little") + payload:
        crc = (crc << 8 & 0xFFFF) ^ _TABLE[crc >> 8 ^ byte]
    return crc


def _entry(byte: int) -> int:
    crc = byte << 8
    for _ in range(8):
        crc = (crc << 1) ^ (0x1021 if crc & 0x8000 else 0)
    return crc & 0xFFFF


_TABLE: Mapping[int, int] = {byte: _entry(byte) for byte in range(256)}
