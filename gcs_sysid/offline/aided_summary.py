"""What `summary.json` tells of a fit inside the filter: the search, the air, the sensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gcs_sysid.aircraft import Aircraft, StreamTiming
from gcs_sysid.estimate import in_common
from gcs_sysid.estimate.filter_error import Fit
from gcs_sysid.estimate.lacking import Lacking
from gcs_sysid.model import aided
from gcs_sysid.offline.flight import SERVO_STREAM, Flight
from gcs_sysid.reconstruct.compatibility import Estimate

DELAYS = ("airspeed", "velocity", "attitude", "vanes")


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


def body(fits: Sequence[Fit], aircraft: Aircraft) -> dict[str, Any]:
    """Mass, inertia and thrust that were found with the aerodynamics; nothing if not sought.

    Args:
        fits: one a flight, the last one knowing what the others told.
        aircraft: as its file describes it.
    """
    if not fits:
        return {}
    last, stated = fits[-1], aircraft.mass
    rows = [row for row, (name, _) in enumerate(last.keys) if name == in_common.BODY]
    by = in_common.values(last.unknowns.means)[rows]
    sure = np.sqrt(np.diagonal(last.covariance)[rows])
    sizes = dict(mass=stated.mass, Ixx=stated.Ixx, Iyy=stated.Iyy, Izz=stated.Izz, thrust=1.0)
    units = {"mass": "kg", "thrust": "1"}
    return {
        part: Estimate(
            sizes[part] * (1.0 + float(share)), sizes[part] * float(sd), units.get(part, "kg·m²")
        ).document()
        for (_, part), share, sd in zip((last.keys[row] for row in rows), by, sure, strict=True)
    }


def put_reconstruction(document: dict[str, Any], fit: Fit, flight: Flight) -> None:
    """Writes wind, gusts, sensor errors and delays that the filter found over the kinematic ones.

    Args:
        document: `reconstruction` of the summary.
        fit: of the first flight.
        flight: the same flight.
    """
    wind = np.asarray(fit.states.air.wind)
    covariance = np.asarray(fit.smoothed.covariance)[: len(wind), aided.BLOCKS["wind"]]
    spread = np.sqrt(np.einsum("sii->si", covariance[:, :, aided.BLOCKS["wind"]]))
    document["wind_ned"] = {
        "value": wind.mean(axis=0),
        "sd": spread.mean(axis=0),
        "unit": "m/s",
    }
    air, relative = fit.unknowns.log_noise.turbulence, fit.deviation.log_noise.turbulence
    # Of level gusts the mean along and across their field.
    for name, axes in (("", slice(0, 2)), ("_vertical", slice(2, 3))):
        for key, each, unit in (("gust_sd", "gust", "m/s"), ("gust_length", "gust_length", "m")):
            size = float(np.mean(np.exp(getattr(air, each)[axes])))
            share = float(np.sqrt(np.mean(np.asarray(getattr(relative, each)[axes]) ** 2)))
            document[key + name] = Estimate(size, size * share, unit).document()
    sensors, sure = fit.unknowns.means.sensors, fit.deviation.means.sensors
    for index, axis in enumerate("xyz"):
        for sensor, unit in (("gyro", "rad/s"), ("accelerometer", "m/s²")):
            document["sensor"][f"{sensor}_{axis}_bias"] = Estimate(
                float(getattr(sensors, f"{sensor}_bias")[index]),
                float(getattr(sure, f"{sensor}_bias")[index]),
                unit,
            ).document()
    noise, doubt = fit.unknowns.log_noise.gyro_error, fit.deviation.log_noise.gyro_error
    drift = float(np.exp(noise))
    document["sensor"]["gyro_drift"] = Estimate(drift, drift * float(doubt), "rad/s").document()
    document["sensor"]["airspeed_scale"] = Estimate(
        float(sensors.airspeed_scale), float(sure.airspeed_scale), "1"
    ).document()
    for index, axis in enumerate(("roll", "pitch")):
        document["sensor"][f"attitude_{axis}_tilt"] = Estimate(
            float(sensors.attitude_tilt[index]), float(sure.attitude_tilt[index]), "rad"
        ).document()
    lag = flight.aircraft.pitot.error.lag + float(sensors.airspeed_lag)
    document["sensor"]["airspeed_lag"] = Estimate(lag, float(sure.airspeed_lag), "s").document()
    used = flight.reconstruction.data.used
    for index, name in enumerate(("alpha", "beta")):
        if "vanes" in used:
            for part, unit in (("bias", "rad"), ("scale", "1")):
                document["sensor"][f"{name}_{part}"] = Estimate(
                    float(getattr(sensors, f"vane_{part}")[index]),
                    float(getattr(sure, f"vane_{part}")[index]),
                    unit,
                ).document()
    stated = flight.aircraft.streams.get(SERVO_STREAM, StreamTiming()).delay
    document["delays"][SERVO_STREAM] = Estimate(
        stated + float(sensors.surface_delay), float(sure.surface_delay), "s"
    ).document()
    for name in DELAYS:
        field = "vane_delay" if name == "vanes" else f"{name}_delay"
        if name in used:
            document["delays"][used[name]] = Estimate(
                float(getattr(sensors, field)), float(getattr(sure, field)), "s"
            ).document()
