"""What a filter has to go by in made-up flights."""

from __future__ import annotations

import jax
import numpy as np

from gcs_sysid.estimate.innovation_spectrum import Sensing
from gcs_sysid.model.aided import Sensors
from tests.estimate import made_flight

STEP = 0.02
EVERY = (5, 10, 2)
"""Rows from one airspeed, velocity and attitude to the next."""


def sensing(*, vanes: bool = False) -> Sensing:
    """Streams of their own, gusts of 0.3 m/s."""
    noise = jax.tree.map(np.asarray, made_flight.unknowns(1.0).log_noise)
    zero, pair = np.zeros(()), np.zeros(2)
    deviation = Sensors(
        *(np.full(3, 1e-3), np.full(3, 0.01), np.asarray(0.005), zero),
        *(np.full(2, 0.01), np.full(2, 0.03), np.asarray(0.002), *[zero] * 5, pair),
    )
    shares = np.array([*(1.0 / one for one in EVERY), 0.5 if vanes else 0.0])
    return Sensing(STEP, shares, noise, deviation)
