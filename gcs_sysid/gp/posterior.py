"""What a Gaussian process says after its data: means, variances and slopes, for every output.

Exact or approximated, a posterior over the values at some points p has the same form:

    mean_i(x) = k_i(x, p) α,    var_i(x) = k_ii − k_i(x, p) B k_i(p, x),

and so have its slopes, with ∂k/∂x in place of k. Far from all points k vanishes and both return to
the prior.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float

from gcs_sysid.frames import Array
from gcs_sysid.gp import dependent
from gcs_sysid.gp.dependent import Kernel, Points

MATERN = 5.0 / 3.0
"""Minus the second derivative of Matérn's correlation at 0, of unit length-scale."""

AT_ONCE = 64
"""Samples whose slopes are worked out together: memory stays small however many are asked for."""


class Posterior(NamedTuple):
    """Attributes: the prior's kernel, points, and α and B of the module's equation."""

    kernel: Kernel
    points: Points
    weights: Float[Array, " point"]
    reduction: Float[Array, "point point"]


class Belief(NamedTuple):
    """Mean and variance of every output, noise excluded."""

    mean: Float[Array, "sample output"]
    variance: Float[Array, "sample output"]


class Slopes(NamedTuple):
    """Mean and variance of the derivative of every output with respect to every input."""

    mean: Float[Array, "sample output input"]
    variance: Float[Array, "sample output input"]


@jax.jit
def mean(
    posterior: Posterior, inputs: Float[Array, "sample input"]
) -> Float[Array, "sample output"]:
    """The mean alone: a hundredth of the work."""
    kernel, points = posterior.kernel, posterior.points
    if not kernel.tied:
        return dependent.covariance_of_all(kernel, inputs, points) @ posterior.weights
    shared, own = dependent.parts(kernel, inputs, points)
    same = dependent.outputs_of(kernel, points)
    return (shared @ posterior.weights).T @ kernel.amplitude + (
        own * posterior.weights[None, :]
    ) @ same


@jax.jit
def predict(posterior: Posterior, inputs: Float[Array, "sample input"]) -> Belief:
    """Mean and variance at `inputs`, scaled units."""
    prior = dependent.variance(posterior.kernel)[None, :]
    # Rounding may leave a variance of 1e-9 of the prior on the wrong side of zero.
    left = jnp.maximum(prior - _known(posterior, inputs), 1e-9 * prior)
    return Belief(mean(posterior, inputs), left)


def _known(
    posterior: Posterior, inputs: Float[Array, "sample input"]
) -> Float[Array, "sample output"]:
    """What the data took from the prior variance, k B kᵀ of every output.

    With tied length-scales k_i = Σ_q a_qi u_q + o_i, and the products of u and o with B serve all
    outputs.
    """
    kernel, points, reduction = posterior.kernel, posterior.points, posterior.reduction
    if not kernel.tied:
        cross = dependent.covariance_of_all(kernel, inputs, points)
        return jnp.sum((cross @ reduction) * cross, axis=-1)
    shared, own = dependent.parts(kernel, inputs, points)
    same = dependent.outputs_of(kernel, points)
    known = ((own @ (reduction * (same @ same.T))) * own) @ same
    for index, amplitude in enumerate(kernel.amplitude):
        half = shared[index] @ reduction
        known = known + 2.0 * amplitude[None, :] * ((half * own) @ same)
        for other in range(shared.shape[0]):
            size = amplitude * kernel.amplitude[other]
            known = known + size[None, :] * jnp.sum(half * shared[other], axis=1)[:, None]
    return known


@jax.jit
def slopes(posterior: Posterior, inputs: Float[Array, "sample input"]) -> Slopes:
    """Derivatives at `inputs` with their variances, scaled units."""
    prior = slope_variance(posterior.kernel)

    def row(here: Float[Array, " input"]) -> Float[Array, "output point"]:
        return dependent.covariance_of_all(posterior.kernel, here[None, :], posterior.points)[0]

    def one(here: Float[Array, " input"]) -> tuple[Array, Array]:
        cross = jnp.moveaxis(jax.jacfwd(row)(here), -1, 1)
        known = jnp.sum((cross @ posterior.reduction) * cross, axis=-1)
        return cross @ posterior.weights, jnp.maximum(prior - known, 1e-9 * prior)

    middle, spread = jax.lax.map(one, inputs, batch_size=AT_ONCE)
    return Slopes(middle, spread)


@jax.jit
def mean_slopes(
    posterior: Posterior, inputs: Float[Array, "sample input"]
) -> Float[Array, "sample output input"]:
    """The derivatives' means alone."""

    def row(here: Float[Array, " input"]) -> Float[Array, " output"]:
        return mean(posterior, here[None, :])[0]

    return jax.lax.map(jax.jacfwd(row), inputs, batch_size=AT_ONCE)


def slope_variance(kernel: Kernel) -> Float[Array, "output input"]:
    """Prior variance of each derivative: ∂²k/∂x∂x' where x = x'.

    1/L² of a Gaussian correlation, 5/3 of that of Matérn's (see `dependent`).
    """
    shared = jnp.sum(kernel.amplitude[:, :, None] ** 2 / kernel.scale**2, axis=0)
    own = kernel.own_amplitude[:, None] ** 2 / kernel.own_scale**2
    return (MATERN if kernel.tied else 1.0) * shared + MATERN * own
