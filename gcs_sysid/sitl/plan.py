"""What is flown: legs with their targets, and the test inputs in them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from gcs_sysid.aircraft import Aircraft, Envelope
from gcs_sysid.errors import UsageError
from gcs_sysid.sitl.inputs import THROTTLE, TestInput
from gcs_sysid.sitl.slopes import Slopes, slopes


@dataclass(frozen=True)
class Leg:
    """A part of a flight with constant targets.

    Attributes:
        name: for the log.
        duration: [s].
        airspeed: to hold [m/s, equivalent].
        height: to hold [m above home].
        heading: to turn to, the shorter way, and to hold [rad].
        bank: limit of the bank angle [rad].
        inputs: test inputs.
    """

    name: str
    duration: float
    airspeed: float
    height: float
    heading: float = 0.0
    bank: float = math.radians(30.0)
    inputs: tuple[TestInput, ...] = ()


# Share of the way from the envelope's lowest to its highest airspeed, and headings [deg] out and
# back: two right turns, two left ones, another right one.
_SPEEDS = ((0.27, (0.0, 170.0)), (0.43, (340.0, 170.0)), (0.65, (0.0, 170.0)))


def standard(aircraft: Aircraft, *, height: float = 120.0) -> tuple[Leg, ...]:
    """A flight of about four and a half minutes that excites every axis at three airspeeds.

    At each: a turn and a climb, a steady leg, each surface alone, the throttle,
    a turn back, and all surfaces together in orthogonal multisines. Amplitudes and pulse widths
    come from the aircraft file.

    Args:
        aircraft: with an envelope and `aerodynamics`.
        height: to fly at [m above home].

    Returns:
        The legs in order.

    Raises:
        UsageError: the file has no envelope.
    """
    envelope = aircraft.envelope
    if envelope is None:
        raise UsageError(
            f"{aircraft.name}: the standard flight needs `[envelope]` in the aircraft file"
        )
    low, high = envelope.airspeed
    height = max(height, envelope.height_min + 40.0)
    return tuple(
        leg
        for i, (share, headings) in enumerate(_SPEEDS)
        for leg in _at_speed(
            aircraft, envelope, low + share * (high - low), height + 15.0 * i, headings
        )
    )


def _at_speed(
    aircraft: Aircraft,
    envelope: Envelope,
    airspeed: float,
    height: float,
    headings_deg: tuple[float, float],
) -> Iterable[Leg]:
    slope = slopes(aircraft, airspeed)
    bank = min(math.radians(40.0), 0.8 * envelope.bank)
    speed = f"{airspeed:.0f} m/s"
    out, back = (math.radians(heading) for heading in headings_deg)
    yield Leg(f"turn {speed}", 14.0, airspeed, height, out, bank)
    yield Leg(f"singles {speed}", 34.0, airspeed, height, out, bank, _singles(slope))
    yield Leg(f"turn back {speed}", 14.0, airspeed, height, back, bank)
    yield Leg(f"multisine {speed}", 24.0, airspeed, height, back, bank, _together(slope))


def amplitudes(slope: Slopes) -> dict[str, float]:
    """Deflections [rad] that give about 6° of alpha, 80 deg/s of roll and 6° of sideslip."""
    pitch = math.radians(6.0) * abs(slope.pitch_stiffness / slope.pitch_control)
    roll = math.radians(80.0) * abs(slope.roll_damping / slope.roll_control)
    found = {slope.pitch_name: pitch, slope.roll_name: roll}
    if slope.yaw_name is not None:
        yaw = math.radians(6.0) * abs(slope.yaw_stiffness / slope.yaw_control)
        found[slope.yaw_name] = 1.6 * yaw
    return {name: min(max(value, 0.02), 0.2) for name, value in found.items()}


def _singles(slope: Slopes) -> tuple[TestInput, ...]:
    size = amplitudes(slope)
    # Pulses after Hamel and Jategaonkar: 1.6/ω for a 3-2-1-1, 2.3/ω for each half of a doublet.
    short = min(max(1.6 / slope.short_period, 0.16), 0.8)
    dutch = min(max(2.3 / slope.dutch_roll, 0.3), 1.2)
    pitch, roll, yaw = slope.pitch_name, slope.roll_name, slope.yaw_name
    tests = [
        TestInput(pitch, "multistep", 6.0, 7.0 * short, size[pitch]),
        TestInput(pitch, "doublet", 11.0, 4.0 * short, -size[pitch]),
        TestInput(roll, "multistep", 15.0, 2.1, 0.8 * size[roll]),
        TestInput(roll, "doublet", 19.0, 1.0, -size[roll]),
        TestInput(THROTTLE, "doublet", 27.0, 5.0, 0.2),
    ]
    if yaw is not None:
        tests.append(TestInput(yaw, "doublet", 22.0, 2.0 * dutch, size[yaw]))
    return tuple(tests)


def _together(slope: Slopes) -> tuple[TestInput, ...]:
    size, duration = amplitudes(slope), 18.0
    # 0.2 Hz to a little above the short period, every third line for each surface.
    last = max(12, int(1.3 * slope.short_period / (2.0 * math.pi) * duration))
    return tuple(
        TestInput(name, "multisine", 4.0, duration, size[name], tuple(range(3 + i, last, 3)))
        for i, name in enumerate(size)
    )
