"""Linear models of an aircraft, or of an identified model, at conditions of steady flight."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from gcs_sysid import atmosphere, frames
from gcs_sysid.aircraft import COEFFICIENTS, Aircraft
from gcs_sysid.atmosphere import GRAVITY
from gcs_sysid.errors import RefusedError, UsageError
from gcs_sysid.gp.aerodynamics import LearnedModel
from gcs_sysid.maneuvers.information import lasting
from gcs_sysid.model import eigenmodes, linear, trim
from gcs_sysid.model.eigenmodes import Mode, Uncertain
from gcs_sysid.model.linear import LATERAL, LONGITUDINAL, OUTPUTS, STATES, Linear, Linearisation
from gcs_sysid.model.trim import Trim
from gcs_sysid.offline import model_store, tested
from gcs_sysid.offline.model_store import StoredModel

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
    bank: float = 0.0,
    climb: float = 0.0,
) -> tuple[Aircraft, list[Linear]]:
    """Linear models at each airspeed.

    Args:
        aircraft: file whose aerodynamics are used, with their sigmas.
        model: folder of an identified model, instead.
        airspeeds: true airspeeds [m/s]; empty takes one from the envelope.
        height: above sea level [m].
        bank: of a coordinated turn [rad]; 0 flies straight.
        climb: angle of the flight path above level [rad].

    Raises:
        UsageError: both or neither is given, or steady flight there is impossible.
        InputError: what is given cannot be used.
    """
    described, found = tested.load(aircraft, model).aircraft, None
    if model is not None:
        described, found = _identified(model_store.load(model))
    wanted = tuple(airspeeds) or (_usual(described),)
    density = float(atmosphere.density(np.array(height)))
    trims = [
        trim.find(described, speed, height, density, bank=bank, climb=climb) for speed in wanted
    ]
    return described, _about(described, found, trims)


def modes(stored: StoredModel, airspeed: float, height: float, density: float) -> dict[str, Any]:
    """Modes of an identified model about level flight, or the reason why there are none.

    Args:
        stored: the model.
        airspeed: true [m/s].
        height: above the ground [m].
        density: of the air [kg/m³].
    """
    described, found = _identified(stored)
    at = {"airspeed": airspeed, "density": density}
    missing = [name for name in COEFFICIENTS if name not in described.aerodynamics]
    if missing:
        return {**at, "modes": [], "reason": f"nothing is known of {', '.join(missing)}"}
    if not np.isfinite(airspeed):
        return {**at, "modes": [], "reason": "no steady flight was found, so no airspeed"}
    try:
        level = trim.find(described, airspeed, height, density)
        (model,) = _about(described, found, [level])
    except UsageError as error:
        return {**at, "modes": [], "reason": str(error)}
    if not all(np.isfinite(part).all() for part in (model.mean.A, model.slopes.A)):
        return {**at, "modes": [], "reason": "the model is not defined about level flight"}
    each = [mode_document(mode) for mode in eigenmodes.modes(model)]
    reason = None if each else "pitch does not come apart from roll and yaw"
    return {**at, "modes": each, "reason": reason}


def _about(
    aircraft: Aircraft,
    found: Mapping[str, Float[np.ndarray, "term term"]] | None,
    trims: Sequence[Trim],
) -> list[Linear]:
    covariance = linear.stated_covariance(aircraft, found)
    solver = Linearisation(aircraft)
    return [solver.at(one, covariance) for one in trims]


def _identified(
    stored: StoredModel,
) -> tuple[Aircraft, Mapping[str, Float[np.ndarray, "term term"]]]:
    """The aircraft with what was identified, and its covariance without errors of mass.

    What processes know less of slopes than the polynomial beside them is told as of the middle of
    what they have seen.
    """
    model = stored.model
    flown = tested.with_model(stored.aircraft, model)
    every = {**stored.aircraft.aerodynamics, **flown.aerodynamics}
    found = {name: fit.covariance - lasting(fit) for name, fit in model.fits.items()}
    if isinstance(model, LearnedModel):
        middle = dict(zip(model.inputs, model.process.scaling.centre[:, None], strict=True))
        for name, fit in model.fits.items():
            more = model.linear_variance(name, fit.keys, middle)
            found[name] = found[name] + np.diag(more)
    return replace(flown, aerodynamics=every), found


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
        "bank": found.trim.bank,
        "climb": found.trim.climb,
        "turn_rate": found.trim.turn_rate,
        "load_factor": _load_factor(found),
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


def _load_factor(found: Linear) -> float:
    """Specific force upward in the aircraft, in g."""
    attitude, rate = found.trim.state.attitude, found.trim.state.rate
    velocity = frames.unrotate(attitude, found.trim.state.velocity)
    weight = frames.unrotate(attitude, np.array([0.0, 0.0, GRAVITY]))
    return float(weight[2] - frames.cross(rate, velocity)[2]) / GRAVITY


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
