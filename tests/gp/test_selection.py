"""The greedy choices against their definitions, worked out anew at every step."""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid.gp import dependent, selection
from tests.gp.test_dependent import made, points

COUNT, TAKEN = 24, 8
KERNEL = made(21, latents=1, outputs=2, inputs=2, tied=True)
CANDIDATES = points(22, COUNT, outputs=2, inputs=2)
NOISE = np.full(COUNT, 0.05)


@pytest.fixture(scope="module")
def matrix() -> np.ndarray:
    return np.asarray(dependent.covariance(KERNEL, CANDIDATES, CANDIDATES)) + np.diag(NOISE)


def left(matrix: np.ndarray, one: int, given: list[int]) -> float:
    if not given:
        return float(matrix[one, one])
    cross = matrix[one, given]
    return float(matrix[one, one] - cross @ np.linalg.solve(matrix[np.ix_(given, given)], cross))


def greedy(found: np.ndarray, gain: Callable[[int, list[int]], float]) -> None:
    """Each is worth as much as any other that was left; of equal ones either may be taken."""
    assert len(set(found.tolist())) == TAKEN
    for step, one in enumerate(found.tolist()):
        chosen = found[:step].tolist()
        gains = {other: gain(other, chosen) for other in set(range(COUNT)) - set(chosen)}
        assert gains[one] == pytest.approx(max(gains.values()), rel=1e-12)


def test_mutual_information_is_the_greedy_choice(matrix):
    def gain(one: int, chosen: list[int]) -> float:
        rest = [other for other in range(COUNT) if other != one and other not in chosen]
        return left(matrix, one, chosen) / left(matrix, one, rest)

    greedy(selection.mutual_information(KERNEL, CANDIDATES, NOISE, TAKEN), gain)


def test_entropy_is_the_greedy_choice(matrix):
    found = selection.entropy(KERNEL, CANDIDATES, NOISE, TAKEN)
    greedy(found, lambda one, chosen: left(matrix, one, chosen))


@pytest.mark.parametrize("method", ["mutual information", "entropy", "random", "k-means"])
def test_every_method_takes_different_candidates(method):
    found = selection.choose(method, KERNEL, CANDIDATES, NOISE, TAKEN, seed=1)
    assert len(set(found.tolist())) == TAKEN
    taken = selection.take(CANDIDATES, found)
    np.testing.assert_array_equal(np.asarray(taken.inputs), np.asarray(CANDIDATES.inputs)[found])


def test_more_than_there_are_is_all():
    assert sorted(selection.entropy(KERNEL, CANDIDATES, NOISE, 99).tolist()) == list(range(COUNT))


def test_a_point_of_another_output_can_tell_more():
    """Output 1 is output 0 almost noiseless: where both can be had, it is taken first."""
    twin = dependent.Kernel(
        jnp.ones((1, 2)), jnp.ones((1, 1, 1)), jnp.full(2, 1e-3), jnp.ones((2, 1))
    )
    inputs = jnp.repeat(jnp.linspace(-3.0, 3.0, 8)[:, None], 2, axis=0)
    both = dependent.Points(inputs, jnp.tile(jnp.arange(2), 8))
    noise = np.tile([0.5, 0.01], 8)
    found = selection.mutual_information(twin, both, noise, 4)
    assert np.all(np.asarray(both.output)[found] == 1)


def test_another_number_of_candidates_is_not_compiled_anew():
    def taken(count: int) -> int:
        fewer = selection.take(CANDIDATES, np.arange(count))
        selection.mutual_information(KERNEL, fewer, NOISE[:count], 3)
        return selection._covariance._cache_size()

    assert taken(COUNT) == taken(COUNT - 1) == taken(COUNT - 7)
