"""Slopes of the estimating equations against differences of the equations themselves."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid.estimate import sandwich
from gcs_sysid.estimate.sandwich import Slopes
from gcs_sysid.reconstruct import aided_smoother, causal
from tests.estimate import made_flight as made

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _short_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    # Two chunks, so that what is carried from one to the next counts.
    monkeypatch.setattr(aided_smoother, "CHUNK", made.COUNT // 2)


def test_slopes_have_the_sensitivities_of_the_innovations_gains_and_all() -> None:
    """Jᵀ S⁻¹ T, T by running the filter again with a parameter and an intensity moved."""
    flight, known = made.made_flight(), made.unknowns(1.0)
    flat, unravel = ravel_pytree(known.means)
    logs, unravel_logs = ravel_pytree(known.log_noise)
    path = causal.along(flight.rows, flight.nominal, flight.beginning)
    for _ in range(3):
        path, _, _ = causal.filtered(path, causal.joined(made.MODEL, *known, path))
    free = np.zeros(flat.size, dtype=bool), np.zeros(logs.size, dtype=bool)
    free[0][:8] = True
    free[1][0] = True
    every = np.ones(made.COUNT, dtype=bool)
    sizes = np.full(flat.size, 1e-3)
    found = sandwich.slopes(made.MODEL, *known, path, every, free, sizes, free[0])

    def whitened(values: jnp.ndarray, noises: jnp.ndarray) -> np.ndarray:
        """Innovations over the root of their covariance at the truth."""
        rows = causal.joined(made.MODEL, unravel(values), unravel_logs(noises), path)
        _, _, steps = causal.filtered(path, rows)
        out = []
        for done, base in zip(steps, here, strict=True):
            factor = np.linalg.inv(np.asarray(done.root))
            raw = np.einsum("kij,kj->ki", factor, done.whitened)
            out.append(np.einsum("kij,kj->ki", base.root, raw))
        return np.concatenate(out)

    rows = causal.joined(made.MODEL, *known, path)
    _, _, here = causal.filtered(path, rows)
    held = causal.Carried(made.MODEL, *known, np.arange(8))
    white = np.concatenate(
        [held.chunk(*item) for item in zip(path.chunks, rows, here, strict=True)]
    )
    step = 1e-5
    for place, (values, noises) in enumerate(
        [(flat.at[index].add(step), logs) for index in range(8)] + [(flat, logs.at[0].add(step))]
    ):
        total = (whitened(values, noises) - whitened(flat, logs)) / step
        expected = np.einsum("krp,kr->p", white, total)
        size = np.sqrt(np.diagonal(found.scatter)[:8] * np.sum(total**2))
        np.testing.assert_allclose(found.slope[:8, place] / size, expected / size, atol=2e-3)


def test_without_gains_of_their_own_the_covariance_is_that_of_the_information() -> None:
    matrix = np.array([[4.0, 1.0], [1.0, 2.0]])
    prior = np.diag([1.0, 0.5])
    found = sandwich.covariance(Slopes(matrix, matrix), prior, 2.0)
    np.testing.assert_allclose(found, np.linalg.inv(matrix / 2.0 + prior))


def test_what_moves_the_equations_less_is_known_less() -> None:
    found = sandwich.covariance(Slopes(np.diag([2.0]), np.diag([4.0])), np.zeros((1, 1)), 1.0)
    np.testing.assert_allclose(found, [[1.0]])
