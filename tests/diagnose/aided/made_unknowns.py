"""Made-up information about a handful of unknowns."""

from __future__ import annotations

import numpy as np

from gcs_sysid.diagnose.aided import unknowns
from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information, information

PARAMETERS = ("aerodynamics.CZ.alpha", "departures.mass", "departures.cg", "sensors.gyro_bias.0")
ORDINARY = np.array([0.5, 0.01, 0.002, 0.01])
QUANTITIES = {
    "mass": {"departures.mass": 1.0},
    "cg.x": {"departures.cg": 0.2},
    "airspeed": {"departures.mass": 0.5, "aerodynamics.CZ.alpha": 1.0},
}
USUAL = dict.fromkeys(QUANTITIES, 1e-4)
EVERY = tuple(Candidate(CAUSES[name]) for name in ("mass", "cg_shift", "airspeed_scale"))


def listed(flights: int = 1) -> unknowns.Unknowns:
    return unknowns.of_flights(
        PARAMETERS, ORDINARY, QUANTITIES, USUAL, {"": 1.0}, flights, np.zeros(ORDINARY.size)
    )


def told(truth: dict[str, float], *, alike: bool = False, clear: float = 30.0) -> Information:
    """What 300 rows of unit noise say of `listed()` where quantities have these sizes."""
    random = np.random.default_rng(11)
    columns = clear * random.standard_normal((300, len(PARAMETERS)))
    if alike:
        columns[:, 2] = 5.0 * columns[:, 1]
    every = listed()
    wide = columns @ np.concatenate([np.eye(len(PARAMETERS)), every.directions], axis=1)
    wrong = np.array([truth.get(name, 0.0) for name in every.names])
    return information(wide, wide @ wrong + random.standard_normal(300))
