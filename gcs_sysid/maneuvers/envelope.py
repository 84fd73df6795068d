"""Whether a maneuver stays inside the envelope of the aircraft file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import Envelope
from gcs_sysid.maneuvers.flown import Flown

MARGIN = 0.1
"""Part of each range that is kept free at both ends for gusts and for what the model lacks."""
LIKELY = 0.02
"""No maneuver is suggested that leaves the envelope, margin included, more probably than this."""


@dataclass(frozen=True)
class Excursion:
    """Ranges of the mean aircraft, and the probability that any limit is broken."""

    ranges: dict[str, tuple[float, float]]
    violation_probability: float


def limits(allowed: Envelope) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of every limited quantity [m/s, rad, g, m]."""
    return {
        "airspeed": allowed.airspeed,
        "alpha": allowed.alpha,
        "beta": allowed.beta,
        "load_factor": allowed.load_factor,
        "bank": (-allowed.bank, allowed.bank),
        "height": (allowed.height_min, np.inf),
    }


def excursion(flown: Flown, allowed: Envelope) -> Excursion:
    """How far a maneuver goes, and how probably beyond a limit, margins kept.

    The probability is the share of drawn aircraft that break one, by the rule of succession: with
    none of n it is 1/(n + 2), since n draws cannot show less.
    """
    ranges, broken = {}, np.zeros(flown.alpha.shape[0], dtype=bool)
    for name, (low, high) in limits(allowed).items():
        values: Float[np.ndarray, "draw sample"] = getattr(flown, name)
        ranges[name] = (float(values[0].min()), float(values[0].max()))
        room = MARGIN * (high - low) if np.isfinite(high) else 0.0
        inside = (values >= low + room) & (values <= high - room)
        broken |= ~inside.all(axis=1)
    return Excursion(ranges, float((broken.sum() + 1.0) / (broken.size + 2.0)))
