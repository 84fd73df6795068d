"""What may be said of a ranking: who is named, who cannot be told apart, when to be silent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.hypothesis import Ranked

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
STRAIN = 3.0
"""A value of the file that had to go further than so many of its sigmas."""


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


def sustained(answer: Verdict, gained: float) -> Verdict:
    """The verdict, unless it accuses and what took no part is foretold no better for it.

    Something that no cause here stands for is explained by those there are only where it was
    fitted.

    Args:
        answer: as the ranking has it.
        gained: log predictive density that the causes gain on what took no part; nan where
            nothing took none.
    """
    if answer.answer not in ("effect", "ambiguous") or not gained <= 0.0:
        return answer
    return replace(answer, answer="insufficient_data", indistinguishable=())


def _rival(item: Ranked, best: Ranked) -> bool:
    """Whether a set that is not the best one with more added explains about as much."""
    more = set(best.causes) <= set(item.causes)
    close = _support(best) - _support(item) < RIVAL
    return bool(item.causes) and not more and close and len(item.causes) <= len(best.causes)


def _support(item: Ranked) -> float:
    """Evidence and prior: one derivative among dozens has less of the latter."""
    return item.log_bayes_factor + float(np.log(item.prior))


def would_show(
    candidates: Sequence[Candidate],
    deviations: Sequence[Sequence[float]],
    sizes: Mapping[str, float],
) -> tuple[bool, ...]:
    """For each cause, whether these flights would have shown one of a size that matters.

    Args:
        candidates: the causes; single derivatives, of which there are dozens, are left out.
        deviations: how well the flights would know the parameters of each.
        sizes: what `Parameter.matters` is a share of.
    """
    return tuple(
        any(
            SHOWN * deviation <= parameter.matters * sizes[parameter.per]
            for deviation, parameter in zip(spread, candidate.cause.parameters, strict=True)
        )
        for candidate, spread in zip(candidates, deviations, strict=True)
        if candidate.cause.about != "derivative"
    )


def strained(
    names: Sequence[str], sigma: Float[np.ndarray, " unknown"], best: Ranked
) -> dict[str, float]:
    """Values of the file that had to go beyond `STRAIN` of their sigmas, the farthest first.

    A file that had to be bent that far is not free of error, whatever the causes say. What belongs
    to one flight, such as the bias of its accelerometer, is no value of the file.

    Args:
        names: of the unknowns; those of one flight have a `#`.
        sigma: ordinary standard deviation of each, 0 for what only causes free.
        best: the hypothesis.
    """
    bent = best.posterior.mean / np.where(sigma > 0.0, sigma, np.inf)
    freed = {name for candidate in best.causes for name in candidate.frees}
    listed = {
        name.removeprefix("aerodynamics."): float(value)
        for name, value in zip(names, bent, strict=True)
        if abs(value) > STRAIN and name not in freed and "#" not in name
    }
    return dict(sorted(listed.items(), key=lambda item: -abs(item[1])))
