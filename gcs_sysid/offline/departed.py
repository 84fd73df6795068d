"""What a simulation leaves of the measured coefficients, before and after it was put right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import COEFFICIENTS, Aircraft, CoefficientModel, StreamTiming
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.estimate.surface_delay import Delay
from gcs_sysid.model import aerodynamics
from gcs_sysid.offline import aided_states, settled
from gcs_sysid.offline.flight import SERVO_STREAM
from gcs_sysid.offline.investigation import Investigation


def table(found: Investigation, file: Aircraft, corrected: Aircraft) -> dict[str, np.ndarray]:
    """Measured less predicted, sample by sample: by the file, and by the file put right.

    Args:
        found: the flights, settled with what was found.
        file: the simulation.
        corrected: with what was found.
    """
    parts = []
    for number, (subject, done) in enumerate(zip(found.subjects, found.settled, strict=True)):
        one = subject.one
        unknowns, states, covariance = settled.states(found.model, subject, done)
        part: dict[str, Any] = {
            "time_us": one.recording.time_us(one.samples.time),
            "t": one.samples.time,
            "flight": np.full(one.samples.time.size, number),
            "maneuver": one.pieces(),
        }
        for label, aircraft in (("before", file), ("after", corrected)):
            late = aircraft.streams.get(SERVO_STREAM, StreamTiming()).delay
            seen = aided_states.refined(
                replace(one, aircraft=aircraft),
                unknowns,
                Delay(late, 0.0, found=True),
                states,
                covariance,
            ).samples
            for name in COEFFICIENTS:
                part[f"{name}_{label}"] = seen.measured[name] - _predicted(aircraft, seen, name)
                if label == "before":
                    part[f"{name}_measured"] = seen.measured[name]
        parts.append(part)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _predicted(aircraft: Aircraft, samples: Samples, name: str) -> Float[np.ndarray, " sample"]:
    model = aircraft.aerodynamics.get(name, CoefficientModel())
    flow = {key: jnp.asarray(values) for key, values in samples.regressors.items()}
    return np.asarray(aerodynamics.coefficient(model, flow))


def discrepancy(rows: Mapping[str, np.ndarray]) -> dict[str, dict[str, float]]:
    """RMS of measured less predicted over the spread of measured, before and after."""
    used = rows["maneuver"] >= 0
    return {
        name: {label: _share(rows, name, label, used) for label in ("before", "after")}
        for name in COEFFICIENTS
    }


def gain(
    rows: Mapping[str, np.ndarray],
    found: Investigation,
    held_out: Sequence[int],
    named: bool,
    gained: float,
) -> dict[str, float]:
    """How much better what took no part is foretold.

    The densities are of a measurement, relative to that of the simulation taken as exact; the
    errors of coefficients, in percent of the measured spread, their mean.
    """
    judged = np.isin(rows["maneuver"], held_out)
    before = -found.foretold(())
    out = {"holdout_nlpd_before": before, "holdout_nlpd_after": before - (gained if named else 0.0)}
    for label in ("before", "after"):
        shares = [100.0 * _share(rows, name, label, judged) for name in COEFFICIENTS]
        out[f"holdout_error_{label}"] = float(np.mean(shares)) if judged.any() else float("nan")
    return out


def _share(rows: Mapping[str, np.ndarray], name: str, label: str, used: np.ndarray) -> float:
    if not used.any():
        return float("nan")
    left, measured = rows[f"{name}_{label}"][used], rows[f"{name}_measured"][used]
    return float(np.sqrt(np.mean(left**2)) / max(float(np.std(measured)), 1e-12))
