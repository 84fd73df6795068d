"""Which set of causes explains the flights: evidence, probabilities, estimates."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information, Posterior, posterior
from gcs_sysid.diagnose.hypothesis import (
    PRIOR_OF_NONE,
    PRIOR_OF_ONE,
    PRIOR_OF_TWO,
    Estimate,
    Ranked,
)
from gcs_sysid.diagnose.unknowns import Columns


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
        estimates.append(
            Estimate(parameter.name, value, deviation, parameter.unit, parameter.nominal)
        )
    return tuple(estimates)


def deviations(
    data: Information, columns: Columns, candidates: Sequence[Candidate]
) -> tuple[tuple[float, ...], ...]:
    """For each cause, how well these flights would know its parameters, were it the only one."""
    found = []
    for candidate in candidates:
        under = posterior(data, sigma_under((candidate,), columns))
        places = [columns.names.index(name) for name in candidate.frees]
        found.append(tuple(float(np.sqrt(under.covariance[i, i])) for i in places))
    return tuple(found)
