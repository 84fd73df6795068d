"""Which set of causes explains the flights: evidence, probabilities, estimates."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid.diagnose.cause import Candidate, Parameter
from gcs_sysid.diagnose.evidence import Information, Posterior, posterior
from gcs_sysid.diagnose.unknowns import Columns

PRIOR_OF_NONE = 0.5
PRIOR_OF_ONE = 0.4
"""Shared by all causes, and by a cause's controls."""
PRIOR_OF_TWO = 0.1
"""Shared by all pairs."""


@dataclass(frozen=True)
class Estimate:
    """A parameter of a cause: its value and one standard deviation."""

    parameter: Parameter
    value: float
    deviation: float


@dataclass(frozen=True)
class Ranked:
    """One set of causes.

    Attributes:
        causes: what is wrong; empty where nothing is.
        prior: its probability before the flights.
        probability: after them.
        log_bayes_factor: evidence against that of nothing being wrong [nat].
        estimates: of the parameters, one tuple a cause.
        posterior: of all unknowns.
    """

    causes: tuple[Candidate, ...]
    prior: float
    probability: float
    log_bayes_factor: float
    estimates: tuple[tuple[Estimate, ...], ...]
    posterior: Posterior

    @property
    def names(self) -> tuple[str, ...]:
        """Identifiers of the causes."""
        return tuple(candidate.cause.name for candidate in self.causes)


def sigma_under(causes: Sequence[Candidate], columns: Columns) -> Float[np.ndarray, " unknown"]:
    """Prior standard deviations with some causes set free beside what is ordinary."""
    sigma = np.array(columns.sigma)
    for candidate in causes:
        for name, parameter in zip(candidate.frees, candidate.cause.parameters, strict=True):
            index = columns.names.index(name)
            sigma[index] = np.hypot(sigma[index], parameter.sigma)
    return sigma


def rank(
    data: Information, columns: Columns, candidates: Sequence[Candidate]
) -> tuple[Ranked, ...]:
    """Every set of up to two causes, the most probable first."""
    sets = _sets(candidates)
    posteriors = [posterior(data, sigma_under(causes, columns)) for causes, _ in sets]
    score = np.array(
        [
            found.log_evidence + np.log(prior)
            for found, (_, prior) in zip(posteriors, sets, strict=True)
        ]
    )
    weight = np.exp(score - score.max())
    probability = weight / weight.sum()
    reference = posteriors[0].log_evidence
    ranked = [
        Ranked(
            causes=causes,
            prior=prior,
            probability=float(share),
            log_bayes_factor=found.log_evidence - reference,
            estimates=tuple(_estimates(one, found, columns) for one in causes),
            posterior=found,
        )
        for (causes, prior), found, share in zip(sets, posteriors, probability, strict=True)
    ]
    return tuple(sorted(ranked, key=lambda item: -item.probability))


def _sets(candidates: Sequence[Candidate]) -> list[tuple[tuple[Candidate, ...], float]]:
    """Nothing first, then single causes, then pairs of different causes, with their priors."""
    names = [candidate.cause.name for candidate in candidates]
    share = {name: 1.0 / names.count(name) for name in names}
    sets: list[tuple[tuple[Candidate, ...], float]] = [((), PRIOR_OF_NONE)]
    total = len(share)
    for one in candidates:
        sets.append(((one,), PRIOR_OF_ONE / total * share[one.cause.name]))
    pairs = list(itertools.combinations(candidates, 2))
    weights = np.array([share[a.cause.name] * share[b.cause.name] for a, b in pairs])
    for pair, weight in zip(pairs, weights / max(weights.sum(), 1e-300), strict=True):
        sets.append((pair, PRIOR_OF_TWO * float(weight)))
    return sets


def _estimates(candidate: Candidate, found: Posterior, columns: Columns) -> tuple[Estimate, ...]:
    estimates = []
    for name, parameter in zip(candidate.frees, candidate.cause.parameters, strict=True):
        index = columns.names.index(name)
        deviation = float(np.sqrt(found.covariance[index, index]))
        value = parameter.nominal + float(found.mean[index])
        estimates.append(Estimate(parameter, value, deviation))
    return tuple(estimates)
