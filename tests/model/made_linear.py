"""An aircraft that flies level at 20 m/s, for linear models."""

from __future__ import annotations

from dataclasses import replace

from gcs_sysid.aircraft import Aircraft, CoefficientModel, Value
from tests.offline.made_aircraft import small

AIRSPEED, HEIGHT, DENSITY = 20.0, 100.0, 1.2133
TERMS = {
    "CX": {"1": -0.05, "alpha^2": 2.0},
    "CY": {"beta": -0.9, "rudder": 0.2},
    "CZ": {"1": -0.3, "alpha": -5.0, "qhat": -8.0, "elevator": -0.13},
    "Cl": {"beta": -0.1, "phat": -0.5, "rhat": 0.2, "aileron": 0.17},
    "Cm": {"1": 0.01, "alpha": -1.5, "qhat": -30.0, "elevator": -0.99},
    "Cn": {"beta": 0.08, "phat": -0.05, "rhat": -0.1, "rudder": -0.07},
}


def flying(**changed: dict[str, float]) -> Aircraft:
    """The aircraft; every value has a sigma of 4 %; `changed` replaces terms by coefficient."""
    aerodynamics = {
        name: CoefficientModel(
            {
                key: Value(value, 0.04 * abs(value))
                for key, value in {**terms, **changed.get(name, {})}.items()
            }
        )
        for name, terms in TERMS.items()
    }
    return replace(small(), aerodynamics=aerodynamics)
