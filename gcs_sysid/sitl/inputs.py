"""Test inputs: what is added to one control, after the autopilot.

References:
    Multisine with Schroeder phases: Schroeder, IEEE Trans. Information Theory 16 (1970) 85.
    3-2-1-1: Hamel and Jategaonkar, J. Aircraft 33 (1996) 9.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

from gcs_sysid.errors import UsageError

Named = Literal["doublet", "multistep", "multisine", "step"]
KINDS: tuple[Named, ...] = get_args(Named)
"""Kinds that a scenario can name."""
Kind = Literal[Named, "samples"]

THROTTLE = "throttle"
"""Name under which a test input reaches all thrusters."""

_MULTISTEP = (3, 2, 1, 1)


@dataclass(frozen=True)
class TestInput:
    """One input on one control.

    Attributes:
        control: control of the aircraft file, or `throttle`.
        kind: `doublet`; `multistep` (3-2-1-1); `multisine`, harmonics `lines` of 1/duration;
            `step`; `samples`, any shape given by its values.
        start: when it begins [s after its leg began].
        duration: its whole length [s].
        amplitude: largest excursion [rad; throttle 0 to 1]; its sign is the first move's.
        lines: harmonics of a multisine; disjoint sets make inputs flown together orthogonal.
        values: of `samples`, in units of the amplitude, evenly over the duration, each held.
    """

    __test__ = False

    control: str
    kind: Kind
    start: float
    duration: float
    amplitude: float
    lines: tuple[int, ...] = ()
    values: tuple[float, ...] = ()


def signal(test: TestInput) -> Callable[[float], float]:
    """The input as a function of time since its leg began [s]; zero outside its duration."""
    shape = _shape(test)

    def value(time: float) -> float:
        phase = (time - test.start) / test.duration
        return test.amplitude * shape(phase) if 0.0 <= phase < 1.0 else 0.0

    return value


def _shape(test: TestInput) -> Callable[[float], float]:
    """Unit-amplitude shape over 0 ≤ phase < 1."""
    match test.kind:
        case "step":
            return lambda phase: 1.0
        case "doublet":
            return lambda phase: 1.0 if phase < 0.5 else -1.0
        case "multistep":
            return _multistep
        case "multisine":
            return _multisine(test)
        case "samples" if test.values:
            return lambda phase: test.values[
                min(int(phase * len(test.values)), len(test.values) - 1)
            ]
    raise UsageError(f"no test input `{test.kind}`; there are {', '.join(KINDS)}")


def _multistep(phase: float) -> float:
    sign, end = 1.0, 0.0
    for steps in _MULTISTEP:
        end += steps / sum(_MULTISTEP)
        if phase < end:
            return sign
        sign = -sign
    return -sign


def _multisine(test: TestInput) -> Callable[[float], float]:
    if not test.lines:
        raise UsageError("a multisine needs `lines`, the harmonics of 1/duration it is made of")
    count = len(test.lines)
    angles = [(2.0 * math.pi * n, math.pi * k * k / count) for k, n in enumerate(test.lines)]

    def raw(phase: float) -> float:
        return sum(math.sin(rate * phase + offset) for rate, offset in angles)

    # Twenty points a period of the fastest line find the peak to 1.3 %.
    points = 20 * max(test.lines)
    peak = max(abs(raw(i / points)) for i in range(points))
    return lambda phase: raw(phase) / peak
