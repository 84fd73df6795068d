"""What the global part leaves: the neighbours of each query, a covariance that is not stationary.

The covariance is that of a network of infinitely many neurons: it bends where the data bend and
goes straight on beyond them, where the stationary one of the global part falls back to zero. For
each query the k nearest samples (k-d tree) make an exact posterior of their own,

    k(x, x') = s² (2/π) asin( 2 x̃ᵀΣx̃' / √((1 + 2 x̃ᵀΣx̃)(1 + 2 x̃'ᵀΣx̃')) ),   x̃ = (1, x),

Σ diagonal. Its hyper-parameters are those that foretell samples best from neighbours of *other*
stretches of flight: neighbours in time share their errors, and would be foretold by them.

References:
    C. K. I. Williams, "Computation with infinite neural networks", Neural Computation 10, 1998;
    S. Vasudevan et al., "Gaussian process modeling of large-scale terrain", J. Field Robotics 26,
    2009.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int
from scipy import optimize
from scipy.spatial import KDTree

from gcs_sysid.gp.posterior import Belief
from gcs_sysid.gp.samples import Rows

NEIGHBOURS = 32
AT_ONCE = 256
"""Queries a compiled step takes."""
SPARE = 8
"""So many times as many are looked up where those of the query's own stretch do not count."""
WIDE = 3.0
"""Standard deviation of the prior of each logarithm in `Shape`."""


class Shape(NamedTuple):
    """Hyper-parameters, as logarithms.

    Attributes:
        weights: Σ, of the constant and of each input.
        variance: s² of each output.
        noise: variance of each output that the samples' own errors do not explain.
    """

    weights: Float[Array, " weight"]
    variance: Float[Array, " output"]
    noise: Float[Array, " output"]


@dataclass(frozen=True)
class Local:
    """Samples, found by their inputs.

    Attributes:
        shape: of the covariance.
        rows: samples; values are what the global part left.
        piece: stretch of flight of each.
        tree: over the inputs.
    """

    shape: Shape
    rows: Rows
    piece: Int[np.ndarray, " sample"]
    tree: KDTree


def built(shape: Shape, rows: Rows, piece: Int[np.ndarray, " sample"]) -> Local:
    """The samples made ready for queries."""
    return Local(shape, rows, piece, KDTree(np.asarray(rows.inputs)))


def neural(
    weights: Float[Array, " weight"],
    left: Float[Array, "left input"],
    right: Float[Array, "right input"],
) -> Float[Array, "left right"]:
    """The covariance for s = 1."""
    size = jnp.exp(weights)

    def product(one: Float[Array, "a input"], other: Float[Array, "b input"]) -> Array:
        return 2.0 * (size[0] + (one * size[None, 1:]) @ other.T)

    def own(some: Float[Array, "a input"]) -> Array:
        return 1.0 + 2.0 * (size[0] + jnp.sum(some**2 * size[None, 1:], axis=1))

    ratio = product(left, right) / jnp.sqrt(own(left)[:, None] * own(right)[None, :])
    return (2.0 / jnp.pi) * jnp.arcsin(ratio)


def predict(
    local: Local,
    inputs: Float[np.ndarray, "sample input"],
    *,
    piece: Int[np.ndarray, " sample"] | None = None,
) -> Belief:
    """Mean and variance of what the global part leaves, noise excluded.

    Args:
        local: samples.
        inputs: queries, scaled.
        piece: stretch of flight of each query; samples of the same one are not asked.
    """
    near, own = neighbours(local, inputs, piece)
    parts = []
    count = inputs.shape[0]
    for start in range(0, count, AT_ONCE):
        stop = min(start + AT_ONCE, count)
        fill = (0, AT_ONCE - (stop - start))
        asked = np.pad(inputs[start:stop], (fill, (0, 0)), mode="edge")
        index = np.pad(near[start:stop], (fill, (0, 0)), mode="edge")
        used = np.pad(own[start:stop], (fill, (0, 0)), mode="edge")
        mean, variance = _beliefs(local.shape, local.rows, asked, index, used)
        parts.append((np.asarray(mean)[: stop - start], np.asarray(variance)[: stop - start]))
    return Belief(*(jnp.asarray(np.concatenate(part)) for part in zip(*parts, strict=True)))


def neighbours(
    local: Local,
    inputs: Float[np.ndarray, "sample input"],
    piece: Int[np.ndarray, " sample"] | None,
) -> tuple[Int[np.ndarray, "sample near"], Float[np.ndarray, "sample near"]]:
    """Indices of the nearest samples, and 1 for each that counts, 0 for those that do not."""
    total = local.piece.size
    few = min(NEIGHBOURS, total)
    if piece is None:
        near = local.tree.query(inputs, k=np.arange(1, few + 1))[1]
        return near, np.ones(near.shape)
    near = local.tree.query(inputs, k=np.arange(1, min(SPARE * NEIGHBOURS, total) + 1))[1]
    other = local.piece[near] != piece[:, None]
    first = np.argsort(~other, axis=1, kind="stable")[:, :few]
    return np.take_along_axis(near, first, 1), np.take_along_axis(other, first, 1).astype(float)


@jax.jit
def _beliefs(
    shape: Shape,
    rows: Rows,
    inputs: Float[Array, "query input"],
    near: Int[Array, "query near"],
    used: Float[Array, "query near"],
) -> tuple[Float[Array, "query output"], Float[Array, "query output"]]:
    def one(here: Array, index: Array, counts: Array) -> tuple[Array, Array]:
        there = rows.inputs[index]
        between = neural(shape.weights, there, there)
        across = neural(shape.weights, here[None, :], there)[0]
        alone = neural(shape.weights, here[None, :], here[None, :])[0, 0]

        def output(size: Array, noise: Array, values: Array, precision: Array) -> tuple:
            counted = precision * counts
            # Noise of 1e6 times the variance takes a sample out without changing any shape.
            own = jnp.where(counted > 0.0, 1.0 / jnp.maximum(counted, 1e-300) + noise, 1e6 * size)
            factor = jnp.linalg.cholesky(size * between + jnp.diag(own))
            half = jsl.solve_triangular(factor, size * across, lower=True)
            mean = half @ jsl.solve_triangular(factor, values * (counted > 0.0), lower=True)
            return mean, jnp.maximum(size * alone - half @ half, 1e-9 * size)

        return jax.vmap(output, in_axes=(0, 0, 1, 1))(
            jnp.exp(shape.variance),
            jnp.exp(shape.noise),
            rows.values[index],
            rows.precision[index],
        )

    return jax.vmap(one)(inputs, near, used)


def learned(
    rows: Rows, piece: Int[np.ndarray, " sample"], *, queries: int, steps: int, seed: int
) -> Local:
    """Hyper-parameters that foretell `queries` of the samples best from other stretches of flight.

    Args:
        rows: samples; values are what the global part left.
        piece: stretch of flight of each; with one stretch alone nothing is foretold by another, and
            the neighbours' own count.
        queries: samples that are foretold; a multiple of `AT_ONCE` wastes nothing.
        steps: of the search.
        seed: of the draw.
    """
    outputs, inputs = rows.values.shape[1], rows.inputs.shape[1]
    middle = Shape(jnp.full(inputs + 1, -1.0), jnp.full(outputs, -2.0), jnp.full(outputs, -1.0))
    plain = built(middle, rows, piece)
    count = rows.inputs.shape[0]
    draw = np.random.default_rng(seed).permutation(count)[:queries]
    asked = np.asarray(rows.inputs)[draw]
    several = np.unique(piece).size > 1
    apart = piece[draw] if several else np.arange(draw.size)
    near, used = neighbours(
        plain if several else built(middle, rows, _numbers(count, draw)), asked, apart
    )
    first, restore = ravel_pytree(middle)
    data = (rows, jnp.asarray(draw), jnp.asarray(near), jnp.asarray(used))

    def cost(vector: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = _foretold(restore(jnp.asarray(vector)), middle, *data)
        flat = np.asarray(ravel_pytree(slope)[0])
        if not (np.isfinite(float(value)) and np.all(np.isfinite(flat))):
            return 1e12, np.zeros_like(flat)
        return float(value), flat

    found = optimize.minimize(
        cost, np.asarray(first), jac=True, method="L-BFGS-B", options={"maxiter": steps}
    )
    return built(restore(jnp.asarray(found.x)), rows, piece)


def _numbers(count: int, draw: Int[np.ndarray, " query"]) -> Int[np.ndarray, " sample"]:
    """A stretch of its own for every query, and one for all other samples."""
    own = np.full(count, -1)
    own[draw] = np.arange(draw.size)
    return own


@jax.jit
def _foretold(
    shape: Shape, middle: Shape, rows: Rows, draw: Array, near: Array, used: Array
) -> tuple[Float[Array, ""], Shape]:
    def cost(at: Shape) -> Float[Array, ""]:
        mean, variance = _beliefs(at, rows, rows.inputs[draw], near, used)
        precision = rows.precision[draw]
        known = precision > 0.0
        own = jnp.where(known, 1.0 / jnp.where(known, precision, 1.0), 1.0)
        total = variance + own + jnp.exp(at.noise)[None, :]
        terms = jnp.log(total) + (rows.values[draw] - mean) ** 2 / total
        prior = sum(
            0.5 * jnp.sum(((one - other) / WIDE) ** 2)
            for one, other in zip(at, middle, strict=True)
        )
        return 0.5 * jnp.sum(jnp.where(known, terms, 0.0)) + prior

    return jax.value_and_grad(cost)(shape)
