"""The update explains the last step and learns a quadratic."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from gcs_sysid.estimate import quasi_newton

RANDOM = np.random.default_rng(3)
ROOT = RANDOM.standard_normal((4, 4))
TRUE = ROOT @ ROOT.T + np.eye(4)


def test_the_last_step_is_explained_and_the_curvature_stays_positive() -> None:
    step = RANDOM.standard_normal(4)
    found = quasi_newton.updated(np.eye(4), step, TRUE @ step)
    np.testing.assert_allclose(found @ step, TRUE @ step)
    assert np.linalg.eigvalsh(found)[0] > 0.0


def test_conjugate_steps_learn_the_whole_of_a_quadratic() -> None:
    _, vectors = np.linalg.eigh(TRUE)
    found = np.eye(4)
    for step in vectors.T:
        found = quasi_newton.updated(found, step, TRUE @ step)
    np.testing.assert_allclose(found, TRUE, atol=1e-12)


def test_a_step_along_which_the_slope_fell_tells_nothing() -> None:
    step = RANDOM.standard_normal(4)
    np.testing.assert_array_equal(quasi_newton.updated(TRUE, step, -TRUE @ step), TRUE)


def test_a_damped_update_at_most_doubles_a_step() -> None:
    step = RANDOM.standard_normal(4)
    found = quasi_newton.updated(TRUE, step, 0.2 * TRUE @ step, least=0.5)
    assert step @ found @ step == pytest.approx(0.5 * step @ TRUE @ step)
    assert np.linalg.eigvalsh(found)[0] > 0.0
    np.testing.assert_allclose(
        quasi_newton.updated(TRUE, step, 0.7 * TRUE @ step, least=0.5) @ step, 0.7 * TRUE @ step
    )


def test_a_step_that_is_short_enough_is_newton_s() -> None:
    slope = RANDOM.standard_normal(4)
    found = quasi_newton.bounded(TRUE, slope, np.full(4, np.inf))
    np.testing.assert_allclose(found, np.linalg.solve(TRUE, slope), rtol=1e-12)


def test_parts_of_a_step_go_along_with_one_that_is_held() -> None:
    """Two parameters of which only the difference is seen well: cut alone it would be torn open."""
    curvature = np.array([[100.0, -99.0], [-99.0, 100.0]])
    slope = curvature @ np.array([3.0, 3.1])
    found = quasi_newton.bounded(curvature, slope, np.array([0.7, np.inf]))
    assert found[0] == pytest.approx(0.7)
    # Where the second one's own slope is gone.
    assert curvature[1] @ found == pytest.approx(slope[1])
    assert np.all(np.abs(quasi_newton.bounded(curvature, slope, np.full(2, 0.7))) <= 0.7 + 1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_a_bounded_step_is_the_best_one_there_is(seed: int) -> None:
    """Against SciPy's bounded least squares, with parts that are known as differences only."""
    random = np.random.default_rng(seed)
    root = random.standard_normal((30, 12)) * 10.0 ** random.uniform(-2.0, 1.0, 12)
    root[:, 1] = root[:, 0] + 0.01 * random.standard_normal(30)
    curvature = root.T @ root + 1e-3 * np.eye(12)
    slope = curvature @ random.standard_normal(12) * 3.0
    longest = np.where(np.arange(12) < 6, 0.7, np.inf)
    factor = np.linalg.cholesky(curvature)
    best = lsq_linear(factor.T, np.linalg.solve(factor, slope), (-longest, longest), tol=1e-14)
    found = quasi_newton.bounded(curvature, slope, longest)

    def gained(step: np.ndarray) -> float:
        return float(step @ slope - 0.5 * step @ curvature @ step)

    assert np.all(np.abs(found) <= longest + 1e-12)
    assert gained(found) == pytest.approx(gained(best.x), rel=1e-6)
    assert gained(found) > 0.0


def test_a_parameter_without_curvature_stays() -> None:
    """Also one that may go anywhere, and whatever its slope: the others are as without it."""
    curvature = np.array([[2.0, 0.0, 0.5], [0.0, 0.0, 0.0], [0.5, 0.0, 1.0]])
    slope, longest = np.array([1.0, 3.0, -1.0]), np.array([np.inf, np.inf, 0.4])
    others = np.ix_([0, 2], [0, 2])
    without = quasi_newton.bounded(curvature[others], slope[[0, 2]], longest[[0, 2]])
    step = quasi_newton.bounded(curvature, slope, longest)
    np.testing.assert_array_equal(step, [without[0], 0.0, without[1]])


def test_equations_that_are_no_gradient_are_corrected_by_what_steps_do() -> None:
    """Steps by a slope that is twice too flat along one direction swing for ever; corrected they
    end where the equations vanish."""
    true = np.array([[4.0, 1.0, 0.0], [0.0, 3.0, 0.5], [0.2, 0.0, 1.0]])
    believed = true.copy()
    believed[2, 2] = 0.45
    metric = np.diag([4.0, 3.0, 1.0])
    target = np.array([1.0, -2.0, 3.0])

    def ends(*, correcting: bool) -> float:
        matrix, place = believed, np.zeros(3)
        slope = true @ (target - place)
        for _ in range(8):
            step = np.linalg.solve(matrix, slope)
            if np.abs(step).max() < 1e-9:
                break
            place, foretold = place + step, slope - matrix @ step
            slope = true @ (target - place)
            if correcting:
                matrix = quasi_newton.corrected(matrix, step, slope - foretold, metric)
        return float(np.abs(place - target).max())

    assert ends(correcting=False) > 1.0
    assert ends(correcting=True) < 1e-6


def test_a_correction_explains_the_last_step_and_leaves_what_is_across_it() -> None:
    generator = np.random.default_rng(0)
    matrix, root = generator.standard_normal((2, 4, 4))
    metric = root @ root.T + np.eye(4)
    step, left = generator.standard_normal((2, 4))
    found = quasi_newton.corrected(matrix, step, left, metric)
    np.testing.assert_allclose(found @ step, matrix @ step - left)
    across = np.linalg.solve(metric, np.linalg.qr(np.outer(metric @ step, np.ones(4)))[0][:, 1])
    across -= step * (across @ metric @ step) / (step @ metric @ step)
    np.testing.assert_allclose(found @ across, matrix @ across, atol=1e-12)
