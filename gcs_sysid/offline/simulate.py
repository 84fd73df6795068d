"""`simulate`: the simulation flown on a flight's own controls, and where it departs from it."""

from __future__ import annotations

import time as clock
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from gcs_sysid.aircraft import COEFFICIENTS, Aircraft
from gcs_sysid.errors import RefusedError
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.model import aerodynamics
from gcs_sysid.offline import (
    advice,
    coherence,
    documents,
    flight,
    maneuver_choice,
    parquet_file,
    summary,
    tested,
    windows,
)
from gcs_sysid.offline import tolerances as allowed
from gcs_sysid.offline.flight import Flight, Progress
from gcs_sysid.offline.tolerances import Tolerances
from gcs_sysid.offline.windows import CHANNELS, UNITS, Simulated, Windows

EVERY = 2
"""One of so many steps of the integration is kept in the table."""


def run(
    log: Path,
    *,
    aircraft: Path | None,
    model: Path | None,
    vehicle: int | None,
    segments: Path | None,
    out: Path,
    progress: Progress,
    columns: Path | None = None,
    can: Path | None = None,
    tolerances: Path | None = None,
) -> dict[str, Any]:
    """Flies the simulation beside the flight; writes `simulate.json` and `simulated.parquet`.

    Args:
        log: a recorded flight.
        aircraft: aircraft file whose aerodynamics to test.
        model: identified model to test instead.
        vehicle: which vehicle of the log.
        segments: maneuvers to use.
        out: directory for the results.
        progress: told what is being done.
        columns: what the columns are where the log is a table.
        can: a CAN log of the same flight. Surfaces move as the simulation's servos make them, not
            as the bus measured them.
        tolerances: file with what is asked of each channel; None for the usual ones.

    Raises:
        InputError: the log or the simulation cannot be used.
        UsageError: no simulation is given, or two.
    """
    started = clock.perf_counter()
    under = tested.load(aircraft, model)
    limits = (
        allowed.usual(under.aircraft)
        if tolerances is None
        else allowed.read(tolerances, under.aircraft)
    )
    one = flight.read(
        log,
        under.aircraft,
        vehicle=vehicle,
        segments=maneuver_choice.chooser(segments, under.aircraft),
        delay=under.delay,
        progress=progress,
        columns=columns,
        can=can,
    )
    flown = flight.without_controls(under.aircraft, one.absent)
    progress("flying the simulation", 0.9)
    cut = windows.cut(one, flown)
    if cut.piece.size == 0:
        raise RefusedError(
            one.recording.source,
            f"no maneuver of {windows.LENGTH:.0f} s without a hole in the telemetry",
            fix="record at least that long without loss",
        )
    found = windows.fly(flown, cut)
    parquet_file.write(out / "simulated.parquet", _table(one, cut, found))
    document = {
        **summary.header("simulate", under.aircraft, "none"),
        "simulation": under.source,
        "flights": summary.flights_document([one]),
        "windows": {"count": int(cut.piece.size), "length_s": windows.LENGTH},
        "channels": channels(limits, cut, found),
        "theil_limit": limits.theil,
        "frequency": in_frequency(cut, found),
        "coefficients": coefficients(flown, one.samples, one.pieces()),
        "free_run": free_run(flown, windows.whole(one, flown)),
        "departures": departures(one, limits, cut, found),
        "maneuvers": summary.maneuvers([one], []),
        "reconstruction": summary.reconstruction(one),
        "compatibility": summary.compatibility(one),
        "warnings": [*one.warnings, *advice.flight_warnings(one)],
        "timing": {
            "read_s": one.read_seconds,
            "reconstruct_s": one.reconstruct_seconds,
            "total_s": clock.perf_counter() - started,
        },
    }
    documents.write_json(out / "simulate.json", document)
    return documents.plain(document)


def channels(limits: Tolerances, cut: Windows, found: Simulated) -> dict[str, dict[str, Any]]:
    """How well each channel is simulated: bias and rms of simulated less measured, Theil's U.

    A channel passes where its rms error is within its tolerance, or small against the motion.
    """
    document = {}
    for index, name in enumerate(CHANNELS):
        measured, simulated = cut.measured[..., index], found.value[..., index]
        scored, limit = agreement(measured, simulated), limits.channels[name]
        document[name] = {
            **scored,
            "pass": bool(scored["rms"] <= limit or scored["theil"] <= limits.theil),
            "tolerance": limit,
            "expected_sd": _rms(found.deviation[..., index]),
            "unit": UNITS.get(name, "rad"),
        }
    return document


def in_frequency(cut: Windows, found: Simulated) -> dict[str, dict[str, Any] | None]:
    """For each channel the frequencies at which it goes along with the measured one, and how."""
    return {
        name: coherence.response(cut.measured[..., index], found.value[..., index], windows.STEP)
        for index, name in enumerate(CHANNELS)
    }


def coefficients(
    aircraft: Aircraft, samples: Samples, piece: Int[np.ndarray, " sample"]
) -> dict[str, dict[str, Any]]:
    """The same of coefficients: of the file's less the measured, at the measured motion.

    Unlike the channels they do not gather: what is wrong stands where it acts. Theil's coefficient
    is of the changes about each maneuver's mean.

    Args:
        aircraft: the simulation.
        samples: of the flight.
        piece: maneuver of each sample, -1 for none.
    """
    flow = {key: jnp.asarray(values) for key, values in samples.regressors.items()}
    predicted = np.asarray(aerodynamics.of_aircraft(aircraft, flow))
    document = {}
    for column, name in enumerate(COEFFICIENTS):
        file, measured = predicted[:, column], samples.measured[name]
        good = (piece >= 0) & np.isfinite(measured) & np.isfinite(file)
        if name in samples.refused or not good.any():
            continue
        _, which = np.unique(piece[good], return_inverse=True)
        mean = np.bincount(which, weights=measured[good]) / np.bincount(which)
        one, other = measured[good][:, None], file[good][:, None]
        document[name] = agreement(one, other, since=mean[which][:, None])
    return document


def free_run(aircraft: Aircraft, whole: Windows) -> dict[str, Any]:
    """The same over whole maneuvers, each left alone from its beginning.

    A maneuver that the simulation cannot fly to its end is `lost`, and scored in none.
    """
    if whole.piece.size == 0:
        return {"count": 0, "lost": [], "longest_s": 0.0, "channels": {}}
    value = windows.fly_freely(aircraft, whole)
    seen = np.isfinite(whole.measured)
    ended = np.isfinite(np.where(seen, value, 0.0)).all(axis=(1, 2))
    return {
        "count": int(ended.sum()),
        "lost": whole.piece[~ended].tolist(),
        "longest_s": float(np.max(seen[..., 0].sum(axis=1), initial=0) * windows.STEP),
        "channels": {
            name: {
                **agreement(whole.measured[ended, :, index], value[ended, :, index]),
                "unit": UNITS.get(name, "rad"),
            }
            for index, name in enumerate(CHANNELS)
        }
        if ended.any()
        else {},
    }


def agreement(
    measured: Float[np.ndarray, "window sample"],
    simulated: Float[np.ndarray, "window sample"],
    *,
    since: Float[np.ndarray, "window 1"] | None = None,
) -> dict[str, Any]:
    """Bias and rms of simulated less measured, and Theil's coefficient with its parts.

    Args:
        measured: windows of one channel.
        simulated: likewise.
        since: what changes are reckoned from; None for the measured beginning of each window.
    """
    seen = np.isfinite(measured)
    error = (simulated - measured)[seen]
    return {
        "bias": float(np.mean(error)),
        "rms": _rms(error),
        "theil": theil(measured, simulated, since=since),
        "theil_parts": theil_parts(measured, simulated, since=since),
    }


def theil(
    measured: Float[np.ndarray, "window sample"],
    simulated: Float[np.ndarray, "window sample"],
    *,
    since: Float[np.ndarray, "window 1"] | None = None,
) -> float:
    """Theil's inequality coefficient, 0 for equal and 1 for opposite motions.

    Of the changes since the measured beginning of each window: with an airspeed's or a heading's
    mean in it any simulation would pass.
    """
    one, other = _changes(measured, simulated, since)
    size = _rms(one) + _rms(other)
    return _rms(other - one) / size if size > 0.0 else 0.0


def theil_parts(
    measured: Float[np.ndarray, "window sample"],
    simulated: Float[np.ndarray, "window sample"],
    *,
    since: Float[np.ndarray, "window 1"] | None = None,
) -> dict[str, float]:
    """Of what the mean square of the error is made; the parts add up to one.

    Another mean, another size, and another course (Jategaonkar, *Flight Vehicle System
    Identification*, 2nd ed. 2015, section 11.3.3): of a good simulation's error the last is most.
    """
    one, other = _changes(measured, simulated, since)
    total = float(np.mean((other - one) ** 2))
    if total == 0.0:
        return {"bias": 0.0, "variance": 0.0, "covariance": 0.0}
    bias = float(np.mean(other) - np.mean(one)) ** 2 / total
    variance = float(np.std(other) - np.std(one)) ** 2 / total
    return {"bias": bias, "variance": variance, "covariance": 1.0 - bias - variance}


def _changes(
    measured: Float[np.ndarray, "window sample"],
    simulated: Float[np.ndarray, "window sample"],
    since: Float[np.ndarray, "window 1"] | None,
) -> tuple[Float[np.ndarray, " seen"], Float[np.ndarray, " seen"]]:
    """Measured and simulated changes, where something was measured."""
    first, seen = measured[:, :1] if since is None else since, np.isfinite(measured)
    return (measured - first)[seen], (simulated - first)[seen]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def departures(
    one: Flight, limits: Tolerances, cut: Windows, found: Simulated
) -> list[dict[str, Any]]:
    """Windows in which a channel is out of tolerance, the largest in terms of it first.

    The time is when the error first leaves the tolerance, the size its largest in that window.
    """
    kinds = {segment.id: segment.kind for segment in one.segments}
    listed = []
    for window, piece in enumerate(cut.piece):
        for index, name in enumerate(CHANNELS):
            measured = cut.measured[window : window + 1, :, index]
            simulated = found.value[window : window + 1, :, index]
            error, limit = (simulated - measured)[0], limits.channels[name]
            if theil(measured, simulated) <= limits.theil or _rms(error) <= limit:
                continue
            first = int(np.argmax(np.abs(error) > limit))
            largest = float(error[np.argmax(np.abs(error))])
            listed.append(
                {
                    "t_us": int(one.recording.time_us(cut.time[window, first : first + 1])[0]),
                    "t_s": float(cut.time[window, first]),
                    "channel": name,
                    "size": largest,
                    "unit": UNITS.get(name, "rad"),
                    "tolerance": limit,
                    "region": _region(kinds[int(piece)], cut.measured[window]),
                    "maneuver": int(piece),
                }
            )
    return sorted(listed, key=lambda item: -abs(item["size"]) / item["tolerance"])


def _region(kind: str, measured: Float[np.ndarray, "sample channel"]) -> str:
    """Where in the envelope a window was flown, in words."""
    middle = np.median(measured, axis=0)
    value = dict(zip(CHANNELS, middle, strict=True))
    alpha, beta, bank = (round(float(np.degrees(value[name]))) for name in ("alpha", "beta", "phi"))
    return f"{kind} at {value['V']:.0f} m/s, alpha {alpha} deg, beta {beta} deg, bank {bank} deg"


def _table(one: Flight, cut: Windows, found: Simulated) -> dict[str, np.ndarray]:
    """One row a simulated instant: measured, simulated and its standard deviation."""
    time = cut.time[:, ::EVERY]
    table = {
        "time_us": one.recording.time_us(time.ravel()),
        "t": time.ravel(),
        "window": np.repeat(np.arange(time.shape[0]), time.shape[1]),
        "maneuver": np.repeat(cut.piece, time.shape[1]),
    }
    for index, name in enumerate(CHANNELS):
        table[f"{name}_measured"] = cut.measured[:, ::EVERY, index].ravel()
        table[name] = found.value[:, ::EVERY, index].ravel()
        table[f"{name}_sd"] = found.deviation[:, ::EVERY, index].ravel()
    return table
