"""What a flight brought: error and deviation of the moments' derivatives, and limits that it broke.

What a flight can change of a deviation is told apart: noise, errors of the regressors. The hidden
aircraft has the file's mass and inertia, but nobody is told that: each derivative of a moment stays
as unsure as the file says of the inertia, by 5 to 30 %, however well it is flown. The same goes,
inside the filter, for what the moments' lag may be off by. Errors and deviations are those of what
was believed before and what the flights say together; the ratio to what was foretold is of what the
flights say alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.atmosphere import GRAVITY
from gcs_sysid.estimate.result import AeroModel, CoefficientFit
from gcs_sysid.maneuvers import information
from gcs_sysid.maneuvers.information import Added, Knowledge
from gcs_sysid.offline import servo_outputs
from gcs_sysid.reconstruct.control_history import SERVO_STREAM
from gcs_sysid.recording import Recording
from gcs_sysid.sitl.autopilot import PERIOD
from gcs_sysid.sitl.plan import Leg
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


def score(
    model: AeroModel, real: Aircraft, foretold: Deviations | None, *, inside_filter: bool
) -> dict[str, Any]:
    """Error and deviation over the size of each primary derivative, means of them.

    Args:
        model: identified from both flights.
        real: the aircraft that flew.
        foretold: deviations by `foretell`; the ratio to them is a median.
        inside_filter: whether the filter found the model.
    """
    errors, deviations, lasting, ratios = [], [], [], []
    for name, keys in PRIMARY.items():
        fit = model.fits.get(name)
        for key in keys:
            if fit is None or key not in fit.keys or key not in real.aerodynamics[name].terms:
                continue
            index = fit.keys.index(key)
            true = real.aerodynamics[name].terms[key].value
            errors.append(abs(float(fit.value[index]) - true) / abs(true))
            reached = _without_scale(fit, inside_filter=inside_filter)
            lasting.append(float(reached[index]) / abs(true))
            deviations.append(lasting[-1] * float(_noisy(fit)[index]))
            if foretold is not None:
                ratios.append(float(changeable(fit)[index]) / foretold[name][key])
    return {
        "error": float(np.mean(errors)),
        "sd": float(np.mean(deviations)),
        "sd_with_lag": float(np.mean(lasting)),
        "ratio": float(np.median(ratios)) if ratios else None,
    }


def changeable(fit: CoefficientFit) -> np.ndarray:
    """Deviation of each term by noise and errors of the regressors, nothing believed before."""
    nothing = np.zeros(len(fit.keys))
    noise, regressor = (fit.deviations.get(one, nothing) for one in ("noise", "regressor"))
    return np.hypot(noise, regressor)


def _without_scale(fit: CoefficientFit, *, inside_filter: bool) -> np.ndarray:
    """Deviation of each term were mass and inertia known, what was believed before weighed in.

    The filter adds their part last, and it is taken off. Its `noise` is of the flight without the
    prior, and where a weak one does not see a direction, far larger than what is known.
    """
    if inside_filter:
        return np.sqrt(np.maximum(fit.deviation**2 - fit.deviations["scale"] ** 2, 0.0))
    return np.sqrt(1.0 / (1.0 / changeable(fit) ** 2 + _believed(fit)))


def _noisy(fit: CoefficientFit) -> np.ndarray:
    """Part of a deviation without mass and inertia that the lag has not made."""
    noise = changeable(fit)
    return noise / np.maximum(np.hypot(noise, fit.deviations.get("lag", 0.0)), 1e-300)


def _believed(fit: CoefficientFit) -> np.ndarray:
    """What was believed of each term before the flights: one over its variance."""
    raw = changeable(fit) ** 2 + _staying(fit)
    return np.maximum(1.0 / np.diagonal(fit.covariance) - 1.0 / raw, 0.0)


def foretell(model: AeroModel, flown: Sequence[Knowledge]) -> Deviations:
    """The same deviations once these maneuvers were flown, as `suggest` reckons.

    It tells whole variances, 1/(1/(c² + s²) + p): c is what a flight can change, s by mass, inertia
    and lag, p what was believed. The first is told from these.
    """
    known = information.nothing(model)
    for more in flown:
        known = information.with_more(known, more)
    return {
        name: dict(zip(fit.keys, _later(fit, known[name]).tolist(), strict=True))
        for name, fit in model.fits.items()
    }


def _later(fit: CoefficientFit, added: Added) -> np.ndarray:
    after = np.diagonal(information.covariance(fit, added))
    return np.sqrt(np.maximum(1.0 / (1.0 / after - _believed(fit)) - _staying(fit), 1e-300))


def _staying(fit: CoefficientFit) -> np.ndarray:
    """Variance of each term by what no flight takes away."""
    scale, lag = (np.asarray(fit.deviations.get(one, 0.0)) for one in ("scale", "lag"))
    return scale**2 + lag**2


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
    allowed = aircraft.envelope
    if allowed is None:
        raise ValueError(f"{aircraft.name} has no envelope")
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
