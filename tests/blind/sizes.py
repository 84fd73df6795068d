"""What can be hidden, and how large: the catalogue of causes as a table.

A size is given by its larger end; `least` is the smaller end over the larger one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.sitl.slopes import slopes
from gcs_sysid.sitl.terms import slope
from tests.blind import plans

_BOTH = (1.0, -1.0)
_UP = (1.0,)
_DOWN = (-1.0,)
_DEGREE = math.pi / 180.0

_UNLISTED: tuple[tuple[str, str, tuple[str, ...], str, float], ...] = (
    ("Cn", "rudder*qhat", ("qhat", "rudder"), "rudder", 0.3),
    ("Cl", "beta*alpha", ("alpha", "beta"), "beta", 0.3),
    ("CY", "beta*alpha", ("alpha", "beta"), "beta", 0.3),
    ("Cn", "aileron*alpha", ("aileron", "alpha"), "beta", 0.2),
    ("Cm", "alpha^2", ("alpha",), "alpha", 0.1),
)
"""Coefficient, term, what it depends on, the term it is measured by, and its share of that one."""

_DERIVATIVES = ("CZ.alpha", "CY.beta", "Cl.beta", "Cl.phat", "Cm.alpha", "Cm.qhat", "Cn.beta")


@dataclass(frozen=True)
class Size:
    """How far one parameter may be from where it belongs.

    Attributes:
        parameter: as effect files and diagnoses name it.
        larger: the larger deviation that matters.
        least: the smaller one over the larger.
        nominal: value of the parameter where nothing is wrong.
        signs: to draw from.
    """

    parameter: str
    larger: float
    least: float = 0.5
    nominal: float = 0.0
    signs: tuple[float, ...] = _BOTH

    def drawn(self, share: float, generator: np.random.Generator) -> float:
        """The parameter at a share of the larger size, its sign at random."""
        sign = self.signs[int(generator.integers(len(self.signs)))]
        return self.nominal + sign * max(share, 0.0) * self.larger


_FIXED: Mapping[str, tuple[Size, ...]] = {
    "mass": (Size("mass_ratio", 0.12, nominal=1.0),),
    "cg_shift": (Size("cg_x_chord", 0.12, least=0.25),),
    "inertia": tuple(Size(f"{axis}_ratio", 0.3, nominal=1.0) for axis in ("Ixx", "Iyy", "Izz")),
    "airspeed_scale": (Size("airspeed_scale", 0.1, least=0.3),),
    "pitot_lag": (Size("pitot_lag", 0.2, signs=_UP),),
    "accelerometer_bias": tuple(Size(f"bias_{axis}", 0.6) for axis in "xyz"),
    "gyro_scale": tuple(Size(f"scale_{axis}", 0.03) for axis in "xyz"),
    "imu_misalignment": tuple(Size(f"tilt_{axis}", 4.0 * _DEGREE) for axis in "xyz"),
    "imu_position": tuple(Size(f"d{axis}", 0.1) for axis in "xyz"),
    "vane_bias": tuple(Size(f"{angle}_bias", 2.0 * _DEGREE) for angle in ("alpha", "beta")),
    "heading_bias": (Size("heading_bias", 10.0 * _DEGREE),),
    "time_skew": (Size("delay", 0.1),),
    "actuator_lag": (Size("time_constant", 0.2, signs=_UP),),
    "actuator_backlash": (Size("width", 2.0 * _DEGREE, signs=_UP),),
    "surface_effectiveness": (Size("ratio", 0.35, least=0.57, nominal=1.0, signs=_DOWN),),
    "surface_offset": (Size("offset", 4.0 * _DEGREE),),
    "thrust_scale": (Size("ratio", 0.3, nominal=1.0, signs=_DOWN),),
    "propwash": (Size("gain", 0.8, signs=_UP),),
    "wind_shear": (Size("gradient", 0.05, signs=_UP),),
    "stall": (Size("slope_loss", 0.8, signs=_UP),),
    "asymmetry": (Size("Cl0", 0.012),),
    "aeroelastic": (Size("loss", 0.35, least=0.57, signs=_DOWN),),
    "ground_effect": (Size("lift", 1.0, signs=_UP),),
    "aero_derivative": (Size("ratio", 0.2, nominal=1.0),),
}

CAUSES = (*_FIXED, "actuator_rate_limit", "thrust_offset", "drag_increase", "cross_coupling")
"""Everything in the catalogue but `unlisted`."""

_STREAMS = (*["SERVO_OUTPUT_RAW"] * 3, "GLOBAL_POSITION_INT")
"""Whose times may be skewed; servo outputs may be early or late."""

_OF_CONTROL = (
    *("actuator_lag", "actuator_rate_limit", "actuator_backlash"),
    *("surface_effectiveness", "surface_offset", "aeroelastic"),
)


def sizes(cause: str, aircraft: Aircraft) -> tuple[Size, ...]:
    """The parameters that a cause may have on an aircraft; one of them is drawn."""
    found = _FIXED.get(cause)
    if found is not None:
        return found
    match cause:
        case "thrust_offset":
            return (Size("z", 0.03 * aircraft.geometry.wing_span),)
        case "drag_increase":
            drag = abs(slope(aircraft, "CX", "1"))
            return (Size("CX0", 0.45 * drag, least=0.56, signs=_DOWN),)
        case "cross_coupling":
            return (Size("Cm_beta", 0.35 * abs(slope(aircraft, "Cm", "alpha")), least=0.57),)
    raise KeyError(cause)


def hidden(
    cause: str, share: float | None, aircraft: Aircraft, generator: np.random.Generator
) -> tuple[dict[str, Any], float]:
    """An entry of an effect file, and the size it has as a share of the larger one.

    Args:
        cause: what to hide, `unlisted` among it.
        share: of the larger size; None for any between the smaller and the larger.
        aircraft: as its file has it.
        generator: of sign, axis, control and the like.
    """
    if cause == "unlisted":
        return _unlisted(share, aircraft, generator)
    if cause == "actuator_rate_limit":
        return _rate_limit(share, aircraft, generator)
    options = sizes(cause, aircraft)
    size = options[int(generator.integers(len(options)))]
    share = generator.uniform(size.least, 1.0) if share is None else share
    value = size.drawn(share, generator)
    if cause == "cg_shift":
        value = _flyable(value, aircraft)
    if cause == "inertia":
        value = _possible(size.parameter, value, aircraft)
    entry: dict[str, Any] = {"name": cause, size.parameter: value}
    if cause in _OF_CONTROL:
        entry["control"] = _control(aircraft, generator)
    match cause:
        case "time_skew":
            entry["stream"] = _STREAMS[int(generator.integers(len(_STREAMS)))]
            if entry["stream"] != _STREAMS[0]:
                # A measurement cannot be sent before it is made.
                entry["delay"] = abs(value)
        case "aero_derivative":
            entry["derivative"] = _DERIVATIVES[int(generator.integers(len(_DERIVATIVES)))]
        case "stall":
            entry["alpha_break"] = plans.STALL
        case "ground_effect":
            entry |= {"drag": share, "moment": 0.1 * share}
    return entry, float(share)


def depends_on(entry: Mapping[str, Any]) -> tuple[str, tuple[str, ...]]:
    """Coefficient and variables of an unlisted effect."""
    ((coefficient, values),) = entry["terms"].items()
    for name, term, variables, _, _ in _UNLISTED:
        if name == coefficient and term in values:
            return coefficient, variables
    raise KeyError(str(entry["terms"]))


def _flyable(forward: float, aircraft: Aircraft) -> float:
    """Forward instead where a shift aft would take more than six tenths of the stability."""
    margin = slope(aircraft, "Cm", "alpha") / slope(aircraft, "CZ", "alpha")
    return abs(forward) if -forward > 0.6 * margin else forward


def _possible(parameter: str, ratio: float, aircraft: Aircraft) -> float:
    """More instead of less where less would not be the inertia of any body."""
    axis = parameter.removesuffix("_ratio")
    changed = replace(aircraft.mass, **{axis: ratio * getattr(aircraft.mass, axis)})
    return ratio if np.linalg.eigvalsh(changed.inertia)[0] > 0.0 else 2.0 - ratio


def _control(aircraft: Aircraft, generator: np.random.Generator) -> str:
    """Half of the time the one for pitch, which every measurement knows best."""
    pitch = slopes(aircraft, plans.airspeeds(aircraft)[1]).pitch_name
    others = [name for name in aircraft.control_names if name != pitch]
    return pitch if generator.random() < 0.5 else others[int(generator.integers(len(others)))]


def _rate_limit(
    share: float | None, aircraft: Aircraft, generator: np.random.Generator
) -> tuple[dict[str, Any], float]:
    """Half of the fastest motion that the plan's multisine asks for; 0.75 of it at half size.

    Not in pitch, where gusts and a limit of that kind end in an oscillation that nobody flies on
    with.
    """
    pitch = slopes(aircraft, plans.airspeeds(aircraft)[1]).pitch_name
    names = [name for name in aircraft.control_names if name != pitch]
    name = names[int(generator.integers(len(names)))]
    share = generator.uniform(0.5, 1.0) if share is None else share
    limit = (1.0 - 0.5 * share) * plans.fastest(aircraft, name)
    return {"name": "actuator_rate_limit", "control": name, "rate_limit": limit}, float(share)


def _unlisted(
    share: float | None, aircraft: Aircraft, generator: np.random.Generator
) -> tuple[dict[str, Any], float]:
    options = [one for one in _UNLISTED if all(_known(name, aircraft) for name in one[2])]
    coefficient, term, variables, beside, portion = options[int(generator.integers(len(options)))]
    share = generator.uniform(0.5, 1.0) if share is None else share
    # At one sigma of this variable the term beside it acts by that portion more or less.
    by = "qhat" if "qhat" in variables else "alpha"
    usual = abs(slope(aircraft, coefficient, beside))
    value = portion * share * usual / plans.typical(aircraft, by)
    sign = -1.0 if term == "alpha^2" else float(generator.choice(_BOTH))
    return {"name": "unlisted", "terms": {coefficient: {term: sign * value}}}, float(share)


def _known(name: str, aircraft: Aircraft) -> bool:
    return name in ("alpha", "beta", "qhat") or name in aircraft.control_names
