"""What `summary.json` tells of a fit inside the filter: the search, the air, the sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gcs_sysid.aircraft import Aircraft, StreamTiming
from gcs_sysid.estimate import in_common
from gcs_sysid.estimate.filter_error import Fit
from gcs_sysid.estimate.inside_filter import Derivatives
from gcs_sysid.estimate.lacking import Lacking
from gcs_sysid.model import aided
from gcs_sysid.offline import aided_compatibility
from gcs_sysid.offline.flight import SERVO_STREAM, Flight
from gcs_sysid.reconstruct.compatibility import Estimate

DRIFTS: Mapping[str, tuple[str, int, str]] = {
    "gyro_drift": ("gyro_error", 0, "rad/s"),
    "airspeed_drift": ("airspeed_error", 0, "m/s"),
    "velocity_drift": ("velocity_error", 0, "m/s"),
    "attitude_drift": ("attitude_error", 0, "rad"),
    "heading_drift": ("attitude_error", 2, "rad"),
}
"""Sizes of errors that last: intensity, axis, and unit."""


def method(fits: Sequence[Fit], reason: str | None, *, refused: bool) -> dict[str, Any]:
    """Which method made the model, and how the search ended; why not the usual one.

    Where the filter was asked and its search `refused`, `converged` says so.
    """
    if not fits:
        status = {"converged": False} if refused else {}
        return {"name": "equation_error", "reason": reason, **status}
    return {
        "name": "filter_error",
        "reason": None,
        "converged": True,
        "log_likelihood": [fit.log_likelihood[-1] for fit in fits],
        "steps": [len(fit.log_likelihood) - 1 for fit in fits],
        "innovations": [_innovations(fit) for fit in fits],
    }


def lacking(terms: Sequence[Lacking]) -> list[dict[str, Any]]:
    """Terms that flights ask for, the surest first."""
    return [
        {
            "coefficient": one.coefficient,
            "regressor": one.key,
            "log_bayes_factor": one.evidence,
            "value": one.value,
            "sd": one.deviation,
            "share": one.share,
        }
        for one in terms
    ]


def _innovations(fit: Fit) -> dict[str, float]:
    """Mean square of the whitened innovations by sensor: 1 where the model tells everything."""
    out = {}
    for name, rows in aided.ROWS.items():
        white = fit.whitened[:, rows]
        seen = white[white != 0.0]
        if seen.size:
            out[name] = float(np.mean(seen**2))
    return out


def body(found: Derivatives | None, aircraft: Aircraft) -> dict[str, Any]:
    """Mass, inertia and thrust that were found with the aerodynamics; nothing if not sought.

    Args:
        found: by the filter, of all flights.
        aircraft: as its file describes it.
    """
    if found is None:
        return {}
    stated = aircraft.mass
    sizes = dict(mass=stated.mass, Ixx=stated.Ixx, Iyy=stated.Iyy, Izz=stated.Izz, thrust=1.0)
    units = {"mass": "kg", "thrust": "1"}
    sure = np.sqrt(np.diagonal(found.covariance))
    return {
        part: Estimate(
            sizes[part] * (1.0 + float(share)), sizes[part] * float(sd), units.get(part, "kg·m²")
        ).document()
        for (name, part), share, sd in zip(found.keys, found.value, sure, strict=True)
        if name == in_common.BODY
    }


def put_reconstruction(document: dict[str, Any], fit: Fit, flight: Flight) -> None:
    """Writes what only the filter finds: wind and gusts, lags, drifts, and what is level.

    Args:
        document: `reconstruction` of the summary, with the channels' errors and delays.
        fit: of the first flight.
        flight: the same flight.
    """
    document["wind_ned"] = _wind(fit)
    air, relative = fit.unknowns.log_noise.turbulence, fit.deviation.log_noise.turbulence
    # Of level gusts the mean along and across their field.
    for name, axes in (("", slice(0, 2)), ("_vertical", slice(2, 3))):
        for key, each, unit in (("gust_sd", "gust", "m/s"), ("gust_length", "gust_length", "m")):
            size = float(np.mean(np.exp(getattr(air, each)[axes])))
            share = float(np.sqrt(np.mean(np.asarray(getattr(relative, each)[axes]) ** 2)))
            document[key + name] = Estimate(size, size * share, unit).document()
    found, sure = fit.unknowns.means.sensors, fit.deviation.means.sensors
    sensors = document["sensor"]
    for index, axis in enumerate(("roll", "pitch")):
        sensors[f"attitude_{axis}_tilt"] = Estimate(
            float(found.attitude_tilt[index]), float(sure.attitude_tilt[index]), "rad"
        ).document()
    lag = flight.aircraft.pitot.error.lag + float(found.airspeed_lag)
    sensors["airspeed_lag"] = Estimate(lag, float(sure.airspeed_lag), "s").document()
    for name, entry in DRIFTS.items():
        sensors[name] = aided_compatibility.size(fit, *entry).document()
    stated = flight.aircraft.streams.get(SERVO_STREAM, StreamTiming()).delay
    document["delays"][SERVO_STREAM] = Estimate(
        stated + float(found.surface_delay), float(sure.surface_delay), "s"
    ).document()


def _wind(fit: Fit) -> dict[str, Any]:
    """Mean wind; its deviation takes in what is not known of the parameters."""
    wind, block = np.asarray(fit.states.air.wind), aided.BLOCKS["wind"]
    own = np.einsum("sii->si", np.asarray(fit.smoothed.covariance)[: len(wind), block, block])
    by = fit.moved[block]
    shared = np.einsum("ip,pq,iq->i", by, fit.parameters, by)
    return {
        "value": wind.mean(axis=0),
        "sd": np.sqrt(own.mean(axis=0) + shared),
        "unit": "m/s",
    }
