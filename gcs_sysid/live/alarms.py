"""What is wrong with the data while it flies: sensors that stand still, fall silent, or disagree.

A sensor that repeats itself exactly is left out of the filter, whose states then grow uncertain as
they should; one that disagrees with all others is told, and weighed by what it is found to be worth
(`intensities`). Nothing here stops anything.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid.live.choice import measured
from gcs_sysid.live.commands import Watched
from gcs_sysid.model.kinematics import MEASURED
from gcs_sysid.reconstruct.measurements import (
    AIRSPEED_STREAMS,
    ATTITUDE_STREAMS,
    IMU_STREAMS,
    VELOCITY_STREAMS,
)
from gcs_sysid.sources.samples import Sample

FROZEN_S = 2.0
"""A sensor in flight that repeats itself for so long is dead: noise alone moves the last digit."""
FROZEN_LEAST = 5
"""And so many samples at least."""
SILENT_S = 3.0
DISAGREES = 4.0
"""Mean square innovation over its own, from which a sensor disagrees with the others..."""
AGREES, AGREED_S = 2.0, 20.0
"""... and below which for so long [s] it does not any more: meanwhile its noise is learned anew, so
that what it says counts for less, and the innovations look small again."""
MEMORY_S = 5.0
"""Time constant of that mean: one outlier of a radio is no disagreement."""

WATCHED: Watched = {
    "inertial unit": (IMU_STREAMS, ("p", "q", "r", "acc_x", "acc_y", "acc_z")),
    "airspeed": (AIRSPEED_STREAMS, ("airspeed",)),
    "velocity": (VELOCITY_STREAMS, ("v_north", "v_east", "v_down")),
    "attitude": (ATTITUDE_STREAMS, ("roll", "pitch", "yaw")),
    "vanes": (("AOA_SSA",), ("alpha", "beta")),
}
"""What is watched: streams, and the channels that must move."""
_SAID = {
    "silent": ("is not heard", "are not heard"),
    "invalid": ("holds no number", "hold no number"),
    "disagrees": ("disagrees with the rest", "disagree with the rest"),
}
_MANY = ("vanes", "servo outputs")
_WIDTHS = np.array([rows.stop - rows.start for rows in MEASURED.values()])


@dataclass(frozen=True)
class Alarm:
    """Something wrong now.

    Attributes:
        kind: `frozen`, `silent`, `invalid` or `disagrees`.
        what: sensor.
        since: when it began [s after the epoch].
        words: for people.
    """

    kind: str
    what: str
    since: float
    words: str


@dataclass
class _Seen:
    """What was heard of one stream."""

    values: tuple[float, ...]
    since: float
    repeats: int = 0


class Alarms:
    """Watches samples and innovations of one flight; memory does not grow.

    Args:
        commands: what is watched beside the sensors: it must be heard, and may stand still.
    """

    def __init__(self, commands: Watched | None = None) -> None:
        self._commands = commands or {}
        self._seen: dict[str, _Seen] = {}
        self._frozen: dict[str, float] = {}
        self._valid: dict[str, float] = {}
        self._heard: dict[str, float] = {}
        self._square = np.zeros(len(MEASURED))
        self._away: dict[str, float] = {}
        self._apart: dict[str, float] = {}
        self._last = np.full(len(MEASURED), np.nan)
        self._now = 0.0
        self.left_out = 0

    def usable(self, sample: Sample, time: float, *, flying: bool) -> bool:
        """Takes note of a sample; says whether the filter may use it."""
        self._now = max(self._now, time)
        for what, (streams, channels) in self._commands.items():
            self._note(what, sample, time, streams, channels)
        for what, (streams, channels) in WATCHED.items():
            if self._note(what, sample, time, streams, channels):
                if self._stands_still(sample, channels, time) and flying:
                    self._frozen.setdefault(sample.stream, time - FROZEN_S)
                    self.left_out += 1
                    return False
                self._frozen.pop(sample.stream, None)
        return True

    def _note(
        self,
        what: str,
        sample: Sample,
        time: float,
        streams: Sequence[str],
        channels: Sequence[str],
    ) -> bool:
        """Whether a sample holds numbers for what is watched."""
        if sample.stream not in streams:
            return False
        self._heard[what] = time
        if not measured(sample, channels):
            return False
        self._valid[what] = time
        return True

    def _stands_still(self, sample: Sample, channels: tuple[str, ...], time: float) -> bool:
        values = tuple(sample.channels[name] for name in channels)
        seen = self._seen.get(sample.stream)
        if seen is None or seen.values != values or not any(values):
            self._seen[sample.stream] = _Seen(values, time)
            return False
        seen.repeats += 1
        return seen.repeats >= FROZEN_LEAST and time - seen.since >= FROZEN_S

    def innovations(
        self,
        time: float,
        new: Bool[np.ndarray, " group"],
        nis: Float[np.ndarray, " group"],
    ) -> None:
        """Takes note of normalised innovations squared of the groups that are `new`."""
        for index, name in enumerate(MEASURED):
            if not new[index]:
                continue
            step = time - self._last[index] if math.isfinite(self._last[index]) else MEMORY_S
            self._last[index] = time
            share = 1.0 - math.exp(-min(max(step, 0.0), MEMORY_S) / MEMORY_S)
            # One sample says no more than a five-sigma one: see `observation.NIS_LIMIT`.
            one = min(float(nis[index]) / _WIDTHS[index], 25.0)
            self._square[index] += share * (one - self._square[index])
            if self._square[index] > DISAGREES:
                self._away.setdefault(name, time)
            if self._square[index] > AGREES:
                self._apart[name] = time
            elif time - self._apart.get(name, time) > AGREED_S:
                self._away.pop(name, None)

    def restarted(self) -> None:
        """Forgets innovations: the filter has begun anew."""
        self._square[:] = 0.0
        self._away.clear()

    def told(self, *, flying: bool, now: float | None = None) -> list[Alarm]:
        """What is wrong now; `now` is the newest time known [s], that of the samples if None."""
        here = self._now if now is None else max(now, self._now)
        found = [
            Alarm("frozen", stream, since,
                  f"{stream} repeats itself for {here - since:.0f} s and is left out")
            for stream, since in self._frozen.items()
        ]  # fmt: skip
        if not flying:
            return found
        for what, last in self._valid.items():
            if here - last > SILENT_S:
                speaks = here - self._heard[what] <= SILENT_S
                found.append(_told("invalid" if speaks else "silent", what, last, here))
        return found + [_told("disagrees", what, since, here) for what, since in self._away.items()]


def _told(kind: str, what: str, since: float, now: float) -> Alarm:
    said = _SAID[kind][what in _MANY]
    return Alarm(kind, what, since, f"{what} {said} for {now - since:.0f} s")
