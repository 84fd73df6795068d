"""Short-period flights with known truth: clean, and with gusts that no model knows."""

from __future__ import annotations

import itertools

import jax.numpy as jnp
import numpy as np
from scipy.signal import cont2discrete

from gcs_sysid.estimate.output_error import Model, Records, padded

NAMES = ("Z_alpha", "M_alpha", "M_q", "M_delta")
TRUE = np.array([-1.2, -6.0, -2.5, -9.0])
STEP = 0.02
NOISE = np.array([0.003, 0.006])
"""Standard deviation of alpha [rad] and q [rad/s] measured."""


def model() -> Model:
    def rate(value, state, inputs):
        alpha, q = state
        return jnp.stack(
            [value[0] * alpha + q, value[1] * alpha + value[2] * q + value[3] * inputs[0]]
        )

    return Model(rate, lambda value, state, inputs: state)


def elevator(seconds: float, amplitude: float = 0.05) -> np.ndarray:
    """A 3-2-1-1 of 0.4 s, twice, linear between samples."""
    time = np.arange(round(seconds / STEP) + 1) * STEP
    inside = np.mod(time - 1.0, 8.0)
    edges = np.cumsum([0.0, 1.2, 0.8, 0.4, 0.4])
    sign = np.select([(inside >= a) & (inside < b) for a, b in itertools.pairwise(edges)],
                     [1.0, -1.0, 1.0, -1.0], 0.0)  # fmt: skip
    return amplitude * np.where(time < 1.0, 0.0, sign)[:, None]


def flown(
    inputs: np.ndarray,
    start: np.ndarray,
    *,
    gust: np.ndarray | None = None,
    truth: np.ndarray = TRUE,
) -> np.ndarray:
    """States by the exact solution for inputs linear between samples; gust is an angle [rad].

    A gust is felt by the aerodynamics as an angle of attack, not seen by an inertial one.
    """
    z_alpha, m_alpha, m_q, m_delta = truth
    A = np.array([[z_alpha, 1.0], [m_alpha, m_q]])
    B = np.array([[0.0, z_alpha], [m_delta, m_alpha]])
    both = np.column_stack([inputs, np.zeros(len(inputs)) if gust is None else gust])
    advance, drive, _, carry, _ = cont2discrete((A, B, np.eye(2), np.zeros((2, 2))), STEP, "foh")
    # With a first-order hold x = ξ + D u, ξ moving by A and B.
    state = start - carry @ both[0]
    rows = []
    for row in both:
        rows.append(state + carry @ row)
        state = advance @ state + drive @ row
    return np.array(rows)


def dryden(generator: np.random.Generator, count: int, deviation: float, memory: float):
    """A first-order gust [rad] with a correlation time of `memory` seconds."""
    keep = np.exp(-STEP / memory)
    kicks = deviation * np.sqrt(1.0 - keep**2) * generator.standard_normal(count)
    gust = np.empty(count)
    gust[0] = deviation * generator.standard_normal()
    for index in range(1, count):
        gust[index] = keep * gust[index - 1] + kicks[index]
    return gust


def flights(
    seed: int,
    *,
    seconds: tuple[float, ...] = (20.0,),
    noise: float = 1.0,
    gust: float = 0.0,
    missing: float = 0.0,
) -> Records:
    """Maneuvers with measurement noise of `noise` times `NOISE`, and gusts of `gust` rad."""
    generator = np.random.default_rng(seed)
    inputs, measured, starts = [], [], []
    for index, length in enumerate(seconds):
        command = elevator(length, 0.05 * (-1.0) ** index)
        start = np.array([0.01, -0.02]) * (index + 1)
        blown = dryden(generator, len(command), gust, 0.6) if gust else None
        truth = flown(command, start, gust=blown)
        seen = truth + noise * NOISE * generator.standard_normal(truth.shape)
        seen[generator.random(truth.shape) < missing] = np.nan
        inputs.append(command)
        measured.append(seen)
        starts.append(np.zeros(2))
    return padded(inputs, measured, starts, STEP)
