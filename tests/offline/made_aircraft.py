"""An aircraft for made-up flights: outputs 1, 2, 4 aileron, elevator, rudder; 3 throttle."""

from __future__ import annotations

from gcs_sysid.aircraft import (
    Aircraft,
    CoefficientModel,
    Control,
    Envelope,
    Geometry,
    Mass,
    Propulsion,
    Servo,
    Value,
)


def small(*, aerodynamics: bool = True, span: float = 2.9) -> Aircraft:
    """An 11 kg aircraft; its derivatives are those of a published light UAV."""
    surfaces = {"aileron": 1, "elevator": 2, "rudder": 4}
    values = {
        "CZ": {"alpha": -5.65, "elevator": -0.13},
        "Cl": {"phat": -0.51, "aileron": 0.17},
        "Cm": {"alpha": -2.74, "qhat": -38.21, "elevator": -0.99},
        "Cn": {"beta": 0.073, "rudder": -0.069},
    }
    models = {
        name: CoefficientModel({key: Value(value, 0.1) for key, value in terms.items()})
        for name, terms in values.items()
    }
    return Aircraft(
        name="made up",
        mass=Mass(11.0, 0.824, 1.135, 1.759, 0.12),
        geometry=Geometry(0.55, span, 0.19),
        servos=tuple(
            Servo(channel, name, (1000.0, 1500.0, 2000.0), (-0.5, 0.0, 0.5))
            for name, channel in surfaces.items()
        ),
        controls=tuple(Control(name, {name: 1.0}) for name in surfaces),
        propulsion=(
            Propulsion(3, (1000.0, 2000.0), (0.0, 1.0), (10.0, 30.0), ((0.0, 0.0), (40.0, 20.0))),
        ),
        envelope=Envelope((13.0, 35.0), (-0.1, 0.2), (-0.2, 0.2), (-1.0, 3.5), 1.0, 50.0),
        aerodynamics=models if aerodynamics else {},
    )
