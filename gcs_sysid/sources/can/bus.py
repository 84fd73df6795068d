"""A CAN bus at this computer, through python-can: `can:socketcan:can0`, `can:virtual:bench`.

What is heard is handed on as MAVLink frames (CAN_FRAME, CANFD_FRAME) of this program's own, so that
one recording holds the flight and the bus, and any tool that knows these messages can read it.
Nothing is ever sent to the bus.
"""

from __future__ import annotations

import time
from typing import Any

import can
from pymavlink.dialects.v20 import all as dialect

from gcs_sysid.errors import SourceError
from gcs_sysid.sources.can.tunnel import FLAG_EXTENDED, SCHEME
from gcs_sysid.sources.closing import Closing
from gcs_sysid.sources.sender import BUS_COMPONENT, SYSTEM

_SHORT = 8
_MOST = 256
"""Frames handed on at a time."""


class CanLink(Closing):
    """An open bus. Use as a context, or call `close`.

    Args:
        address: `can:INTERFACE:CHANNEL`, the interface as python-can names it, with the bit rate
            behind a comma where it must be set (`can:slcan:/dev/ttyACM0,1000000`).

    Raises:
        SourceError: the address is malformed, or the bus cannot be opened.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._link = dialect.MAVLink(None, srcSystem=SYSTEM, srcComponent=BUS_COMPONENT)
        interface, _, place = address.removeprefix(SCHEME).partition(":")
        channel, _, rate = place.partition(",")
        if not (interface and channel) or (rate and not rate.isdigit()):
            raise SourceError(
                address, "is no bus", fix="write it as can:socketcan:can0 or can:slcan:/dev/ttyACM0"
            )
        options: dict[str, Any] = {"bitrate": int(rate)} if rate else {}
        try:
            self._bus = can.Bus(interface=interface, channel=channel, **options)
        except (can.CanError, OSError, ValueError) as error:
            raise self._failed(error) from error

    def read(self, timeout_s: float) -> bytes:
        """Frames of what arrived, waiting for the first up to `timeout_s`.

        Raises:
            SourceError: the bus is gone.
        """
        frames = []
        until = time.monotonic() + timeout_s
        try:
            while len(frames) < _MOST:
                message = self._bus.recv(0.0 if frames else max(until - time.monotonic(), 0.0))
                if message is None:
                    break
                if message.is_extended_id and not message.is_error_frame | message.is_remote_frame:
                    frames.append(self._frame(message))
        except (can.CanError, OSError) as error:
            raise self._failed(error) from error
        return b"".join(frames)

    def write(self, data: bytes) -> None:
        """Refused: this program never sends to a bus.

        Raises:
            SourceError: always.
        """
        raise SourceError(
            self.address, f"{len(data)} bytes are not sent to a CAN bus", fix="give a link"
        )

    def close(self) -> None:
        """Leaves the bus."""
        self._bus.shutdown()

    def _frame(self, message: can.Message) -> bytes:
        short = len(message.data) <= _SHORT
        kind = dialect.MAVLink_can_frame_message if short else dialect.MAVLink_canfd_frame_message
        size = len(message.data)
        data = [*message.data, *[0] * ((_SHORT if short else 64) - size)]
        told = kind(0, 0, 0, size, message.arbitration_id | FLAG_EXTENDED, data)
        return bytes(told.pack(self._link))

    def _failed(self, error: Exception) -> SourceError:
        return SourceError(
            self.address,
            f"CAN bus failed ({' '.join(str(error).split())})",
            fix="check interface and channel, and that the bus is up",
        )
