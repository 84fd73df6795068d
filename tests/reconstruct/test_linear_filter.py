"""The linear filter against the joint Gaussian of a whole flight, solved densely."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from gcs_sysid.model.aided_linear import Linearised
from gcs_sysid.reconstruct import linear_filter
from gcs_sysid.reconstruct.linear_filter import Belief

STATES, ROWS, STEPS = 4, 3, 9
TIGHT = 1e-9
"""Two algebras for the same numbers, conditioned to about 1e3 in float64."""


def system(*, everything: bool = False) -> tuple[Belief, Linearised]:
    """A random system of which a third of the measurements is missing."""
    rng = np.random.default_rng(11)
    root = 0.3 * rng.standard_normal((STEPS, STATES, STATES))
    present = np.ones((STEPS, ROWS), bool) if everything else rng.random((STEPS, ROWS)) > 0.33
    rows = Linearised(
        transition=np.eye(STATES) + 0.2 * rng.standard_normal((STEPS, STATES, STATES)),
        offset=0.5 * rng.standard_normal((STEPS, STATES)),
        process=root @ np.swapaxes(root, 1, 2) + 0.01 * np.eye(STATES),
        sensitivity=np.where(present[:, :, None], rng.standard_normal((STEPS, ROWS, STATES)), 0.0),
        residual=np.where(present, rng.standard_normal((STEPS, ROWS)), 0.0),
        variance=np.where(present, rng.uniform(0.1, 0.5, (STEPS, ROWS)), 1.0),
        present=present,
    )
    spread = np.diag(rng.uniform(0.2, 1.0, STATES))
    start = Belief(jnp.asarray(rng.standard_normal(STATES)), jnp.asarray(spread))
    return start, jax.tree.map(jnp.asarray, rows)


def dense(start: Belief, rows: Linearised) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of all states, from the definition of the process."""
    mean, covariance = np.asarray(start.mean), np.asarray(start.covariance)
    means, blocks = [], {}
    for k in range(STEPS):
        step = np.asarray(rows.transition[k])
        mean = step @ mean + np.asarray(rows.offset[k])
        means.append(mean)
        for j in range(k):
            blocks[k, j] = step @ blocks[k - 1, j]
        covariance = step @ covariance @ step.T + np.asarray(rows.process[k])
        blocks[k, k] = covariance
    full = np.block(
        [[blocks[max(k, j), min(k, j)] if k >= j else blocks[j, k].T for j in range(STEPS)]
         for k in range(STEPS)]
    )  # fmt: skip
    return np.concatenate(means), full


def observed(rows: Linearised) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sensitivity, residual and noise variance of the rows that were measured."""
    present = np.asarray(rows.present).ravel()
    matrix = np.zeros((STEPS * ROWS, STEPS * STATES))
    for k in range(STEPS):
        matrix[k * ROWS : (k + 1) * ROWS, k * STATES : (k + 1) * STATES] = rows.sensitivity[k]
    residual, variance = np.asarray(rows.residual).ravel(), np.asarray(rows.variance).ravel()
    return matrix[present], residual[present], variance[present]


def test_the_likelihood_is_the_joint_density_of_all_measurements() -> None:
    start, rows = system()
    mean, covariance = dense(start, rows)
    matrix, residual, variance = observed(rows)
    wanted = multivariate_normal.logpdf(
        residual, matrix @ mean, matrix @ covariance @ matrix.T + np.diag(variance)
    )
    assert float(linear_filter.likelihood(start, rows)[1]) == pytest.approx(wanted, rel=TIGHT)


def test_the_smoother_is_the_conditional_of_the_joint_density() -> None:
    start, rows = system()
    mean, covariance = dense(start, rows)
    matrix, residual, variance = observed(rows)
    gain = np.linalg.solve(
        matrix @ covariance @ matrix.T + np.diag(variance), matrix @ covariance
    ).T
    wanted = mean + gain @ (residual - matrix @ mean)
    spread = covariance - gain @ matrix @ covariance
    end, done = linear_filter.run(start, rows)
    _, smoothed = linear_filter.smooth(end, start, rows, done)
    np.testing.assert_allclose(np.asarray(smoothed.mean).ravel(), wanted, atol=TIGHT)
    for k in range(STEPS):
        part = slice(k * STATES, (k + 1) * STATES)
        np.testing.assert_allclose(smoothed.covariance[k], spread[part, part], atol=TIGHT)


def test_the_adjoint_is_the_gradient_by_differences() -> None:
    start, rows = system()
    zero = jax.tree.map(jnp.zeros_like, start)
    _, done = linear_filter.run(start, rows)
    at_start, slope = linear_filter.adjoint(start, rows, done, zero)
    rng = np.random.default_rng(3)
    for name in ("transition", "offset", "process", "sensitivity", "residual", "variance"):
        draw = rng.standard_normal(getattr(rows, name).shape)
        along = jnp.asarray(draw + np.swapaxes(draw, 1, 2) if name == "process" else draw)

        def moved(by: float, name: str = name, along: jax.Array = along) -> float:
            changed = rows._replace(**{name: getattr(rows, name) + by * along})
            return float(linear_filter.likelihood(start, changed)[1])

        numeric = (moved(1e-6) - moved(-1e-6)) / 2e-6
        # Central differences of a value of about 50 in float64.
        exact = float(jnp.sum(getattr(slope, name) * along))
        assert exact == pytest.approx(numeric, rel=1e-6, abs=1e-6)
    draw = rng.standard_normal((STATES, STATES))
    along = Belief(jnp.asarray(rng.standard_normal(STATES)), jnp.asarray(draw + draw.T))

    def started(by: float) -> float:
        begun = jax.tree.map(lambda part, way: part + by * way, start, along)
        return float(linear_filter.likelihood(begun, rows)[1])

    numeric = (started(1e-6) - started(-1e-6)) / 2e-6
    exact = sum(float(jnp.sum(part)) for part in jax.tree.map(jnp.multiply, at_start, along))
    assert exact == pytest.approx(numeric, rel=1e-6, abs=1e-6)


def test_two_chunks_have_the_gradient_of_one() -> None:
    start, rows = system()
    zero = jax.tree.map(jnp.zeros_like, start)
    _, done = linear_filter.run(start, rows)
    _, whole = linear_filter.adjoint(start, rows, done, zero)
    first = jax.tree.map(lambda part: part[:4], rows)
    second = jax.tree.map(lambda part: part[4:], rows)
    middle, before = linear_filter.run(start, first)
    after = linear_filter.run(middle, second)[1]
    carried, late = linear_filter.adjoint(middle, second, after, zero)
    _, early = linear_filter.adjoint(start, first, before, carried)
    for one, parts in zip(whole, zip(early, late, strict=True), strict=True):
        np.testing.assert_allclose(one, np.concatenate(parts), atol=1e-10)


def test_innovations_and_their_covariance_change_with_all_matrices() -> None:
    start, rows = system()
    rng = np.random.default_rng(6)
    names = ("transition", "offset", "process", "sensitivity", "residual", "variance")
    moves = {name: rng.standard_normal(getattr(rows, name).shape) for name in names}
    moves["process"] = moves["process"] + np.swapaxes(moves["process"], 1, 2)
    present = np.asarray(rows.present)
    moves["sensitivity"] *= present[:, :, None]
    for name in ("residual", "variance"):
        moves[name] *= present

    def near(size: float) -> Linearised:
        return rows._replace(**{name: getattr(rows, name) + size * moves[name] for name in names})

    def expected(size: float) -> tuple[np.ndarray, np.ndarray]:
        done = linear_filter.run(start, near(size))[1]
        factor = np.linalg.inv(done.root)
        missed = np.einsum("kij,kj->ki", factor, done.whitened)
        return missed, factor @ np.swapaxes(factor, 1, 2)

    size = 1e-6
    root = np.asarray(linear_filter.run(start, rows)[1].root)
    (missed, spread), (before, less) = expected(size), expected(-size)
    still = jax.tree.map(lambda part: jnp.zeros((2, *part.shape)), start)
    done = linear_filter.run(start, rows)[1]
    _, both = linear_filter.changes(start, rows, done, (rows, near(size)), still)
    for part in jax.tree.leaves(both):
        np.testing.assert_array_equal(part[:, 0], 0.0)
    found = jax.tree.map(lambda part: part[:, 1], both)
    # Central differences of numbers of order one: good to 1e-16/1e-6 of the change.
    np.testing.assert_allclose(
        found.innovation,
        np.einsum("kij,kj->ki", root, missed - before) / 2.0,
        atol=1e-8 * size / 1e-6,
    )
    np.testing.assert_allclose(
        found.spread,
        root @ (spread - less) @ np.swapaxes(root, 1, 2) / 2.0,
        atol=1e-8 * size / 1e-6,
    )
