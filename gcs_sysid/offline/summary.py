"""`summary.json`: what was learned, how well it holds on maneuvers not fitted, what is unknown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid.aircraft import COEFFICIENTS, Aircraft
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.estimate.verdict import judge
from gcs_sysid.model.kinematics import MEASURED
from gcs_sysid.offline.flight import SERVO_STREAM, Flight
from gcs_sysid.reconstruct import cut, segment_file
from gcs_sysid.reconstruct.compatibility import Channel, Estimate
from gcs_sysid.reconstruct.reconstruction import GUST_TIME

SCHEMA = 1


def scores(
    table: Mapping[str, np.ndarray], rows: Bool[np.ndarray, " sample"], refused: Mapping[str, str]
) -> dict[str, dict[str, Any]]:
    """How well each coefficient is predicted on `rows`.

    `relative_error` is 100·RMS(predicted − measured)/std(measured) and takes in the noise of the
    measurement; `coverage95` and `nlpd` (nats a sample) use predicted and measured sd together.
    """
    out: dict[str, dict[str, Any]] = {}
    for name in COEFFICIENTS:
        if name in refused:
            out[name] = {"refused": refused[name], "samples": 0}
            continue
        measured = table[f"{name}_measured"][rows]
        error = table[name][rows] - measured
        out[name] = {
            **_score(
                error, measured, np.hypot(table[f"{name}_sd"], table[f"{name}_measured_sd"])[rows]
            ),
            "refused": None,
            "samples": int(rows.sum()),
        }
    return out


def _score(
    error: Float[np.ndarray, " sample"],
    measured: Float[np.ndarray, " sample"],
    deviation: Float[np.ndarray, " sample"],
) -> dict[str, float | None]:
    if error.size < 2:
        return dict.fromkeys(("relative_error", "coverage95", "nlpd", "r2"))
    spread = float(np.std(measured))
    ratio = error / deviation
    return {
        "relative_error": 100.0 * float(np.sqrt(np.mean(error**2))) / spread,
        "coverage95": float(np.mean(np.abs(ratio) < 1.959964)),
        "nlpd": float(np.mean(0.5 * ratio**2 + np.log(deviation) + 0.5 * np.log(2.0 * np.pi))),
        "r2": 1.0 - float(np.mean(error**2)) / spread**2,
    }


def derivatives(model: AeroModel, aircraft: Aircraft) -> dict[str, dict[str, dict[str, Any]]]:
    """Every term of every coefficient with its uncertainty by origin and a verdict."""
    out: dict[str, dict[str, dict[str, Any]]] = {}
    for name, fit in model.fits.items():
        believed = aircraft.aerodynamics[name].terms if name in aircraft.aerodynamics else {}
        entries = {}
        for index, key in enumerate(fit.keys):
            stated = believed.get(key)
            verdict = judge(fit, index, None if stated is None else stated.value)
            entries[key] = {
                "value": fit.value[index],
                "sd": fit.deviation[index],
                "flight_value": fit.flight_value[index],
                **{f"sd_{origin}": sd[index] for origin, sd in fit.deviations.items()},
                "sd_white": fit.white_deviation[index],
                "file": None if stated is None else stated.value,
                "file_sigma": None if stated is None else stated.sigma,
                "verdict": verdict.answer,
                "reason": verdict.reason,
            }
        out[name] = entries
    return out


def reconstruction(flight: Flight) -> dict[str, Any]:
    """Wind, gusts, sensor errors and delays of one flight."""
    states = flight.reconstruction
    channels = flight.compatibility.channels
    wind = states.block("wind")
    gust = float(states.noise.gust[0])
    duration = float(states.time[-1] - states.time[0])
    sensors: dict[str, Any] = {}
    for name, channel in channels.items():
        for part in ("bias", "scale"):
            estimate = getattr(channel, part)
            if estimate is not None:
                sensors[f"{name}_{part}"] = estimate.document()
    delays = {SERVO_STREAM: Estimate(flight.delay.value, flight.delay.deviation, "s").document()}
    for group in MEASURED:
        channel = channels.get(
            {"velocity": "velocity_north", "attitude": "roll"}.get(
                group, "alpha" if group == "vanes" else group
            )
        )
        if channel is not None and channel.delay is not None:
            delays[states.data.used[group]] = channel.delay.document()
    return {
        "wind_ned": {
            "value": wind.mean(axis=0),
            "sd": states.deviation("wind").mean(axis=0),
            "unit": "m/s",
        },
        # A process of correlation time τ has about T/2τ independent samples.
        "gust_sd": Estimate(gust, gust / np.sqrt(duration / GUST_TIME), "m/s").document(),
        "sensor": sensors,
        "delays": delays,
        "inertial_cut": cut.was_cut(flight.recording.streams[states.data.used["gyro"]]),
    }


def compatibility(flight: Flight) -> dict[str, Any]:
    """The sensors' verdicts, and by which filter."""
    return {
        "filter": flight.compatibility.filter,
        "verdict": flight.compatibility.verdict,
        "channels": {
            name: _channel(channel) for name, channel in flight.compatibility.channels.items()
        },
    }


def _channel(channel: Channel) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for part in ("bias", "scale", "delay", "lag"):
        estimate = getattr(channel, part)
        out[part] = None if estimate is None else estimate.value
        out[f"{part}_sd"] = None if estimate is None else estimate.deviation
    return {
        **out,
        "nis": channel.nis,
        "nis_band": None if channel.nis_band is None else list(channel.nis_band),
        "whiteness": channel.whiteness,
        "whiteness_limit": channel.whiteness_limit,
        "rms": channel.noise,
        "unit": channel.unit,
        "verdict": channel.verdict,
    }


def maneuvers(flights: Sequence[Flight], held_out: Sequence[int]) -> list[dict[str, Any]]:
    """All maneuvers, and which were held out."""
    return [
        {**entry, "flight": index, "held_out": entry["id"] in held_out}
        for index, flight in enumerate(flights)
        for entry in segment_file.entries(flight.segments, epoch_us=flight.recording.epoch_us)
    ]


def flights_document(flights: Sequence[Flight]) -> list[dict[str, Any]]:
    """Where the data came from."""
    return [
        {
            "source": flight.recording.source,
            "sha256": flight.recording.sha256,
            "vehicle": flight.recording.vehicle.system,
            "epoch_us": flight.recording.epoch_us,
            "duration_s": float(flight.samples.time[-1] - flight.samples.time[0]),
            "airborne_s": flight.airborne,
        }
        for flight in flights
    ]


def envelope(table: Mapping[str, np.ndarray], controls: Sequence[str]) -> dict[str, list[float]]:
    """Ranges covered (0.5 and 99.5 percentiles; SI, rad)."""
    names = ("V", "qbar", "alpha", "beta", "phat", "qhat", "rhat", "phi", "theta", *controls)
    used = table["maneuver"] >= 0
    return {name: np.percentile(table[name][used], [0.5, 99.5]).tolist() for name in names}


def trim(table: Mapping[str, np.ndarray], controls: Sequence[str]) -> dict[str, Any]:
    """Median of the quietest quarter of the flight: level, slow rates."""
    motion = np.abs(table["p"]) + np.abs(table["q"]) + np.abs(table["r"]) + np.abs(table["phi"])
    used = table["maneuver"] >= 0
    quiet = used & (motion <= np.quantile(motion[used], 0.25))
    return {
        **{name: float(np.median(table[name][quiet])) for name in ("V", "alpha", "beta", "theta")},
        "controls": {name: float(np.median(table[name][quiet])) for name in controls},
        "thrust_coefficient": float(np.median(table["thrust_coefficient"][quiet])),
    }


def limits(aircraft: Aircraft) -> dict[str, list[float]] | None:
    """The aircraft file's envelope, for drawing."""
    allowed = aircraft.envelope
    if allowed is None:
        return None
    return {
        "V": list(allowed.airspeed),
        "alpha": list(allowed.alpha),
        "beta": list(allowed.beta),
        "load_factor": list(allowed.load_factor),
        "phi": [-allowed.bank, allowed.bank],
    }


def header(command: str, aircraft: Aircraft, prior: str) -> dict[str, Any]:
    """What made the document."""
    return {
        "schema": SCHEMA,
        "program": f"gcs-sysid {version('gcs-sysid')}",
        "command": command,
        "aircraft": aircraft.name,
        "prior": prior,
    }
