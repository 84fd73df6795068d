"""A link through MAVSDK, for those whose vehicle side is MAVSDK: `mavsdk:udpin://0.0.0.0:14540`.

MAVSDK hands over decoded messages, not frames; they are put into MAVLink 2 frames again, so that
recording, filter and model work as for any other link. Sequence numbers are new, signatures are
gone, and what a vehicle sent before MAVSDK had discovered it is not handed over. MAVSDK itself
sends heartbeats and asks the vehicle for its version and components.
"""

from __future__ import annotations

import json
import logging
import math
import queue
import time
from functools import cache
from typing import Any

from mavsdk import (
    ComponentType,
    Configuration,
    ConnectionResult,
    LogLevel,
    Mavsdk,
    log_subscribe,
)
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from pymavlink.dialects.v20 import all as dialect

from gcs_sysid.errors import SourceError
from gcs_sysid.sources.closing import Closing

SCHEME = "mavsdk:"
_LOG = logging.getLogger(__name__)
_WAITING = 65536
"""Messages that may wait to be read; more that arrive meanwhile are dropped and counted."""
_LOOK_S = 0.05
"""How long [s] to wait before looking again for a vehicle."""
_LEVELS = {
    LogLevel.DEBUG: logging.DEBUG,
    LogLevel.INFO: logging.DEBUG,
    LogLevel.WARN: logging.INFO,
    LogLevel.ERROR: logging.WARNING,
}


class MavsdkLink(Closing):
    """An open link. Use as a context, or call `close`.

    Args:
        address: `mavsdk:` and a connection as MAVSDK writes it, for instance
            `mavsdk:udpin://0.0.0.0:14540` or `mavsdk:serial:///dev/ttyUSB0:57600`.

    Raises:
        SourceError: MAVSDK cannot open it.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self.dropped = 0
        self.unknown = 0
        self._arrived: queue.Queue[MavlinkMessage] = queue.Queue(_WAITING)
        self._senders: dict[tuple[int, int], dialect.MAVLink] = {}
        self._plugins: dict[int, MavlinkDirect] = {}
        log_subscribe(_logged)
        self._mavsdk = Mavsdk(
            Configuration.create_with_component_type(ComponentType.GROUND_STATION)
        )
        result = self._mavsdk.add_any_connection(address.removeprefix(SCHEME))
        if result != ConnectionResult.SUCCESS:
            self._mavsdk.destroy()
            reason = result.name.replace("_", " ").lower()
            raise SourceError(
                address,
                f"MAVSDK cannot open it ({reason})",
                fix="write it as mavsdk:udpin://0.0.0.0:14540, and check that nothing else uses it",
            )

    def read(self, timeout_s: float) -> bytes:
        """Frames of what arrived, waiting for it up to `timeout_s`; empty if nothing did."""
        until = time.monotonic() + timeout_s
        while True:
            self._discover()
            left = until - time.monotonic()
            try:
                first = self._arrived.get(timeout=max(min(left, _LOOK_S), 0.0) or 1e-3)
                return b"".join(self._frame(one) for one in (first, *self._waiting()))
            except queue.Empty:
                if left <= 0.0:
                    return b""

    def write(self, data: bytes) -> None:
        """Refused: MAVSDK sends messages of its own making only.

        Raises:
            SourceError: always.
        """
        raise SourceError(
            self.address,
            f"{len(data)} bytes cannot be sent through MAVSDK",
            fix="use udpout: or a serial device to send",
        )

    def send(self, message: dialect.MAVLink_message, system: int) -> None:
        """Sends a message to a vehicle that MAVSDK has found; before that it is lost.

        Args:
            message: whose fields MAVSDK puts into a frame of its own.
            system: number of the vehicle.
        """
        plugin = self._plugins.get(system)
        if plugin is None:
            return
        told = {key: value for key, value in message.to_dict().items() if key != "mavpackettype"}
        plugin.send_message(MavlinkMessage(message.get_type(), 0, 0, system, 0, json.dumps(told)))

    def close(self) -> None:
        """Ends the link."""
        self._mavsdk.destroy()
        if self.dropped or self.unknown:
            _LOG.warning(
                "%s: %d messages dropped, %d not known", self.address, self.dropped, self.unknown
            )

    def _discover(self) -> None:
        """Subscribes to all messages of vehicles that MAVSDK has found since."""
        if self._mavsdk.system_count() == len(self._plugins):
            return
        for system in self._mavsdk.get_systems():
            number = system.get_system_id()
            if number not in self._plugins:
                plugin = self._plugins[number] = MavlinkDirect(system)
                plugin.subscribe_message("", self._take)

    def _take(self, message: MavlinkMessage, _data: object) -> None:
        # In MAVSDK's own thread: nothing but putting aside.
        try:
            self._arrived.put_nowait(message)
        except queue.Full:
            self.dropped += 1

    def _waiting(self) -> list[MavlinkMessage]:
        return [self._arrived.get_nowait() for _ in range(self._arrived.qsize())]

    def _frame(self, message: MavlinkMessage) -> bytes:
        """The message as a MAVLink 2 frame; empty for one that no dialect defines."""
        kind = _kinds().get(message.message_name)
        sender = (message.system_id, message.component_id)
        if kind is None or sender[0] == 0:
            self.unknown += 1
            return b""
        link = self._senders.setdefault(sender, dialect.MAVLink(None, *sender))
        return bytes(kind(**fields(kind, message.fields_json)).pack(link))


@cache
def _kinds() -> dict[str, type[dialect.MAVLink_message]]:
    return {kind.msgname: kind for kind in dialect.mavlink_map.values()}


def fields(kind: type[dialect.MAVLink_message], text: str) -> dict[str, Any]:
    """Field values of a message class of pymavlink from MAVSDK's JSON.

    Numbers that are not finite, which JSON does not know, come as null; extension fields that a
    sender did not have are zero.
    """
    told = json.loads(text)
    values: dict[str, Any] = {}
    for name, letter, count in zip(
        kind.ordered_fieldnames, kind.native_format[1:], kind.array_lengths, strict=True
    ):
        value = told.get(name)
        if chr(letter) in "sc":
            characters = str(value or "").encode()
            values[name] = characters if count else characters[:1] or b"\0"
        elif count:
            given = value if isinstance(value, list) else []
            values[name] = [_number(one, chr(letter)) for one in given] or [0] * count
        else:
            values[name] = _number(value, chr(letter)) if name in told else 0
    return values


def _number(value: Any, letter: str) -> float | int:
    if value is None:
        return math.nan if letter in "fd" else 0
    return float(value) if letter in "fd" else int(value)


def _logged(level: LogLevel, message: str, _file: str | None, _line: int) -> bool:
    """What MAVSDK would print goes to the program's log."""
    _LOG.log(_LEVELS[level], "%s", message)
    return True
