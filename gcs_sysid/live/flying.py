"""Whether the aircraft flies on its wing, as far as can be said without the future."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.atmosphere import SEA_LEVEL_DENSITY
from gcs_sysid.model.kinematics import GRAVITY
from gcs_sysid.reconstruct.airborne import LANDED, LIFT_OFF

BEGIN, END = 0.75, 0.55
"""Of the slowest airspeed: above the one a flight begins, below the other it ends (as in a log)."""
MOST_LIFT = 1.4
"""Lift coefficient at the slowest airspeed, for aircraft files without an envelope."""


def slowest(aircraft: Aircraft) -> float:
    """Slowest airspeed of the envelope, or the one at which the wing just carries [m/s]."""
    if aircraft.envelope is not None:
        return aircraft.envelope.airspeed[0]
    weight = aircraft.mass.mass * GRAVITY
    lifting = 0.5 * SEA_LEVEL_DENSITY * aircraft.geometry.wing_area * MOST_LIFT
    return float(np.sqrt(weight / lifting))


class FlyingWatch:
    """Says whether the aircraft flies; short spikes and short pushes do not change its mind.

    Args:
        aircraft: its envelope sets the speeds.
    """

    def __init__(self, aircraft: Aircraft) -> None:
        self._begin = BEGIN * slowest(aircraft)
        self._end = END * slowest(aircraft)
        self._since: float | None = None
        self.flying = False

    def fast_enough(self, airspeed: Float[np.ndarray, " sample"]) -> bool:
        """Whether none of these airspeeds [m/s] is one at which a flight ends."""
        return bool(np.min(airspeed) > self._end)

    def take(self, time: float, airspeed: float) -> bool:
        """Whether it flies, given the indicated airspeed [m/s] at a time [s]."""
        changing = airspeed < self._end if self.flying else airspeed > self._begin
        if not changing:
            self._since = None
        elif self._since is None:
            self._since = time
        elif time - self._since >= (LANDED if self.flying else LIFT_OFF):
            self.flying, self._since = not self.flying, None
        return self.flying
