"""Coloured noise: what is learned of it, and that its rows are worth what they are."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.diagnose import whitening
from gcs_sysid.diagnose.evidence import posterior
from gcs_sysid.diagnose.whitening import Blocks

MEMORY = 0.8
MIX = np.array([[1.0, 0.0], [0.6, 0.5]])


def coloured(seed: int, count: int = 3000, size: float = 0.0) -> Blocks:
    """First-order noise in two coefficients that share their innovations, and a known signature."""
    random = np.random.default_rng(seed)
    innovation = random.standard_normal((count, 2)) @ MIX.T
    noise = np.zeros((count, 2))
    for row in range(1, count):
        noise[row] = MEMORY * noise[row - 1] + innovation[row]
    slow = np.sin(2.0 * np.pi * np.arange(count) / 80.0)
    columns = np.stack([slow[:, None] * np.array([1.0, -0.5]), np.ones((count, 2))], axis=2)
    return Blocks(
        left=noise + size * columns[:, :, 0],
        measured=noise,
        columns=columns,
        run=np.repeat(np.arange(3), count // 3),
        piece=np.repeat(np.arange(6), count // 6),
    )


def test_the_colour_and_the_correlation_are_learned() -> None:
    noise = whitening.learn(coloured(1), np.array([1.0, 1.0]))
    np.testing.assert_allclose(noise.memory[0], MEMORY, atol=0.06)
    np.testing.assert_allclose(noise.memory[1:], 0.0, atol=0.1)
    np.testing.assert_allclose(noise.covariance, MIX @ MIX.T, atol=0.08)
    assert noise.inflation < 1.6


def test_intervals_hold_over_seeds() -> None:
    """A signature of size 0.5 in noise of memory 0.8: textbook errors would be three times small.

    Forty seeds; the mean square of the normalised error is χ²₄₀/40, within 0.5 and 1.6 for all but
    one in a hundred, a little lower because of the inflation.
    """
    ratios = []
    for seed in range(40):
        data = coloured(100 + seed, size=0.5)
        sigma = np.array([3.0, 3.0])
        noise = whitening.learn(data, sigma)
        found = posterior(whitening.gathered(data, noise), sigma)
        ratios.append((found.mean[0] - 0.5) / np.sqrt(found.covariance[0, 0]))
    assert 0.4 < float(np.mean(np.square(ratios))) < 1.6


def test_a_noisy_maneuver_counts_for_less() -> None:
    data = coloured(5)
    left = np.where((data.piece == 2)[:, None], 4.0 * data.left, data.left)
    noise = whitening.learn(
        Blocks(left, data.measured, data.columns, data.run, data.piece), np.array([1.0, 1.0])
    )
    assert noise.weight[2] < 0.5
    assert all(weight == 1.0 for piece, weight in noise.weight.items() if piece != 2)


def test_runs_do_not_see_across_their_ends() -> None:
    data = coloured(6, count=60)
    noise = whitening.Noise(np.full((whitening.ORDER, 2), 0.1), np.eye(2), {}, 1.0, np.ones(2))
    columns, left, pieces = whitening.whitened(data, noise)
    assert left.size == 2 * (60 - 3 * whitening.ORDER)
    assert columns.shape == (left.size, 2)
    assert pieces.size == left.size


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_evidence_does_not_depend_on_the_unit_of_a_coefficient(scale: float) -> None:
    data = coloured(7, size=0.3)
    other = Blocks(scale * data.left, data.measured, scale * data.columns, data.run, data.piece)
    sigma = np.array([1.0, 1.0])
    factors = []
    for blocks in (data, other):
        information = whitening.gathered(blocks, whitening.learn(blocks, sigma))
        free = posterior(information, sigma).log_evidence
        factors.append(free - posterior(information, np.array([0.0, 1.0])).log_evidence)
    assert factors[0] == pytest.approx(factors[1], rel=1e-6)
