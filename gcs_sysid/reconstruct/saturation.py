"""Sensors at the end of their range: what they tell there is the end, and no measurement.

Between what can be measured and what cannot, everything beyond piles up on one value. The tails of
a motion that was measured do the opposite: extreme values are told once or twice (of ArduPlane's
own flights, 30 000 samples each, no more than three times), and seldomer than those next to them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid.reconstruct.measurements import AIRSPEED_STREAMS, GYRO_STREAMS
from gcs_sysid.recording import Recording

UNITS: Mapping[str, str] = {
    **dict.fromkeys(("p", "q", "r"), "rad/s"),
    **dict.fromkeys(("acc_x", "acc_y", "acc_z"), "m/s²"),
    **dict.fromkeys(("alpha", "beta"), "rad"),
    "airspeed": "m/s",
}
"""Of what can saturate."""
STREAMS = (*GYRO_STREAMS, *AIRSPEED_STREAMS, "AOA_SSA")
TOGETHER = 3
"""Samples in a row at an end: a top that is flat for a moment is no end."""
SAMPLES = 5
"""At an end, fewer of them are no pile."""
NEXT = 10
"""Values next to the extreme one that it is compared with."""
PILED = 3.0
"""A pile is so many times as high as any of them."""


def at_limits(values: Float[np.ndarray, " sample"]) -> dict[float, Bool[np.ndarray, " sample"]]:
    """Ends of its range that a channel reached, with the samples there.

    Args:
        values: one channel in the order of time; NaN where it was not measured.
    """
    known = values[np.isfinite(values)]
    levels, counts = np.unique(known, return_counts=True)
    if levels.size <= NEXT:
        return {}
    found = {}
    for level, piled, beside in (
        (levels[0], counts[0], counts[1 : NEXT + 1]),
        (levels[-1], counts[-1], counts[-NEXT - 1 : -1]),
    ):
        there = values == level
        if piled >= SAMPLES and piled > PILED * beside.max() and _together(there) >= TOGETHER:
            found[float(level)] = there
    return found


def _together(there: Bool[np.ndarray, " sample"]) -> int:
    """Samples of the longest run."""
    turns = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(np.int8)))
    return int(np.max(turns[1::2] - turns[::2], initial=0))


def without_saturated(
    recording: Recording, flown: Sequence[tuple[float, float]]
) -> tuple[Recording, tuple[str, ...]]:
    """The recording with what was told at a limit made NaN, and a line on each stream with limits.

    An axis at its limit turns rates and forces of the others into those of no aircraft: what else
    can saturate in that sample goes with it.

    Args:
        recording: of the whole flight.
        flown: begin and end of each flight in it [s after the epoch]; standing, sensors repeat
            themselves.
    """
    streams, lines = dict(recording.streams), []
    for name in streams.keys() & set(STREAMS):
        stream = streams[name]
        inside = np.any([(stream.time >= a) & (stream.time <= b) for a, b in flown], axis=0)
        can = [channel for channel in UNITS if channel in stream.channels]
        gone, limits = np.zeros(stream.count, dtype=bool), []
        for channel in can:
            reached = at_limits(np.where(inside, stream.channels[channel], np.nan))
            limits += [f"{channel} {value:.4g} {UNITS[channel]}" for value in reached]
            gone = np.any([gone, *reached.values()], axis=0)
        if limits:
            cleared = {item: np.where(gone, np.nan, stream.channels[item]) for item in can}
            streams[name] = replace(stream, channels={**stream.channels, **cleared})
            lines.append(
                f"{recording.source}: {name} stood at the end of its range ({', '.join(limits)}) "
                f"in {gone.sum()} samples, {100.0 * gone.sum() / inside.sum():.2g} % of the "
                "flight: not measured, and bridged by what else was"
            )
    return (replace(recording, streams=streams) if lines else recording), tuple(sorted(lines))
