"""Which maneuvers, how often and in which order: the most knowledge for the time in the air."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

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
    """One maneuver after the other, each the one that is worth most for its time then.

    Worth is the mean over aircraft drawn from the posterior; what was flown before counts with the
    mean of what it teaches.

    A sum of logarithms of variances gains less and less from the same information, so that this
    order is near the best set of maneuvers for the time (Nemhauser, Wolsey & Fisher 1978).

    Args:
        target: what is to be known better.
        model: identified so far.
        start: what was added to its fits since.
        maneuvers: to choose from.
        budget: flight time [s].
    """
    known, steps, used = start, [], 0.0
    careful = CAREFUL if poor(model) else ()
    while maneuvers:
        stated = target.stated(model, known)
        left = [
            item
            for item in maneuvers
            if used + _cost(item, steps, careful) <= budget
            and target.stated_worth(model, known, item.taught, before=stated) >= LEAST_WORTH
        ]
        if not left:
            break
        best = _best(target, model, known, left)
        first = not any(step.maneuver is best for step in steps)
        for share in (*(careful if first else ()), 1.0):
            later = known.with_more(best.taught, share=share)
            worth = robust_worth(target, model, known, best, share=share)
            steps.append(_step(best, share, len(steps), used, worth))
            used += cost(best)
            known = later
    return Sortie(tuple(steps), used, covariances(model, start), covariances(model, known))


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


def _cost(item: Maneuver, steps: Sequence[Step], careful: tuple[float, ...]) -> float:
    tried = any(step.maneuver is item for step in steps)
    return cost(item) * (1 if tried else 1 + len(careful))


def _step(item: Maneuver, share: float, count: int, used: float, worth: float) -> Step:
    leg = count // ON_A_LEG
    return Step(item, share, leg + 1, "out" if leg % 2 == 0 else "back", used, worth)
