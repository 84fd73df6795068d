"""Several measurements of one stream, taken at nearly the same times, on one column of times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid.recording import Stream

BESIDE_US = 2000.0
"""What an autopilot logs in one pass of a task carries stamps at most this far apart [µs]: a few
microseconds between two writes, a pass of a 400 Hz loop at the most."""


@dataclass(frozen=True)
class Piece:
    """Values of some channels at some times.

    Attributes:
        stream: the stream they belong to.
        time_us: when, µs on the log's own clock, not decreasing.
        channels: SI values.
    """

    stream: str
    time_us: Float[np.ndarray, " piece"]
    channels: Mapping[str, Float[np.ndarray, " piece"]]


def streams(
    pieces: Sequence[Piece], origin_us: float, *, beside_us: float = 0.0
) -> dict[str, Stream]:
    """The streams that the pieces make up.

    Args:
        pieces: in the order of importance: the first of a stream sets its times.
        origin_us: time zero of the recording on the clock of the pieces.
        beside_us: a value this close to a time of a more important piece belongs to it; others
            get a row of their own, in which what was not measured is NaN.
    """
    names = sorted({piece.stream for piece in pieces})
    return {
        name: _stream(name, [p for p in pieces if p.stream == name], origin_us, beside_us)
        for name in names
    }


def _stream(name: str, pieces: Sequence[Piece], origin_us: float, beside_us: float) -> Stream:
    if not any(piece.channels for piece in pieces):
        time = np.sort(np.concatenate([(p.time_us - origin_us) * 1e-6 for p in pieces]))
        return Stream(name=name, time=time, link_time=time, channels={})
    rows: list[np.ndarray] = []
    time_us = np.unique(pieces[0].time_us)
    for piece in pieces:
        placed = _placed(time_us, piece.time_us, beside_us)
        rows.append(placed)
        time_us = np.union1d(time_us, placed)
    channels: dict[str, np.ndarray] = {}
    for piece, placed in zip(pieces, rows, strict=True):
        at = np.searchsorted(time_us, placed)
        for channel, values in piece.channels.items():
            column = channels.setdefault(channel, np.full(time_us.size, np.nan))
            column[at] = np.where(np.isnan(column[at]), values, column[at])
    time = (time_us - origin_us) * 1e-6
    return Stream(name=name, time=time, link_time=time, channels=channels)


def _placed(
    time_us: Float[np.ndarray, " row"], own_us: Float[np.ndarray, " piece"], beside_us: float
) -> Float[np.ndarray, " piece"]:
    """The times of a piece, moved to the nearest of `time_us` where that is close enough."""
    if not time_us.size:
        return own_us
    right = np.clip(np.searchsorted(time_us, own_us), 0, time_us.size - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(
        np.abs(time_us[right] - own_us) <= np.abs(own_us - time_us[left]),
        time_us[right],
        time_us[left],
    )
    return np.where(np.abs(nearest - own_us) <= beside_us, nearest, own_us)
