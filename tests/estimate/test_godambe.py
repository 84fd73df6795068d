"""Scores and what they say: against normal scores written out, and a joint integral."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.estimate import godambe
from gcs_sysid.reconstruct.causal import Told

SURE = np.zeros((4, 4))
"""Precision where nothing is believed before."""


def scored(count: int = 4, *, seed: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Slope, scatter and one draw of the scores."""
    random = np.random.default_rng(seed)
    rows, other = random.standard_normal((2, 30, count))
    scatter = rows.T @ rows
    return (
        rows.T @ (rows + 0.3 * other),
        scatter,
        np.linalg.cholesky(scatter) @ random.normal(size=count),
    )


def test_of_the_likelihoods_own_slope_it_is_information_and_slope() -> None:
    _, scatter, score = scored()
    matrix, slope = godambe.quadratic(scatter, scatter, score, SURE)
    np.testing.assert_allclose(matrix, scatter)
    np.testing.assert_allclose(slope, score)


def test_its_greatest_is_where_the_scores_are_nothing_and_scatters_as_it_says() -> None:
    slope, scatter, _ = scored()
    random, found = np.random.default_rng(8), []
    for _ in range(4000):
        score = np.linalg.cholesky(scatter) @ random.normal(size=4)
        matrix, along = godambe.quadratic(slope, scatter, score, SURE)
        found.append(np.linalg.solve(matrix, along))
        np.testing.assert_allclose(score, slope @ found[-1])
    np.testing.assert_allclose(
        np.cov(np.array(found).T), np.linalg.inv(matrix), rtol=0.1, atol=1e-3
    )


def test_what_is_one_and_the_same_is_no_more_than_one() -> None:
    slope, scatter, score = scored()
    twice = np.eye(4)[:, [0, 1, 2, 3, 3]]
    matrix, along = godambe.quadratic(
        *(twice.T @ slope @ twice, twice.T @ scatter @ twice, twice.T @ score),
        np.zeros((5, 5)),
    )
    once = godambe.quadratic(slope, scatter, score, SURE)
    np.testing.assert_allclose(matrix, twice.T @ once[0] @ twice, atol=1e-6 * once[0].max())
    np.testing.assert_allclose(along, twice.T @ once[1], atol=1e-6 * np.abs(once[1]).max())


def test_an_error_in_how_scores_move_is_not_made_much_of() -> None:
    """A score that hardly scatters, and seems to be moved by what it knows nothing of."""
    scatter = np.diag([1e-9, 1.0, 400.0, 1.0])
    slope = scatter.copy()
    slope[0, 1] = 1e-3
    score = np.array([3e-5, 0.5, 30.0, 0.0])
    made_much, _ = godambe.quadratic(slope, scatter, score, SURE)
    assert made_much[1, 1] > 900.0
    matrix, along = godambe.quadratic(slope, scatter, score, np.eye(4))
    # All else is as it was, but for a hundredth of what was believed.
    np.testing.assert_allclose(np.diagonal(matrix)[1:], [1.0, 400.0, 1.0], rtol=0.011)
    np.testing.assert_allclose(along[1:], score[1:], rtol=0.011)


def test_nothing_measured_says_nothing() -> None:
    none = np.zeros((3, 3))
    matrix, along = godambe.quadratic(none, none, np.zeros(3), none)
    assert not matrix.any()
    assert not along.any()


def test_nuisances_are_integrated_out() -> None:
    """Mean and covariance of the parameters are those of the joint Gaussian's marginal."""
    _, joint, slope = scored(5)
    precision, pull = np.array([4.0, 0.5]), np.array([0.3, -1.0])
    matrix, score = godambe.integrated(joint, slope, precision, pull)
    joint[[3, 4], [3, 4]] += precision
    slope[3:] += pull
    np.testing.assert_allclose(np.linalg.inv(matrix), np.linalg.inv(joint)[:3, :3])
    np.testing.assert_allclose(np.linalg.solve(matrix, score), np.linalg.solve(joint, slope)[:3])


def test_what_a_flight_tells_nothing_of_has_its_place() -> None:
    found = godambe.placed(np.eye(2), np.array([1.0, 2.0]), np.array([True, False, True]), 7.0)
    np.testing.assert_allclose(found.matrix, np.diag([1.0, 0.0, 1.0]))
    np.testing.assert_allclose(found.score, [1.0, 0.0, 2.0])
    assert found.count == pytest.approx(7.0)


def test_a_further_parameter_loses_what_it_shares() -> None:
    """One that is a sum of others says what these say; one that shares nothing says it all."""
    random = np.random.default_rng(5)
    basis = np.linalg.qr(random.standard_normal((30, 5)))[0]
    rows, left = basis[:, :3] * [3.0, 1.0, 0.5], random.standard_normal(30)
    mixed = np.column_stack([rows, rows @ [1.0, -2.0, 0.5], 2.0 * basis[:, 3]])
    held = Told(mixed.T @ mixed, mixed.T @ left, 30.0)
    own = Told(0.2 * held.matrix[:3, :3], 0.1 * held.score[:3], 30.0)
    found = godambe.widened(own, held)
    views = np.array([1.0, -2.0, 0.5])
    np.testing.assert_allclose(found.matrix[:3, :3], own.matrix)
    np.testing.assert_allclose(found.matrix[3, :3], own.matrix @ views, atol=1e-9)
    assert found.matrix[3, 3] == pytest.approx(views @ own.matrix @ views)
    assert found.matrix[4, 4] == pytest.approx(4.0)
    np.testing.assert_allclose(found.matrix[4, :4], 0.0, atol=1e-9)
    np.testing.assert_allclose(found.score[3], own.score @ views)
    np.testing.assert_allclose(found.score[4], held.score[4])
