"""The covariance of convolved white noise, against the convolution itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import special

from gcs_sysid.gp import dependent, posterior
from gcs_sysid.gp.dependent import Kernel, Points


def made(seed: int, *, latents: int, outputs: int, inputs: int, tied: bool) -> Kernel:
    random = np.random.default_rng(seed)
    rows = 1 if tied else outputs
    return Kernel(
        amplitude=jnp.asarray(random.normal(size=(latents, outputs))),
        scale=jnp.asarray(random.uniform(0.6, 2.0, (latents, rows, inputs))),
        own_amplitude=jnp.asarray(random.uniform(0.2, 0.8, outputs)),
        own_scale=jnp.asarray(random.uniform(0.6, 2.0, (outputs, inputs))),
    )


def points(seed: int, count: int, *, outputs: int, inputs: int) -> Points:
    random = np.random.default_rng(seed)
    return Points(
        jnp.asarray(random.normal(size=(count, inputs))),
        jnp.asarray(random.integers(0, outputs, count)),
    )


GRID = np.linspace(-40.0, 40.0, 80001)
Smoothing = Callable[[float, np.ndarray], np.ndarray]


def gaussian(scale: float, apart: np.ndarray) -> np.ndarray:
    """The smoothing kernel of unit square integral whose correlation is Gaussian."""
    width = scale / np.sqrt(2.0)
    return (np.pi * width**2) ** -0.25 * np.exp(-0.5 * (apart / width) ** 2)


def bessel(scale: float, apart: np.ndarray) -> np.ndarray:
    """That whose correlation is Matérn's of order 5/2.

    The root of its spectrum, (5/L² + ω²)^(−3/2), transforms to |t| K₁(√5 |t|/L).
    """

    def shape(apart: np.ndarray) -> np.ndarray:
        where = np.maximum(np.sqrt(5.0) * np.abs(apart) / scale, 1e-12)
        return where * special.k1(where)

    return shape(apart) / np.sqrt(np.trapezoid(shape(GRID) ** 2, GRID))


@pytest.mark.parametrize(("tied", "shared"), [(True, bessel), (False, gaussian)])
def test_covariance_is_the_integral_of_the_smoothing_kernels(tied: bool, shared: Smoothing):
    """Two outputs, one shared latent, one input."""
    kernel = made(1, latents=1, outputs=2, inputs=1, tied=tied)

    def integral(smoothing: Smoothing, x: float, other: float, scales: Sequence[float]) -> float:
        left, right = smoothing(scales[0], x - GRID), smoothing(scales[1], other - GRID)
        return float(np.trapezoid(left * right, GRID))

    for x, other in ((0.0, 0.0), (0.7, -0.4), (-1.1, 1.3)):
        for i in range(2):
            for j in range(2):
                scales = [float(kernel.scale[0, 0 if tied else one, 0]) for one in (i, j)]
                sizes = [float(kernel.amplitude[0, one]) for one in (i, j)]
                wanted = sizes[0] * sizes[1] * integral(shared, x, other, scales)
                if i == j:
                    own = [float(kernel.own_scale[i, 0])] * 2
                    size = float(kernel.own_amplitude[i]) ** 2
                    wanted += size * integral(bessel, x, other, own)
                left = Points(jnp.array([[x]]), jnp.array([i]))
                right = Points(jnp.array([[other]]), jnp.array([j]))
                found = float(dependent.covariance(kernel, left, right)[0, 0])
                np.testing.assert_allclose(found, wanted, rtol=1e-7)


def test_matern_has_the_slopes_of_its_closed_form_even_where_points_meet():
    """First and second derivative by one coordinate: −5/3 x (1 + √5 r) e^{−√5 r} and on."""
    kernel = made(7, latents=0, outputs=1, inputs=1, tied=True)
    size, scale = float(kernel.own_amplitude[0]) ** 2, float(kernel.own_scale[0, 0])
    zero = jnp.zeros(1, dtype=int)

    def between(x: jnp.ndarray, other: jnp.ndarray) -> jnp.ndarray:
        left, right = Points(x[None, None], zero), Points(other[None, None], zero)
        return dependent.covariance(kernel, left, right)[0, 0]

    for apart in (0.0, 1e-9, 0.3, -2.0):
        x, r = jnp.asarray(apart), np.sqrt(5.0) * abs(apart) / scale
        first = float(jax.grad(between)(x, jnp.asarray(0.0)))
        second = float(jax.grad(jax.grad(between), argnums=1)(x, jnp.asarray(0.0)))
        fall = size * 5.0 / 3.0 / scale**2 * np.exp(-r)
        np.testing.assert_allclose(first, -fall * apart * (1.0 + r), rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(second, fall * (1.0 + r - r**2), rtol=1e-6)
        if apart == 0.0:
            np.testing.assert_allclose(second, posterior.slope_variance(kernel)[0, 0])


@pytest.mark.parametrize("tied", [True, False])
def test_covariance_is_symmetric_and_positive(tied):
    kernel = made(2, latents=3, outputs=3, inputs=4, tied=tied)
    some = points(3, 120, outputs=3, inputs=4)
    matrix = np.asarray(dependent.covariance(kernel, some, some))
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-12)
    assert np.linalg.eigvalsh(matrix).min() > -1e-10 * np.trace(matrix)
    np.testing.assert_allclose(
        np.diagonal(matrix),
        np.asarray(dependent.variance(kernel))[np.asarray(some.output)],
        rtol=1e-9,
    )


@pytest.mark.parametrize("tied", [True, False])
def test_all_outputs_at_once_are_the_single_ones(tied):
    kernel = made(4, latents=2, outputs=3, inputs=2, tied=tied)
    some = points(5, 7, outputs=3, inputs=2)
    inputs = points(6, 5, outputs=3, inputs=2).inputs
    found = dependent.covariance_of_all(kernel, inputs, some)
    for output in range(3):
        left = Points(inputs, jnp.full(5, output))
        np.testing.assert_allclose(
            np.asarray(found[:, output]),
            np.asarray(dependent.covariance(kernel, left, some)),
            atol=1e-12,
        )


def test_unequal_length_scales_bound_the_correlation():
    """Ratio 2 in three inputs: 0.8^{3/2} = 0.72 and no more."""
    kernel = Kernel(
        amplitude=jnp.ones((1, 2)),
        scale=jnp.array([[[1.0] * 3, [2.0] * 3]]),
        own_amplitude=jnp.full(2, 1e-6),
        own_scale=jnp.ones((2, 3)),
    )
    origin = Points(jnp.zeros((2, 3)), jnp.array([0, 1]))
    matrix = dependent.covariance(kernel, origin, origin)
    np.testing.assert_allclose(float(matrix[0, 1]), 0.8**1.5, rtol=1e-9)
