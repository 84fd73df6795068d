"""A vehicle that flies in real time and speaks MAVLink over a link."""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Callable, Iterable
from typing import IO, Any, Protocol, runtime_checkable

import numpy as np
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_sysid.errors import InputError
from gcs_sysid.sitl import commands, status, telemetry
from gcs_sysid.sitl.autopilot import PERIOD
from gcs_sysid.sitl.computer import Computer
from gcs_sysid.sitl.flight import Flight
from gcs_sysid.sitl.inputs import THROTTLE
from gcs_sysid.sitl.link import Transmitter, tlog
from gcs_sysid.sitl.telemetry import Snapshot
from gcs_sysid.sitl.truth import Witness
from gcs_sysid.sitl.vehicle import Vehicle, told_late

_log = logging.getLogger(__name__)

SCHEMES = ("udpout:", "udpin:", "udp:", "tcpin:", "tcp:")
"""Beginnings of link addresses; a serial device is a path with the baud rate behind a comma."""

_MISSION_CHECK = 5
"""Ticks between two looks at an unfinished mission upload."""


@runtime_checkable
class Wire(Protocol):
    """Both directions of a link; `read` does not wait."""

    def read(self) -> bytes:
        """What has arrived."""
        ...

    def write(self, data: bytes) -> None:
        """Send."""
        ...


class LiveVehicle:
    """A vehicle on the end of a wire.

    Args:
        flight: aircraft, air, sensors, radio, and what to fly until told otherwise.
        wire: the link; it stays the caller's to close.
        record: where every frame that arrives is kept too, as a .tlog; the caller's to close.
        witness: what sees the truth.
    """

    def __init__(
        self,
        flight: Flight,
        wire: Wire,
        *,
        record: IO[bytes] | None = None,
        witness: Witness | None = None,
    ) -> None:
        sensors, link = np.random.SeedSequence(flight.seed).spawn(2)
        self._flight = flight
        self._wire, self._record, self._witness = wire, record, witness
        self._vehicle = Vehicle(flight, generator=np.random.default_rng(sensors))
        self._transmitter = Transmitter(flight.link, generator=np.random.default_rng(link))
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._delays = told_late(flight.hidden.delays)
        self.computer = Computer(flight)
        self._used = 0.0
        self._tick = 0

    @property
    def time(self) -> float:
        """How long it has flown [s]."""
        return self._tick * PERIOD

    @property
    def sent(self) -> int:
        """Messages sent so far, lost ones included."""
        return self._transmitter.sent

    def tick(self) -> None:
        """Sense, obey, command and tell, then move on by one period."""
        state, measurement = self._vehicle.sense()
        if self._witness is not None:
            self._witness.see(self._tick, state, self._vehicle)
        controls = self.computer.command(measurement, self.time)
        pulses = self._vehicle.mixer.pulses(controls)
        power = min(max(controls[THROTTLE], 0.0), 1.0)
        self._used += telemetry.current(power) * PERIOD / 3600.0
        snapshot = Snapshot(
            self._tick,
            self._flight.epoch_us,
            measurement,
            pulses,
            power,
            self._used,
            self._vehicle.motors(),
            status=self.computer.status(self.time),
        )
        self._tell(snapshot)
        self._listen(snapshot)
        arrived = self._transmitter.arrived(snapshot.unix_us)
        for frame in arrived:
            self._wire.write(frame.data)
        if self._record is not None:
            self._record.write(tlog(arrived))
        self._vehicle.move(pulses)
        self._tick += 1

    def _tell(self, snapshot: Snapshot) -> None:
        for name in self.computer.streams.due(snapshot.boot_us):
            told = snapshot.told_late(self._delays.get(name, 0.0))
            self._transmitter.send(status.BUILDERS[name](told), told.unix_us)
        self._send(self.computer.outbox, snapshot.unix_us)
        self.computer.outbox.clear()
        if self._tick % _MISSION_CHECK == 0:
            self._send(self.computer.mission.remind(self.time), snapshot.unix_us)

    def _listen(self, snapshot: Snapshot) -> None:
        data = self._wire.read()
        for message in (self._parser.parse_buffer(data) or []) if data else []:
            answers = commands.receive(self.computer, message, commands.Now(self.time, snapshot))
            self._send(answers, snapshot.unix_us)

    def _send(self, messages: Iterable[telemetry.Message], unix_us: int) -> None:
        for message in messages:
            self._transmitter.send(message, unix_us)


def fly(
    vehicle: LiveVehicle,
    *,
    duration: float | None = None,
    now: Callable[[], float] = clock.monotonic,
    wait: Callable[[float], None] = clock.sleep,
) -> None:
    """Fly in real time, for `duration` [s] or until interrupted.

    A machine that is too slow by more than a second flies slower than real time and says so.
    """
    begun, behind = now(), False
    while duration is None or vehicle.time < duration:
        vehicle.tick()
        ahead = begun + vehicle.time - now()
        if ahead > 0.0:
            wait(ahead)
        elif ahead < -1.0:
            begun -= ahead
            if not behind:
                _log.warning("this machine is too slow to fly in real time")
            behind = True


class Link:
    """A `Wire` by address, opened by pymavlink; use as a context.

    Args:
        address: `udpout:HOST:PORT`, `udpin:`, `tcp:` (connects), `tcpin:` (waits for a client), or
            a serial device with its baud rate, `/dev/ttyUSB0,57600`.

    Raises:
        InputError: the address is malformed, or the link cannot be opened.
    """

    def __init__(self, address: str) -> None:
        serial = address.startswith("/dev/") or address[:3] == "COM"
        if not (serial or address.startswith(SCHEMES)):
            raise InputError(
                address,
                "is no link",
                fix="write it as udpout:127.0.0.1:14550 or tcpin:0.0.0.0:5760",
            )
        try:
            self._port: Any = mavutil.mavlink_connection(address, retries=1, source_system=1)
        except (OSError, ValueError) as error:
            raise InputError(
                address, f"link failed ({error})", fix="check the address, and what else uses it"
            ) from error

    def __enter__(self) -> Link:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def read(self) -> bytes:
        """What has arrived, up to a few messages."""
        data = self._port.recv(65535)
        # Where there was nothing to read, pymavlink returns an empty text.
        return data if isinstance(data, bytes) else b""

    def write(self, data: bytes) -> None:
        """Send; while nobody listens it is lost, as with a radio."""
        try:
            self._port.write(data)
        except OSError as error:
            _log.debug("not sent: %s", error)

    def close(self) -> None:
        """End the link."""
        self._port.close()
