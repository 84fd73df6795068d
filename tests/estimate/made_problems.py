"""Regressions whose truth is known, with residuals as coloured as those of a flight."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from gcs_sysid.estimate import equation_error
from gcs_sysid.estimate.equation_error import Problem

STEP = 0.02
KEYS = ("1", "alpha", "qhat", "elevator")
TRUE = np.array([-0.03, -0.72, -13.6, -0.85])
SIZE = np.array([1.0, 0.05, 0.003, 0.04])
"""Standard deviations of the regressors."""


def coloured(generator: np.random.Generator, count: int, memory: float) -> np.ndarray:
    """A stationary first-order process of unit variance, correlation `memory` per sample."""
    white = generator.standard_normal(count)
    white[0] /= np.sqrt(1.0 - memory**2)
    return lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], white)


def columns(generator: np.random.Generator, count: int, *, memory: float = 0.97) -> np.ndarray:
    """Regressors that wander as slowly as an aircraft does."""
    moving = [coloured(generator, count, memory) for _ in KEYS[1:]]
    return np.stack([np.ones(count), *moving], axis=1) * SIZE


def problem(
    matrix: np.ndarray,
    measured: np.ndarray,
    *,
    keys: tuple[str, ...] = KEYS,
    noise: np.ndarray | float = 0.01,
    error: np.ndarray | None = None,
    systematic: np.ndarray | None = None,
    sigma: tuple[float, float] = (0.0, 0.0),
    piece: np.ndarray | None = None,
) -> Problem:
    """A regression as `equation_error.problem` would stack it; `error` is a variance by term."""
    count, terms = matrix.shape
    variance = np.zeros(terms) if error is None else error
    return Problem(
        keys=keys,
        columns=matrix,
        measured=measured,
        noise=np.broadcast_to(np.asarray(noise, dtype=float), (count,)).copy(),
        slopes=np.repeat(np.eye(terms)[:, None, :], count, axis=1),
        slope_variance=np.repeat(variance[:, None], count, axis=1),
        plausible=np.full(terms, np.inf),
        systematic=np.zeros((count, 2)) if systematic is None else systematic,
        systematic_sigma=np.array(sigma),
        piece=np.zeros(count, dtype=int) if piece is None else piece,
        step=STEP,
    )


def coverage(memory: float, *, seeds: range, count: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    """Share of 95 % intervals that hold the truth, by term: coloured, and as textbooks have it."""
    held, white = np.zeros(TRUE.size), np.zeros(TRUE.size)
    for seed in seeds:
        generator = np.random.default_rng(seed)
        matrix = columns(generator, count)
        measured = matrix @ TRUE + 0.01 * coloured(generator, count, memory)
        fit = equation_error.solve(problem(matrix, measured), None)
        error = np.abs(fit.value - TRUE)
        held += error < 1.96 * fit.deviations["noise"]
        white += error < 1.96 * fit.white_deviation
    return held / len(seeds), white / len(seeds)
