"""DroneCAN nodes: messages packed by the `dronecan` package, the second implementation."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import can
import dronecan
from dronecan import transport


class Bus:
    """Frames of some nodes on a bus, in the order in which they were sent."""

    def __init__(self) -> None:
        self.frames: list[tuple[float, int, bytes]] = []
        self._number = 0

    def send(self, time: float, name: str, *, node: int = 42, **fields: object) -> None:
        """Sends a message at a time [s] on the bus' clock."""
        message = dronecan.TYPENAMES[f"uavcan.equipment.{name}"]()
        for field, value in fields.items():
            if isinstance(value, list):
                for index, entry in enumerate(value):
                    getattr(message, field)[index] = entry
            else:
                setattr(message, field, value)
        transfer = transport.Transfer(
            transfer_id=self._number % 32,
            source_node_id=node,
            transfer_priority=16,
            payload=message,
        )
        self._number += 1
        for index, frame in enumerate(transfer.to_frames()):
            self.frames.append((time + 2e-4 * index, frame.message_id, bytes(frame.bytes)))

    def messages(self) -> Iterator[can.Message]:
        for time, identifier, data in self.frames:
            yield can.Message(
                timestamp=time, arbitration_id=identifier, data=data, is_extended_id=True
            )

    def save(self, path: Path) -> Path:
        with can.Logger(path) as logger:
            for message in self.messages():
                logger(message)
        return path
