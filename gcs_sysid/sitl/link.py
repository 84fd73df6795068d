"""The radio between vehicle and ground station, and the file in which the station keeps it.

A .tlog is a sequence of frames as received, each after its arrival time: 8 bytes, big-endian,
microseconds since 1970 (as Mission Planner, QGroundControl and pymavlink write it).
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_sysid.sitl.telemetry import Message

SYSTEM = 1
COMPONENT = 1


@dataclass(frozen=True)
class Link:
    """A telemetry radio: each frame is lost with probability `loss`, or arrives late [s].

    Lateness is `latency` plus an exponential with mean `jitter`; frames may overtake each other.
    """

    latency: float = 0.004
    jitter: float = 0.002
    loss: float = 0.01


@dataclass(frozen=True)
class Frame:
    """One received frame."""

    arrival_us: int
    data: bytes


class Transmitter:
    """Numbers, packs and sends messages; keeps what arrives.

    Args:
        link: the radio.
        generator: where its randomness comes from.
    """

    def __init__(self, link: Link, *, generator: np.random.Generator) -> None:
        self._link = link
        self._generator = generator
        self._packer = mavlink.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)
        self._received: list[Frame] = []
        self.sent = 0

    def send(self, message: Message, unix_us: int, *, reliable: bool = False) -> None:
        """Send one message at a wall time [µs]; a `reliable` one is repeated until it arrives."""
        data = bytes(message.pack(self._packer))
        self._packer.seq = (self._packer.seq + 1) % 256
        self.sent += 1
        luck, late = self._generator.random(), self._generator.standard_exponential()
        if reliable or luck >= self._link.loss:
            delay = self._link.latency + self._link.jitter * late
            self._received.append(Frame(unix_us + round(1e6 * delay), data))

    def received(self) -> list[Frame]:
        """What has arrived so far, in order of arrival."""
        return sorted(self._received, key=lambda frame: frame.arrival_us)


def tlog(frames: Iterable[Frame]) -> bytes:
    """The frames as the contents of a .tlog."""
    return b"".join(struct.pack(">Q", frame.arrival_us) + frame.data for frame in frames)
