"""What is foretold of sets of causes, held against what searches with them reached.

Evidence about one point is of the flights as far from there as a set of causes says to go. Where
gains of the filter change on the way, that is a promise: about the end of one search another set
was 20 nats more probable, the search with which had stood still 50 nats of steps short of what
these promised. A set that was searched is worth what its search reached.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gcs_sysid.diagnose.aided.ranking import ACCURACIES, Needed, Overrated, density, labels, rank
from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information, posterior
from gcs_sysid.offline.question import Answer


class Reached(NamedTuple):
    """The end of a search with a set of causes.

    Attributes:
        causes: which.
        information: what flights say there.
        left: what steps would still gain, each measurement counting for as much as there [nat].
        listed: all unknowns, with what servos' changes were reckoned with.
    """

    causes: tuple[Candidate, ...]
    information: Information
    left: float
    listed: Unknowns


def reached(answer: Answer, listed: Unknowns) -> Reached:
    """Of an answer no more than is asked for later: its instruments are a hundred megabytes."""
    rows = sum(one.told.count for one in answer.each)
    left = answer.left * answer.information.count / rows
    return Reached(answer.causes, answer.information, left, listed)


def overrated(standing: Reached, others: Sequence[Reached]) -> tuple[Overrated, ...]:
    """By how much sets that were searched seem more probable than they are, from elsewhere.

    Args:
        standing: where flights stand.
        others: ends of other searches; of those with the same causes the best counts.
    """
    found = dict[frozenset[str], Overrated]()
    here = labels(standing.causes)
    for one in others:
        if labels(one.causes) == here:
            continue
        count = min(each.information.count for each in (standing, one))
        foretold = _density(standing, one.causes, count) - _scaled(standing, count)
        kept = _density(one, one.causes, count) - _scaled(one, count)
        extra = tuple(each for each in one.causes if labels([each]) - here)
        missing = tuple(each for each in standing.causes if labels([each]) - labels(one.causes))
        told = Overrated(extra, missing, foretold - kept)
        before = found.get(searched := frozenset(labels(one.causes)))
        if before is None or told.by < before.by:
            found[searched] = told
    return tuple(found.values())


def likelier(there: Reached, here: Reached, every: Sequence[Candidate], needed: Needed) -> bool:
    """Whether flights are more probable with the best set about one end than about the other."""
    count = min(each.information.count for each in (there, here))
    bare = needed._replace(overrated=())

    def best(one: Reached) -> float:
        told = _weighed(one, count)
        return density(told, rank(told, one.listed, every, bare)[0]) - _scaled(one, count)

    return best(there) > best(here)


def _weighed(one: Reached, count: float) -> Information:
    """What flights say at an end, each measurement counting for as much as elsewhere."""
    return one.information.weighed(count / one.information.count)


def _scaled(one: Reached, count: float) -> float:
    return one.left * count / one.information.count


def _density(one: Reached, causes: Sequence[Candidate], count: float) -> float:
    """Of flights and beliefs about an end."""
    data = _weighed(one, count)
    each = [
        posterior(data, *one.listed.as_accurate(share).freed(causes)).log_evidence + np.log(prior)
        for share, prior in ACCURACIES.items()
    ]
    return float(data.shared + max(each))
