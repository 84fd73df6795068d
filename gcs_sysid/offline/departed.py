"""What a simulation leaves of the measured coefficients, before and after it was put right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid.aircraft import COEFFICIENTS, Aircraft, StreamTiming
from gcs_sysid.estimate.surface_delay import Delay
from gcs_sysid.model import aerodynamics
from gcs_sysid.offline import aided_states, settled
from gcs_sysid.offline.flight import SERVO_STREAM, Flight
from gcs_sysid.offline.investigation import Investigation

STRETCH = 2.0
"""Errors further apart than this [s] are taken as independent."""
SURE, WORTH = 1.96, 1.0
"""A coefficient is called worse where it is by so many standard deviations, and by so many percent
of its spread."""


def flown(found: Investigation, file: Aircraft, corrected: Aircraft) -> list[dict[str, Flight]]:
    """Every flight with the aided filter's states, by the file and by the file put right.

    Args:
        found: the flights, settled with what was found.
        file: the simulation.
        corrected: with what was found.
    """
    pairs = []
    for subject, done in zip(found.subjects, found.settled, strict=True):
        unknowns, states, covariance = settled.states(found.model, subject, done)
        pair = {}
        for label, aircraft in (("before", file), ("after", corrected)):
            late = aircraft.streams.get(SERVO_STREAM, StreamTiming()).delay
            own = replace(subject.one, aircraft=aircraft)
            delay = Delay(late, 0.0, found=True)
            pair[label] = aided_states.refined(own, unknowns, delay, states, covariance)
        pairs.append(pair)
    return pairs


def table(flights: Sequence[Mapping[str, Flight]]) -> dict[str, np.ndarray]:
    """Measured less predicted, sample by sample: by the file, and by the file put right.

    Args:
        flights: see `flown`.
    """
    parts = []
    for number, pair in enumerate(flights):
        one = pair["before"]
        part: dict[str, Any] = {
            "time_us": one.recording.time_us(one.samples.time),
            "t": one.samples.time,
            "flight": np.full(one.samples.time.size, number),
            "maneuver": one.pieces(),
        }
        for label, flight in pair.items():
            seen = flight.samples
            flow = {key: jnp.asarray(values) for key, values in seen.regressors.items()}
            predicted = np.asarray(aerodynamics.of_aircraft(flight.aircraft, flow))
            for column, name in enumerate(COEFFICIENTS):
                part[f"{name}_{label}"] = seen.measured[name] - predicted[:, column]
                if label == "before":
                    part[f"{name}_measured"] = seen.measured[name]
        parts.append(part)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def discrepancy(rows: Mapping[str, np.ndarray]) -> dict[str, dict[str, float]]:
    """RMS of measured less predicted over the spread of measured, before and after."""
    used = rows["maneuver"] >= 0
    return {
        name: {label: _share(rows, name, label, used) for label in ("before", "after")}
        for name in COEFFICIENTS
    }


def gain(
    rows: Mapping[str, np.ndarray],
    held_out: Sequence[int],
    *,
    before: float,
    gained: float,
    gained_sd: float | None,
) -> dict[str, Any]:
    """How much better what took no part is foretold.

    Errors of coefficients are in percent of the measured spread, one by one and their mean. One
    sigma of a gain by leaving out one stretch of `STRETCH` seconds after the other (Efron & Stein,
    Annals of Statistics 9, 1981): errors that are near each other in time go together.

    Args:
        rows: residuals, see `table`.
        held_out: maneuvers that took no part.
        before: negative log predictive density of a measurement.
        gained: by how much it is less with what was put right.
        gained_sd: one sigma of that, where it is known.
    """
    judged = np.isin(rows["maneuver"], held_out)
    out: dict[str, Any] = {
        "holdout_nlpd_before": before,
        "holdout_nlpd_after": before - gained,
        "holdout_nlpd_gained_sd": gained_sd,
    }
    for label in ("before", "after"):
        shares = [100.0 * _share(rows, name, label, judged) for name in COEFFICIENTS]
        out[f"holdout_error_{label}"] = float(np.mean(shares)) if judged.any() else float("nan")
    if not judged.any():
        return {**out, "channels": {}}
    parts = _parts(rows, judged)
    apart = np.mean([_gains(*part)[1] for part in parts.values()], axis=0)
    return {
        **out,
        "holdout_error_gained_sd": _jackknife(apart),
        "channels": {name: left_out(*part) for name, part in parts.items()},
    }


_Part = tuple[dict[str, np.ndarray], np.ndarray, float]
"""Of a channel, what `left_out` asks for."""


def _parts(rows: Mapping[str, np.ndarray], judged: Bool[np.ndarray, " sample"]) -> dict[str, _Part]:
    """Squared errors of each coefficient stretch by stretch, in percent of its measured spread."""
    stretch = np.floor(rows["t"][judged] / STRETCH)
    _, place = np.unique(np.stack([rows["flight"][judged], stretch]), axis=1, return_inverse=True)
    count = np.bincount(place.ravel()).astype(float)
    out = {}
    for name in COEFFICIENTS:
        spread = max(float(np.std(rows[f"{name}_measured"][judged])), 1e-12)
        squares = {
            label: np.bincount(place.ravel(), weights=rows[f"{name}_{label}"][judged] ** 2)
            for label in ("before", "after")
        }
        out[name] = (squares, count, 100.0 / spread)
    return out


def left_out(
    squares: Mapping[str, Float[np.ndarray, " part"]],
    count: Float[np.ndarray, " part"],
    unit: float,
) -> dict[str, float]:
    """Root mean square before and after, and what is gained with one sigma by the jackknife.

    Args:
        squares: sums of squared errors, part by part.
        count: errors in each part.
        unit: factor on the results.
    """
    errors, apart = _gains(squares, count, unit)
    gained = errors["before"] - errors["after"]
    return {**errors, "gained": gained, "gained_sd": _jackknife(apart)}


def _gains(
    squares: Mapping[str, Float[np.ndarray, " part"]],
    count: Float[np.ndarray, " part"],
    unit: float,
) -> tuple[dict[str, float], Float[np.ndarray, " part"]]:
    """Root mean square before and after, and what is gained without each part."""
    errors, without = {}, {}
    for label, each in squares.items():
        errors[label] = unit * float(np.sqrt(each.sum() / count.sum()))
        rest = (each.sum() - each) / np.maximum(count.sum() - count, 1)
        without[label] = unit * np.sqrt(np.maximum(rest, 0.0))
    return errors, without["before"] - without["after"]


def _jackknife(apart: Float[np.ndarray, " part"]) -> float:
    """One sigma of what is gained, by what is gained without each part."""
    return float(np.sqrt((apart.size - 1) / apart.size * np.sum((apart - apart.mean()) ** 2)))


def paid(gains: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Coefficients that are foretold worse for it, each as a warning."""
    return [
        f"putting the cause right makes {name} worse by {-one['gained']:.1f} % of its spread on "
        "what took no part: what it gains elsewhere is partly paid for there"
        for name, one in gains.items()
        if one["gained"] < -SURE * one["gained_sd"] and one["gained"] < -WORTH
    ]


def _share(rows: Mapping[str, np.ndarray], name: str, label: str, used: np.ndarray) -> float:
    if not used.any():
        return float("nan")
    left, measured = rows[f"{name}_{label}"][used], rows[f"{name}_measured"][used]
    return float(np.sqrt(np.mean(left**2)) / max(float(np.std(measured)), 1e-12))
