"""One short flight for all tests of filter and smoother: every sensor, a gap, an outlier."""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gcs_sysid.model.kinematics import Levers, Measurements, Noise, State
from gcs_sysid.reconstruct import measurements, reconstruction, smoother
from gcs_sysid.reconstruct.smoother import Inputs, Smoothed
from tests.reconstruct import kinematic_flights

ROWS = 560
"""No multiple of any chunk used here."""
OUTLIER = 250
"""The velocity next after this row is wrong by 60 m/s."""


class Example(NamedTuple):
    state: State
    covariance: np.ndarray
    inputs: Inputs
    levers: Levers
    reference: np.ndarray
    noise: Noise

    def smooth(self) -> Smoothed:
        return smoother.smooth(*self)


@functools.cache
def example() -> Example:
    flight = kinematic_flights.flight(31, duration=12.0)
    aircraft = kinematic_flights.aircraft()
    data = measurements.select(flight.recording, aircraft, (-np.inf, np.inf))
    state, covariance = reconstruction.first_state(data, aircraft, 0)
    levers, reference = reconstruction.sensor_levers(aircraft)
    # A hole of 0.8 s in everything, as when the link drops.
    kept = np.delete(np.arange(data.time.size), slice(300, 340))[:ROWS]
    rows = jax.tree.map(lambda values: np.asarray(values)[kept], data.inputs())
    step = np.diff(data.time[kept], prepend=data.time[0])
    before = jax.tree.map(lambda values: values[np.maximum(np.arange(ROWS) - 1, 0)], rows.after)
    velocity = rows.measured.velocity.copy()
    wrong = OUTLIER + int(np.argmax(rows.measured.valid[OUTLIER:, 1]))
    velocity[wrong, 0] += 60.0
    inputs = Inputs(before, rows.after, step, rows.measured._replace(velocity=velocity))
    noise = jax.tree.map(
        lambda value: jnp.asarray(np.asarray(value)), reconstruction.first_noise(data)
    )
    return Example(state, covariance, inputs, levers, reference, noise)


@functools.cache
def smoothed() -> Smoothed:
    return example().smooth()


def row(inputs: Inputs, index: int) -> Inputs:
    return jax.tree.map(lambda values: jnp.asarray(np.asarray(values)[index]), inputs)


def with_measured(measured: Measurements, **values: np.ndarray) -> Measurements:
    return measured._replace(**{name: jnp.asarray(value) for name, value in values.items()})
