"""Derivatives of an ordinary small aircraft: where a search begins that may not use a file's.

Orders of magnitude for the usual arrangement (Roskam, *Airplane Flight Dynamics*, 1995, part VI;
lift slope of a wing of aspect ratio A after Helmbold, 2πA/(A + 2)). They are not believed: only the
sign conventions of the usual controls and being within a factor of a few matter, so that a filter
that flies with them does not lose the aircraft.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gcs_sysid import regressors
from gcs_sysid.aircraft import Aircraft

USUAL: Mapping[str, Mapping[str, float]] = {
    "CX": {"1": -0.03, "alpha": 0.2, "alpha^2": 4.0},
    "CY": {"beta": -0.5},
    "CZ": {"1": -0.2, "qhat": -5.0},
    "Cl": {"beta": -0.06, "phat": -0.45, "rhat": 0.12},
    "Cm": {"alpha": -0.7, "qhat": -12.0},
    "Cn": {"beta": 0.06, "phat": -0.03, "rhat": -0.1},
}
CONTROLS: Mapping[str, Mapping[str, float]] = {
    "elevator": {"CZ": -0.3, "Cm": -0.8},
    "aileron": {"Cl": 0.15},
    "rudder": {"CY": 0.1, "Cn": -0.06},
}
"""By the first part of a control's name; elevons are what they replace."""
ELEVON = {"symmetric": "elevator", "differential": "aileron"}


def derivatives(
    aircraft: Aircraft, structure: Mapping[str, Sequence[str]]
) -> dict[str, dict[str, float]]:
    """A value for every term of a structure; 0 where nothing is usual."""
    aspect = aircraft.geometry.wing_span**2 / aircraft.geometry.wing_area
    lift = {"CZ": {"alpha": -2.0 * np.pi * aspect / (aspect + 2.0)}}
    out = {}
    for name, keys in structure.items():
        known = {**USUAL[name], **lift.get(name, {})}
        known |= {
            control: CONTROLS.get(_usual_name(control), {}).get(name, 0.0)
            for control in aircraft.control_names
            if regressors.control_kind(control) != "unknown"
        }
        out[name] = {key: float(known.get(key, 0.0)) for key in keys}
    return out


def _usual_name(control: str) -> str:
    words = control.lower().split("_")
    for word, meaning in ELEVON.items():
        if word in words:
            return meaning
    return words[0]
