"""What the global part leaves: the neighbours of each query, a covariance that is not stationary.

The covariance is that of a network of infinitely many neurons: it bends where the data bend and
goes straight on beyond them, where the stationary one of the global part falls back to zero. For
each query the k nearest samples (k-d tree) make an exact posterior of their own,

    k(x, x') = s² (2/π) asin( 2 x̃ᵀΣx̃' / √((1 + 2 x̃ᵀΣx̃)(1 + 2 x̃'ᵀΣx̃')) ),   x̃ = (1, x),

Σ diagonal. Its hyper-parameters are those that foretell samples best from neighbours of *other*
stretches of flight: neighbours in time share their errors, and would be foretold by them.

NumPy throughout: compiled batches of small factorisations stopped for good now and then on two
cores (jaxlib 0.10), waiting for a thread that waited for them.

References:
    C. K. I. Williams, "Computation with infinite neural networks", Neural Computation 10, 1998;
    S. Vasudevan et al., "Gaussian process modeling of large-scale terrain", J. Field Robotics 26,
    2009.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from gcs_sysid.gp.posterior import Belief
from gcs_sysid.gp.samples import Rows

NEIGHBOURS = 32
AT_ONCE = 256
"""Queries answered together: bounds the memory."""
SPARE = 8
"""So many times as many are looked up where those of the query's own stretch do not count."""
OFF = 1e6
"""Noise, in variances of the process, that takes a sample out."""
CONSTANT = (0.1, 1.0, 10.0)
STEEPNESS = (0.01, 0.1, 1.0)
"""Σ of the constant and of every input that are tried: from nearly straight to many bends."""
SHARE = (0.01, 0.03, 0.1, 0.3, 1.0)
REST = (0.0, 0.3, 1.0)
"""Variance of the process, and of noise beside the samples' own, over that of what is left."""


class Shape(NamedTuple):
    """Hyper-parameters.

    Attributes:
        weights: Σ, of the constant and of each input.
        variance: s² of each output.
        noise: variance of each output that the samples' own errors do not explain.
    """

    weights: Float[np.ndarray, " weight"]
    variance: Float[np.ndarray, " output"]
    noise: Float[np.ndarray, " output"]


class Store(NamedTuple):
    """Samples; values are what the global part left. See `samples.Rows`."""

    inputs: Float[np.ndarray, "sample input"]
    values: Float[np.ndarray, "sample output"]
    precision: Float[np.ndarray, "sample output"]
    piece: Int[np.ndarray, " sample"]


@dataclass(frozen=True)
class Local:
    """Samples, found by their inputs.

    Attributes:
        shape: of the covariance.
        store: samples and the stretch of flight of each.
        tree: over the inputs.
    """

    shape: Shape
    store: Store
    tree: KDTree


def built(shape: Shape, store: Store) -> Local:
    """The samples made ready for queries."""
    return Local(shape, store, KDTree(store.inputs))


def stored(rows: Rows, piece: Int[np.ndarray, " sample"]) -> Store:
    """Samples as the local part keeps them."""
    inputs, values, precision = (np.asarray(part) for part in rows)
    return Store(inputs, values, precision, np.asarray(piece))


def neural(
    weights: Float[np.ndarray, " weight"],
    left: Float[np.ndarray, "*query left input"],
    right: Float[np.ndarray, "*query right input"],
) -> Float[np.ndarray, "*query left right"]:
    """The covariance for s = 1."""
    product = 2.0 * (weights[0] + (left * weights[1:]) @ np.swapaxes(right, -1, -2))
    ends = [1.0 + 2.0 * (weights[0] + np.sum(one**2 * weights[1:], -1)) for one in (left, right)]
    ratio = product / np.sqrt(ends[0][..., :, None] * ends[1][..., None, :])
    return (2.0 / np.pi) * np.arcsin(ratio)


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
    near, counts = neighbours(local, inputs, piece)
    parts = []
    for start in range(0, inputs.shape[0], AT_ONCE):
        some = slice(start, start + AT_ONCE)
        parts.append(_beliefs(local.shape, local.store, inputs[some], near[some], counts[some]))
    return Belief(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def neighbours(
    local: Local,
    inputs: Float[np.ndarray, "sample input"],
    piece: Int[np.ndarray, " sample"] | None,
) -> tuple[Int[np.ndarray, "sample near"], Float[np.ndarray, "sample near"]]:
    """Indices of the nearest samples, and 1 for each that counts, 0 for those that do not."""
    total = local.store.piece.size
    few = min(NEIGHBOURS, total)
    if piece is None:
        near = local.tree.query(inputs, k=np.arange(1, few + 1))[1]
        return near, np.ones(near.shape)
    near = local.tree.query(inputs, k=np.arange(1, min(SPARE * NEIGHBOURS, total) + 1))[1]
    other = local.store.piece[near] != piece[:, None]
    first = np.argsort(~other, axis=1, kind="stable")[:, :few]
    return np.take_along_axis(near, first, 1), np.take_along_axis(other, first, 1).astype(float)


def _beliefs(
    shape: Shape,
    store: Store,
    inputs: Float[np.ndarray, "query input"],
    near: Int[np.ndarray, "query near"],
    counts: Float[np.ndarray, "query near"],
) -> tuple[Float[np.ndarray, "query output"], Float[np.ndarray, "query output"]]:
    there = store.inputs[near]
    here = inputs[:, None, :]
    between = neural(shape.weights, there, there)
    across = neural(shape.weights, here, there)[:, 0]
    alone = neural(shape.weights, here, here)[:, 0, 0]
    columns = [
        _output(size, rest, between, across, alone, values, precision * counts)
        for size, rest, values, precision in zip(
            shape.variance,
            shape.noise,
            np.moveaxis(store.values[near], 2, 0),
            np.moveaxis(store.precision[near], 2, 0),
            strict=True,
        )
    ]
    mean, variance = zip(*columns, strict=True)
    return np.stack(mean, axis=1), np.stack(variance, axis=1)


def _output(
    size: float,
    rest: float,
    between: Float[np.ndarray, "query near near"],
    across: Float[np.ndarray, "query near"],
    alone: Float[np.ndarray, " query"],
    values: Float[np.ndarray, "query near"],
    precision: Float[np.ndarray, "query near"],
) -> tuple[Float[np.ndarray, " query"], Float[np.ndarray, " query"]]:
    counted = precision > 0.0
    own = np.where(counted, 1.0 / np.where(counted, precision, 1.0) + rest, OFF * size)
    matrix = size * between + own[:, :, None] * np.eye(own.shape[1])
    gain = np.linalg.solve(matrix, size * across[:, :, None])[:, :, 0]
    mean = np.sum(gain * np.where(counted, values, 0.0), axis=1)
    left = size * (alone - np.sum(gain * across, axis=1))
    return mean, np.maximum(left, 1e-9 * size)


def learned(store: Store, *, queries: int, seed: int) -> Local:
    """Hyper-parameters that foretell `queries` of the samples best from other stretches of flight.

    Args:
        store: samples; with one stretch alone every query asks all samples but itself.
        queries: samples that are foretold.
        seed: of their draw.
    """
    total = store.piece.size
    draw = np.random.default_rng(seed).permutation(total)[:queries]
    if np.unique(store.piece).size == 1:
        store = store._replace(piece=np.arange(total))
    known = store.precision > 0.0
    power = np.sum(np.where(known, store.values, 0.0) ** 2, axis=0)
    spread = np.maximum(power / np.maximum(known.sum(axis=0), 1), 1e-12)
    plain = built(Shape(np.ones(store.inputs.shape[1] + 1), spread, spread), store)
    near, counts = neighbours(plain, store.inputs[draw], store.piece[draw])
    tried = []
    for constant, steep in itertools.product(CONSTANT, STEEPNESS):
        weights = np.array([constant, *np.full(store.inputs.shape[1], steep)])
        cost, variance, noise = _sizes(weights, spread, store, draw, near, counts)
        tried.append((float(cost.sum()), Shape(weights, variance, noise)))
    return built(min(tried, key=lambda one: one[0])[1], store)


def _sizes(
    weights: Float[np.ndarray, " weight"],
    spread: Float[np.ndarray, " output"],
    store: Store,
    draw: Int[np.ndarray, " query"],
    near: Int[np.ndarray, "query near"],
    counts: Float[np.ndarray, "query near"],
) -> tuple[
    Float[np.ndarray, " output"], Float[np.ndarray, " output"], Float[np.ndarray, " output"]
]:
    """Cost, and best variances of process and noise, output by output, for given weights."""
    values, precision = store.values[draw], store.precision[draw]
    known = precision > 0.0
    own = 1.0 / np.where(known, precision, 1.0)
    cost = np.full(spread.size, np.inf)
    variance, noise = spread.copy(), spread.copy()
    for share, rest in itertools.product(SHARE, REST):
        tried = Shape(weights, share * spread, rest * spread)
        mean, left = _beliefs(tried, store, store.inputs[draw], near, counts)
        total = left + own + tried.noise
        density = np.log(total) + (values - mean) ** 2 / total
        tried_cost = np.sum(np.where(known, density, 0.0), axis=0)
        better = tried_cost < cost
        cost = np.where(better, tried_cost, cost)
        variance = np.where(better, tried.variance, variance)
        noise = np.where(better, tried.noise, noise)
    return cost, variance, noise
