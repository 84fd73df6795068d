"""Where to fly: headings and heights that lead to places, in metres north and east of home."""

from __future__ import annotations

import math
from dataclasses import dataclass

EARTH_RADIUS = 6371000.0
"""Mean radius [m] (IUGG); over a few kilometres its error is that of a scale, below 0.4 %."""


@dataclass(frozen=True)
class Place:
    """A point: north and east of home, above home [m]."""

    north: float
    east: float
    height: float


@dataclass(frozen=True)
class Home:
    """Where places are measured from: latitude, longitude [rad], height above sea level [m]."""

    latitude: float
    longitude: float
    elevation: float

    def place(self, latitude: float, longitude: float, height: float) -> Place:
        """A position [rad, m above home] as a place."""
        return Place(
            EARTH_RADIUS * (latitude - self.latitude),
            EARTH_RADIUS * math.cos(self.latitude) * (longitude - self.longitude),
            height,
        )


def distance(here: Place, there: Place) -> float:
    """Horizontal distance [m]."""
    return math.hypot(there.north - here.north, there.east - here.east)


def bearing(here: Place, there: Place) -> float:
    """Course from here to there [rad]."""
    return math.atan2(there.east - here.east, there.north - here.north)


def around(here: Place, centre: Place, radius: float, *, lead: float) -> float:
    """Course that leads onto a circle and along it, clockwise for a positive radius [rad].

    Far away it points to the centre, on the circle along it, inside it outwards.

    Args:
        here: present place.
        centre: of the circle.
        radius: of the circle [m]; negative turns left.
        lead: angle by which a follower stays behind a course that turns [rad].
    """
    size, side = abs(radius), math.copysign(1.0, radius)
    outside = (distance(here, centre) - size) / size
    # A quarter turn to the centre one radius off the circle.
    inwards = min(max(outside, -1.0), 1.0) * 0.5 * math.pi
    return bearing(here, centre) - side * (0.5 * math.pi - inwards) + side * lead
