"""Plays a recorded flight to a link, with its own timing."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gcs_sysid.errors import SourceError
from gcs_sysid.sources import content, encode, tlog
from gcs_sysid.sources.registry import open_recording

_STEP_S = 0.5


@dataclass(frozen=True)
class Playable:
    """What can be played.

    Attributes:
        frames: (when it is due [µs], frame), in order.
        left_out: what no message carries, with how many values; see `encode`.
    """

    frames: Sequence[tuple[int, bytes]]
    left_out: Mapping[str, int] = field(default_factory=dict)


def load(log: Path, *, vehicle: int | None = None, columns: Path | None = None) -> Playable:
    """The frames of a log: of telemetry as received, of any other as a vehicle would send them.

    Args:
        log: any log that `registry.open_recording` reads.
        vehicle: MAVLink system id to play; None plays all of a .tlog.
        columns: what the columns of a table are.

    Raises:
        SourceError: the log cannot be read, or holds nothing that could be sent.
        RefusedError: another vehicle was asked for.
    """
    if log.suffix.lower() == ".tlog" and vehicle is None:
        found = Playable(tlog.frames(content.read(log)))
    else:
        encoded = encode.frames(open_recording(log, vehicle=vehicle, columns=columns))
        found = Playable(encoded.frames, encoded.left_out)
    if not found.frames:
        raise SourceError(str(log), "holds no MAVLink message", fix="give a recorded flight")
    return found


def play(
    frames: Sequence[tuple[int, bytes]],
    send: Callable[[bytes], None],
    *,
    speed: float = 1.0,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
    progress: Callable[[float, float], None] | None = None,
) -> int:
    """Sends every frame when it is due.

    Args:
        frames: (when it is due [µs], frame), in order.
        send: takes one frame, for instance `Link.write`.
        speed: 2 plays twice as fast; infinity as fast as `send` takes frames.
        clock: seconds, from any origin, never falling.
        sleep: waits for some seconds.
        progress: told (seconds of the log played, seconds in the log) at least twice a second.

    Returns:
        Number of frames sent.
    """
    if not frames:
        return 0
    first_us = frames[0][0]
    duration = max(link_us for link_us, _ in frames) - first_us
    begin = clock()
    for link_us, frame in frames:
        due = begin + (link_us - first_us) * 1e-6 / speed
        # Long pauses are waited for in steps, so that progress goes on.
        while (left := due - clock()) > 0.0:
            sleep(min(left, _STEP_S))
            if progress is not None:
                played = (link_us - first_us) * 1e-6 - max(due - clock(), 0.0) * speed
                progress(played, duration * 1e-6)
        send(frame)
    if progress is not None:
        progress(duration * 1e-6, duration * 1e-6)
    return len(frames)
