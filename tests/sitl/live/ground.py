"""A ground station on the other end of a wire that needs no socket and no clock."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_sysid.sitl import plan
from gcs_sysid.sitl.flight import Flight
from gcs_sysid.sitl.jsbsim_aircraft import Start
from gcs_sysid.sitl.link import Link
from gcs_sysid.sitl.live import LiveVehicle
from tests.sitl import examples


class Wire:
    """Bytes to and from the vehicle."""

    def __init__(self) -> None:
        self.up, self.down = bytearray(), bytearray()

    def read(self) -> bytes:
        data = bytes(self.up)
        self.up.clear()
        return data

    def write(self, data: bytes) -> None:
        self.down += data


class Ground:
    """Talks to a live vehicle and flies it as fast as the machine can."""

    def __init__(self, flight: Flight | None = None) -> None:
        wire = Wire()
        self.vehicle = LiveVehicle(flight or usual(), wire)
        self.computer = self.vehicle.computer
        self.received: list[Any] = []
        self._wire = wire
        self._packer = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._parser = mavlink.MAVLink(None)

    def send(self, message: mavlink.MAVLink_message) -> None:
        self._wire.up += message.pack(self._packer)
        self._packer.seq = (self._packer.seq + 1) % 256

    def fly(self, seconds: float) -> list[Any]:
        """Fly on, and what arrived meanwhile."""
        before = len(self.received)
        for _ in range(round(seconds * 50)):
            self.vehicle.tick()
            self.received += self._parser.parse_buffer(bytes(self._wire.down)) or []
            self._wire.down.clear()
        return self.received[before:]

    def until(self, done: Callable[[], bool], seconds: float) -> bool:
        """Fly on until something has happened; False if it has not."""
        for _ in range(round(seconds)):
            self.fly(1.0)
            if done():
                return True
        return False

    def command(self, number: int, *parameters: float) -> int:
        """Send a COMMAND_LONG; the result in its acknowledgement."""
        padded = [*parameters, *[0.0] * (7 - len(parameters))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded))
        [ack] = [m for m in self.fly(0.2) if m.get_type() == "COMMAND_ACK"]
        assert ack.command == number
        return ack.result

    def last(self, kind: str) -> Any:
        return next(m for m in reversed(self.received) if m.get_type() == kind)

    def counts(self, seconds: float) -> Counter[str]:
        return Counter(m.get_type() for m in self.fly(seconds))


def usual(**parts: Any) -> Flight:
    """An Ultra Stick in calm air on a perfect radio."""
    believed = examples.ultra_stick()
    legs = plan.standard(believed)
    start = Start(airspeed=legs[0].airspeed, height=legs[0].height)
    return Flight(believed, believed, legs, start=start, **({"link": Link(loss=0.0)} | parts))
