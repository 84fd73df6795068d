"""The Ultra Stick 25e with what its linear table leaves out, as an aircraft file of its own.

    .venv/bin/python -m data.scripts.ultra_stick

writes data/aircraft/ultra_stick_25e_full.toml from ultra_stick_25e.toml: the propeller and the
motor that were measured, where they and the air's forces act, side force in body axes, the
propeller's wash over the tail, and a stall. What is published and what is estimated is told in
data/MANIFEST.md.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from data.scripts import files
from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft, CoefficientModel, Propulsion, Value

FOLDER = Path(__file__).parents[1] / "aircraft"

DIAMETER = 0.3048
_THRUST = (-0.4314, 1.08, -0.896, 0.1089, 0.0604)
_POWER = (0.5054, -0.5304, 0.0412, 0.01664, 0.0223)
_MOTOR = (174.46, 70.135, -4.39)
# Published of advance ratios between 0 and those at which thrust and power are nothing; beyond,
# straight on.
_LAST_ADVANCE = 0.60

IMMERSED = 0.5
"""Share of the tail that stands in the propeller's wash."""
STALL = 0.25
"""Angle of attack beyond which lift is lost [rad], 14°."""
_SIGMA = 0.2


def coefficient(polynomial: tuple[float, ...], advance: float) -> float:
    """A propeller's coefficient at an advance ratio."""
    inside = min(advance, _LAST_ADVANCE)
    slope = np.polyval(np.polyder(np.array(polynomial)), inside)
    return float(np.polyval(polynomial, inside) + slope * (advance - inside))


def turns(throttle: float, airspeed: float) -> float:
    """Revolutions a second at which the propeller takes what the motor gives, at sea level."""
    power = max(float(np.polyval(_MOTOR, throttle)), 0.0)

    def missing(n: float) -> float:
        drawn = coefficient(_POWER, airspeed / (n * DIAMETER)) * 1.225 * n**3 * DIAMETER**5
        return drawn - power

    return float(brentq(missing, 5.0, 400.0))


def thrust(throttle: float, airspeed: float) -> float:
    """Thrust at sea level [N]."""
    n = turns(throttle, airspeed)
    advance = airspeed / (n * DIAMETER)
    return coefficient(_THRUST, advance) * 1.225 * n**2 * DIAMETER**4


def torque(throttle: float, airspeed: float) -> float:
    """Reaction on the airframe about x [N·m]: the propeller turns to the right."""
    power = max(float(np.polyval(_MOTOR, throttle)), 0.0)
    return -power / (2.0 * math.pi * turns(throttle, airspeed))


def aircraft() -> Aircraft:
    """The aircraft."""
    base = aircraft_file.load(FOLDER / "ultra_stick_25e.toml")
    disc = 0.25 * math.pi * DIAMETER**2
    # Behind a propeller, far: dynamic pressure grows by T/A (momentum theory), so by Tc·S/A.
    wash = IMMERSED * base.geometry.wing_area / disc
    drag = 0.0455
    terms = {name: dict(model.terms) for name, model in base.aerodynamics.items()}
    terms["CY"]["beta"] = _value(terms["CY"]["beta"].value - drag)
    lift_slope = -terms["CZ"]["alpha"].value
    for name, control in (
        ("CZ", "elevator"),
        ("Cm", "elevator"),
        ("CY", "rudder"),
        ("Cn", "rudder"),
    ):
        terms[name][f"Tc*{control}"] = _value(wash * terms[name][control].value, 0.5)
    beyond = f"max(0, alpha - {STALL})"
    for name, value in (("CZ", 0.85 * lift_slope), ("CX", -1.5), ("Cm", -0.5)):
        terms[name][beyond] = _value(value, 0.5)
    return replace(
        base,
        name="Ultra Stick 25e, beyond the linear table",
        mass=replace(base.mass, cg=(0.0045, 0.0, 0.0)),
        propulsion=(_propulsion(base.propulsion[0]),),
        aerodynamics={name: CoefficientModel(each) for name, each in terms.items()},
    )


def _value(value: float, sigma: float = _SIGMA) -> Value:
    return Value(files.rounded(value), sigma * abs(files.rounded(value)))


def _propulsion(base: Propulsion) -> Propulsion:
    throttles = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    speeds = (8.0, 11.0, 14.0, 17.0, 20.0, 23.0, 26.0)
    rows = tuple(tuple(files.rounded(thrust(t, v)) for v in speeds) for t in throttles)
    reaction = tuple(tuple(files.rounded(torque(t, v)) for v in speeds) for t in throttles)
    return replace(
        base,
        throttle=throttles,
        airspeed=speeds,
        thrust=rows,
        torque=reaction,
        position=(0.297, 0.0, -0.046),
    )


def main() -> None:
    """Write the file."""
    files.write(
        aircraft(), FOLDER / "ultra_stick_25e_full.toml", made_by="data.scripts.ultra_stick"
    )


if __name__ == "__main__":
    main()
