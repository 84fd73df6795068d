"""What may be said of a ranking: who is named, who cannot be told apart, when to be silent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information, posterior
from gcs_sysid.diagnose.ranking import Ranked, sigma_under
from gcs_sysid.diagnose.unknowns import Columns

Answer = Literal["effect", "no_effect", "ambiguous", "unlisted_effect", "insufficient_data"]

NAMED = float(np.log(20.0))
"""Evidence against nothing being wrong from which a cause is named: 20 to 1, strong on the scale of
Kass & Raftery 1995."""
RIVAL = float(np.log(10.0))
"""Sets of causes that the evidence favours less than this apart cannot be told apart."""
QUIET = 0.7
"""Probability of nothing being wrong from which a flight is called free of causes."""
SHOWN = 3.0
"""A flight would show a cause of a size that matters if that is so many standard deviations."""


@dataclass(frozen=True)
class Verdict:
    """The answer, the set it names (or the best one), and those that explain as much."""

    answer: Answer
    best: Ranked
    indistinguishable: tuple[Ranked, ...]


def judge(ranked: Sequence[Ranked], shown: Sequence[bool]) -> Verdict:
    """What the ranking allows to say.

    Args:
        ranked: sets of causes, the most probable first.
        shown: for each single cause, whether the flights would have shown one that matters.
    """
    best = ranked[0]
    if best.causes and best.log_bayes_factor >= NAMED:
        rivals = tuple(item for item in ranked if _rival(item, best))
        if rivals:
            return Verdict("ambiguous", best, (best, *rivals))
        return Verdict("effect", best, (best,))
    enough = sum(shown) * 2 >= len(shown) and len(shown) > 0
    quiet = not best.causes and best.probability >= QUIET
    answer: Answer = "no_effect" if quiet and enough else "insufficient_data"
    return Verdict(answer, best, ())


def sustained(answer: Verdict, *, before: float, after: float) -> Verdict:
    """The verdict, unless it accuses and what took no part is foretold no better with it put right.

    Something that no cause here stands for, as a servo that is late, is explained by those there
    are only where it was fitted.

    Args:
        answer: as the ranking has it.
        before: negative log predictive density of what took no part, with the file as it is.
        after: with the best set of causes put right.
    """
    if answer.answer not in ("effect", "ambiguous") or after < before:
        return answer
    return replace(answer, answer="insufficient_data", indistinguishable=())


def _rival(item: Ranked, best: Ranked) -> bool:
    """Whether a set that is not the best one with more added explains about as much."""
    more = set(best.causes) <= set(item.causes)
    close = best.log_bayes_factor - item.log_bayes_factor < RIVAL
    return bool(item.causes) and not more and close and len(item.causes) <= len(best.causes)


def would_show(
    data: Information, columns: Columns, candidates: Sequence[Candidate]
) -> tuple[bool, ...]:
    """For each cause, whether these flights would have shown one of a size that matters."""
    found = []
    for candidate in candidates:
        under = posterior(data, sigma_under((candidate,), columns))
        deviations = [
            np.sqrt(under.covariance[index, index])
            for index in (columns.names.index(name) for name in candidate.frees)
        ]
        found.append(
            all(
                SHOWN * deviation <= parameter.matters
                for deviation, parameter in zip(deviations, candidate.cause.parameters, strict=True)
            )
        )
    return tuple(found)
