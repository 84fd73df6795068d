"""Parameters by the likelihood, intensities integrated out: against the integral written out."""

from __future__ import annotations

import numpy as np

from gcs_sysid.estimate import settled_likelihood
from gcs_sysid.estimate.likelihood import Quadratic


def test_intensities_are_integrated_out() -> None:
    """Mean and covariance of the parameters are those of the joint Gaussian's marginal."""
    random = np.random.default_rng(4)
    rows = random.standard_normal((30, 5))
    part = Quadratic(rows.T @ rows, random.standard_normal(5))
    believed = Quadratic(np.diag([4.0, 0.5]), np.array([0.3, -1.0]))
    free = np.array([True, False, True, True])
    matrix, score = settled_likelihood._without_intensities(part, believed, free)
    joint, slope = part.information.copy(), part.score.copy()
    joint[3:, 3:] += believed.information
    slope[3:] += believed.score
    taken = np.ix_(free, free)
    np.testing.assert_allclose(np.linalg.inv(matrix[taken]), np.linalg.inv(joint)[:3, :3])
    np.testing.assert_allclose(
        np.linalg.solve(matrix[taken], score[free]), np.linalg.solve(joint, slope)[:3]
    )
    assert np.all(matrix[1] == 0.0)
    assert np.all(matrix[:, 1] == 0.0)
    assert score[1] == 0.0
