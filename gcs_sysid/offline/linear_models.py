"""Linear models of an aircraft, or of an identified model, at conditions of level flight."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from gcs_sysid import atmosphere
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import RefusedError
from gcs_sysid.maneuvers.information import lasting
from gcs_sysid.model import eigenmodes, linear, trim
from gcs_sysid.model.eigenmodes import Mode, Uncertain
from gcs_sysid.model.linear import LATERAL, LONGITUDINAL, OUTPUTS, STATES, Linear, Linearisation
from gcs_sysid.offline import model_store, tested

HEIGHT = 100.0
"""Height [m] where none is asked for."""
MIDDLE = 0.45
"""Where in the envelope's airspeeds, where none is asked for."""


def models(
    aircraft: Path | None,
    model: Path | None,
    *,
    airspeeds: Sequence[float],
    height: float,
) -> tuple[Aircraft, list[Linear]]:
    """Linear models at each airspeed.

    Args:
        aircraft: file whose aerodynamics are used, with their sigmas.
        model: folder of an identified model, instead.
        airspeeds: true airspeeds [m/s]; empty takes one from the envelope.
        height: above sea level [m].

    Raises:
        UsageError: both or neither is given, or level flight there is impossible.
        InputError: what is given cannot be used.
    """
    described, found = _described(aircraft, model)
    wanted = tuple(airspeeds) or (_usual(described),)
    density = float(atmosphere.density(np.array(height)))
    covariance = linear.stated_covariance(described, found)
    solver = Linearisation(described)
    return described, [
        solver.at(trim.find(described, speed, height, density), covariance) for speed in wanted
    ]


def _described(
    aircraft: Path | None, model: Path | None
) -> tuple[Aircraft, Mapping[str, Float[np.ndarray, "term term"]] | None]:
    """The aircraft, and the covariance of what was identified, without errors of mass."""
    source = tested.load(aircraft, model)
    if model is None:
        return source.aircraft, None
    stored = model_store.load(model)
    every = {**stored.aircraft.aerodynamics, **source.aircraft.aerodynamics}
    found = {name: fit.covariance - lasting(fit) for name, fit in stored.model.fits.items()}
    return replace(source.aircraft, aerodynamics=every), found


def _usual(aircraft: Aircraft) -> float:
    if aircraft.envelope is None:
        raise RefusedError(
            aircraft.name,
            "the aircraft file has no [envelope] to take an airspeed from",
            fix="give --airspeed in m/s",
        )
    low, high = aircraft.envelope.airspeed
    return low + MIDDLE * (high - low)


def document(found: Linear) -> dict[str, Any]:
    """One linear model as plain data: matrices, names, units, one sd of every entry, modes."""
    mean, deviation = found.mean, found.deviation
    return {
        "airspeed": found.trim.airspeed,
        "height": -float(found.trim.state.position[2]),
        "density": found.trim.density,
        "states": list(STATES),
        "state_units": list(STATES.values()),
        "inputs": list(found.inputs),
        "input_units": list(found.inputs.values()),
        "outputs": list(OUTPUTS),
        "output_units": list(OUTPUTS.values()),
        "longitudinal": list(LONGITUDINAL),
        "lateral": list(LATERAL),
        "trim_states": mean.state,
        "trim_states_sd": deviation.state,
        "trim_inputs": mean.control,
        "trim_inputs_sd": deviation.control,
        **{name: getattr(mean, name) for name in ("A", "B", "C", "D")},
        **{f"{name}_sd": getattr(deviation, name) for name in ("A", "B", "C", "D")},
        "modes": [mode_document(mode) for mode in eigenmodes.modes(found)],
    }


def mode_document(mode: Mode) -> dict[str, Any]:
    """One mode: natural frequency [rad/s], damping ratio, time constants [s], roots [1/s]."""
    return {
        "name": mode.name,
        "frequency": _number(mode.frequency),
        "damping": _number(mode.damping),
        "time_constants": [_number(item) for item in mode.time_constants],
        "roots": [
            {"real": root.real, "imag": root.imag, "real_sd": sd[0], "imag_sd": sd[1]}
            for root, sd in zip(mode.roots, mode.root_deviations, strict=True)
        ],
        "stable": mode.stable,
    }


def _number(item: Uncertain) -> dict[str, float] | None:
    """Value and sd; None where the quantity has no meaning."""
    if math.isnan(item.value):
        return None
    return {"value": item.value, "sd": item.deviation}
