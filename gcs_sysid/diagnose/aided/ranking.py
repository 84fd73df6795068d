"""Which set of causes explains the flights: evidence, probabilities, estimates.

How good a file is, its sigmas only guess, and the flights tell: where twenty derivatives agree with
it to a percent, that all forces are larger by a tenth is no play of chance. By which share of their
sigmas the derivatives are off is one more unknown, over which every set is averaged.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import log_ndtr, logsumexp

from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information, Posterior, disputed, gained, posterior
from gcs_sysid.diagnose.hypothesis import (
    PRIOR_OF_MORE,
    PRIOR_OF_NONE,
    PRIOR_OF_ONE,
    PRIOR_OF_TWO,
    Estimate,
    Ranked,
)
from gcs_sysid.estimate import scoring

LAG = "sensors.moment_lag"
"""What a flight times no better than `scoring.TIMING`, however well it fits: an inertia in roll
hangs on it by 2 % a millisecond."""
LISTED = 40
"""Sets of several causes beyond the most probable of this number are not looked at any further."""
PAIRED = 12
"""So many of the best single causes are tried together with every other."""
WIDENED, MOST = 6, 6
"""So many of the best sets of each size are tried with one cause more, up to so many causes."""
ACCURACIES = {0.05: 0.1, 0.1: 0.1, 0.25: 0.1, 0.5: 0.1, 1.0: 0.5, 2.0: 0.05, 4.0: 0.05}
"""What the file's derivatives may be off by, over the sigmas that it states, and how probable it is
before the flights."""
RIGHT = 0.1
"""Share of its sigmas by which a file is off at most that is right but for what causes free."""
BESIDES = 12.0
"""Sets are weighed without the worse accuracies that single causes favour less by so much [nat].
The better ones stay: what a second cause takes upon itself makes the rest look better."""


@dataclass(frozen=True)
class _Tried:
    """A cause at the place where it explains most, and what all its places together explain.

    Attributes:
        candidate: at that place.
        evidence: at each accuracy of the file.
        place: mean and standard deviation; None where it is nowhere in particular.
        beside: the same at the next places.
        other: one that is taken on the other side, where its size may be of either sign.
    """

    candidate: Candidate
    evidence: Float[np.ndarray, " accuracy"]
    place: tuple[float, float] | None
    beside: tuple[Candidate, ...]
    other: Candidate | None


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
        return self.bare + gained(*self._beliefs, *given)

    @cached_property
    def bare(self) -> Float[np.ndarray, " accuracy"]:
        """Evidence of no cause."""
        return np.array([one.log_evidence for one in self.nothing])

    @cached_property
    def _beliefs(self) -> tuple[np.ndarray, np.ndarray]:
        """Means and covariances with no cause, one behind the other."""
        parts = ((one.mean, one.covariance) for one in self.nothing)
        found, covariance = (np.stack(part) for part in zip(*parts, strict=True))
        return found, covariance

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


def shares(candidates: Sequence[Candidate]) -> dict[str, float]:
    """Prior share of each cause and what it is about, by label, whatever its places."""
    weights = {one.cause.name: one.cause.weight for one in candidates}
    labels = {one.label: one.cause.name for one in candidates}
    named = list(labels.values())
    return {
        label: weights[name] / sum(weights.values()) / named.count(name)
        for label, name in labels.items()
    }


def likeliest_accuracy(
    information: Information, unknowns: Unknowns, causes: Sequence[Candidate]
) -> float:
    """What the file's aerodynamics are off by, over the sigmas that it states, with these causes.

    Args:
        information: of all flights.
        unknowns: with the file's own sigmas.
        causes: what is free.
    """
    density = [
        posterior(information, *unknowns.as_accurate(share).freed(causes)).log_evidence
        + np.log(prior)
        for share, prior in ACCURACIES.items()
    ]
    return tuple(ACCURACIES)[int(np.argmax(density))]


class Overrated(NamedTuple):
    """What seems likelier from where flights stand than a search with it has shown it to be.

    It holds for sets that differ from what flights were searched with there as that search did.

    Attributes:
        extra: causes that were free in it, and are not where flights stand.
        missing: causes that are free there, and were not in it.
        by: evidence that sets with the ones and without the others have too much [nat]; below 0
            where they were found to be likelier.
    """

    extra: tuple[Candidate, ...]
    missing: tuple[Candidate, ...]
    by: float


class Needed(NamedTuple):
    """What searches have shown of sets of causes, beyond what is seen from where flights stand.

    Attributes:
        causes: without which flights are far less likely.
        missed: by how much sets without all of them have less evidence [nat].
        incredible: a set that has to be of a size that nobody believes; empty where there is none.
        overrated: as searches have shown.
    """

    causes: tuple[Candidate, ...] = ()
    missed: float = 0.0
    incredible: tuple[Candidate, ...] = ()
    overrated: tuple[Overrated, ...] = ()

    def lacking(self, chosen: Sequence[Candidate]) -> float:
        """What a set of causes loses."""
        there, held, never = (labels(causes) for causes in (chosen, self.causes, self.incredible))
        if never and never <= there:
            return np.inf
        return (0.0 if held <= there else self.missed) + self._promised(there)

    def _promised(self, there: AbstractSet[str]) -> float:
        """What a set loses by what was promised too much: of what is nearest to it."""
        held = [one for one in self.overrated if labels(one.extra) <= there]
        alike = [one for one in held if not labels(one.missing) & there]
        if alike:
            return max(alike, key=lambda one: (len(one.extra), len(one.missing))).by
        return max((one.by for one in held if one.extra and one.by > 0.0), default=0.0)


def labels(causes: Sequence[Candidate]) -> set[str]:
    """Causes and what they are about, wherever they are."""
    return {one.label for one in causes}


NONE_NEEDED = Needed()


def rank(
    data: Information,
    unknowns: Unknowns,
    candidates: Sequence[Candidate],
    needed: Needed = NONE_NEEDED,
    accuracies: Mapping[float, float] = ACCURACIES,
) -> tuple[Ranked, ...]:
    """Sets of causes, the most probable first.

    Args:
        data: of all flights.
        unknowns: with the file's own sigmas.
        candidates: every cause.
        needed: causes without which flights are far less likely.
        accuracies: what the file may be off by, and how probable that is.
    """
    accurate = tuple(unknowns.as_accurate(share) for share in accuracies)
    files = _Files(
        accurate,
        tuple(posterior(data, *one.freed(())) for one in accurate),
        np.log(list(accuracies.values())),
        tuple(accuracies),
    )
    nothing = files.bare
    tried = _tried(files, candidates)
    told = np.max([nothing, *(one.evidence for one in tried)], axis=0) + files.prior
    likely = (told > told.max() - BESIDES) | (np.arange(told.size) < told.argmax())
    files, nothing = files.kept(likely), nothing[likely]
    tried = [replace(one, evidence=one.evidence[likely]) for one in tried]
    sets = _sets(files, tried, nothing, needed)
    listed = [
        (place, chosen)
        for place, chosen in enumerate(sets)
        if place < LISTED or len(chosen.causes) < 2
    ]
    averaged = float(files.averaged(nothing[None])[0])
    return _weighed([_ranked(data, files, chosen, averaged) for _, chosen in listed])


def with_a_right_file(
    data: Information,
    unknowns: Unknowns,
    candidates: Sequence[Candidate],
    needed: Needed = NONE_NEEDED,
) -> Ranked:
    """The most probable set of causes, were the file right in all else."""
    good = {share: prior for share, prior in ACCURACIES.items() if share <= RIGHT}
    return rank(data, unknowns, candidates, needed, good)[0]


def density(data: Information, one: Ranked) -> float:
    """How probable the flights are and a set of causes, at its own accuracy of the file [nat].

    Unlike a Bayes factor it may be compared between points about which flights were weighed.
    """
    before = np.log(one.prior) + np.log(ACCURACIES[one.accuracy])
    return float(data.shared + one.posterior.log_evidence + before)


def _weighed(ranked: Sequence[Ranked]) -> tuple[Ranked, ...]:
    """With the probabilities that evidence and prior give, the most probable first."""
    score = np.array([one.log_bayes_factor + np.log(one.prior) for one in ranked])
    weight = np.exp(score - score.max())
    probability = weight / weight.sum()
    order = np.argsort(-probability, kind="stable")
    return tuple(replace(ranked[i], probability=float(probability[i])) for i in order)


@dataclass(frozen=True)
class _Set:
    """Causes that act together.

    Attributes:
        causes: what explains most by itself first.
        prior: probability before the flights.
        evidence: at each accuracy of the file.
    """

    causes: tuple[_Tried, ...]
    prior: float
    evidence: Float[np.ndarray, " accuracy"]


def _sets(
    files: _Files,
    tried: Sequence[_Tried],
    nothing: Float[np.ndarray, " accuracy"],
    needed: Needed,
) -> list[_Set]:
    """Sets of causes, the most probable first.

    All of one, all pairs with one of the best, and from there by one cause more at a time. What a
    further cause makes superfluous is dropped again, since smaller sets stay beside larger ones.
    """
    before = shares([one.candidate for one in tried])
    share = [before[one.candidate.label] for one in tried]
    alone = np.argsort(-files.averaged(np.array([one.evidence for one in tried]))).tolist()

    def possible(chosen: tuple[int, ...]) -> bool:
        freed = {name for i in chosen for name in tried[i].candidate.frees}
        return not any(pair <= freed for pair in files.unknowns[0].either)

    def of(chosen: tuple[int, ...]) -> _Set:
        causes = tuple(tried[i] for i in chosen)
        evidence = causes[0].evidence
        if len(causes) > 1:
            evidence = files.evidence([one.candidate for one in causes])
        together = PRIOR_OF_ONE if len(chosen) == 1 else PRIOR_OF_TWO
        together *= PRIOR_OF_MORE ** max(len(chosen) - 2, 0) * math.factorial(len(chosen))
        evidence = evidence - needed.lacking([one.candidate for one in causes])
        return _Set(causes, together * math.prod(share[i] for i in chosen), evidence)

    none = _Set((), PRIOR_OF_NONE, nothing - needed.lacking(()))
    numbered: dict[tuple[int, ...], _Set] = {(): none}
    numbered |= {(i,): of((i,)) for i in alone}
    wanted = [(i, j) for turn, i in enumerate(alone[:PAIRED]) for j in alone[turn + 1 :]]
    for size in range(2, MOST + 1):
        numbered |= {chosen: of(chosen) for chosen in wanted if possible(chosen)}
        order = _order(files, list(numbered.values()))
        keys = list(numbered)
        best = [keys[i] for i in order if len(keys[i]) == size][:WIDENED]
        wider = {tuple(i for i in alone if i in {*one, j}) for one in best for j in alone}
        wanted = sorted(chosen for chosen in wider if len(chosen) > size)
    return [numbered[keys[i]] for i in order]


def _order(files: _Files, sets: Sequence[_Set]) -> list[int]:
    """Places of sets, the most probable first."""
    averaged = files.averaged(np.array([one.evidence for one in sets]))
    score = averaged + np.log([one.prior for one in sets])
    return np.argsort(-score, kind="stable").tolist()


def _ranked(data: Information, files: _Files, chosen: _Set, nothing: float) -> Ranked:
    """A set of causes with its estimates; its probability is still to be told.

    What cannot be, such as a message that comes before what it tells of, is taken off the evidence:
    by as much as the posterior believes in it, and the prior did.
    """
    chosen = _facing(data, files, chosen)
    favoured = int(np.argmax(chosen.evidence + files.prior))
    own = files.unknowns[favoured]
    causes = tuple(one.candidate for one in chosen.causes)
    sigma, mean = own.freed(causes)
    found = own.estimated(data, causes)
    if LAG in own.names and sigma[own.names.index(LAG)] > 0.0:
        late = scoring.timed(found.covariance, own.names.index(LAG))
        found = replace(found, covariance=late)
    names = [name for one in causes for name in one.frees]
    moved = own.along(names, found.mean, found.covariance)
    possible = 0.0
    for name in set(names) & set(own.least):
        index, least = own.names.index(name), own.least[name]
        before = (mean[index] - least) / sigma[index]
        after = (moved[name][0] - least) / moved[name][1]
        possible += float(log_ndtr(after) - log_ndtr(before))
    ordinary = (sigma > 0.0) & ~np.isin(own.names, names)
    found = disputed(found, sigma, mean, ordinary)
    moved = own.along(names, found.mean, found.covariance)
    return Ranked(
        causes=causes,
        prior=chosen.prior,
        probability=float(np.nan),
        log_bayes_factor=float(files.averaged(chosen.evidence[None])[0]) - nothing + possible,
        estimates=tuple(
            _estimates(one, moved, own, _by_place(data, own, chosen.causes, one, moved))
            for one in chosen.causes
        ),
        posterior=found,
        accuracy=files.accuracies[favoured],
    )


def _facing(data: Information, files: _Files, chosen: _Set) -> _Set:
    """With late or early commands taken on the side where they are found.

    Alone they may explain more on the other one: the first delay of UMN's Thor was 0.06 s late, on
    the side of those that are early, and was searched at 0.02 s early.
    """
    for one in chosen.causes:
        causes = [each.candidate for each in chosen.causes]
        own = files.unknowns[int(np.argmax(chosen.evidence + files.prior))]
        if one.other is None or one.candidate.at is None:
            continue
        found = own.estimated(data, causes)
        names = [name for each in causes for name in each.frees]
        (size,) = (
            own.along(names, found.mean, found.covariance)[name][0] for name in one.candidate.frees
        )
        if size * one.candidate.at < 0.0:
            facing = replace(one, candidate=one.other, other=one.candidate)
            kept = tuple(facing if each is one else each for each in chosen.causes)
            turned = files.evidence([each.candidate for each in kept]) - files.evidence(causes)
            chosen = replace(chosen, causes=kept, evidence=chosen.evidence + turned)
    return chosen


def _tried(files: _Files, candidates: Sequence[Candidate]) -> list[_Tried]:
    """Every cause and what it is about, over the places where it may be."""
    found = []
    groups: dict[tuple[str, str], list[Candidate]] = {}
    for candidate in candidates:
        groups.setdefault((candidate.cause.name, candidate.about), []).append(candidate)
    for group in groups.values():
        evidence = np.array([files.evidence((one,)) for one in group])
        total = files.averaged(evidence)
        best, place, beside, other = int(total.argmax()), None, (), None
        if group[0].cause.where:
            places = np.array([one.at for one in group], dtype=float)
            near = slice(max(best - 1, 0), best + 2)
            spacing = float(np.mean(np.diff(places[near]))) if places.size > 1 else 0.0
            weight = np.exp(total - total.max())
            mean = float(np.average(places, weights=weight))
            spread = float(np.average((places - mean) ** 2, weights=weight)) + spacing**2 / 12.0
            place = (mean, float(np.sqrt(spread)))
            beside = tuple(one for one in group[near] if one is not group[best])
        elif len(group) > 1:
            (other,) = (one for one in group if one is not group[best])
        together = logsumexp(evidence, axis=0) - np.log(len(group))
        found.append(_Tried(group[best], together, place, beside, other))
    return found


def _by_place(
    data: Information,
    own: Unknowns,
    causes: Sequence[_Tried],
    one: _Tried,
    moved: Mapping[str, tuple[float, float]],
) -> tuple[float, ...]:
    """Change of each parameter of a cause with its place, from those next to it.

    How much lift is lost beyond an angle hangs on which angle it is, and that is between two that
    were tried.
    """
    if not one.beside:
        return (0.0,) * len(one.candidate.frees)
    rows = [(one.candidate.at, [moved[name][0] for name in one.candidate.frees])]
    for other in one.beside:
        freed = [other if each is one else each.candidate for each in causes]
        under = own.estimated(data, freed)
        names = [name for each in freed for name in each.frees]
        there = own.along(names, under.mean, under.covariance)
        rows.append((other.at, [there[name][0] for name in other.frees]))
    places, values = (np.array(each, dtype=float) for each in zip(*rows, strict=True))
    return tuple(np.polyfit(places, values, 1)[0])


def _estimates(
    one: _Tried,
    moved: Mapping[str, tuple[float, float]],
    own: Unknowns,
    by_place: Sequence[float],
) -> tuple[Estimate, ...]:
    """A cause's parameters, for each place where it may be."""
    estimates, off, doubt = list[Estimate](), 0.0, 0.0
    cause, candidate = one.candidate.cause, one.candidate
    if one.place is not None and candidate.at is not None:
        size = own.sizes[cause.where_per.format(about=candidate.about)]
        mean, doubt = one.place
        off = mean - candidate.at
        estimates.append(Estimate(cause.where, mean * size, doubt * size, cause.where_unit, 0.0))
    for name, parameter, slope in zip(candidate.frees, cause.parameters, by_place, strict=True):
        if parameter.expected:
            continue
        change, deviation = moved[name]
        value = parameter.nominal + change + slope * off
        deviation = float(np.hypot(deviation, slope * doubt))
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
        under = unknowns.estimated(data, (candidate,))
        moved = unknowns.along(candidate.frees, under.mean, under.covariance)
        found.append(tuple(moved[name][1] for name in candidate.frees))
    return tuple(found)
