"""Single terms of an aircraft file's coefficients."""

from __future__ import annotations

from gcs_sysid.aircraft import Aircraft


def slope(aircraft: Aircraft, coefficient: str, key: str) -> float:
    """The linear term of a coefficient, 0 where the file has none."""
    model = aircraft.aerodynamics.get(coefficient)
    value = model.terms.get(key) if model else None
    return value.value if value else 0.0
