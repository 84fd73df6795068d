"""`live.json`: the newest of everything, as a plain document."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import metadata
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from gcs_sysid import frames
from gcs_sysid.live import advice, envelope_map, latency, processes
from gcs_sysid.live.causes import likely
from gcs_sysid.live.coefficients import KEPT
from gcs_sysid.live.filter import Estimate
from gcs_sysid.live.inside import FIRST_S
from gcs_sysid.live.regression import Solution, TermEstimate
from gcs_sysid.live.station import Station
from gcs_sysid.model.kinematics import BLOCKS

SCHEMA = 1
FRESH_S = 3.0
"""What the filter with the aerodynamics inside says is shown while it is no older [s]."""


class Outside(NamedTuple):
    """What a station does not know of itself: link and recording.

    Attributes:
        link: address that is listened to.
        phase: what is going on, in words.
        recorded: frames written to the recording.
        lost: what could not be used, counted by reason.
        now_us: the ground station's clock, from which ages count; None leaves them out.
        health: of the link: whether it is up, rates and ages of its messages, what was asked for.
    """

    link: str
    phase: str
    recorded: int = 0
    lost: Mapping[str, int] = MappingProxyType({})
    now_us: int | None = None
    health: Mapping[str, Any] = MappingProxyType({})


def document(station: Station, around: Outside) -> dict[str, Any]:
    """State, coefficients and derivatives with sd, latencies and counts."""
    newest, epoch = station.newest, station.rows.epoch_us
    solved = station.model.solutions()
    known = {name: one.terms() for name, one in solved.items()}
    alone = station.model.solutions(believing=False)
    taught = {name: one.terms() for name, one in alone.items()}
    learned = processes.document(station.processes, here(station))
    outside, now_us = bare(station, around), around.now_us
    within = inside(station, now_us)
    keeps_up = within["age_s"] is not None and within["age_s"] <= FRESH_S
    departures = station.departed_inside if keeps_up else station.departures
    return {
        **outside,
        "time_us": None
        if newest is None or epoch is None
        else epoch + round(newest.row.time * 1e6),
        "state_age_s": None
        if newest is None or now_us is None
        else round((now_us - newest.row.link_us) * 1e-6, 3),
        "inertial_delay_s": round(station.rows.inertial_delay, 5),
        "state": {} if newest is None else state(newest) | (within["state"] if keeps_up else {}),
        "coefficients": coefficients(station, now_us),
        "derivatives": within["derivatives"] if keeps_up else _told(known),
        "derivatives_by": "inside the filter" if keeps_up else "first model",
        "first_model": _told(known),
        "departures": {
            name: {
                "since_us": None if epoch is None else epoch + round(one.since * 1e6),
                "size": one.size,
                "deviations": one.deviations,
                "derivative": one.derivative,
            }
            for name, one in departures.told().items()
        },
        "causes": causes(station, station.inside.known.derivatives if keeps_up else alone)
        if newest is not None and departures.lately(newest.row.time)
        else [],
        "alarms": [*alarms(station, now_us), *outside["alarms"]],
        "maneuver": station.maneuvers.document(taught, epoch),
        "maneuvers": station.maneuvers.legs(epoch),
        "suggestions": advice.suggestions(station.aircraft, taught),
        "processes": learned,
        "inside": within,
        "map": known_where(station, solved),
        "latency": {
            "packet_to_update": station.latency.percentiles(),
            "update": station.effort.percentiles(),
        },
    }


def bare(station: Station, around: Outside) -> dict[str, Any]:
    """The same without anything that has to be computed; see `document`."""
    vehicle = station.decoder.vehicle
    return {
        "schema": SCHEMA,
        "program": f"gcs-sysid {metadata.version('gcs-sysid')}",
        "command": "listen",
        "link": around.link,
        "aircraft": station.aircraft.name,
        "vehicle": None if vehicle is None else vehicle.system,
        "other_vehicles": sorted(station.decoder.others),
        "phase": around.phase,
        "time_us": None,
        "written_us": around.now_us,
        "state_age_s": None,
        "inertial_delay_s": None,
        "health": dict(around.health),
        **{name: {} for name in ("state", "coefficients", "derivatives", "departures")},
        "derivatives_by": "first model",
        "first_model": {},
        "causes": [],
        "alarms": [
            {"kind": "failed", "what": one.what, "since_us": one.first_us, "words": one.words}
            for one in station.failures.told()
        ],
        "maneuver": None,
        "maneuvers": [],
        "suggestions": [],
        "processes": {
            "phase": station.processes.phase,
            "samples": 0,
            "wanted": processes.FIRST,
            "coefficients": {},
        },
        "inside": {"phase": station.inside.known.phase, "state": {}, "derivatives": {}},
        "map": None,
        "latency": {name: dict.fromkeys(latency.NAMES) for name in ("packet_to_update", "update")},
        "counts": {
            "received": station.decoder.received,
            "recorded": around.recorded,
            "updates": station.updates,
            "decimated": station.rows.decimated + station.skipped,
            "late": station.rows.late,
            "frozen": station.alarms.left_out,
            "reboots": station.decoder.clock.reboots,
            "restarts": station.filter.restarts,
            "failures": station.failures.count,
            "lost": dict(around.lost),
        },
    }


def state(estimate: Estimate) -> dict[str, dict[str, Any]]:
    """Flow, attitude, wind and rates with one standard deviation."""
    flow_sd = np.sqrt(np.diagonal(estimate.flow_covariance))
    euler = frames.euler_from_quaternion(estimate.attitude)
    # The error turns the body axes: at moderate angles its parts are those of roll, pitch, yaw.
    turn_sd = estimate.deviation[BLOCKS["attitude"]]
    wind = estimate.rest[BLOCKS["wind"]] + estimate.rest[BLOCKS["gust"]]
    wind_sd = np.hypot(estimate.deviation[BLOCKS["wind"]], estimate.deviation[BLOCKS["gust"]])
    rows = [
        *zip(("V", "alpha", "beta"), estimate.flow, flow_sd, ("m/s", "rad", "rad"), strict=True),
        *zip(("roll", "pitch", "yaw"), euler, turn_sd, ("rad",) * 3, strict=True),
        *zip(("wind_north", "wind_east", "wind_down"), wind, wind_sd, ("m/s",) * 3, strict=True),
    ]
    return {
        name: {"value": float(value), "sd": float(sd), "unit": unit}
        for name, value, sd, unit in rows
    }


def inside(station: Station, now_us: int | None) -> dict[str, Any]:
    """What the filter with the aerodynamics inside knows, and how old its state is."""
    known, epoch = station.inside.known, station.rows.epoch_us
    found, now = known.newest, _log_now(station, now_us)
    old = None if found is None or now is None else round(now - found.time, 3)
    return {
        "phase": known.phase,
        "collected_s": round(known.collected, 1),
        "wanted_s": FIRST_S,
        "lost": known.lost,
        "refused": known.refused,
        "excess": None if found is None else round(known.excess, 3),
        "time_us": None if found is None or epoch is None else epoch + round(found.time * 1e6),
        "age_s": old,
        "state": {}
        if found is None
        else {
            name: {"value": float(value), "sd": float(sd), "unit": unit}
            for name, value, sd, unit in zip(
                ("V", "alpha", "beta"),
                found.flow,
                found.deviation,
                ("m/s", "rad", "rad"),
                strict=True,
            )
        },
        "derivatives": _told({name: one.terms() for name, one in known.derivatives.items()}),
    }


def _told(
    derivatives: Mapping[str, Mapping[str, TermEstimate]],
) -> dict[str, dict[str, dict[str, float]]]:
    return {
        name: {key: {"value": term.value, "sd": term.deviation} for key, term in terms.items()}
        for name, terms in derivatives.items()
    }


def coefficients(station: Station, now_us: int | None) -> dict[str, dict[str, float]]:
    """Newest measured coefficients with one standard deviation, and how old they are."""
    samples, now = station.samples, _log_now(station, now_us)
    if samples is None:
        return {}
    row = KEPT.stop - 1
    age = (samples.time[-1] if now is None else now) - samples.time[row]
    return {
        name: {
            "value": float(values[row]),
            "sd": float(samples.noise[name][row]),
            "age_s": round(float(age), 3),
        }
        for name, values in samples.measured.items()
    }


def _log_now(station: Station, now_us: int | None) -> float | None:
    """The log's clock now [s after the epoch]: it goes on while nothing comes."""
    newest = station.newest
    if newest is None:
        return None
    waited = 0 if now_us is None else max(now_us - newest.row.link_us, 0)
    return newest.row.time + waited * 1e-6


def here(station: Station) -> Mapping[str, np.ndarray] | None:
    """Flow and deflections of the newest measured coefficients."""
    if station.samples is None:
        return None
    row = slice(KEPT.stop - 1, KEPT.stop)
    return {name: np.asarray(value)[row] for name, value in station.samples.regressors.items()}


def known_where(station: Station, solved: Mapping[str, Solution]) -> dict[str, Any]:
    """The confidence map: by the processes, before these know anything by the first model."""
    learned, now = station.processes, 0.0 if station.newest is None else station.newest.row.time
    if learned.phase != "known":
        first = envelope_map.of_first_model(solved, station.aircraft.control_names)
        return station.map.lately("first model", now, first)

    def deviation(places: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
        found = learned.at(places)
        return {} if found is None else found.lack

    return station.map.lately("processes", now, deviation)


def alarms(station: Station, now_us: int | None) -> list[dict[str, Any]]:
    """What is wrong with the data now, each with when it began on the log's clock."""
    epoch, now = station.rows.epoch_us, _log_now(station, now_us)
    return [
        {
            "kind": one.kind,
            "what": one.what,
            "since_us": None if epoch is None else epoch + round(one.since * 1e6),
            "words": one.words,
        }
        for one in station.alarms.told(flying=station.watch.flying, now=now)
    ]


def causes(station: Station, alone: Mapping[str, Solution]) -> list[dict[str, Any]]:
    """Likely causes of what departs, the likeliest first; `alone` is what the flight says.

    What the filter with the aerodynamics inside knows holds the file's values too: they pull toward
    the file, so that a cause shows later for it, and not more often for nothing.
    """
    found = likely(station.aircraft, alone)
    return [
        {
            "cause": one.suspect.cause,
            "about": one.suspect.about,
            "probability": round(one.probability, 3),
            "log_bayes_factor": round(one.log_bayes_factor, 1),
            "size": one.size,
            "sd": one.deviation,
            "unit": one.suspect.unit,
        }
        for one in found
    ]
