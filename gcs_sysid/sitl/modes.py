"""Flight modes of an ArduPlane, and the sticks that some of them obey.

References:
    ArduPlane/mode.h (numbers) and the ArduPlane documentation, "Flight modes", version 4.6.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field

STICK_LOW, STICK_MIDDLE, STICK_HIGH = 1000, 1500, 2000
"""Pulses of a stick [µs]."""

ROLL, PITCH, POWER, YAW = 1, 2, 3, 4
"""Channels of the sticks, as RCMAP has them by default."""

OVERRIDE_TIME = 3.0
"""How long an override holds without being repeated [s] (RC_OVERRIDE_TIME)."""

IGNORE, RELEASE = 65535, 0
"""Values of RC_CHANNELS_OVERRIDE that leave a channel as it is, and give it back."""


class Mode(enum.IntEnum):
    """Custom modes that can be flown here."""

    MANUAL = 0
    CIRCLE = 1
    STABILIZE = 2
    FBWA = 5
    FBWB = 6
    CRUISE = 7
    AUTO = 10
    RTL = 11
    LOITER = 12
    GUIDED = 15


def mode(number: int) -> Mode | None:
    """The mode of that number, None if it cannot be flown here."""
    return Mode(number) if number in set(Mode) else None


@dataclass(frozen=True)
class Sticks:
    """What the remote control says: pulses [µs] by channel, and until when each holds [s]."""

    neutral: Mapping[int, int]
    overrides: Mapping[int, tuple[int, float]] = field(default_factory=dict)

    def override(self, pulses: Mapping[int, int], time: float) -> Sticks:
        """With pulses from the ground at a time [s]; `IGNORE` keeps, `RELEASE` gives back."""
        merged = dict(self.overrides)
        for channel, pulse in pulses.items():
            if pulse == RELEASE:
                merged.pop(channel, None)
            elif pulse != IGNORE:
                merged[channel] = (pulse, time + OVERRIDE_TIME)
        return Sticks(self.neutral, merged)

    def pulse(self, channel: int, time: float) -> int:
        """Pulse of a channel at a time [µs]."""
        pulse, until = self.overrides.get(channel, (0, -1.0))
        return pulse if time < until else self.neutral.get(channel, STICK_MIDDLE)

    def share(self, channel: int, time: float) -> float:
        """Deflection of a stick, -1 to 1."""
        half = STICK_HIGH - STICK_MIDDLE
        return min(max((self.pulse(channel, time) - STICK_MIDDLE) / half, -1.0), 1.0)

    def power(self, time: float) -> float:
        """Where the throttle stick stands, 0 to 1."""
        return 0.5 * (self.share(POWER, time) + 1.0)
