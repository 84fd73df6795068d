"""Where to look first when a search of causes has found no rest.

A simulation can be so far from a flight that with no set of causes the filter follows it. Where
the search began, near the aircraft file and on the busiest stretch, what had to be off by more than
it ordinarily is says where to look. That is no finding: nothing that took no part speaks for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gcs_sysid.errors import RefusedError
from gcs_sysid.estimate.settling import Beliefs, Settled

UNUSUAL = 3.0
"""Of the deviations that are ordinary: what is off by more stands out."""
UNITS = {
    "gyro_bias": "rad/s",
    "accelerometer_bias": "m/s²",
    "vane_bias": "rad",
    "surface_delay": "s",
    "moment_lag": "s",
    "airspeed_delay": "s",
    "velocity_delay": "s",
    "attitude_delay": "s",
    "vane_delay": "s",
    "airspeed_lag": "s",
    "attitude_tilt": "rad",
    "cg": "m",
    "offset": "rad",
    "imu_position": "m",
    "imu_tilt": "rad",
    "heading": "rad",
    "shear": "1/s",
}
"""Of parameters of sensors and departures; all others of these are shares."""


class Lead(NamedTuple):
    """A parameter of the model that stands out.

    Attributes:
        name: of the parameter.
        off: by how much it is off of what was believed.
        ordinary: one deviation of what was believed.
        unit: of both.
    """

    name: str
    off: float
    ordinary: float
    unit: str


class RestlessError(RefusedError):
    """Raised when no set of causes lets the filter follow a simulation.

    Args:
        where: the flight.
        leads: what stood out where the search began, the farthest first.
    """

    def __init__(self, where: str, leads: Sequence[Lead]) -> None:
        super().__init__(
            where,
            "the simulation's own model found no rest inside the filter",
            fix="check the aircraft file; air that shakes the aircraft within the time that its "
            "inertial unit filters over can do it too: fly in calmer air",
        )
        self.leads = tuple(leads)


def standing_out(names: Sequence[str], before: Beliefs, done: Settled) -> list[Lead]:
    """What is off by more than it ordinarily is, the farthest first; nothing without rest.

    Args:
        names: of the model's parameters.
        before: what is believed of them.
        done: where the flight settled.
    """
    if done.restless:
        return []
    usual = np.sqrt(np.diagonal(before.covariance))
    leads = [
        Lead(name, float(off), float(sigma), _unit(name))
        for name, off, sigma in zip(names, done.values - before.mean, usual, strict=True)
        if abs(off) > UNUSUAL * sigma > 0.0
    ]
    return sorted(leads, key=lambda one: -abs(one.off) / one.ordinary)


def _unit(name: str) -> str:
    """Of `sensors.surface_delay`, `departures.offset.0`; "1" is a share, a derivative has none."""
    kind, root, *_ = name.split(".")
    return UNITS.get(root, "1") if kind in ("sensors", "departures") else ""
