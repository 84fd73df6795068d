"""What a test input is flown through from the ground: sticks, modes and the newest telemetry.

Sticks go as RC_CHANNELS_OVERRIDE, which an ArduPilot gives back to its own receiver when they are
released, or not repeated for RC_OVERRIDE_TIME.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, Protocol, runtime_checkable

from pymavlink.dialects.v20 import all as mavlink

from gcs_sysid.errors import SourceError
from gcs_sysid.sources.closing import Closing
from gcs_sysid.sources.link import AnyLink, Link, open_link

STATION = (255, 190)
"""Sender of what is sent: the usual numbers of a ground station (SYSID_MYGCS)."""
RELEASE, KEEP = 0, 65535
HEARTBEAT_S = 1.0
WANTED = {"ATTITUDE": 50.0, "VFR_HUD": 20.0, "GLOBAL_POSITION_INT": 10.0}
"""Telemetry that flying an input needs [Hz]."""


@runtime_checkable
class _Sender(Protocol):
    """A link that frames messages by itself."""

    def send(self, message: mavlink.MAVLink_message, system: int) -> None: ...


class Cockpit(Closing):
    """A vehicle's sticks and what it tells. Use as a context, or call `close`.

    Args:
        address: of a link that can send, see `gcs_sysid.sources.link`, or `mavsdk:…`.
        opener: of links; for tests.
        now: clock [s].
    """

    def __init__(
        self,
        address: str,
        *,
        opener: Callable[[str], AnyLink] = open_link,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self.address = address
        self.newest: dict[str, Any] = {}
        self.heard = -float("inf")
        self._link = opener(address)
        self._now = now
        self._packer = mavlink.MAVLink(None, *STATION)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._vehicle: tuple[int, int] | None = None
        self._beat = -float("inf")

    def close(self) -> None:
        """Ends the link."""
        self._link.close()

    def poll(self, timeout_s: float) -> bool:
        """Takes what has arrived, waiting for it up to `timeout_s`; keeps the link alive.

        Returns:
            Whether anything had arrived.
        """
        self._keep_alive()
        data = self._link.read(timeout_s)
        arrived: list[Any] = (self._parser.parse_buffer(data) or []) if data else []
        for message in arrived:
            sender = (message.get_srcSystem(), message.get_srcComponent())
            kind = message.get_type()
            if kind == "HEARTBEAT" and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
                self._vehicle = self._vehicle or sender
            if sender == self._vehicle:
                self.newest[kind] = message
                self.heard = self._now()
        return bool(data)

    def find(self, timeout_s: float) -> None:
        """Waits for an autopilot, and asks it for what flying needs.

        Raises:
            SourceError: none speaks in that time.
        """
        until = self._now() + timeout_s
        while self._vehicle is None:
            if self._now() > until:
                raise SourceError(
                    self.address,
                    f"no autopilot speaks in {timeout_s:.0f} s",
                    fix="start the vehicle, and check the address",
                )
            self.poll(0.1)
        for name, rate in WANTED.items():
            number = float(getattr(mavlink, f"MAVLINK_MSG_ID_{name}"))
            self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1e6 / rate)

    @property
    def mode(self) -> int | None:
        """Custom mode of the vehicle; None before its first heartbeat."""
        beat = self.newest.get("HEARTBEAT")
        return None if beat is None else int(beat.custom_mode)

    def set_mode(self, mode: int) -> None:
        """Asks for a custom mode."""
        enabled = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        self.command(mavlink.MAV_CMD_DO_SET_MODE, float(enabled), float(mode))

    def set_airspeed(self, airspeed: float) -> None:
        """Asks the mode that flies to hold an airspeed [m/s]."""
        self.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 0.0, airspeed, -1.0)

    def command(self, number: int, *parameters: float) -> None:
        """Sends a command."""
        padded = [*parameters, *[0.0] * (7 - len(parameters))]
        target = self._target()
        self._send(mavlink.MAVLink_command_long_message(*target, number, 0, *padded))

    def sticks(self, pulses: Mapping[int, int]) -> None:
        """Overrides channels 1 to 8 [µs]; those not named stay as they are."""
        values = [pulses.get(channel, KEEP) for channel in range(1, 9)]
        self._send(mavlink.MAVLink_rc_channels_override_message(*self._target(), *values))

    def release(self, channels: tuple[int, ...]) -> None:
        """Gives channels back to the vehicle's receiver."""
        self.sticks(dict.fromkeys(channels, RELEASE))

    def _keep_alive(self) -> None:
        if self._now() - self._beat < HEARTBEAT_S:
            return
        self._beat = self._now()
        kind, nobody = mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID
        self._send(mavlink.MAVLink_heartbeat_message(kind, nobody, 0, 0, 0, 3))

    def _target(self) -> tuple[int, int]:
        if self._vehicle is None:
            raise SourceError(self.address, "no autopilot was heard", fix="call `find` first")
        return self._vehicle

    def _send(self, message: mavlink.MAVLink_message) -> None:
        if isinstance(self._link, _Sender):
            if self._vehicle is not None:
                self._link.send(message, self._vehicle[0])
            return
        data = bytes(message.pack(self._packer))
        self._packer.seq = (self._packer.seq + 1) % 256
        if isinstance(self._link, Link):
            self._link.write(data)
