"""The global approximation: inducing points, and a posterior that is a sum over samples.

With u = f(z) at inducing points z = (input, output) and K = cov[u] = L Lᵀ, each value is taken to
depend on the others through u only (FITC: the variance that u leaves counts as its noise). In
v = L⁻¹u, with φ = L⁻¹ k(z, x) the features of a value,

    G = Σ φ φᵀ / r,   h = Σ φ y / r,   r = k(x, x) − φᵀφ + noise,   v ~ N((I + G)⁻¹h, (I + G)⁻¹).

G and h are sums, so that a sample is added, or a flight taken away, exactly, in any order, at a
cost and in a memory that do not depend on how many came before; until kernel or points change, the
posterior is that of the batch.

References:
    J. Quiñonero-Candela, C. E. Rasmussen, "A unifying view of sparse approximate Gaussian process
    regression", JMLR 6, 2005 (FITC); T. D. Bui, C. V. Nguyen, R. E. Turner, "Streaming sparse
    Gaussian process approximations", NIPS 30, 2017 (carrying a posterior to other points).
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jaxtyping import Float

from gcs_sysid.frames import Array
from gcs_sysid.gp import dependent
from gcs_sysid.gp.dependent import Kernel, Points
from gcs_sysid.gp.posterior import Posterior
from gcs_sysid.gp.samples import Rows

JITTER = 1e-8
"""Added to K, relative to the prior variance: two inducing points may almost coincide."""


class Basis(NamedTuple):
    """Prior and inducing points.

    Attributes:
        kernel: prior covariance.
        noise: variance of each output that its samples' own errors do not explain.
        repeats: samples of each output that say the same, because their errors last: each counts
            as the fraction of one.
        points: inducing points.
        factor: L.
    """

    kernel: Kernel
    noise: Float[Array, " output"]
    repeats: Float[Array, " output"]
    points: Points
    factor: Float[Array, "point point"]


class Information(NamedTuple):
    """What samples said: G and h of the module's equations."""

    matrix: Float[Array, "point point"]
    vector: Float[Array, " point"]


def nothing(size: int) -> Information:
    """Before the first sample."""
    return Information(jnp.zeros((size, size)), jnp.zeros(size))


@jax.jit
def basis(
    kernel: Kernel,
    noise: Float[Array, " output"],
    repeats: Float[Array, " output"],
    points: Points,
) -> Basis:
    """Prior and inducing points, made ready."""
    prior = dependent.variance(kernel)[points.output]
    matrix = dependent.covariance(kernel, points, points)
    factor = jnp.linalg.cholesky(matrix + JITTER * jnp.diag(prior))
    return Basis(kernel, noise, repeats, points, factor)


def features(
    base: Basis, inputs: Float[Array, "sample input"]
) -> Float[Array, "sample output point"]:
    """φ of every output at every sample."""
    cross = dependent.covariance_of_all(base.kernel, inputs, base.points)
    flat = cross.reshape((-1, cross.shape[-1]))
    return jsl.solve_triangular(base.factor, flat.T, lower=True).T.reshape(cross.shape)


def precisions(
    base: Basis, some: Rows, phi: Float[Array, "sample output point"]
) -> Float[Array, "sample output"]:
    """1/r of every value, 0 where it is missing."""
    left = dependent.variance(base.kernel)[None, :] - jnp.sum(phi**2, axis=-1)
    return some.precision / (1.0 + some.precision * (jnp.maximum(left, 0.0) + base.noise[None, :]))


@jax.jit
def told(base: Basis, some: Rows) -> Information:
    """What samples add."""
    phi = features(base, some.inputs)
    weight = precisions(base, some, phi) / base.repeats[None, :]
    flat = phi.reshape((-1, phi.shape[-1]))
    weighted = flat * weight.reshape((-1, 1))
    return Information(weighted.T @ flat, weighted.T @ some.values.reshape(-1))


@jax.jit
def plus(left: Information, right: Information) -> Information:
    """Both together."""
    return Information(left.matrix + right.matrix, left.vector + right.vector)


@jax.jit
def minus(whole: Information, part: Information) -> Information:
    """The whole without a part that was in it."""
    return Information(whole.matrix - part.matrix, whole.vector - part.vector)


@jax.jit
def posterior(base: Basis, known: Information) -> Posterior:
    """What the information says of every output everywhere."""
    size = known.vector.shape[0]
    factor = jnp.linalg.cholesky(jnp.eye(size) + known.matrix)
    inverse = jsl.solve_triangular(base.factor, jnp.eye(size), lower=True)
    middle = jsl.cho_solve((factor, True), known.vector)
    # I − (I + G)⁻¹ = (I + G)⁻¹ G keeps its sign where G is small.
    gained = jsl.cho_solve((factor, True), known.matrix)
    reduction = inverse.T @ (0.5 * (gained + gained.T)) @ inverse
    return Posterior(base.kernel, base.points, inverse.T @ middle, reduction)


@jax.jit
def log_marginal(base: Basis, some: Rows) -> Float[Array, ""]:
    """Logarithm of the density of the samples under the approximation [nat].

    Where samples repeat each other each density is taken to the power of 1/repeats.
    """
    phi = features(base, some.inputs)
    precision = precisions(base, some, phi)
    share = 1.0 / base.repeats[None, :]
    flat = phi.reshape((-1, phi.shape[-1]))
    # No square root of the weights: it has no slope where a value is missing.
    weight = (precision * share).reshape(-1)
    weighted = flat * weight[:, None]
    value = some.values.reshape(-1)
    factor = jnp.linalg.cholesky(jnp.eye(flat.shape[1]) + weighted.T @ flat)
    white = jsl.solve_triangular(factor, weighted.T @ value, lower=True)
    present = precision > 0.0
    density = jnp.log(jnp.where(present, precision, 2.0 * jnp.pi) / (2.0 * jnp.pi))
    return 0.5 * (
        jnp.sum(density * share)
        - value @ (weight * value)
        + white @ white
        - 2.0 * jnp.sum(jnp.log(jnp.diagonal(factor)))
    )


@jax.jit
def carried(old: Basis, known: Information, new: Basis) -> Information:
    """The same information about other inducing points, or under another kernel.

    What the samples said of v_old = T v_new + e stays what it was; e, which the new points do not
    determine, is integrated out under the new kernel. Exact as far as the old information was.
    """
    size = known.vector.shape[0]
    prior = dependent.covariance(new.kernel, old.points, old.points)
    cross = dependent.covariance(new.kernel, old.points, new.points)
    half = jsl.solve_triangular(old.factor, cross, lower=True)
    turn = jsl.solve_triangular(new.factor, half.T, lower=True).T
    inner = jsl.solve_triangular(old.factor, prior, lower=True)
    inner = jsl.solve_triangular(old.factor, inner.T, lower=True)
    rest = 0.5 * (inner + inner.T) - turn @ turn.T
    both = jnp.concatenate([known.matrix @ turn, known.vector[:, None]], axis=1)
    solved = turn.T @ jnp.linalg.solve(jnp.eye(size) + known.matrix @ rest, both)
    matrix = solved[:, :-1]
    return Information(0.5 * (matrix + matrix.T), solved[:, -1])
