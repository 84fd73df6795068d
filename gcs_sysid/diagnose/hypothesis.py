"""A set of causes with what the flights say of it."""

from __future__ import annotations

from dataclasses import dataclass

from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Posterior

PRIOR_OF_NONE = 0.5
PRIOR_OF_ONE = 0.4
"""Shared by all causes, and by all that a cause may be about."""
PRIOR_OF_TWO = 0.1
"""Shared by all pairs."""
PRIOR_OF_MORE = 0.25
"""Sets of one cause more are together so many times as probable, beside all of these."""
PRIOR_OF_UNLISTED = 0.05
"""That something is at work that no cause stands for, beside all of these."""


@dataclass(frozen=True)
class Estimate:
    """A parameter of a cause: its value and one standard deviation."""

    name: str
    value: float
    deviation: float
    unit: str
    nominal: float


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
        accuracy: what the aerodynamics of the file are off by, over the sigmas that it states.
    """

    causes: tuple[Candidate, ...]
    prior: float
    probability: float
    log_bayes_factor: float
    estimates: tuple[tuple[Estimate, ...], ...]
    posterior: Posterior
    accuracy: float = 1.0

    @property
    def names(self) -> tuple[str, ...]:
        """Identifiers of the causes."""
        return tuple(candidate.cause.name for candidate in self.causes)
