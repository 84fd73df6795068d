"""Choice of a model's terms by the data: from the usual ones, forward with a backward check.

Starting from nothing would never find the roll of a well damped aircraft: rate and aileron cancel,
and neither explains anything without the other. A term enters when the evidence for it exceeds
`ENTER` and it explains at least `LEAST_GAIN` of the variation; one for which it has fallen below
`LEAVE` goes.

The evidence is the logarithm of a Bayes factor: of k terms on n independent samples that leave the
mean square s²,

    ln p(data | terms) = −(n/2) ln s² − (k/2) ln n + constant,

the prior of each term being worth one independent sample (Schwarz, *Ann. Statist.* 6, 1978, p. 461;
Kass & Wasserman, *JASA* 90, 1995, p. 928). Residuals are coloured, so that n is far less than the
number of samples; with that number false terms get in.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from gcs_sysid import regressors
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate import equation_error
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.estimate.equation_error import Problem

ENTER = 5.0
"""Logarithm of the Bayes factor from which a term is taken in: 2 ln B > 10, "very strong" (Kass &
Raftery, *JASA* 90, 1995, p. 777)."""
LEAVE = 1.0
"""Below this a term is no better than none: "not worth more than a bare mention" there."""
LEAST_GAIN = 0.005
MOTION = ("alpha", "beta", "phat", "qhat", "rhat")


def candidates(aircraft: Aircraft) -> tuple[str, ...]:
    """Every term that may enter: linear, squares of the flow angles, α times the others."""
    linear = (*MOTION, *aircraft.control_names)
    products = (f"alpha*{name}" for name in linear if name != "alpha")
    keys = itertools.chain(linear, ("alpha^2", "beta^2"), products)
    return tuple(regressors.parse(key, controls=aircraft.control_names).key for key in keys)


def choose(
    flights: Sequence[Samples],
    aircraft: Aircraft,
    usual: Mapping[str, Sequence[str]],
    pieces: Sequence[Int[np.ndarray, " _sample"]],
) -> dict[str, tuple[str, ...]]:
    """Terms of each coefficient, chosen from `candidates` and the usual structure."""
    chosen = {}
    for name, keys in usual.items():
        if any(name in flight.refused for flight in flights):
            chosen[name] = tuple(keys)
            continue
        pool = tuple(dict.fromkeys((*keys, *candidates(aircraft))))
        everything = equation_error.problem(name, flights, aircraft, pool, pieces)
        chosen[name] = _select(everything, len(keys))
    return chosen


def _select(everything: Problem, usual: int) -> tuple[str, ...]:
    """Terms chosen, beginning with the constant and the first `usual` ones."""
    constant = everything.keys.index(regressors.CONSTANT)
    chosen = _pruned(everything, sorted({constant, *range(usual)}), {constant})
    while True:
        left = [index for index in range(len(everything.keys)) if index not in chosen]
        if not left:
            break
        base, independent = _remainder(everything, chosen)
        tried = {index: _remainder(everything, [*chosen, index])[0] for index in left}
        best = min(tried, key=lambda index: tried[index])
        gain = (base - tried[best]) / float(np.var(everything.measured))
        if evidence(base, tried[best], independent) < ENTER or gain < LEAST_GAIN:
            break
        chosen = _pruned(everything, [*chosen, best], {constant, best})
    return tuple(everything.keys[index] for index in sorted(chosen))


def _pruned(everything: Problem, chosen: Sequence[int], safe: Collection[int]) -> list[int]:
    """Drops superfluous terms, the weakest first; never one that is `safe`."""
    kept = list(chosen)
    while True:
        full, independent = _remainder(everything, kept)
        strength = {
            index: evidence(
                _remainder(everything, [item for item in kept if item != index])[0],
                full,
                independent,
            )
            for index in kept
            if index not in safe
        }
        weakest = min(strength, key=lambda index: strength[index], default=None)
        if weakest is None or strength[weakest] >= LEAVE:
            return kept
        kept.remove(weakest)


def evidence(without: float, with_it: float, independent: float) -> float:
    """Logarithm of the Bayes factor for one more term.

    Args:
        without: mean squared residual of the model without it.
        with_it: of the model with it.
        independent: samples that are independent of each other.
    """
    return 0.5 * independent * float(np.log(without / with_it)) - 0.5 * float(np.log(independent))


def _remainder(everything: Problem, chosen: Sequence[int]) -> tuple[float, float]:
    """Mean squared residual of a choice of terms, and its number of independent samples."""
    picked = list(chosen)
    part = replace(
        everything,
        keys=tuple(everything.keys[index] for index in picked),
        columns=everything.columns[:, picked],
        slopes=everything.slopes[:, :, picked],
        plausible=everything.plausible[picked],
    )
    residual = _residual(part)
    return float(np.mean(residual**2)), _independent(residual, everything.piece)


def _residual(problem: Problem) -> Float[np.ndarray, " sample"]:
    solution = np.linalg.lstsq(problem.columns, problem.measured, rcond=None)[0]
    return problem.measured - problem.columns @ solution


def _independent(
    residual: Float[np.ndarray, " sample"], piece: Int[np.ndarray, " sample"]
) -> float:
    """Independent samples of a residual by its lag-one correlation, N (1 − ρ) / (1 + ρ)."""
    same = piece[1:] == piece[:-1]
    centred = residual - residual.mean()
    correlation = float(np.mean((centred[1:] * centred[:-1])[same]) / np.mean(centred**2))
    share = (1.0 - correlation) / (1.0 + correlation)
    return residual.size * float(np.clip(share, 1e-4, 1.0))
