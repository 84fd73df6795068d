"""From what size on flights name a cause, and tell it from every other.

Of flights that show just what a cause of size x does, and no noise, the evidence of every
hypothesis is a parabola in x: known at three sizes it is known at all. Where it reaches what names
a cause, half of the flights with that cause would name it, since noise takes as often as it gives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gcs_sysid.diagnose.aided.ranking import shares
from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information, Posterior, gained, posterior
from gcs_sysid.diagnose.verdict import NAMED, RIVAL


class Power(NamedTuple):
    """Of one parameter of a cause, in its unit; infinite where no size is enough.

    Attributes:
        named: from here on it is named, alone or beside others that explain as much.
        alone: from here on nothing else explains as much.
        rival: what does up to there; None where nothing does.
    """

    named: float
    alone: float
    rival: Candidate | None


def of_flights(
    data: Information, unknowns: Unknowns, candidates: Sequence[Candidate]
) -> tuple[tuple[Power, ...], ...]:
    """For each cause, what these flights could say of each of its parameters.

    Args:
        data: information of the flights; what they found does not come into it.
        unknowns: with the accuracy that the file has.
        candidates: causes at all their places. A single derivative is no less of a rival.
    """
    nothing = posterior(replace(data, score=np.zeros_like(data.score)), *unknowns.freed(()))
    moved = nothing.covariance @ data.gram
    prior = np.log([shares(candidates)[one.label] for one in candidates])
    found = []
    for place, candidate in enumerate(candidates):
        powers = []
        for name in candidate.frees:
            column = moved[:, unknowns.names.index(name)]
            grown = np.array([_parabola(nothing, column, unknowns, one) for one in candidates])
            others = []
            for other, one in enumerate(candidates):
                if one.label != candidate.label:
                    ahead = grown[place] - grown[other]
                    apart = min(NAMED, RIVAL - prior[place] + prior[other])
                    others.append((_reached(ahead, apart), other))
            named = _reached(grown[place], NAMED)
            alone, rival = max(others, default=(0.0, place))
            beaten = alone <= named
            powers.append(Power(named, max(named, alone), None if beaten else candidates[rival]))
        found.append(tuple(powers))
    return tuple(found)


def _parabola(
    nothing: Posterior,
    moved: Float[np.ndarray, " unknown"],
    unknowns: Unknowns,
    candidate: Candidate,
) -> Float[np.ndarray, " 3"]:
    """Evidence of a cause against nothing [nat]: constant, linear and square in the true size.

    Args:
        nothing: posterior of the file as it is, by flights that show nothing.
        moved: by how much a true size of 1 moves its mean.
        unknowns: of which the cause frees some.
        candidate: the cause.
    """
    before, (after, mean) = unknowns.sigma, unknowns.freed((candidate,))
    chosen = np.flatnonzero((after != before) | (mean != 0.0))
    given = (before[chosen], chosen, after[chosen], mean[chosen])

    sizes = np.array([-1.0, 0.0, 1.0])
    less, still, more = gained(sizes[:, None] * moved, nothing.covariance, *given)
    return np.array([still, 0.5 * (more - less), 0.5 * (more + less) - still])


def _reached(parabola: Float[np.ndarray, " 3"], wanted: float) -> float:
    """The size beyond which a parabola stays above a value; infinite where it does not."""
    constant, slope, square = parabola
    if square <= 0.0:
        return 0.0 if square == slope == 0.0 and constant >= wanted else np.inf
    under = slope**2 - 4.0 * square * (constant - wanted)
    return max(0.0, float((np.sqrt(under) - slope) / (2.0 * square))) if under > 0.0 else 0.0
