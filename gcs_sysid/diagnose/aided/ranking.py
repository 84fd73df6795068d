"""Which set of causes explains the flights: evidence, probabilities, estimates.

How good a file is, its sigmas only guess, and the flights tell: where twenty derivatives agree with
it to a percent, that all forces are larger by a tenth is no play of chance. By which share of their
sigmas the derivatives are off is one more unknown, over which every set is averaged.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import logsumexp

from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information, Posterior, gained, posterior
from gcs_sysid.diagnose.hypothesis import (
    PRIOR_OF_NONE,
    PRIOR_OF_ONE,
    PRIOR_OF_TWO,
    Estimate,
    Ranked,
)

LISTED = 40
"""Pairs beyond the most probable sets of this number are not looked at any further."""
PAIRED = 12
"""So many of the best single causes are tried together with every other."""
ACCURACIES = {0.05: 0.1, 0.1: 0.1, 0.25: 0.1, 0.5: 0.1, 1.0: 0.5, 2.0: 0.05, 4.0: 0.05}
"""What the file's derivatives may be off by, over the sigmas that it states, and how probable it is
before the flights."""
BESIDES = 12.0
"""Pairs are weighed without the worse accuracies that single causes favour less by so much [nat].
The better ones stay: what a second cause takes upon itself makes the rest look better."""


@dataclass(frozen=True)
class _Tried:
    """A cause at the place where it explains most, and what all its places together explain.

    Attributes:
        candidate: at that place.
        evidence: at each accuracy of the file.
        place: mean and standard deviation.
    """

    candidate: Candidate
    evidence: Float[np.ndarray, " accuracy"]
    place: tuple[float, float] | None


@dataclass(frozen=True)
class _Files:
    """The file at each accuracy, with nothing free that only causes free.

    Attributes:
        unknowns: with that accuracy.
        nothing: posterior.
        prior: logarithm of the accuracy's prior probability.
        accuracies: shares of the stated sigmas.
    """

    unknowns: tuple[Unknowns, ...]
    nothing: tuple[Posterior, ...]
    prior: Float[np.ndarray, " accuracy"]
    accuracies: tuple[float, ...]

    def evidence(self, causes: Sequence[Candidate]) -> Float[np.ndarray, " accuracy"]:
        """Of a set of causes at each accuracy."""
        sigma, mean = self.unknowns[0].freed(causes)
        before = self.unknowns[0].sigma
        # What a cause frees is no aerodynamic value of the file: it hangs on no accuracy.
        chosen = np.flatnonzero((sigma != before) | (mean != 0.0))
        given = (before[chosen], chosen, sigma[chosen], mean[chosen])
        return np.array([one.log_evidence + gained(one, *given) for one in self.nothing])

    def averaged(self, evidence: Float[np.ndarray, "set accuracy"]) -> Float[np.ndarray, " set"]:
        """Evidence over all accuracies."""
        return logsumexp(evidence + self.prior, axis=1)

    def kept(self, chosen: Bool[np.ndarray, " accuracy"]) -> _Files:
        places = np.flatnonzero(chosen)
        return _Files(
            tuple(self.unknowns[i] for i in places),
            tuple(self.nothing[i] for i in places),
            self.prior[places],
            tuple(self.accuracies[i] for i in places),
        )


def rank(
    data: Information, unknowns: Unknowns, candidates: Sequence[Candidate]
) -> tuple[Ranked, ...]:
    """Sets of up to two causes, the most probable first."""
    accurate = tuple(unknowns.as_accurate(share) for share in ACCURACIES)
    files = _Files(
        accurate,
        tuple(posterior(data, *one.freed(())) for one in accurate),
        np.log(list(ACCURACIES.values())),
        tuple(ACCURACIES),
    )
    nothing = np.array([one.log_evidence for one in files.nothing])
    tried = _tried(files, candidates)
    told = np.max([nothing, *(one.evidence for one in tried)], axis=0) + files.prior
    likely = (told > told.max() - BESIDES) | (np.arange(told.size) < told.argmax())
    files, nothing = files.kept(likely), nothing[likely]
    tried = [replace(one, evidence=one.evidence[likely]) for one in tried]
    total = sum({one.candidate.cause.name: one.candidate.cause.weight for one in tried}.values())
    names = [one.candidate.cause.name for one in tried]

    def share(one: _Tried) -> float:
        cause = one.candidate.cause
        return cause.weight / total / names.count(cause.name)

    sets: list[tuple[tuple[_Tried, ...], float, np.ndarray]] = [((), PRIOR_OF_NONE, nothing)]
    sets += [((one,), PRIOR_OF_ONE * share(one), one.evidence) for one in tried]
    alone = np.argsort(-files.averaged(np.array([one.evidence for one in tried])))
    best = set(alone[:PAIRED].tolist())
    for numbers in itertools.combinations(range(len(tried)), 2):
        if not best.intersection(numbers):
            continue
        pair = tuple(tried[number] for number in numbers)
        prior = 2.0 * PRIOR_OF_TWO * share(pair[0]) * share(pair[1])
        sets.append((pair, prior, files.evidence([one.candidate for one in pair])))
    evidence = np.array([each for _, _, each in sets])
    favoured = np.argmax(evidence + files.prior, axis=1)
    averaged = files.averaged(evidence)
    score = averaged + np.log([prior for _, prior, _ in sets])
    weight = np.exp(score - score.max())
    probability = weight / weight.sum()
    order = np.argsort(-probability, kind="stable")
    ranked = []
    for place, index in enumerate(order):
        causes, prior, _ = sets[index]
        if place >= LISTED and len(causes) > 1:
            continue
        own = files.unknowns[favoured[index]]
        found = posterior(data, *own.freed([one.candidate for one in causes]))
        names = [name for one in causes for name in one.candidate.frees]
        moved = own.along(names, found.mean, found.covariance)
        ranked.append(
            Ranked(
                causes=tuple(one.candidate for one in causes),
                prior=prior,
                probability=float(probability[index]),
                log_bayes_factor=float(averaged[index] - averaged[0]),
                estimates=tuple(_estimates(one, moved) for one in causes),
                posterior=found,
                accuracy=files.accuracies[favoured[index]],
            )
        )
    return tuple(ranked)


def _tried(files: _Files, candidates: Sequence[Candidate]) -> list[_Tried]:
    """Every cause and what it is about, over the places where it may be."""
    found = []
    groups: dict[tuple[str, str], list[Candidate]] = {}
    for candidate in candidates:
        groups.setdefault((candidate.cause.name, candidate.about), []).append(candidate)
    for group in groups.values():
        evidence = np.array([files.evidence((one,)) for one in group])
        total = files.averaged(evidence)
        place = None
        if group[0].cause.where:
            places = np.array([one.at for one in group], dtype=float)
            spacing = float(np.mean(np.diff(places))) if places.size > 1 else 0.0
            weight = np.exp(total - total.max())
            mean = float(np.average(places, weights=weight))
            spread = float(np.average((places - mean) ** 2, weights=weight)) + spacing**2 / 12.0
            size = files.unknowns[0].sizes[group[0].cause.where_per.format(about=group[0].about)]
            place = (mean * size, float(np.sqrt(spread)) * size)
        together = logsumexp(evidence, axis=0) - np.log(len(group))
        found.append(_Tried(group[int(total.argmax())], together, place))
    return found


def _estimates(one: _Tried, moved: Mapping[str, tuple[float, float]]) -> tuple[Estimate, ...]:
    estimates = []
    cause = one.candidate.cause
    if one.place is not None:
        estimates.append(Estimate(cause.where, *one.place, cause.where_unit, 0.0))
    for name, parameter in zip(one.candidate.frees, cause.parameters, strict=True):
        if parameter.expected:
            continue
        change, deviation = moved[name]
        value = parameter.nominal + change
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
        moved = unknowns.along(candidate.frees, under.mean, under.covariance)
        found.append(tuple(moved[name][1] for name in candidate.frees))
    return tuple(found)
