"""Aircraft for the simulator's tests."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import (
    Aircraft,
    CoefficientModel,
    Control,
    Geometry,
    Mass,
    Propulsion,
    Servo,
    TableTerm,
    Value,
)

ROOT = Path(__file__).resolve().parents[2]
ULTRA_STICK = ROOT / "data" / "aircraft" / "ultra_stick_25e.toml"


def ultra_stick() -> Aircraft:
    return aircraft_file.load(ULTRA_STICK)


def terms(**values: float) -> CoefficientModel:
    """A coefficient of plain terms; `one` is the constant."""
    return CoefficientModel(
        {("1" if key == "one" else key): Value(value, 0.0) for key, value in values.items()}
    )


def servo(channel: int, surface: str) -> Servo:
    return Servo(channel, surface, (1000.0, 1500.0, 2000.0), (-0.5, 0.0, 0.5))


def plain(aerodynamics: dict[str, CoefficientModel], **changes) -> Aircraft:
    """A 2 kg aircraft with the given aerodynamics and no engine."""
    aircraft = Aircraft(
        name="plain",
        mass=Mass(2.0, 0.07, 0.09, 0.15),
        geometry=Geometry(0.3, 1.3, 0.25),
        servos=(servo(1, "aileron"), servo(2, "elevator"), servo(4, "rudder")),
        controls=tuple(Control(name, {name: 1.0}) for name in ("elevator", "aileron", "rudder")),
        aerodynamics=aerodynamics,
    )
    return dataclasses.replace(aircraft, **changes)


def everything() -> Aircraft:
    """Nothing at zero: every kind of term, all products of inertia, all lever arms, two engines."""
    table = TableTerm(
        name="tail",
        regressors=("alpha", "elevator"),
        breakpoints=((-0.1, 0.0, 0.2), (-0.3, 0.1)),
        values=((0.01, 0.03), (0.02, -0.02), (-0.05, 0.04)),
        sigma=0.1,
    )
    line = TableTerm(
        name="drag",
        regressors=("beta^2",),
        breakpoints=((0.0, 0.01, 0.05),),
        values=(0.0, -0.02, -0.03),
        sigma=0.1,
    )
    thruster = Propulsion(
        throttle_channel=3,
        pwm=(1000.0, 2000.0),
        throttle=(0.0, 0.4, 1.0),
        airspeed=(8.0, 20.0, 30.0),
        thrust=((-0.5, -1.0, -2.0), (4.0, 2.0, 0.5), (15.0, 11.0, 6.0)),
        torque=((0.0, 0.01, 0.02), (-0.1, -0.08, -0.05), (-0.4, -0.35, -0.3)),
        axis=(0.98, 0.12, 0.16),
        position=(0.25, 0.15, -0.06),
    )
    left = dataclasses.replace(
        thruster, throttle_channel=6, torque=None, position=(0.2, -0.3, 0.02), axis=(1.0, 0.0, 0.0)
    )
    aerodynamics = {
        "CX": dataclasses.replace(
            terms(one=-0.04, alpha=0.2, **{"alpha^2": 2.9, "Tc": 0.1}), tables=(line,)
        ),
        "CY": terms(beta=-0.5, phat=-0.04, rhat=0.15, rudder=0.19),
        "CZ": terms(
            one=-0.1, alpha=-4.6, qhat=-8.1, elevator=-0.1, **{"max(0, alpha - 0.02)": 1.5}
        ),
        "Cl": terms(beta=-0.05, phat=-0.45, rhat=0.1, aileron=0.16, **{"aileron*qbar": -1e-4}),
        "Cm": dataclasses.replace(
            terms(one=-0.03, alpha=-0.7, qhat=-13.0, **{"elevator*Tc": -0.2, "V": 1e-3}),
            tables=(table,),
        ),
        "Cn": terms(
            beta=0.07, phat=0.1, rhat=-0.18, rudder=-0.18, h_over_b=1e-4, **{"max(0, -beta)^2": 0.3}
        ),
    }
    return plain(
        aerodynamics,
        name="everything",
        mass=Mass(2.1, 0.07, 0.09, 0.15, 0.012, 0.004, -0.003, cg=(0.03, -0.02, 0.05)),
        propulsion=(thruster, left),
    )
