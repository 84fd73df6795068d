"""The exact posterior and its marginal likelihood against scipy and other libraries."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from gcs_sysid.gp import dependent, exact, learning, posterior
from gcs_sysid.gp.dependent import Kernel
from gcs_sysid.gp.samples import Rows
from tests.gp.test_dependent import made, points

COUNT = 40


@pytest.fixture(scope="module")
def case():
    """Three outputs at scattered points, drawn from the prior."""
    kernel = made(11, latents=2, outputs=3, inputs=2, tied=False)
    some = points(12, COUNT, outputs=3, inputs=2)
    random = np.random.default_rng(13)
    noise = random.uniform(0.01, 0.1, COUNT)
    total = np.asarray(dependent.covariance(kernel, some, some)) + np.diag(noise)
    values = random.multivariate_normal(np.zeros(COUNT), total)
    return kernel, some, jnp.asarray(values), jnp.asarray(noise), total


def test_marginal_likelihood_is_the_multivariate_normal(case):
    kernel, some, values, noise, total = case
    found = float(exact.log_marginal(kernel, some, values, noise))
    wanted = stats.multivariate_normal(np.zeros(COUNT), total).logpdf(np.asarray(values))
    np.testing.assert_allclose(found, wanted, rtol=1e-10)


def test_posterior_is_the_conditional_normal(case):
    kernel, some, values, noise, total = case
    known = exact.condition(kernel, some, values, noise)
    inputs = points(14, 6, outputs=3, inputs=2).inputs
    found = posterior.predict(known, inputs)
    cross = np.asarray(dependent.covariance_of_all(kernel, inputs, some))
    mean = cross @ np.linalg.solve(total, np.asarray(values))
    prior = np.asarray(dependent.variance(kernel))
    left = prior - np.einsum("sop,pq,soq->so", cross, np.linalg.inv(total), cross)
    np.testing.assert_allclose(np.asarray(found.mean), mean, atol=1e-9)
    np.testing.assert_allclose(np.asarray(found.variance), left, atol=1e-9)
    np.testing.assert_allclose(np.asarray(posterior.mean(known, inputs)), mean, atol=1e-9)


def test_slopes_are_those_of_the_mean_and_of_samples_of_the_posterior(case):
    """Mean by central differences; variance from the joint covariance of two near points."""
    kernel, some, values, noise, _ = case
    known = exact.condition(kernel, some, values, noise)
    here = jnp.array([[0.3, -0.2], [1.0, 0.5]])
    found = posterior.slopes(known, here)
    step = 1e-4
    for column in range(2):
        move = jnp.zeros((1, 2)).at[0, column].set(step)
        ahead, behind = (posterior.mean(known, here + sign * move) for sign in (1.0, -1.0))
        np.testing.assert_allclose(
            np.asarray(found.mean[:, :, column]),
            np.asarray((ahead - behind) / (2.0 * step)),
            atol=1e-6,
        )
        cross = [
            dependent.covariance_of_all(kernel, here + sign * move, some) for sign in (1.0, -1.0)
        ]
        change = np.asarray(cross[0] - cross[1]) / (2.0 * step)
        prior = np.asarray(posterior.slope_variance(kernel))[:, column]
        wanted = prior[None, :] - np.einsum(
            "sop,pq,soq->so", change, np.asarray(known.reduction), change
        )
        np.testing.assert_allclose(np.asarray(found.variance[:, :, column]), wanted, atol=1e-5)


def test_prior_variance_of_a_slope_is_the_mixed_second_derivative():
    kernel = made(15, latents=2, outputs=2, inputs=2, tied=True)

    def at(left, right):
        cross = dependent.covariance_of_all(
            kernel, left[None, :], dependent.Points(right[None, :], jnp.array([1]))
        )
        return cross[0, 1, 0]

    origin = jnp.array([0.4, 0.1])
    second = jax.jacfwd(jax.jacrev(at, argnums=0), argnums=1)(origin, origin)
    np.testing.assert_allclose(
        np.asarray(posterior.slope_variance(kernel))[1], np.diagonal(np.asarray(second)), rtol=1e-9
    )


def test_far_from_all_data_the_posterior_is_the_prior(case):
    kernel, some, values, noise, _ = case
    found = posterior.predict(exact.condition(kernel, some, values, noise), jnp.full((1, 2), 50.0))
    np.testing.assert_allclose(np.asarray(found.mean), 0.0, atol=1e-12)
    np.testing.assert_allclose(
        np.asarray(found.variance[0]), np.asarray(dependent.variance(kernel)), rtol=1e-9
    )


def test_one_output_is_the_gaussian_process_of_scikit_learn():
    gaussian_process = pytest.importorskip("sklearn.gaussian_process")
    kernels = gaussian_process.kernels
    random = np.random.default_rng(16)
    inputs, values = random.normal(size=(30, 3)), random.normal(size=30)
    kernel = Kernel(
        amplitude=jnp.zeros((0, 1)),
        scale=jnp.ones((0, 1, 3)),
        own_amplitude=jnp.array([1.3]),
        own_scale=jnp.array([[0.7, 1.1, 2.0]]),
    )
    other = gaussian_process.GaussianProcessRegressor(
        kernels.ConstantKernel(1.3**2) * kernels.Matern([0.7, 1.1, 2.0], nu=2.5),
        alpha=0.04,
        optimizer=None,
    ).fit(inputs, values)
    some = dependent.Points(jnp.asarray(inputs), jnp.zeros(30, dtype=int))
    noise = jnp.full(30, 0.04)
    known = exact.condition(kernel, some, jnp.asarray(values), noise)
    new = random.normal(size=(8, 3))
    mean, deviation = other.predict(new, return_std=True)
    found = posterior.predict(known, jnp.asarray(new))
    np.testing.assert_allclose(np.asarray(found.mean[:, 0]), mean, atol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.asarray(found.variance[:, 0])), deviation, atol=1e-7)
    np.testing.assert_allclose(
        float(exact.log_marginal(kernel, some, jnp.asarray(values), noise)),
        other.log_marginal_likelihood_value_,
        rtol=1e-10,
    )


def test_a_missing_output_is_no_point():
    rows = Rows(jnp.zeros((2, 1)), jnp.ones((2, 3)), jnp.array([[1.0, 0.0, 4.0], [0.0, 2.0, 1.0]]))
    some, values, noise = exact.observed(rows)
    np.testing.assert_array_equal(np.asarray(some.output), [0, 2, 1, 2])
    np.testing.assert_allclose(np.asarray(noise), [1.0, 0.25, 0.5, 1.0])
    assert values.shape == (4,)


def test_greatest_likelihood_finds_what_the_data_were_drawn_from():
    """Two outputs that are one process, one of them inverted, and nearly noiseless."""
    random = np.random.default_rng(17)
    inputs = np.sort(random.uniform(-3.0, 3.0, 40))[:, None]
    r = np.sqrt(5.0) * np.abs(inputs - inputs.T)
    matern = (1.0 + r + r**2 / 3.0) * np.exp(-r)
    shared = random.multivariate_normal(np.zeros(40), matern + 1e-9 * np.eye(40))
    values = np.stack([shared, -0.8 * shared], axis=1) + 0.1 * random.normal(size=(40, 2))
    rows = Rows(jnp.asarray(inputs), jnp.asarray(values), jnp.full((40, 2), 1e4))
    found = learning.fit_exact(rows, learning.Structure(1), starts=2, seed=1)
    assert found.log_posterior == max(found.starts)
    amplitude = np.asarray(found.kernel.amplitude[0])
    np.testing.assert_allclose(amplitude[1] / amplitude[0], -0.8, atol=0.15)
    np.testing.assert_allclose(float(found.kernel.scale[0, 0, 0]), 1.0, rtol=0.3)
    np.testing.assert_allclose(np.sqrt(np.asarray(found.noise)), 0.1, rtol=0.35)
