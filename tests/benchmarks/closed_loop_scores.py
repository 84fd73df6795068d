"""What a flight brought: error and deviation of the moments' derivatives, and limits that it broke.

What a flight can change of a deviation is told apart: noise, errors of the regressors. The hidden
aircraft has the file's mass and inertia, but nobody is told that: each derivative of a moment stays
as unsure as the file says of the inertia, by 5 to 30 %, however well it is flown. The same goes,
inside the filter, for what the moments' lag may be off by. Errors, deviations and their ratio to
those foretold are of what was believed before and what the flights say together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gcs_sysid.aircraft import Aircraft, Envelope
from gcs_sysid.atmosphere import GRAVITY, SEA_LEVEL_DENSITY
from gcs_sysid.estimate.result import AeroModel, CoefficientFit
from gcs_sysid.maneuvers import information
from gcs_sysid.maneuvers.knowledge import Added, Knowledge
from gcs_sysid.offline import servo_outputs
from gcs_sysid.reconstruct.control_history import SERVO_STREAM
from gcs_sysid.recording import Recording
from gcs_sysid.sitl.autopilot import PERIOD
from gcs_sysid.sitl.plan import Leg
from gcs_sysid.sitl.slopes import trim
from gcs_sysid.sitl.terms import slope
from gcs_sysid.sitl.truth import Truth

PRIMARY = {
    "Cl": ("phat", "aileron", "beta"),
    "Cm": ("alpha", "qhat", "elevator"),
    "Cn": ("beta", "rhat", "rudder"),
}
"""Derivatives of the moments that are scored, where the aircraft has them."""
STOP = 2.0
"""So near to the end of its range a pulse is at it [µs]."""
Deviations = dict[str, dict[str, float]]


def score(model: AeroModel, real: Aircraft, foretold: Deviations | None) -> dict[str, Any]:
    """Error and deviation over the size of each primary derivative, means of them.

    Args:
        model: identified from both flights.
        real: the aircraft that flew.
        foretold: deviations by `foretell`; the ratio to them is a median.
    """
    errors, deviations, with_lag, ratios = [], [], [], []
    reached = foretell(model, information.nothing(model))
    for name, keys in PRIMARY.items():
        fit = model.fits.get(name)
        for key in keys:
            if fit is None or key not in fit.keys or key not in real.aerodynamics[name].terms:
                continue
            index = fit.keys.index(key)
            true = real.aerodynamics[name].terms[key].value
            errors.append(abs(float(fit.value[index]) - true) / abs(true))
            deviations.append(reached[name][key] / abs(true))
            with_lag.append(float(np.hypot(reached[name][key], _lag(fit)[index])) / abs(true))
            if foretold is not None:
                ratios.append(reached[name][key] / foretold[name][key])
    return {
        "error": float(np.mean(errors)),
        "sd": float(np.mean(deviations)),
        "sd_with_lag": float(np.mean(with_lag)),
        "ratio": float(np.median(ratios)) if ratios else None,
    }


def foretell(model: AeroModel, known: Knowledge) -> Deviations:
    """Deviations without what no flight takes away, once so much was added to the fits."""
    return {
        name: dict(zip(fit.keys, _changeable(fit, known.of(name)).tolist(), strict=True))
        for name, fit in model.fits.items()
    }


def _changeable(fit: CoefficientFit, added: Added) -> np.ndarray:
    """Deviation of each term by all but mass, inertia and lag, what was believed weighed in."""
    whole = np.diagonal(information.covariance(fit, added))
    stays = np.diagonal(information.lasting(fit)) + _lag(fit) ** 2
    return np.sqrt(np.maximum(whole - stays, 1e-300))


def _lag(fit: CoefficientFit) -> np.ndarray:
    return np.asarray(fit.deviations.get("lag", np.zeros(len(fit.keys))))


def sure(document: dict[str, Any], real: Aircraft, confidence: float) -> str:
    """Share of the reachable part of each coefficient's map that is known to a confidence.

    Told is the deviation as stated, and in brackets without what no flight takes away. A flow angle
    is reachable where it is allowed, and where the lift there is an allowed load factor at the
    airspeed of the map.
    """
    found = []
    for name, item in document["confidence_map"].items():
        x, known, stays = (np.asarray(item[key], dtype=float) for key in ("x", "before", "stays"))
        reached = np.ones(x.size, dtype=bool)
        if item["along"] == "alpha":
            load = _load_factor(real, document["conditions"][0]["airspeed"], x)
            low, high = envelope(real).load_factor
            reached = (load >= low) & (load <= high)
        stated, flying = (
            100.0 * np.mean(sd[reached] <= confidence)
            for sd in (known, np.sqrt(np.maximum(known**2 - stays**2, 0.0)))
        )
        found.append(f"{name} {stated:.0f} ({flying:.0f}) %")
    return ", ".join(found)


def _load_factor(real: Aircraft, airspeed: float, alpha: np.ndarray) -> np.ndarray:
    """Of the lift at an angle of attack, by its slope from level flight [g]."""
    pressure = 0.5 * SEA_LEVEL_DENSITY * airspeed**2
    lift = -slope(real, "CZ", "alpha") * pressure * real.geometry.wing_area
    return 1.0 + lift * (alpha - trim(real, airspeed).alpha) / (real.mass.mass * GRAVITY)


def envelope(aircraft: Aircraft) -> Envelope:
    """Its limits, which an aircraft of these flights has."""
    if aircraft.envelope is None:
        raise ValueError(f"{aircraft.name} has no envelope")
    return aircraft.envelope


def excursions(
    truth: Truth, recording: Recording, legs: Sequence[Leg], believed: Aircraft
) -> dict[str, Any]:
    """Runs during which the aircraft left the envelope in truth, or a surface met its stop.

    Args:
        truth: of the flight.
        recording: of the same; its servo outputs tell what was asked of the surfaces.
        legs: as flown; those with inputs are runs.
        believed: the aircraft, whose envelope and whose servos' ranges these are.
    """
    motion, asked = _motion(truth, believed, legs[0].height), _at_stops(truth, recording, believed)
    left, broken = [], set()
    runs, begins = 0, 0.0
    for leg in legs:
        ends = begins + leg.duration
        if leg.inputs:
            runs += 1
            rows = slice(round(begins / PERIOD), round(ends / PERIOD))
            limits = [
                name
                for name, (values, low, high) in motion.items()
                if np.any((values[rows] < low) | (values[rows] > high))
            ]
            limits += [
                f"travel of {surface}"
                for surface, times in asked.items()
                if np.any((times >= begins) & (times < ends))
            ]
            left.append(bool(limits))
            broken.update(limits)
        begins = ends
    return {"left": sum(left), "runs": runs, "limits": sorted(broken)}


def _motion(
    truth: Truth, aircraft: Aircraft, height: float
) -> dict[str, tuple[np.ndarray, float, float]]:
    """Each limited quantity and its limits [m/s, rad, g, m]; recordings begin on the first leg."""
    allowed = envelope(aircraft)
    weight = aircraft.mass.mass * GRAVITY
    lift = -truth.column("CZ") * truth.column("qbar") * aircraft.geometry.wing_area
    climbed = np.cumsum(-truth.column("v_down")) * PERIOD
    return {
        "airspeed": (truth.column("V"), *allowed.airspeed),
        "alpha": (truth.column("alpha"), *allowed.alpha),
        "beta": (truth.column("beta"), *allowed.beta),
        "bank": (truth.column("phi"), -allowed.bank, allowed.bank),
        "load_factor": (lift / weight, *allowed.load_factor),
        "height": (height + climbed, allowed.height_min, np.inf),
    }


def _at_stops(truth: Truth, recording: Recording, aircraft: Aircraft) -> dict[str, np.ndarray]:
    """When each surface was asked for all its travel [s of the truth]: autopilots cut there."""
    stream = recording.streams[SERVO_STREAM]
    late = (truth.t0_us - recording.epoch_us) * 1e-6
    found = {}
    for servo in aircraft.servos:
        time, sent = servo_outputs.pulses(stream, (servo.channel,))
        pulse = sent[servo.channel]
        stopped = (pulse <= min(servo.pwm) + STOP) | (pulse >= max(servo.pwm) - STOP)
        found[servo.surface] = time[stopped] - late
    return found
