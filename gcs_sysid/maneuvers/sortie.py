"""Which maneuvers, how often and in which order: the most knowledge for the time in the air."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from gcs_sysid import regressors
from gcs_sysid.aircraft import MOMENTS
from gcs_sysid.estimate.result import AeroModel, CoefficientFit
from gcs_sysid.maneuvers import information
from gcs_sysid.maneuvers.design import AFTER, AROUND, ON_A_LEG, Maneuver
from gcs_sysid.maneuvers.information import Covariances
from gcs_sysid.maneuvers.knowledge import Knowledge
from gcs_sysid.maneuvers.target import Target

CAREFUL = (0.25, 0.5)
"""Shares of the amplitude at which a maneuver is tried first where the model is poor."""
POOR = 0.15
"""A model is poor where a moment is known worse than to this part of what it varied by, what mass
and inertia leave unsure apart: how an aircraft answers is known whatever they are."""
LEAST_WORTH = 0.01
"""A maneuver is left out that would make no stated deviation smaller by this part, and a sortie
ends where all are: what is left are errors of mass and inertia, which no maneuver takes away."""
SWEEPS = 3
"""Times that every run of a sortie is looked at for a better one in its place, at most."""


@dataclass(frozen=True)
class Step:
    """One run of a sortie.

    Attributes:
        maneuver: which.
        share: of its amplitude.
        leg: number of the leg, from one.
        direction: of it.
        begins: after the start of the sortie [s].
        worth: what it adds for the target, those before it flown.
    """

    maneuver: Maneuver
    share: float
    leg: int
    direction: Literal["out", "back"]
    begins: float
    worth: float


@dataclass(frozen=True)
class Sortie:
    """What to fly in one flight.

    Attributes:
        steps: in order.
        duration: of the whole, turns included [s].
        before: covariance of every coefficient's terms.
        after: the same once it is flown.
    """

    steps: tuple[Step, ...]
    duration: float
    before: Covariances
    after: Covariances


def cost(maneuver: Maneuver) -> float:
    """Flight time that a maneuver takes, its share of the turns included [s]."""
    return maneuver.recipe.duration + AFTER + AROUND


def poor(model: AeroModel) -> bool:
    """Whether the first steps must be careful ones."""
    return any(_unsure(fit) > POOR for name, fit in model.fits.items() if name in MOMENTS)


def _unsure(fit: CoefficientFit) -> float:
    """Deviation of a coefficient in the motions that it was learned from, over its own there.

    Not that of a derivative: one that hardly acts (yaw by roll rate) may be known to a fifth where
    what the aircraft does is known to a fiftieth.
    """
    moved = [index for index, key in enumerate(fit.keys) if key != regressors.CONSTANT]
    moved = [index for index in moved if fit.value[index] != 0.0]
    known = (fit.covariance - information.lasting(fit))[np.ix_(moved, moved)]
    acting = fit.excitation[moved] / np.abs(fit.value[moved])
    each = np.outer(acting, acting) * fit.correlation[np.ix_(moved, moved)] * known
    return float(np.sqrt(max(each.sum(), 0.0)))


def robust_worth(
    target: Target,
    model: AeroModel,
    known: Knowledge,
    maneuver: Maneuver,
    *,
    share: float = 1.0,
    before: Sequence[float] | None = None,
) -> float:
    """Worth of a maneuver, the mean over aircraft drawn from the posterior.

    Logarithms make what teaches little to some of them worth less than its mean information.
    """
    flights = [one.smaller(share) for one in maneuver.each]
    if before is None:
        before = target.variances(model, known)
    return float(np.mean([target.worth(model, known, more, before=before) for more in flights]))


def ranked(
    target: Target, model: AeroModel, known: Knowledge, maneuvers: Sequence[Maneuver]
) -> list[tuple[float, Maneuver]]:
    """Maneuvers by worth for their flight time, best first, with that worth [1/s]."""
    before = target.variances(model, known)
    scored = [
        (robust_worth(target, model, known, item, before=before) / cost(item), item)
        for item in maneuvers
    ]
    return sorted(scored, key=lambda pair: -pair[0])


def planned(
    target: Target,
    model: AeroModel,
    start: Knowledge,
    maneuvers: Sequence[Maneuver],
    *,
    budget: float,
) -> Sortie:
    """The maneuvers that tell most in a flight time, in order of what each is worth for its own.

    First one after the other, each the one that is worth most for its time then: a sum of
    logarithms of variances gains less and less from the same information, so that this is never
    far from the best set (Nemhauser, Wolsey & Fisher 1978). It fills the time badly, since it
    begins with what is short; so single runs are exchanged then as long as all together tell more.

    Worth is the mean over aircraft drawn from the posterior; what was flown before counts with the
    mean of what it teaches.

    Args:
        target: what is to be known better.
        model: identified so far.
        start: what was added to its fits since.
        maneuvers: to choose from.
        budget: flight time [s].
    """
    question = _Question(target, model, start, CAREFUL if poor(model) else ())
    chosen, full = _greedy(question, maneuvers, [], budget)
    longest = budget if full else _time(question, chosen)
    better = _exchanged(question, maneuvers, chosen, longest)
    chosen, _ = _greedy(question, maneuvers, better, longest)
    steps, known, used = [], start, 0.0
    for item, share in _runs(question, _ordered(question, chosen)):
        worth = robust_worth(target, model, known, item, share=share)
        steps.append(_step(item, share, len(steps), used, worth))
        used += cost(item)
        known = known.with_more(item.taught, share=share)
    return Sortie(tuple(steps), used, covariances(model, start), covariances(model, known))


class _Question(NamedTuple):
    """What a sortie is for, what is known before it, and shares of careful first runs."""

    target: Target
    model: AeroModel
    start: Knowledge
    careful: tuple[float, ...]


def _runs(asked: _Question, chosen: Sequence[Maneuver]) -> list[tuple[Maneuver, float]]:
    """All runs with their shares of full size: careful ones before the first of each maneuver."""
    found: list[tuple[Maneuver, float]] = []
    for place, item in enumerate(chosen):
        first = not any(other is item for other in chosen[:place])
        found += [(item, share) for share in (*(asked.careful if first else ()), 1.0)]
    return found


def _time(asked: _Question, chosen: Sequence[Maneuver]) -> float:
    """In the air [s]."""
    return float(sum(cost(item) for item, _ in _runs(asked, chosen)))


def _known(asked: _Question, chosen: Sequence[Maneuver]) -> Knowledge:
    """What is known once they were flown."""
    known = asked.start
    for item, share in _runs(asked, chosen):
        known = known.with_more(item.taught, share=share)
    return known


def _greedy(
    asked: _Question, maneuvers: Sequence[Maneuver], begun: Sequence[Maneuver], budget: float
) -> tuple[list[Maneuver], bool]:
    """What is flown already and then what is worth most for its time, one after the other.

    Returns:
        Maneuvers, and whether time ends it, not want of anything worth flying.
    """
    target, model = asked.target, asked.model
    chosen = list(begun)
    while True:
        known = _known(asked, chosen)
        stated = target.stated(model, known)
        worthy = [
            item
            for item in maneuvers
            if target.stated_worth(model, known, item.taught, before=stated) >= LEAST_WORTH
        ]
        left = [item for item in worthy if _time(asked, [*chosen, item]) <= budget]
        if not left:
            return chosen, bool(worthy)
        chosen.append(_best(target, model, known, left))


def _exchanged(
    asked: _Question,
    maneuvers: Sequence[Maneuver],
    chosen: Sequence[Maneuver],
    budget: float,
) -> list[Maneuver]:
    """Single runs exchanged for others as long as the aircraft drawn learn more of all together.

    What takes part is found by the mean of what aircraft learn, and kept if that is so for their
    mean worth too: logarithms make what teaches little to some of them worth less.
    """
    found = list(chosen)
    told, worth = _told(asked, found), _told_each(asked, found)
    for _ in range(SWEEPS):
        before = told
        for place in range(len(found)):
            rest = [*found[:place], *found[place + 1 :]]
            fitting = [item for item in maneuvers if _time(asked, [*rest, item]) <= budget]
            values = [_told(asked, [*rest, item]) for item in fitting]
            if max(values, default=told) - told < LEAST_WORTH:
                continue
            best = int(np.argmax(values))
            other = [*rest, fitting[best]]
            if (each := _told_each(asked, other)) > worth:
                found, told, worth = other, values[best], each
        if told - before < LEAST_WORTH:
            break
    return found


def _told(asked: _Question, chosen: Sequence[Maneuver]) -> float:
    """What all tell together, but for a constant, by the mean of what they teach."""
    return _certainty(asked, _known(asked, chosen))


def _told_each(asked: _Question, chosen: Sequence[Maneuver]) -> float:
    """The same, the mean over the aircraft drawn."""
    runs = _runs(asked, chosen)
    each = []
    for draw in range(min((len(item.each) for item in chosen), default=0)):
        known = asked.start
        for item, share in runs:
            known = known.with_more(item.each[draw], share=share)
        each.append(_certainty(asked, known))
    return float(np.mean(each)) if each else _told(asked, chosen)


def _certainty(asked: _Question, known: Knowledge) -> float:
    """Minus the sum of logarithms of the deviations asked about."""
    variances = asked.target.variances(asked.model, known)
    return -0.5 * float(np.sum(np.log(np.maximum(variances, 1e-300))))


def _ordered(asked: _Question, chosen: Sequence[Maneuver]) -> list[Maneuver]:
    """The one first that is worth most for its time, and so on."""
    left, found = list(chosen), []
    while left:
        best = _best(asked.target, asked.model, _known(asked, found), left)
        left.pop(next(place for place, item in enumerate(left) if item is best))
        found.append(best)
    return found


def _best(target: Target, model: AeroModel, known: Knowledge, left: Sequence[Maneuver]) -> Maneuver:
    """The maneuver that is worth most for its time.

    What the mean information is worth is never less than the mean worth (Jensen), so that only the
    first few by that bound need be weighed aircraft by aircraft.
    """
    before = target.variances(model, known)
    bounds = [target.worth(model, known, item.taught, before=before) / cost(item) for item in left]
    order = sorted(range(len(left)), key=lambda place: -bounds[place])
    best, rate = left[order[0]], -np.inf
    for place in order:
        if bounds[place] <= rate:
            break
        one = robust_worth(target, model, known, left[place], before=before) / cost(left[place])
        if one > rate:
            best, rate = left[place], one
    return best


def covariances(model: AeroModel, known: Knowledge) -> Covariances:
    """Covariance of every coefficient's terms."""
    return {name: information.covariance(fit, known.of(name)) for name, fit in model.fits.items()}


def _step(item: Maneuver, share: float, count: int, used: float, worth: float) -> Step:
    leg = count // ON_A_LEG
    return Step(item, share, leg + 1, "out" if leg % 2 == 0 else "back", used, worth)
