"""A step by blocks is the step of the full matrices, with the intensities' own structure."""

from __future__ import annotations

import jax
import numpy as np
import scipy.linalg

from gcs_sysid.model import aided_linear, aided_step
from gcs_sysid.model.aided import BLOCKS, MOVING, SIZE
from tests.model.made_aided import NOISE, SPEED, row

LENGTH = 0.02


def passing() -> np.ndarray:
    found = np.ones(SIZE)
    found[BLOCKS["gust"].start : BLOCKS["memory"].stop] = SPEED
    return found


def jacobian() -> np.ndarray:
    """All of it: a motion that feels everything, and what the intensities say of the rest."""
    rates = np.zeros((SIZE, SIZE))
    rates[:MOVING] = np.random.default_rng(8).standard_normal((MOVING, SIZE))
    rates[:MOVING, :MOVING] -= 10.0 * np.eye(MOVING)
    rates[MOVING:, MOVING:] = passing()[MOVING:, None] * np.asarray(aided_linear.decay(NOISE))
    return rates


def test_a_step_is_the_exponential_to_the_fourth_order() -> None:
    decay, rates = aided_linear.decay(NOISE), jacobian()

    @jax.jit
    def stepped(length: float) -> jax.Array:
        sample = row(0.0)._replace(step=length)
        return aided_step.whole(aided_step.half(rates[:MOVING], decay, sample))

    coarse, fine = (
        np.abs(np.asarray(stepped(length)) - scipy.linalg.expm(length * rates)).max()
        for length in (2.0 * LENGTH, LENGTH)
    )
    assert fine < 1e-6
    assert np.log2(coarse / fine) > 4.7


def test_the_noise_is_simpsons_rule_with_the_full_matrices() -> None:
    sample, driving = row(LENGTH), aided_linear.driving(NOISE)
    half = aided_step.half(jacobian()[:MOVING], aided_linear.decay(NOISE), sample)
    found = aided_step.process(half, sample, driving)
    full = 0.5 * LENGTH * jacobian()
    through = sum(np.linalg.matrix_power(full, n) / scipy.special.factorial(n) for n in range(5))
    late = passing()[:, None] * np.asarray(driving)
    middle = through @ late @ through.T
    early = through @ middle @ through.T
    expected = LENGTH / 6.0 * (late + 4.0 * middle + early)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14 * np.abs(expected).max())
