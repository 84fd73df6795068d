"""The covariance of convolved white noise, against the convolution itself."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid.gp import dependent
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


def smoothing(scale: float, amplitude: float, apart: np.ndarray) -> np.ndarray:
    """The Gaussian smoothing kernel whose convolution with itself has variance amplitude²."""
    width = scale / np.sqrt(2.0)
    return amplitude * (np.pi * width**2) ** -0.25 * np.exp(-0.5 * (apart / width) ** 2)


@pytest.mark.parametrize("tied", [True, False])
def test_covariance_is_the_integral_of_the_smoothing_kernels(tied):
    """Two outputs, one shared latent, one input: trapezoids over ±12 are exact to rounding."""
    kernel = made(1, latents=1, outputs=2, inputs=1, tied=tied)
    grid = np.linspace(-12.0, 12.0, 20001)
    for x, other in ((0.0, 0.0), (0.7, -0.4), (-1.1, 1.3)):
        for i in range(2):
            for j in range(2):
                scales = [float(kernel.scale[0, 0 if tied else one, 0]) for one in (i, j)]
                sizes = [float(kernel.amplitude[0, one]) for one in (i, j)]
                wanted = np.trapezoid(
                    smoothing(scales[0], sizes[0], x - grid)
                    * smoothing(scales[1], sizes[1], other - grid),
                    grid,
                )
                if i == j:
                    own = smoothing(
                        float(kernel.own_scale[i, 0]), float(kernel.own_amplitude[i]), x - grid
                    )
                    own = own * smoothing(
                        float(kernel.own_scale[i, 0]), float(kernel.own_amplitude[i]), other - grid
                    )
                    wanted += np.trapezoid(own, grid)
                left = Points(jnp.array([[x]]), jnp.array([i]))
                right = Points(jnp.array([[other]]), jnp.array([j]))
                found = float(dependent.covariance(kernel, left, right)[0, 0])
                np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)


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
