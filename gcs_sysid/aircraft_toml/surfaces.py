"""How the aircraft is controlled: servos, the surfaces they move, the controls these make up."""

from __future__ import annotations

import difflib
import re

import numpy as np

from gcs_sysid.aircraft import Control, Servo
from gcs_sysid.aircraft_toml.checks import lag
from gcs_sysid.aircraft_toml.keys import KEYS
from gcs_sysid.aircraft_toml.section import Section, describe, increasing
from gcs_sysid.errors import AircraftFileError
from gcs_sysid.regressors import VARIABLES

# Beyond these no servo's quantities can be in the unit they should be in.
_LARGEST_DEFLECTION = 180.0
_SMALLEST_TRAVEL = 1.1
_SMALLEST_PULSE = 100.0
_CONTROL_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_RANK_TOLERANCE = 1e-9


def read_servos(top: Section) -> tuple[Servo, ...]:
    """The tables `[[servos]]`."""
    servos: list[Servo] = []
    for section in top.children("servos", name_key="surface"):
        servo = _read_servo(section)
        for other in servos:
            _check_distinct(section, servo, other)
        servos.append(servo)
    return tuple(servos)


def _check_distinct(section: Section, servo: Servo, other: Servo) -> None:
    if other.channel == servo.channel:
        raise section.error(
            "channel",
            found=f"channel {servo.channel} again, which moves `{other.surface}`",
            allowed="one [[servos]] entry a channel",
            fix="two surfaces on one output are one surface to this program: keep one entry",
        )
    if other.surface == servo.surface:
        raise section.error(
            "surface",
            found=f"`{servo.surface}` again, moved by channel {other.channel}",
            allowed="a name of its own for each surface",
            fix=f'for instance surface = "{servo.surface}_right"',
        )


def _read_servo(section: Section) -> Servo:
    section.allow_only(*KEYS["[[servos]]"])
    pwm, deflection = _calibration(section)
    return Servo(
        channel=section.whole("channel", least=1),
        surface=section.text("surface"),
        pwm=pwm,
        deflection=deflection,
        time_constant=lag(section, "time_constant"),
        delay=lag(section, "delay"),
        rate_limit=section.number("rate_limit", "deg/s", above=0.0)
        if section.has("rate_limit")
        else None,
        backlash=section.number("backlash", "deg", default=0.0, least=0.0),
        offset=section.number("offset", "deg", default=0.0),
        effectiveness=section.number("effectiveness", "1", default=1.0, above=0.0),
    )


def _calibration(section: Section) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Pulses [µs, increasing] and deflections [rad] of one servo."""
    pwm = section.numbers("pwm", "µs", at_least=2)
    deflection = section.numbers("deflection", "deg", at_least=2)
    if len(pwm) != len(deflection):
        raise section.error(
            "deflection",
            found=f"{len(deflection)} entries beside {len(pwm)} of `pwm`",
            allowed="as many entries as `pwm`",
            fix="give one deflection for each pulse",
        )
    if increasing(pwm[::-1]):
        pwm, deflection = pwm[::-1], deflection[::-1]
    steps = np.diff(deflection)
    if not increasing(pwm):
        raise _not_monotone(section, "pwm", "pulses that increase or decrease without repeats")
    if not (np.all(steps >= 0.0) or np.all(steps <= 0.0)) or not np.any(steps):
        raise _not_monotone(section, "deflection", "angles that increase or decrease with `pwm`")
    if max(map(abs, pwm)) < _SMALLEST_PULSE:
        raise section.error(
            "pwm",
            found=describe(section.data["pwm"]),
            allowed="pulses in µs",
            fix="write the pulses that the autopilot reports, for instance [1000, 1500, 2000]",
        )
    _check_travel(section)
    return pwm, deflection


def _not_monotone(section: Section, key: str, allowed: str) -> AircraftFileError:
    return section.error(
        key,
        found=describe(section.data[key]),
        allowed=allowed,
        fix="sort the pairs by pulse, and check the one that turns back",
    )


def _check_travel(section: Section) -> None:
    written = section.numbers("deflection", "1")
    largest = max(map(abs, written))
    if _SMALLEST_TRAVEL <= largest <= _LARGEST_DEFLECTION:
        return
    degrees = [round(float(np.degrees(angle)), 2) for angle in written]
    raise section.error(
        "deflection",
        found=f"{describe(section.data['deflection'])} deg",
        allowed=f"degrees, the largest from {_SMALLEST_TRAVEL:g} to {_LARGEST_DEFLECTION:g}",
        fix=f"these look like radians: deflection = {degrees}"
        if largest < _SMALLEST_TRAVEL
        else "write the angle of the surface, not the pulse",
    )


def read_controls(top: Section, servos: tuple[Servo, ...]) -> tuple[Control, ...]:
    """The tables `[[controls]]`, whose mixes must leave every control free of the others."""
    surfaces = tuple(servo.surface for servo in servos)
    sections = top.children("controls", name_key="name")
    controls: list[Control] = []
    for section in sections:
        section.allow_only(*KEYS["[[controls]]"])
        name = _control_name(section, controls)
        controls.append(Control(name, _read_mix(section, surfaces)))
        _check_independent(section, controls, surfaces)
    return tuple(controls)


def _control_name(section: Section, before: list[Control]) -> str:
    name = section.text("name")
    if name in VARIABLES or name in ("max", "min"):
        raise section.error(
            "name",
            found=f"`{name}`, which already is a regressor in [aerodynamics]",
            allowed=f"any name but {', '.join([*VARIABLES, 'max', 'min'])}",
            fix=f'for instance name = "{name}_control"',
        )
    if not _CONTROL_NAME.fullmatch(name):
        tidy = re.sub(r"\W", "_", name, flags=re.ASCII)
        raise section.error(
            "name",
            found=describe(name),
            allowed="letters, digits and underscores, not beginning with a digit",
            fix=f'for instance name = "{tidy if _CONTROL_NAME.fullmatch(tidy) else "flap"}"',
        )
    if any(control.name == name for control in before):
        raise section.error(
            "name",
            found=f"`{name}` again",
            allowed="a name of its own for each control",
            fix="rename one, or put both mixes into one control",
        )
    return name


def _read_mix(section: Section, surfaces: tuple[str, ...]) -> dict[str, float]:
    table = section.table("mix")
    for surface in table.data:
        if surface not in surfaces:
            close = difflib.get_close_matches(surface, surfaces, n=1)
            raise section.error(
                "mix",
                found=f"surface `{surface}`, which no servo moves",
                allowed=", ".join(surfaces) or "nothing, as there are no [[servos]]",
                fix=f"did you mean `{close[0]}`?"
                if close
                else f'add a [[servos]] entry with surface = "{surface}"',
            )
    mix = {surface: table.number(surface, "1") for surface in table.data}
    if not any(mix.values()):
        raise section.error(
            "mix",
            found="gains that are all 0" if mix else "no surface",
            allowed="at least one surface with a gain",
            fix=f"for instance mix = {{ {surfaces[0] if surfaces else 'elevator'} = 1.0 }}",
        )
    return mix


def _check_independent(
    section: Section, controls: list[Control], surfaces: tuple[str, ...]
) -> None:
    """Refuse a control that is a combination of those before it.

    The way from controls to surfaces is the mix's pseudo-inverse, which would then not give back
    the controls that were asked for.
    """
    gains = np.array([[control.mix.get(s, 0.0) for s in surfaces] for control in controls])
    gains = gains / np.linalg.norm(gains, axis=1, keepdims=True)
    if np.linalg.svd(gains, compute_uv=False)[-1] > _RANK_TOLERANCE and len(gains) <= len(surfaces):
        return
    share = np.linalg.lstsq(gains[:-1].T, gains[-1], rcond=None)[0]
    others = [c.name for c, s in zip(controls, share, strict=False) if abs(s) > _RANK_TOLERANCE]
    raise section.error(
        "mix",
        found=f"a combination of {' and '.join(f'`{name}`' for name in others)}",
        allowed="controls that can be moved one without the other",
        fix=f"remove `{controls[-1].name}`, or give it a surface or a sign of its own",
    )
