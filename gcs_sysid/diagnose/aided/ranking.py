"""Which set of causes explains the flights: evidence, probabilities, estimates."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information, Posterior, posterior
from gcs_sysid.diagnose.hypothesis import (
    PRIOR_OF_NONE,
    PRIOR_OF_ONE,
    PRIOR_OF_TWO,
    Estimate,
    Ranked,
)

PAIRED = 12
"""So many of the best single causes are tried together with every other."""


@dataclass(frozen=True)
class _Tried:
    """A cause at the place where it explains most, and what all its places together explain."""

    candidate: Candidate
    evidence: float
    place: tuple[float, float] | None


def rank(
    data: Information, unknowns: Unknowns, candidates: Sequence[Candidate]
) -> tuple[Ranked, ...]:
    """Sets of up to two causes, the most probable first."""
    nothing = posterior(data, *unknowns.freed(()))
    tried = _tried(data, unknowns, candidates, nothing.log_evidence)
    total = sum({one.candidate.cause.name: one.candidate.cause.weight for one in tried}.values())
    names = [one.candidate.cause.name for one in tried]

    def share(one: _Tried) -> float:
        cause = one.candidate.cause
        return cause.weight / total / names.count(cause.name)

    sets: list[tuple[tuple[_Tried, ...], float, float]] = [((), PRIOR_OF_NONE, 0.0)]
    sets += [((one,), PRIOR_OF_ONE * share(one), one.evidence) for one in tried]
    best = sorted(tried, key=lambda one: -one.evidence)[:PAIRED]
    for pair in itertools.combinations(tried, 2):
        if not set(pair) & set(best):
            continue
        causes = tuple(one.candidate for one in pair)
        found = posterior(data, *unknowns.freed(causes))
        sets.append(
            (
                pair,
                2.0 * PRIOR_OF_TWO * share(pair[0]) * share(pair[1]),
                found.log_evidence - nothing.log_evidence,
            )
        )
    score = np.array([evidence + np.log(prior) for _, prior, evidence in sets])
    weight = np.exp(score - score.max())
    probability = weight / weight.sum()
    order = np.argsort(-probability, kind="stable")
    return tuple(
        _ranked(data, unknowns, *sets[index], float(probability[index])) for index in order[:40]
    )


def _tried(
    data: Information, unknowns: Unknowns, candidates: Sequence[Candidate], nothing: float
) -> list[_Tried]:
    """Every cause and what it is about, over the places where it may be."""
    found = []
    groups: dict[tuple[str, str], list[Candidate]] = {}
    for candidate in candidates:
        groups.setdefault((candidate.cause.name, candidate.about), []).append(candidate)
    for group in groups.values():
        evidence = np.array(
            [posterior(data, *unknowns.freed((one,))).log_evidence - nothing for one in group]
        )
        most = float(evidence.max())
        weight = np.exp(evidence - most)
        place = None
        if group[0].at is not None:
            places = np.array([one.at for one in group], dtype=float)
            spacing = float(np.mean(np.diff(places))) if places.size > 1 else 0.0
            mean = float(np.average(places, weights=weight))
            spread = float(np.average((places - mean) ** 2, weights=weight)) + spacing**2 / 12.0
            size = unknowns.sizes[group[0].cause.where_per.format(about=group[0].about)]
            place = (mean * size, float(np.sqrt(spread)) * size)
        found.append(
            _Tried(group[int(evidence.argmax())], most + float(np.log(weight.mean())), place)
        )
    return found


def _ranked(
    data: Information,
    unknowns: Unknowns,
    causes: tuple[_Tried, ...],
    prior: float,
    evidence: float,
    probability: float,
) -> Ranked:
    found = posterior(data, *unknowns.freed([one.candidate for one in causes]))
    return Ranked(
        causes=tuple(one.candidate for one in causes),
        prior=prior,
        probability=probability,
        log_bayes_factor=evidence,
        estimates=tuple(_estimates(one, found, unknowns) for one in causes),
        posterior=found,
    )


def _estimates(one: _Tried, found: Posterior, unknowns: Unknowns) -> tuple[Estimate, ...]:
    estimates = []
    cause = one.candidate.cause
    if one.place is not None:
        estimates.append(Estimate(cause.where, *one.place, cause.where_unit, 0.0))
    for name, parameter in zip(one.candidate.frees, cause.parameters, strict=True):
        if parameter.expected:
            continue
        moved, deviation = unknowns.along(name, found.mean, found.covariance)
        value = parameter.nominal + moved
        estimates.append(
            Estimate(parameter.name, value, deviation, parameter.unit, parameter.nominal)
        )
    return tuple(estimates)


def deviations(
    data: Information, unknowns: Unknowns, candidates: Sequence[Candidate]
) -> tuple[tuple[float, ...], ...]:
    """For each cause, how well these flights would know its parameters, were it the only one."""
    found = []
    for candidate in candidates:
        under = posterior(data, *unknowns.freed((candidate,)))
        found.append(
            tuple(unknowns.along(name, under.mean, under.covariance)[1] for name in candidate.frees)
        )
    return tuple(found)
