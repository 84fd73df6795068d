"""What nothing in the catalogue explains: which coefficient is off, and with what it goes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information, posterior
from gcs_sysid.diagnose.unlisted import PRIOR, SIZE, Missing


def names(terms: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """Of every such term in every coefficient."""
    return tuple(f"missing.{name}.{'*'.join(term)}" for name in COEFFICIENTS for term in terms)


def sizes(
    terms: Sequence[tuple[str, ...]],
    flow: Mapping[str, Float[np.ndarray, " sample"]],
    measured: Mapping[str, Float[np.ndarray, " sample"]],
) -> Float[np.ndarray, " term"]:
    """One sigma of every term in every coefficient.

    Args:
        terms: the products.
        flow: variables and controls.
        measured: the coefficients.
    """
    spread = [float(np.std(np.prod([flow[name] for name in term], axis=0))) for term in terms]
    return np.array(
        [
            SIZE * float(np.std(measured[name])) / max(size, 1e-12)
            for name in COEFFICIENTS
            for size in spread
        ]
    )


def strongest(
    fitted: Information,
    apart: Information,
    listed: Unknowns,
    causes: Sequence[Candidate],
    terms: Sequence[tuple[str, ...]],
    sigma: Float[np.ndarray, " term"],
) -> Missing | None:
    """The one more term that the flights ask for most, if what took no part asks for it too.

    Args:
        fitted: what was fitted says of all unknowns, the terms among them.
        apart: what took no part says.
        listed: the unknowns; the terms are the last of the model's parameters.
        causes: the set that the term is added to.
        terms: the products.
        sigma: of every term in every coefficient.
    """
    ordinary, mean = listed.freed(causes)
    first = listed.parameters - sigma.size

    def gains(data: Information, chosen: Sequence[int]) -> list[float]:
        without = posterior(data, ordinary, mean).log_evidence
        found = []
        for index in chosen:
            freed = ordinary.copy()
            freed[first + index] = sigma[index]
            found.append(posterior(data, freed, mean).log_evidence - without)
        return found

    every = gains(fitted, range(sigma.size))
    best = int(np.argmax(every))
    evidence = every[best] + float(np.log(PRIOR / sigma.size))
    if apart.count and gains(apart, [best])[0] <= 0.0:
        return None
    return Missing(COEFFICIENTS[best // len(terms)], terms[best % len(terms)], evidence)
