"""The radio between vehicle and ground station, and the file in which the station keeps it.

A .tlog is a sequence of frames as received, each after its arrival time: 8 bytes, big-endian,
microseconds since 1970 (as Mission Planner, QGroundControl and pymavlink write it).
"""

from __future__ import annotations

import heapq
import math
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
    """Numbers, packs and sends messages in the order of their times, and hands over what arrives.

    Args:
        link: the radio.
        generator: where its randomness comes from.
    """

    def __init__(self, link: Link, *, generator: np.random.Generator) -> None:
        self._link = link
        self._generator = generator
        self._packer = mavlink.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)
        self._waiting: list[tuple[int, int, Message | None, bool]] = []
        self._under_way: list[tuple[int, int, bytes]] = []
        self.sent = 0

    def send(self, message: Message, unix_us: int, *, reliable: bool = False) -> None:
        """Send one message at a wall time [µs]; a `reliable` one is repeated until it arrives."""
        self.sent += 1
        heapq.heappush(self._waiting, (unix_us, self.sent, message, reliable))

    def restart(self, unix_us: int) -> None:
        """Number messages from zero from a wall time on [µs], as a sender just switched on does."""
        heapq.heappush(self._waiting, (unix_us, -1, None, False))

    def arrived(self, until_us: int | None = None) -> list[Frame]:
        """What arrives up to a wall time [µs], or ever; each frame once, in order of arrival."""
        end = math.inf if until_us is None else until_us
        while self._waiting and self._waiting[0][0] <= end:
            self._transmit(*heapq.heappop(self._waiting))
        frames = []
        while self._under_way and self._under_way[0][0] <= end:
            arrival_us, _, data = heapq.heappop(self._under_way)
            frames.append(Frame(arrival_us, data))
        return frames

    def _transmit(self, unix_us: int, order: int, message: Message | None, reliable: bool) -> None:
        if message is None:
            self._packer.seq = 0
            return
        data = bytes(message.pack(self._packer))
        self._packer.seq = (self._packer.seq + 1) % 256
        luck, late = self._generator.random(), self._generator.standard_exponential()
        if reliable or luck >= self._link.loss:
            delay = self._link.latency + self._link.jitter * late
            heapq.heappush(self._under_way, (unix_us + round(1e6 * delay), order, data))


def tlog(frames: Iterable[Frame]) -> bytes:
    """The frames as the contents of a .tlog."""
    return b"".join(struct.pack(">Q", frame.arrival_us) + frame.data for frame in frames)
