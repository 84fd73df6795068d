"""The local part: its covariance, its neighbours, and what it foretells."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.gp import local
from gcs_sysid.gp.samples import Rows


def made_store(seed: int, count: int) -> local.Store:
    random = np.random.default_rng(seed)
    inputs = random.uniform(-2.0, 2.0, (count, 2))
    values = np.stack([np.abs(inputs[:, 0]), random.normal(size=count)], axis=1)
    values += 0.05 * random.normal(size=values.shape)
    return local.stored(
        Rows(inputs, values, np.full((count, 2), 400.0)), np.arange(count) // (count // 4)
    )


def test_the_covariance_is_that_of_many_neurons():
    """E[erf(uᵀx̃) erf(uᵀx̃')] with u ~ N(0, Σ), by drawing a million neurons; its noise is 1e-3."""
    from scipy import special

    weights = np.array([0.5, 1.5])
    x, other = np.array([[0.4]]), np.array([[-1.2]])
    draw = np.random.default_rng(1).normal(size=(1_000_000, 2)) * np.sqrt(weights)
    outputs = [special.erf(draw[:, 0] + draw[:, 1] * one[0, 0]) for one in (x, other)]
    wanted = float(np.mean(outputs[0] * outputs[1]))
    assert local.neural(weights, x, other)[0, 0] == pytest.approx(wanted, abs=4e-3)


def test_prediction_is_the_exact_posterior_of_the_neighbours():
    store = made_store(2, 200)
    shape = local.Shape(np.array([1.0, 0.5, 0.5]), np.array([0.6, 0.2]), np.array([0.01, 0.02]))
    known = local.built(shape, store)
    here = np.array([[0.3, -0.7]])
    found = local.predict(known, here)
    near = np.argsort(np.sum((store.inputs - here) ** 2, axis=1))[: local.NEIGHBOURS]
    for output in range(2):
        size = shape.variance[output]
        own = 1.0 / 400.0 + shape.noise[output]
        matrix = size * local.neural(shape.weights, store.inputs[near], store.inputs[near])
        matrix += own * np.eye(near.size)
        cross = size * local.neural(shape.weights, here, store.inputs[near])[0]
        mean = cross @ np.linalg.solve(matrix, store.values[near, output])
        alone = size * local.neural(shape.weights, here, here)[0, 0]
        left = alone - cross @ np.linalg.solve(matrix, cross)
        np.testing.assert_allclose(found.mean[0, output], mean, atol=1e-9)
        np.testing.assert_allclose(found.variance[0, output], left, atol=1e-9)


def test_neighbours_of_the_own_stretch_are_not_asked():
    known = local.built(local.Shape(np.ones(3), np.ones(2), np.ones(2)), made_store(3, 200))
    asked = known.store.inputs[:20]
    near, counts = local.neighbours(known, asked, known.store.piece[:20])
    assert np.all(known.store.piece[near[counts > 0.0]] != 0)
    far = local.predict(known, asked, piece=known.store.piece[:20])
    values = known.store.values.copy()
    values[known.store.piece == 0] = 1e3
    changed = local.built(known.shape, known.store._replace(values=values))
    np.testing.assert_allclose(
        local.predict(changed, asked, piece=known.store.piece[:20]).mean, far.mean, atol=1e-9
    )


def test_a_bend_is_learned_and_noise_is_not():
    """|x| to a fifth of its spread where it was flown; white noise stays near zero."""
    found = local.learned(made_store(4, 400), queries=64, seed=1)
    inputs = np.random.default_rng(5).uniform(-1.8, 1.8, (100, 2))
    belief = local.predict(found, inputs)
    error = belief.mean[:, 0] - np.abs(inputs[:, 0])
    assert np.sqrt(np.mean(error**2)) < 0.2 * np.std(np.abs(inputs[:, 0]))
    assert np.sqrt(np.mean(belief.mean[:, 1] ** 2)) < 0.5
