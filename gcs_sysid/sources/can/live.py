"""What CAN nodes measure, as it comes in: channels by stream, without knowing the future.

Channels that belong to one stream come in several messages (angle of attack and sideslip, say).
They are put together as in a log: those within `joined.BESIDE_US` of each other are one sample,
which is complete when the next of a channel comes that it has already.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from gcs_sysid.sources.can.streams import pieces
from gcs_sysid.sources.can.transfers import CanFrame, Transfers
from gcs_sysid.sources.joined import BESIDE_US


@dataclass
class Measured:
    """Channels of a stream at a time [µs on the clock of the frames]."""

    stream: str
    time_us: int
    channels: dict[str, float] = field(default_factory=dict)


class CanSamples:
    """Turns frames into samples.

    Attributes:
        streams: names of streams that were heard.
    """

    def __init__(self) -> None:
        self._transfers = Transfers()
        self._open: dict[str, Measured] = {}
        self._short = 0
        self.streams: set[str] = set()

    @property
    def lost(self) -> dict[str, int]:
        """What could not be used, by reason."""
        lost = dict(self._transfers.lost)
        lost["can_truncated"] += self._short
        return lost

    def feed(self, frames: Iterable[CanFrame]) -> list[Measured]:
        """Samples that these frames complete."""
        done: list[Measured] = []
        for transfer in self._transfers.feed(frames):
            found, short = pieces([transfer])
            self._short += short
            for piece in found:
                values = {name: float(column[0]) for name, column in piece.channels.items()}
                done += self._added(piece.stream, int(piece.time_us[0]), values)
        return done

    def _added(self, stream: str, time_us: int, values: dict[str, float]) -> list[Measured]:
        self.streams.add(stream)
        waiting = self._open.get(stream)
        fits = (
            waiting is not None
            and abs(time_us - waiting.time_us) <= BESIDE_US
            and not values.keys() & waiting.channels.keys()
        )
        if waiting is not None and fits:
            waiting.channels |= values
            return []
        self._open[stream] = Measured(stream, time_us, values)
        return [] if waiting is None else [waiting]
