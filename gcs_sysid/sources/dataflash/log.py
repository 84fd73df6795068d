"""What a DataFlash log holds, however it was written: messages by type, and what was lost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy import ndimage

from gcs_sysid.sources.dataflash.formats import Format

PLAUSIBLE_US = 10_000_000
"""A stamp further than this from those of the messages around it is damaged."""
REBOOT_US = 2_000_000
"""A clock that falls back by more than this, and stays back, has restarted."""
PAUSE_US = 1_000_000
"""Between a run of the autopilot and one appended to it, whose distance nothing tells."""
_NEIGHBOURS = 9


@dataclass(frozen=True)
class Messages:
    """All messages of one type.

    Attributes:
        format: what the fields are.
        time_us: since boot, not before those of the message before in the file by more than tasks
            are late.
        rows: field values as they lie in the log, a structured array, or columns by name of a log
            in text; empty where nobody asked for them.
        scaled: whether letters that imply a scale have been applied already, as in text.
    """

    format: Format
    time_us: Int[np.ndarray, " message"]
    rows: np.ndarray | Mapping[str, np.ndarray]
    scaled: bool = False

    def has(self, name: str) -> bool:
        """Whether the type has a field of that name."""
        return name in self.format.fields

    def raw(self, name: str) -> np.ndarray:
        """A field as it lies in the log."""
        return self.rows[name]

    def value(self, name: str) -> Float[np.ndarray, " message"]:
        """A field in the unit that its format states, NaN where it is no number."""
        at = self.format.fields.index(name)
        values = self.rows[name].astype(np.float64)
        implied = self.scaled and self.format.letters[at] in "cCeEL"
        return values if implied else self.format.scale(name) * values


@dataclass(frozen=True)
class DataflashLog:
    """Everything a reader found.

    Attributes:
        messages: by type name.
        lost: what could not be used, counted by reason.
        restarts: how often the autopilot's clock started again.
    """

    messages: Mapping[str, Messages]
    lost: Mapping[str, int]
    restarts: int = 0

    @property
    def count(self) -> int:
        """Number of messages, definitions included."""
        return sum(one.time_us.size for one in self.messages.values())


class Stamps:
    """Judges the stamps of messages in the order of the log, block by block."""

    def __init__(self) -> None:
        self._latest = 0
        self._shift = 0
        self.restarts = 0
        self.bad = 0

    def judge(
        self, stamp: Int[np.ndarray, " message"]
    ) -> tuple[Int[np.ndarray, " message"], np.ndarray]:
        """Times since boot, continued over restarts, and which of them can be believed."""
        if not stamp.size:
            return stamp, np.zeros(0, dtype=bool)
        usual = ndimage.median_filter(stamp, size=_NEIGHBOURS, mode="nearest")
        good = np.abs(stamp - usual) < PLAUSIBLE_US
        self.bad += int(np.sum(~good))
        before = np.concatenate([[self._latest], usual[:-1]])
        restart = np.flatnonzero(usual < before - REBOOT_US)
        ahead = np.zeros(stamp.size, dtype=np.int64)
        ahead[restart] = before[restart] + PAUSE_US - usual[restart]
        shift = self._shift + np.cumsum(ahead)
        self.restarts += restart.size
        self._latest, self._shift = int(usual[-1]), int(shift[-1])
        return stamp + shift, good
