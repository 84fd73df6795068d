"""The only messages that this program sends to a vehicle: heartbeats, and requests for rates."""

from __future__ import annotations

import time

from pymavlink.dialects.v20 import all as dialect

SYSTEM, COMPONENT = 254, dialect.MAV_COMP_ID_USER1
"""Who sends. Autopilots watch the ground station (255) by its heartbeat and come home without it:
what listens beside it must not stand in for it, so number and type are others."""

BUS_COMPONENT = dialect.MAV_COMP_ID_USER2
"""Who, within `SYSTEM`, passes on what a CAN bus at this computer brings."""

_SIGNING_EPOCH_S = 1_420_070_400
"""Signatures count time from 1 January 2015 (mavlink.io, "Message Signing")."""


class Sender:
    """Makes frames.

    Args:
        key: secret key; with it every frame is signed.
        clock_s: wall clock [s since 1970], with which signatures begin.
    """

    def __init__(self, key: bytes | None = None, *, clock_s: float | None = None) -> None:
        self._link = dialect.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)
        if key is not None:
            signing = self._link.signing
            now = time.time() if clock_s is None else clock_s
            signing.secret_key, signing.sign_outgoing = key, True
            signing.timestamp = int((now - _SIGNING_EPOCH_S) * 100_000)

    def heartbeat(self) -> bytes:
        """That somebody is here; neither an autopilot nor a ground station."""
        return self._packed(
            dialect.MAVLink_heartbeat_message(
                dialect.MAV_TYPE_GENERIC,
                dialect.MAV_AUTOPILOT_INVALID,
                0,
                0,
                dialect.MAV_STATE_ACTIVE,
                3,
            )
        )

    def interval(self, vehicle: tuple[int, int], message: int, rate: float, again: int) -> bytes:
        """Asks a vehicle (system, component) to send a message type at a rate [Hz]."""
        return self._packed(
            dialect.MAVLink_command_long_message(
                *vehicle,
                dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
                again,
                *(float(message), float(round(1e6 / rate))),
                *(0.0, 0.0, 0.0, 0.0, 0.0),
            )
        )

    def group(self, vehicle: tuple[int, int], group: int, rate: float) -> bytes:
        """Asks for a group of message types, as autopilots knew it before."""
        wanted = max(round(rate), 1)
        return self._packed(dialect.MAVLink_request_data_stream_message(*vehicle, group, wanted, 1))

    def _packed(self, message: dialect.MAVLink_message) -> bytes:
        return bytes(message.pack(self._link))
