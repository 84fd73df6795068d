"""CAN frames that travelled through MAVLink, as CAN_FRAME or CANFD_FRAME."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Int

from gcs_sysid.sources.can.transfers import CanFrame
from gcs_sysid.sources.tables import MessageTable

SCHEME = "can:"
"""Beginning of the address of a bus at this computer."""
TUNNELS = ("CAN_FRAME", "CANFD_FRAME")
FLAG_EXTENDED = 0x80000000
"""Of the identifier: it has 29 bits (as SocketCAN marks it)."""
_EXTENDED = 0x1FFFFFFF


def tunnelled(table: MessageTable, time_us: Int[np.ndarray, " message"]) -> Iterator[CanFrame]:
    """Frames that came as CAN_FRAME or CANFD_FRAME, at the times of these messages."""
    rows = zip(
        time_us.tolist(),
        table.fields["id"].tolist(),
        table.fields["len"].tolist(),
        table.fields["data"].tolist(),
        strict=True,
    )
    for time, identifier, length, data in rows:
        if identifier & FLAG_EXTENDED:
            yield CanFrame(time, identifier & _EXTENDED, bytes(data[:length]))
