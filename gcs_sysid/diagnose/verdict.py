"""What may be said of a ranking: who is named, who cannot be told apart, when to be silent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.hypothesis import Estimate, Ranked

Answer = Literal["effect", "no_effect", "ambiguous", "unlisted_effect", "insufficient_data"]

NAMED = float(np.log(20.0))
"""Evidence against nothing being wrong from which a cause is named: 20 to 1, strong on the scale of
Kass & Raftery 1995."""
RIVAL = float(np.log(10.0))
"""Sets of causes that evidence and prior favour less than this apart cannot be told apart. What
evidence alone has `NAMED` apart is no rival of something else, however usual it is."""
GROUP = 3
"""Causes that a group which cannot be told apart may hold beside what is sure, to be of any use."""
QUIET = 0.7
"""Probability of nothing being wrong from which a flight is called free of causes."""
SHOWN = 3.0
"""A flight would show a cause of a size that matters if that is so many standard deviations."""
MENTIONED = 0.2
"""Probability from which a cause that is not sure is mentioned beside those that are."""
SURE = 1.96
"""A cause is named whose size is so many of its deviations from none: none is outside its 95 %."""
STRAIN = 3.0
"""A value of the file that had to go further than so many of its sigmas."""
INCREDIBLE = 4.0
"""Sigmas of a cause beyond which its size is not believed: a tenth of an inertia in yaw was once
asked for in the place of a missing term."""


@dataclass(frozen=True)
class Verdict:
    """The answer, and what it speaks of.

    Attributes:
        answer: in one word.
        best: the set that is named, or the most probable one.
        indistinguishable: sets that explain as much.
        ranked: sets of causes, the most probable first, each with those that only add to `best`
            what is not sure.
        perhaps: probability of each cause beside those that are named.
        sizes: of each of these, in the most probable set that holds it beside what is named.
    """

    answer: Answer
    best: Ranked
    indistinguishable: tuple[Ranked, ...]
    ranked: tuple[Ranked, ...]
    perhaps: Mapping[Candidate, float]
    sizes: Mapping[Candidate, tuple[Estimate, ...]] = field(default_factory=dict)

    @property
    def sure(self) -> tuple[Candidate, ...]:
        """What all sets that explain as much have in common, in the order of the best."""
        return tuple(
            one
            for one in self.best.causes
            if all(one in item.causes for item in self.indistinguishable)
        )


def judge(ranked: Sequence[Ranked], shown: Sequence[bool]) -> Verdict:
    """What the ranking allows to say.

    Of several causes that act together some may be sure and others not: named is what all sets have
    in common that explain about as much, if that by itself is one of them. Otherwise something is
    at work beside it, and which of a few it is cannot be told. Where these are many, what is sure
    is named, and they are what is perhaps beside it: of a real aircraft five things are wrong, and
    that three of them are is worth knowing. Nobody is named for a size that may be none.

    Args:
        ranked: sets of causes, the most probable first.
        shown: for each single cause, whether the flights would have shown one that matters.
    """
    best = ranked[0]
    if best.causes and best.log_bayes_factor >= NAMED:
        alike = (best, *(item for item in ranked if _rival(item, best)))
        sure = set(best.causes).intersection(*(item.causes for item in alike))
        named = next((item for item in alike if set(item.causes) == sure), None)
        if named is None:
            at_work = {one for item in alike for one in item.causes}
            if not sure or len(at_work) - len(sure) <= GROUP:
                return Verdict("ambiguous", best, alike, tuple(ranked), {})
            named = _part(best, sure)
        told = _told(named)
        if not told:
            return Verdict("insufficient_data", best, (), tuple(ranked), {})
        if told < set(named.causes):
            named = _part(named, told)
        named, rest = _with_its_supersets(ranked, named)
        perhaps = _perhaps(ranked, named)
        sizes = {one: _size(ranked, named, one) for one in perhaps}
        return Verdict("effect", named, (named,), (named, *rest), perhaps, sizes)
    enough = sum(shown) * 2 >= len(shown) and len(shown) > 0
    quiet = not best.causes and best.probability >= QUIET
    answer: Answer = "no_effect" if quiet and enough else "insufficient_data"
    return Verdict(answer, best, (), tuple(ranked), {})


def _told(named: Ranked) -> set[Candidate]:
    """Causes whose size is another than none, as stated: of several parameters, one at least.

    A rudder that was named for a lag of −0.043 ± 0.043 s stood in for a mass and an airspeed,
    which cost more beforehand. What was weighed at another size than it has is stated as unsure.
    """
    found = set(named.causes)
    for one, estimates in zip(named.causes, named.estimates, strict=False):
        # Where something begins, or the rate that limits it, is no size.
        sizes = [item for item in estimates if item.name != one.cause.where]
        if sizes and all(abs(item.value - item.nominal) <= SURE * item.deviation for item in sizes):
            found.discard(one)
    return found


def _part(best: Ranked, sure: Set[Candidate]) -> Ranked:
    """Some causes of a set, with the sizes that they have beside its others."""
    kept = [number for number, one in enumerate(best.causes) if one in sure]
    estimates = tuple(best.estimates[number] for number in kept)
    return replace(best, causes=tuple(best.causes[number] for number in kept), estimates=estimates)


def _with_its_supersets(
    ranked: Sequence[Ranked], named: Ranked
) -> tuple[Ranked, tuple[Ranked, ...]]:
    """A set with the probability of all that hold it, and the others."""
    holds = [set(named.causes) <= set(item.causes) for item in ranked]
    total = sum(item.probability for item, held in zip(ranked, holds, strict=True) if held)
    others = (item for item, held in zip(ranked, holds, strict=True) if not held)
    return replace(named, probability=total), tuple(others)


def _perhaps(ranked: Sequence[Ranked], named: Ranked) -> dict[Candidate, float]:
    """Probability of each cause that is in sets with the named ones, those worth mentioning."""
    found: dict[Candidate, float] = {}
    for item in ranked:
        if set(named.causes) < set(item.causes):
            for candidate in set(item.causes) - set(named.causes):
                found[candidate] = found.get(candidate, 0.0) + item.probability
    listed = sorted(found.items(), key=lambda each: -each[1])
    return {candidate: share for candidate, share in listed if share >= MENTIONED}


def _size(ranked: Sequence[Ranked], named: Ranked, one: Candidate) -> tuple[Estimate, ...]:
    """Of a cause beside those that are named, as the most probable set of them has it."""
    holds = (item for item in ranked if {*named.causes, one} <= set(item.causes))
    best = max(holds, key=lambda item: item.probability)
    return dict(zip(best.causes, best.estimates, strict=False)).get(one, ())


def sustained(answer: Verdict, gained: float, against: float = 0.0) -> Verdict:
    """The verdict, unless it accuses and what took no part is foretold no better for it.

    Nor where what took no part speaks against it by as much as it would take to be named.

    Something that no cause here stands for is explained by those there are only where it was
    fitted.

    Args:
        answer: as the ranking has it.
        gained: log predictive density that the causes gain on what took no part; nan where
            nothing took none.
        against: evidence of what took no part against the causes [nat]; likewise.
    """
    refused = gained <= 0.0 or against >= NAMED
    if answer.answer not in ("effect", "ambiguous") or not refused:
        return answer
    return replace(answer, answer="insufficient_data", indistinguishable=())


def credible(answer: Verdict, farthest: float) -> Verdict:
    """The verdict, unless it accuses by a size that nobody would believe of its cause.

    Such a cause stands in for something that is in no catalogue.

    Args:
        answer: as the ranking has it.
        farthest: by how many of its own sigmas the cause's most extreme size is off.
    """
    if answer.answer not in ("effect", "ambiguous") or farthest < INCREDIBLE:
        return answer
    return replace(answer, answer="insufficient_data", indistinguishable=())


def _rival(item: Ranked, best: Ranked) -> bool:
    """Whether a set that is not the best one or that with more added explains about as much."""
    more = set(best.causes) <= set(item.causes)
    less = set(item.causes) < set(best.causes)
    close = _support(best) - _support(item) < RIVAL
    close &= less or best.log_bayes_factor - item.log_bayes_factor < NAMED
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
