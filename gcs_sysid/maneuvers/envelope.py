"""Whether a maneuver stays inside the envelope of the aircraft file, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import stats

from gcs_sysid.aircraft import Aircraft, Envelope
from gcs_sysid.maneuvers.flown import STEP, Flown

MARGIN = 0.05
"""Part of each range that is kept free at both ends, for what neither the model's own uncertainty
nor the gusts drawn hold: errors of form, of mass, of the airspeed sensor."""
LIKELY = 0.01
"""No maneuver is suggested that leaves the envelope, margin included, more probably than this."""
SURE = 0.95
"""How sure of that the number of flights tried must make one."""


class Limited(NamedTuple):
    """One limited quantity: its lowest and highest value, and the margin kept to each."""

    low: float
    high: float
    room: float


@dataclass(frozen=True)
class Excursion:
    """How far a maneuver goes.

    Attributes:
        ranges: of the mean aircraft in calm air.
        left: flights that left the envelope, margins kept.
        flights: tried, each with its own aircraft and gusts.
        first: the limit that most of these broke; None where none did.
    """

    ranges: dict[str, tuple[float, float]]
    left: int
    flights: int
    first: str | None

    @property
    def violation_probability(self) -> float:
        """Upper bound of the probability to leave the envelope, see `upper_bound`."""
        return upper_bound(self.left, self.flights)


def upper_bound(left: int, flights: int) -> float:
    """Probability that so few would leave by chance with 5 % only (Clopper & Pearson 1934)."""
    if left >= flights:
        return 1.0
    return float(stats.beta.ppf(SURE, left + 1, flights - left))


def allowed_to_leave(flights: int) -> int:
    """So many of these flights may leave, at most, for the bound to hold; −1 if none may."""
    count = -1
    while upper_bound(count + 1, flights) <= LIKELY:
        count += 1
    return count


def limits(allowed: Envelope) -> dict[str, Limited]:
    """Every limited quantity of the motion [m/s, rad, g, m]."""
    pairs = {
        "airspeed": allowed.airspeed,
        "alpha": allowed.alpha,
        "beta": allowed.beta,
        "load_factor": allowed.load_factor,
        "bank": (-allowed.bank, allowed.bank),
    }
    found = {name: Limited(*pair, MARGIN * (pair[1] - pair[0])) for name, pair in pairs.items()}
    # Heights are known to what the barometer knows; the aircraft is asked to begin higher anyway.
    return {**found, "height": Limited(allowed.height_min, np.inf, 0.0)}


def broken(
    flown: Flown, allowed: Envelope, aircraft: Aircraft
) -> dict[str, Bool[np.ndarray, " draw"]]:
    """Which flights break which limit, travel and rate of the surfaces included."""
    found: dict[str, np.ndarray] = {}
    for name, limit in limits(allowed).items():
        values: Float[np.ndarray, "draw sample"] = getattr(flown, name)
        outside = (values < limit.low + limit.room) | (values > limit.high - limit.room)
        found[name] = np.any(outside, axis=1)
    for index, servo in enumerate(aircraft.servos):
        asked = flown.commanded[:, :, index]
        low, high = min(servo.deflection), max(servo.deflection)
        found[f"travel of {servo.surface}"] = np.any((asked < low) | (asked > high), axis=1)
        if servo.rate_limit is not None:
            fast = np.abs(np.diff(asked, axis=1)) > servo.rate_limit * STEP * (1.0 + 1e-9)
            found[f"rate of {servo.surface}"] = np.any(fast, axis=1)
    return found


def ranges(flown: Flown, draw: int = 0) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of every limited quantity along one flight."""
    names = ("airspeed", "alpha", "beta", "load_factor", "bank", "height")
    return {
        name: (float(getattr(flown, name)[draw].min()), float(getattr(flown, name)[draw].max()))
        for name in names
    }


def most_broken(found: dict[str, Bool[np.ndarray, " draw"]]) -> str | None:
    """The limit that most flights break; None where none does."""
    worst = max(found, key=lambda name: int(found[name].sum()))
    return worst if found[worst].any() else None


def largest_inside(
    still: Flown, moved: Flown, allowed: Envelope, aircraft: Aircraft, shares: np.ndarray
) -> float:
    """The largest share of an input that should keep every flight inside; 0 where none does.

    Flights without the input and with all of it, in the same gusts, are interpolated.

    Args:
        still: without the input.
        moved: with it.
        allowed: the envelope.
        aircraft: whose surfaces have limits.
        shares: to choose from, increasing.
    """

    def inside(share: float) -> bool:
        found = broken(_between(still, moved, share), allowed, aircraft)
        return not any(which.any() for which in found.values())

    # A larger share goes further everywhere: bisection finds the last that stays inside.
    low, high = -1, shares.size
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if inside(float(shares[middle])) else (low, middle)
    return float(shares[low]) if low >= 0 else 0.0


def each_inside(
    still: Flown, moved: Flown, allowed: Envelope, aircraft: Aircraft, shares: np.ndarray
) -> dict[str, float]:
    """The largest of these shares at which all flights keep each limit; the first where none do.

    The arguments are those of `largest_inside`.
    """
    found: dict[str, float] = {}
    for share in shares[::-1]:
        for name, which in broken(_between(still, moved, share), allowed, aircraft).items():
            if not which.any():
                found.setdefault(name, float(share))
    return {name: found.get(name, float(shares[0])) for name in broken(still, allowed, aircraft)}


def _between(still: Flown, moved: Flown, share: float) -> Flown:
    """Flights without an input and with all of it, interpolated."""
    return Flown(*(one + share * (other - one) for one, other in zip(still, moved, strict=True)))
