"""Decoded messages by vehicle and type, before units and clocks: what every reader hands on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Int


class TableKey(NamedTuple):
    """Who sent a table's messages, and which message type they are."""

    system: int
    component: int
    name: str


@dataclass(frozen=True)
class MessageTable:
    """All messages of one type from one component, in the order they were received.

    Attributes:
        order: position of each message in the log, counted over all types.
        link_us: arrival time at the ground station [µs since 1970].
        fields: raw values by MAVLink field name, in the units of the message definition; shape
            (message,) or (message, element); text fields are bytes.
    """

    order: Int[np.ndarray, " message"]
    link_us: Int[np.ndarray, " message"]
    fields: Mapping[str, np.ndarray]

    @property
    def count(self) -> int:
        """Number of messages."""
        return int(self.order.size)

    def subset(self, index: np.ndarray) -> MessageTable:
        """The messages selected by `index` (a mask or positions)."""
        return MessageTable(
            order=self.order[index],
            link_us=self.link_us[index],
            fields={name: values[index] for name, values in self.fields.items()},
        )


@dataclass(frozen=True)
class LogTables:
    """Everything a reader found in a log.

    Attributes:
        tables: by sender and message type.
        lost: what could not be used, counted by reason: `bad_crc`, `unknown`, `garbage_bytes`,
            `truncated`.
    """

    tables: Mapping[TableKey, MessageTable]
    lost: Mapping[str, int]
