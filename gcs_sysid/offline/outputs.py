"""Which surface or motor is behind each output, as the autopilot's parameters say.

Signs: ArduPilot's demands are positive for roll to the right, pitch up and yaw to the right, and
its mixed outputs move surfaces up (ArduPlane 4.6, servos.cpp); PX4's positive demand moves
horizontal and mixed surfaces up and vertical ones right (control_allocator, module.yaml).
Deflections here are positive trailing edge down, for a rudder trailing edge left.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

Parameters = Mapping[str, float]

THROW = 25.0
"""Assumed throw of a surface [deg]: usual for small aircraft."""
FLAP = 40.0
"""Assumed deflection of a flap all the way out [deg]."""
MAXIMUM_OUTPUTS = 32


@dataclass(frozen=True)
class Surface:
    """An output that moves a surface.

    Attributes:
        channel: number of the output.
        name: of the surface.
        pwm: pulses [µs], rising.
        deflection: of the surface at these, as far as the direction is known [deg].
        role: what it does: `aileron`, `elevon_left`, …; see `MIXES`.
        told: the parameters that say so.
    """

    channel: int
    name: str
    pwm: tuple[float, ...]
    deflection: tuple[float, ...]
    role: str
    told: str


@dataclass(frozen=True)
class Motor:
    """An output that drives a motor: pulses [µs] at rest and at full power."""

    channel: int
    pwm: tuple[float, float]
    told: str


@dataclass(frozen=True)
class Outputs:
    """All outputs whose use is known; `left_out` says of others what they are, a line each."""

    surfaces: tuple[Surface, ...]
    motors: tuple[Motor, ...]
    left_out: tuple[str, ...]


MIXES: Mapping[str, Mapping[str, float]] = {
    "aileron": {"aileron": 1.0},
    "aileron_left": {"aileron": 1.0},
    "aileron_right": {"aileron": -1.0},
    "elevator": {"elevator": 1.0},
    "rudder": {"rudder": 1.0},
    "flap": {"flap": 1.0},
    "elevon_left": {"aileron": 1.0, "elevator": 1.0},
    "elevon_right": {"aileron": -1.0, "elevator": 1.0},
    "vtail_left": {"elevator": 1.0, "rudder": 1.0},
    "vtail_right": {"elevator": 1.0, "rudder": -1.0},
    "flaperon_left": {"aileron": 1.0, "flap": 1.0},
    "flaperon_right": {"aileron": -1.0, "flap": 1.0},
}
"""Role of a surface -> the controls that it is part of, with the sign in which it adds to them."""

_FUNCTIONS: Mapping[int, tuple[str, float]] = {
    2: ("flap", 1.0),
    3: ("flap", 1.0),
    4: ("aileron", 1.0),
    19: ("elevator", -1.0),
    21: ("rudder", -1.0),
    24: ("flaperon_left", 1.0),
    25: ("flaperon_right", -1.0),
    77: ("elevon_left", -1.0),
    78: ("elevon_right", -1.0),
    79: ("vtail_left", -1.0),
    80: ("vtail_right", -1.0),
}
"""SERVOn_FUNCTION -> role, and deflection's sign of a longer pulse that is not reversed."""
_THROTTLES = (70, 73, 74)
_NOT_WINGS: Mapping[int, str] = {
    16: "differential spoiler",
    17: "differential spoiler",
    26: "ground steering",
    86: "differential spoiler",
    87: "differential spoiler",
    **{n: "lifting motor" for n in (*range(33, 41), *range(82, 86))},
    75: "tilt servo",
    76: "tilt servo",
}
_TYPES: Mapping[int, tuple[str, float]] = {
    1: ("aileron_left", -1.0),
    2: ("aileron_right", -1.0),
    3: ("elevator", -1.0),
    4: ("rudder", -1.0),
    5: ("elevon_left", -1.0),
    6: ("elevon_right", -1.0),
    7: ("vtail_left", -1.0),
    8: ("vtail_right", -1.0),
    9: ("flap", 1.0),
    10: ("flap", 1.0),
    15: ("aileron", 1.0),
}
"""CA_SV_CSn_TYPE -> role, and deflection's sign of a longer pulse that is not reversed."""
_MOTOR, _SERVO = 101, 201
"""PWM_MAIN_FUNCn of the first motor and of the first servo."""


def outputs(parameters: Parameters) -> Outputs:
    """The outputs of an ArduPilot or PX4 by its parameters; all empty without such parameters."""
    if any(name.startswith("CA_") for name in parameters):
        found = [*_px4(parameters)]
    else:
        found = [*_ardupilot(parameters)]
    surfaces = _named([one for one in found if isinstance(one, Surface)])
    return Outputs(
        surfaces,
        tuple(one for one in found if isinstance(one, Motor)),
        tuple(one for one in found if isinstance(one, str)),
    )


def controls(surfaces: tuple[Surface, ...]) -> dict[str, dict[str, float]]:
    """Controls and their mixes: each the mean of the surfaces that are part of it."""
    mixes: dict[str, dict[str, float]] = {}
    for surface in surfaces:
        for control, sign in MIXES[surface.role].items():
            mixes.setdefault(control, {})[surface.name] = sign
    return {
        control: {name: sign / len(mix) for name, sign in mix.items()}
        for control, mix in sorted(mixes.items())
    }


def _ardupilot(parameters: Parameters) -> Iterator[Surface | Motor | str]:
    for channel in range(1, MAXIMUM_OUTPUTS + 1):
        key = f"SERVO{channel}"
        function = int(parameters.get(f"{key}_FUNCTION", 0.0))
        if not function:
            continue
        low = parameters.get(f"{key}_MIN", 1100.0)
        high = parameters.get(f"{key}_MAX", 1900.0)
        middle = parameters.get(f"{key}_TRIM", 1500.0)
        turned = parameters.get(f"{key}_REVERSED", 0.0) != 0.0
        told = f"{key}_FUNCTION {function}, {'reversed' if turned else 'not reversed'}"
        if function in _FUNCTIONS:
            role, sign = _FUNCTIONS[function]
            sign = -sign if turned else sign
            yield _surface(channel, role, (low, middle, high), sign, told)
        elif function in _THROTTLES:
            yield Motor(channel, (high, low) if turned else (low, high), told)
        elif function in _NOT_WINGS:
            yield f"output {channel} ({key}_FUNCTION {function}): {_NOT_WINGS[function]}"
        else:
            yield f"output {channel} ({key}_FUNCTION {function})"


def _px4(parameters: Parameters) -> Iterator[Surface | Motor | str]:
    for bank, offset in (("PWM_MAIN", 0), ("PWM_AUX", 16)):
        for output in range(1, 17):
            function = int(parameters.get(f"{bank}_FUNC{output}", 0.0))
            if not function:
                continue
            low = parameters.get(f"{bank}_MIN{output}", 1000.0)
            high = parameters.get(f"{bank}_MAX{output}", 2000.0)
            turned = bool(int(parameters.get(f"{bank}_REV", 0.0)) >> (output - 1) & 1)
            told = f"{bank}_FUNC{output} {function}, {'reversed' if turned else 'not reversed'}"
            channel = output + offset
            if _MOTOR <= function < _MOTOR + 12:
                yield Motor(channel, (high, low) if turned else (low, high), told)
                continue
            number = function - _SERVO
            kind = int(parameters.get(f"CA_SV_CS{number}_TYPE", 0.0))
            if number < 0 or kind not in _TYPES:
                yield f"output {channel} ({told})"
                continue
            role, sign = _TYPES[kind]
            sign = -sign if turned else sign
            told += f"; CA_SV_CS{number}_TYPE {kind}"
            yield _surface(channel, role, (low, 0.5 * (low + high), high), sign, told)


def _surface(
    channel: int, role: str, pulses: tuple[float, float, float], sign: float, told: str
) -> Surface:
    low, middle, high = pulses
    if role == "flap":
        deflection = (0.0, FLAP) if sign > 0.0 else (FLAP, 0.0)
        return Surface(channel, role, (low, high), deflection, role, told)
    points = [(low, -sign * THROW), (middle, 0.0), (high, sign * THROW)]
    rising = [points[0]]
    for (before, _), point in pairwise(points):
        if point[0] > before:
            rising.append(point)
    pwm, deflection = zip(*(rising if len(rising) > 1 else points[::2]), strict=True)
    return Surface(channel, role, pwm, deflection, role, told)


def _named(found: list[Surface]) -> tuple[Surface, ...]:
    """Surfaces with names of their own: several ailerons are called aileron_1, aileron_2."""
    result = []
    for surface in found:
        alike = [one for one in found if one.role == surface.role]
        number = f"_{alike.index(surface) + 1}" if len(alike) > 1 else ""
        result.append(replace(surface, name=surface.role + number))
    return tuple(result)
