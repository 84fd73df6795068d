"""What the blind flights fly: four blocks of single inputs and multisines at different airspeeds.

Plans differ in where they go, since wind shear shows in climbs, the ground near it and a stall at
low speed. Flights with nothing hidden fly every one of them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

from gcs_sysid.aircraft import Aircraft, Envelope
from gcs_sysid.sitl import plan
from gcs_sysid.sitl.inputs import TestInput, signal
from gcs_sysid.sitl.plan import Leg
from gcs_sysid.sitl.slopes import slopes, trim

PLANS = ("usual", "climbs", "slow", "low")
"""`slow` reaches angles of attack beyond 7°, `low` is over the ground."""

STALL = math.radians(7.0)
"""Angle of attack beyond which a hidden stall is [rad]."""

_SHARES = (0.24, 0.40, 0.57, 0.28)
_HEADINGS = ((0.0, 80.0), (60.0, 290.0), (120.0, 340.0), (30.0, 200.0))
_BANK = math.radians(38.0)
_SLOW_BANK = math.radians(20.0)
_TYPICAL = {"alpha": 0.04, "beta": 0.035, "q": 0.15}
"""One sigma in flights in gusts [rad, rad/s]."""


def airspeeds(aircraft: Aircraft) -> tuple[float, ...]:
    """Of the four blocks [m/s]."""
    low, high = _envelope(aircraft).airspeed
    return tuple(round(low + share * (high - low), 1) for share in _SHARES)


def typical(aircraft: Aircraft, variable: str) -> float:
    """One sigma of a regressor in such flights."""
    if variable == "qhat":
        return _TYPICAL["q"] * aircraft.geometry.mean_chord / (2.0 * airspeeds(aircraft)[1])
    return _TYPICAL[variable]


def legs(aircraft: Aircraft, name: str, *, short: bool = False) -> tuple[Leg, ...]:
    """A plan of four minutes, or with `short` its first two blocks in a minute and a half.

    Args:
        aircraft: with envelope and aerodynamics.
        name: one of `PLANS`.
        short: two blocks of 45 s.
    """
    speeds, heights = _targets(aircraft, name)
    found: list[Leg] = []
    for i in range(2 if short else 4):
        found += _block(aircraft, i, speeds[i], heights[i], short=short)
    bank = _SLOW_BANK if name == "slow" else _BANK
    return tuple(replace(leg, bank=bank) for leg in found)


def fastest(aircraft: Aircraft, control: str) -> float:
    """Fastest motion that the multisines of the second block ask of a control [rad/s]."""
    second = _block(aircraft, 1, airspeeds(aircraft)[1], 200.0, short=False)[1]
    test = next(one for one in second.inputs if one.control == control)
    deflection = signal(test)
    values = [deflection(test.start + 0.01 * i) for i in range(int(test.duration / 0.01))]
    return max(abs(b - a) for a, b in itertools.pairwise(values)) / 0.01


def _targets(aircraft: Aircraft, name: str) -> tuple[Sequence[float], Sequence[float]]:
    """Airspeeds [m/s] and heights [m] of the blocks."""
    usual = airspeeds(aircraft)
    match name:
        case "climbs":
            return usual, (70.0, 240.0, 90.0, 235.0)
        case "slow":
            slow = _slowest(aircraft)
            return (slow, usual[1], 1.02 * slow, slow), (230.0, 240.0, 230.0, 225.0)
        case "low":
            near = 0.35 * aircraft.geometry.wing_span
            return usual, (near, 1.2 * near, 40.0, near)
    return usual, (230.0, 240.0, 235.0, 225.0)


def _slowest(aircraft: Aircraft) -> float:
    """Airspeed at which level flight takes a degree less than the angle of the stall.

    Gusts and inputs take it beyond. Slower, an aircraft that stalls as hard as some of those drawn
    cannot be held level. For some that is a little below the envelope.
    """
    low, high = _envelope(aircraft).airspeed
    speed = 0.8 * low
    while speed < high and trim(aircraft, speed).alpha > STALL - math.radians(1.0):
        speed += 0.1
    return round(speed, 1)


def _block(
    aircraft: Aircraft, number: int, airspeed: float, height: float, *, short: bool
) -> tuple[Leg, Leg]:
    """A turn with single inputs after it, and another one with multisines after it."""
    out, back = (math.radians(heading) for heading in _HEADINGS[number])
    turned, single, sine = (5.0, 20.0, 20.0) if short else (8.0, 27.0, 25.0)
    slope = slopes(aircraft, airspeed)
    size = {
        name: min(max(0.45 * value, 0.035), 0.09) for name, value in plan.amplitudes(slope).items()
    }
    pulse = min(max(1.6 / slope.short_period, 0.16), 0.5)
    pitch, roll, yaw = slope.pitch_name, slope.roll_name, slope.yaw_name
    apart = 0.25 * (single - turned)
    tests = [
        TestInput(pitch, "multistep", turned, 7.0 * pulse, size[pitch]),
        TestInput(roll, "doublet", turned + 1.4 * apart, 2.0, size[roll]),
    ]
    if yaw is not None:
        tests.append(TestInput(yaw, "doublet", turned + 2.5 * apart, 2.6, size[yaw]))
    last = min(max(int(1.3 * slope.short_period / (2.0 * math.pi) * sine), 18), 2 * int(sine))
    together = tuple(
        TestInput(name, "multisine", turned, sine, size[name], tuple(range(3 + i, last, 3)))
        for i, name in enumerate(size)
    )
    first = Leg(f"singles {number}", single, airspeed, height, out, inputs=tuple(tests))
    return first, replace(
        first,
        name=f"multisine {number}",
        duration=turned + sine,
        heading=back,
        inputs=together,
    )


def _envelope(aircraft: Aircraft) -> Envelope:
    if aircraft.envelope is None:
        raise ValueError(f"{aircraft.name}: blind flights need `[envelope]` in the aircraft file")
    return aircraft.envelope
