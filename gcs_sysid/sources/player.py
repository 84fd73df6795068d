"""Plays a recorded flight to a link, with its own timing."""

from __future__ import annotations

import time
from collections.abc import Callable

from gcs_sysid.sources import tlog

_STEP_S = 0.5


def play(
    data: bytes,
    send: Callable[[bytes], None],
    *,
    speed: float = 1.0,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
    progress: Callable[[float, float], None] | None = None,
) -> int:
    """Sends every frame of a log when it is due.

    Args:
        data: content of a .tlog.
        send: takes one frame, for instance `Link.write`.
        speed: 2 plays twice as fast; infinity as fast as `send` takes frames.
        clock: seconds, from any origin, never falling.
        sleep: waits for some seconds.
        progress: told (seconds of the log played, seconds in the log) at least twice a second.

    Returns:
        Number of frames sent.
    """
    frames = tlog.frames(data)
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
