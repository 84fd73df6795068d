"""Which values to keep: those that tell most about the rest.

Mutual information takes, one after another, the value with the largest

    ½ ln( var[y | chosen] / var[y | all that are not chosen] ),

so that a point is worth more the more it says about others, which for dependent outputs are points
of other outputs too; entropy takes the largest var[y | chosen] and goes to the edge of the data.
The gain never grows as points are chosen, so that the greedy choice is within 1 − 1/e of the best.

Both variances fall (or rise) by one square a step, and only the chosen value's column is worked
out: n m² for m out of n, after one inverse. A queue of gains that may be stale saves nothing here.

References:
    A. Krause, A. Singh, C. Guestrin, "Near-optimal sensor placements in Gaussian processes", JMLR
    9, 2008.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import jax
import numpy as np
from jaxtyping import Float, Int
from scipy.cluster import vq

from gcs_sysid.errors import UsageError
from gcs_sysid.gp import dependent
from gcs_sysid.gp.dependent import Kernel, Points

Method = Literal["mutual information", "entropy", "random", "k-means"]
_covariance = jax.jit(dependent.covariance)
Chosen = Int[np.ndarray, " chosen"]
PADDED = 256
"""Candidates are as many as outputs were measured, another number at every learning; in steps of so
many the covariance is compiled a few times and not each time, which took time and kept memory."""


def choose(
    method: Method,
    kernel: Kernel,
    candidates: Points,
    noise: Float[np.ndarray, " point"],
    count: int,
    *,
    seed: int,
) -> Chosen:
    """Indices of `count` candidates, the most telling first where there is an order.

    Args:
        method: how.
        kernel: covariance of the outputs.
        candidates: values of single outputs.
        noise: variance of each.
        count: how many; all where there are fewer.
        seed: of `random` and of `k-means`.

    Raises:
        UsageError: `method` is none of the four.
    """
    methods: dict[str, Callable[[], Chosen]] = {
        "mutual information": lambda: mutual_information(kernel, candidates, noise, count),
        "entropy": lambda: entropy(kernel, candidates, noise, count),
        "random": lambda: random(candidates, count, seed=seed),
        "k-means": lambda: k_means(candidates, count, seed=seed),
    }
    if method not in methods:
        raise UsageError(f"method `{method}`; choose one of {', '.join(methods)}")
    return methods[method]()


def mutual_information(
    kernel: Kernel, candidates: Points, noise: Float[np.ndarray, " point"], count: int
) -> Chosen:
    """The greedy choice by mutual information between what is chosen and what is not."""
    matrix = _matrix(kernel, candidates, noise)
    precision = np.linalg.inv(matrix)
    return _greedy(matrix, precision, count, lambda given, rest: np.log(given) + np.log(rest))


def entropy(
    kernel: Kernel, candidates: Points, noise: Float[np.ndarray, " point"], count: int
) -> Chosen:
    """The greedy choice of the least known."""
    matrix = _matrix(kernel, candidates, noise)
    return _greedy(matrix, np.eye(matrix.shape[0]), count, lambda given, _: given)


def random(candidates: Points, count: int, *, seed: int) -> Chosen:
    """Any."""
    total = candidates.output.size
    return np.random.default_rng(seed).permutation(total)[:count]


def k_means(candidates: Points, count: int, *, seed: int) -> Chosen:
    """The candidates nearest to the centres of clusters, the outputs served in turn."""
    inputs, output = np.asarray(candidates.inputs), np.asarray(candidates.output)
    kinds = np.unique(output)
    chosen: list[int] = []
    for turn, kind in enumerate(kinds):
        own = np.flatnonzero(output == kind)
        share = min(count // kinds.size + (turn < count % kinds.size), own.size)
        if share == 0:
            continue
        # A few clusters may end empty, which is a warning there and harmless here.
        centres, _ = (
            vq.kmeans2(
                inputs[own],
                share,
                minit="++",
                rng=np.random.default_rng(seed + turn),
                missing="warn",
            )
            if share < own.size
            else (inputs[own], None)
        )
        distance = np.sum((inputs[own][:, None, :] - centres[None, :, :]) ** 2, axis=2)
        taken: list[int] = []
        for column in distance.T:
            order = np.argsort(column, kind="stable")
            taken.append(int(next(index for index in order if index not in taken)))
        chosen += own[taken].tolist()
    return np.array(chosen, dtype=int)


def _matrix(
    kernel: Kernel, candidates: Points, noise: Float[np.ndarray, " point"]
) -> Float[np.ndarray, "point point"]:
    count = np.asarray(candidates.output).size
    filled = np.minimum(np.arange(-(-count // PADDED) * PADDED), count - 1)
    padded = take(candidates, filled)
    covariance = np.asarray(_covariance(kernel, padded, padded))[:count, :count]
    return covariance + np.diag(np.asarray(noise))


def _greedy(
    matrix: Float[np.ndarray, "point point"],
    precision: Float[np.ndarray, "point point"],
    count: int,
    gain: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> Chosen:
    """Takes the largest `gain` of the variance given the chosen and of the precision in the rest.

    Choosing y conditions the others on it, Σ ← Σ − Σ_y Σ_yᵀ/Σ_yy, and takes it out of the rest,
    whose precision then loses P_y P_yᵀ/P_yy.
    """
    total = matrix.shape[0]
    count = min(count, total)
    given, rest = np.diagonal(matrix).copy(), np.diagonal(precision).copy()
    down, out = np.zeros((count, total)), np.zeros((count, total))
    chosen = np.zeros(count, dtype=int)
    free = np.ones(total, dtype=bool)
    for step in range(count):
        score = np.where(free, gain(np.maximum(given, 1e-300), np.maximum(rest, 1e-300)), -np.inf)
        best = int(np.argmax(score))
        chosen[step], free[best] = best, False
        for columns, table, left in ((down, matrix, given), (out, precision, rest)):
            column = table[best] - columns[:step, best] @ columns[:step]
            columns[step] = column / np.sqrt(max(left[best], 1e-300))
            left -= columns[step] ** 2
    return chosen


def take(candidates: Points, chosen: Chosen) -> Points:
    """The chosen candidates."""
    return Points(np.asarray(candidates.inputs)[chosen], np.asarray(candidates.output)[chosen])
