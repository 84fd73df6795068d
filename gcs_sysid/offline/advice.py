"""What a flight could not tell, why, what to fly next, and what to beware of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gcs_sysid import regressors
from gcs_sysid.aircraft import MOMENTS
from gcs_sysid.diagnose.investigation import GUSTY
from gcs_sysid.estimate.result import AeroModel, CoefficientFit
from gcs_sysid.estimate.verdict import COLLINEAR, LAGGING, collinear_with
from gcs_sysid.offline.flight import Flight

BLURRED = 0.5
"""An angle of attack known no better than this [°] blurs what depends on it."""
INPUT: Mapping[str, str] = {
    "alpha": "3-2-1-1 inputs and push-over/pull-ups on the pitch control at three airspeeds",
    "qhat": "short doublets on the pitch control, at a rate of at least 50 Hz",
    "beta": "rudder doublets and steady-heading sideslips to both sides",
    "phat": "aileron doublets of different length at two airspeeds",
    "rhat": "rudder doublets and coupled rolls at two airspeeds",
}


def cannot_tell(
    derivatives: Mapping[str, Mapping[str, Mapping[str, Any]]],
    refused: Mapping[str, str],
    controls: Sequence[str],
) -> list[dict[str, str]]:
    """What the flight left open, with the reason and a maneuver; refusals first.

    Derivatives with the same reason and remedy share an entry.
    """
    again = "record what is missing and fly the same again"
    found = [(name, reason, again) for name, reason in refused.items()]
    for answer in ("no", "weak"):
        found += [
            (f"{name}_{key}", entry["reason"], _maneuver(key, entry["reason"], controls))
            for name, terms in derivatives.items()
            for key, entry in terms.items()
            if entry["verdict"] == answer and key != regressors.CONSTANT
        ]
    alike: dict[tuple[str, str], list[str]] = {}
    for what, why, fly in found:
        alike.setdefault((why, fly), []).append(what)
    return [
        {"what": ", ".join(names), "why": why, "fly": fly} for (why, fly), names in alike.items()
    ]


def _maneuver(key: str, reason: str, controls: Sequence[str]) -> str:
    """A test that would determine the term."""
    if reason.startswith("gusts"):
        return "calm air, larger inputs added after the autopilot; flow vanes help the angles"
    if "mass, inertia or thrust" in reason:
        return "nothing: weigh the aircraft, swing it for its inertia, or measure its thrust"
    if reason == LAGGING:
        return "nothing: surface to motion is timed to a millisecond, which no flight betters"
    variables = regressors.parse(key, controls=controls).variables
    moved = [name for name in variables if name in controls]
    if moved:
        return f"multisine or 3-2-1-1 on the {' and '.join(moved)}, added after the autopilot"
    known = [INPUT[name] for name in variables if name in INPUT]
    return "; ".join(known) or f"a flight on which {key} varies"


def warnings(flights: Sequence[Flight], model: AeroModel) -> list[str]:
    """What limits the trust in these numbers."""
    out: list[str] = []
    for flight in flights:
        out += flight.warnings
        out += flight_warnings(flight)
    for name, fit in model.fits.items():
        out += _collinear(name, fit)
    return list(dict.fromkeys(out))


def gusty(flight: Flight) -> bool:
    """Whether gusts blur the flow angles of a flight."""
    states = flight.reconstruction
    return float(states.noise.gust[0]) > GUSTY * float(np.median(states.airspeed))


def flight_warnings(flight: Flight) -> list[str]:
    """What the flight itself limits, whatever the model."""
    out = []
    states = flight.reconstruction
    gust = float(states.noise.gust[0])
    source = flight.recording.source
    if "vanes" not in states.data.used and gusty(flight):
        angle = float(np.rad2deg(np.sqrt(np.median(states.flow_covariance[:, 1, 1]))))
        if angle > BLURRED:
            out.append(
                f"{source}: gusts of {gust:.1f} m/s (one sd) and no flow vanes: angle of attack is "
                f"known to {angle:.1f}° only, and every slope over it is pulled toward zero; its "
                "interval holds that"
            )
    if not flight.delay.found:
        out.append(
            f"{source}: the surfaces moved too little to tell their delay; "
            f"{1000.0 * flight.delay.value:.0f} ms is assumed"
        )
    if states.data.has_accelerometer is False:
        out.append(f"{source}: no accelerometer: forces are refused, moments only")
    return out


def _collinear(name: str, fit: CoefficientFit) -> list[str]:
    """Pairs of regressors that moved together."""
    out = []
    for index, key in enumerate(fit.keys):
        partner = collinear_with(fit, index)
        if partner is not None and fit.keys.index(partner[0]) > index:
            out.append(
                f"{name}: {key} and {partner[0]} moved together (correlation {partner[1]:+.2f}, "
                f"beyond {COLLINEAR}); their parts cannot be told apart on this flight"
            )
    kind = "moment" if name in MOMENTS else "force"
    if fit.effective_samples < 5.0 * len(fit.keys):
        out.append(
            f"{name}: only about {fit.effective_samples:.0f} independent samples for "
            f"{len(fit.keys)} terms of this {kind} coefficient"
        )
    return out
