"""How much better flights that took no part are foretold with causes in the simulation.

log p(apart | fitted, hypothesis) = log p(apart and fitted) − log p(fitted): how probable what took
no part is to one who knows what the fitted flights say, each hypothesis with all its uncertainty.
No fit to what took no part comes into it. What no cause frees stays as the file has it: left to
small ordinary errors, nothing being wrong would learn from a flight what is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information, posterior


def foretold(
    fitted: Information, apart: Information, unknowns: Unknowns, causes: Sequence[Candidate]
) -> float:
    """Log predictive density of what took no part [nat]."""
    sigma, mean = unknowns.freed(causes)
    sigma = unknowns.alone(causes, sigma)
    both = posterior(fitted.plus(apart), sigma, mean).log_evidence
    return both - posterior(fitted, sigma, mean).log_evidence + apart.shared


def gained(
    fitted: Information,
    apart: Information,
    unknowns: Unknowns,
    causes: Sequence[Candidate],
    alike: Sequence[Candidate] = (),
) -> float:
    """What causes gain, per measurement that took no part [nat]; nan without any.

    Of the simulation with them put right over the simulation as it is: in either its aerodynamics
    are what the file says, and so is, without the causes, what they and those that explain as much
    are about. Ordinary errors of the same kind, left free, would have been learned from what was
    fitted as well as the cause is. (Of 12 % of mass in a file that is 5 % wrong, its derivatives
    learned all, and it gained nothing; a rolling moment of its own gained nothing over an aileron
    that stood eight of its ordinary sigmas elsewhere.)
    """
    if not apart.count:
        return float(np.nan)
    return _won(fitted, apart, unknowns.as_accurate(0.0), causes, alike) / apart.count


def against(
    fitted: Information,
    apart: Information,
    unknowns: Unknowns,
    causes: Sequence[Candidate],
    alike: Sequence[Candidate] = (),
) -> float:
    """By how much what took no part speaks against causes [nat], the file as wrong as it may be."""
    return -_won(fitted, apart, unknowns, causes, alike)


def _won(
    fitted: Information,
    apart: Information,
    unknowns: Unknowns,
    causes: Sequence[Candidate],
    alike: Sequence[Candidate],
) -> float:
    """What causes win [nat] over what they and those like them are about as the file has it."""
    held = unknowns.as_it_is((*causes, *alike))
    with_causes = foretold(fitted, apart, unknowns, causes)
    return with_causes - foretold(fitted, apart, held, ())


def scattered(
    blocks: Float[np.ndarray, "block parameter"],
    apart: Bool[np.ndarray, " row"],
    moved: Float[np.ndarray, " parameter"],
    length: int,
) -> float:
    """Variance of what a correction gains on rows that took no part [nat²].

    The gain is Σ g·δ + ½ δᵀHδ over blocks of rows, of which g, the slope where the flight ended,
    has mean 0 and scatters from block to block, H is what it is. Rows near each other may go
    together; blocks do not.

    Args:
        blocks: slope of the log-likelihood by every block.
        apart: rows that took no part; those behind the last of them are padding.
        moved: δ, the correction of each parameter.
        length: of a block, in rows.
    """
    padded = np.zeros(blocks.shape[0] * length)
    padded[: apart.size] = apart
    share = padded.reshape(-1, length).mean(axis=1)
    return float(np.sum((share * (blocks @ moved)) ** 2))
