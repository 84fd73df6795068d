"""How much better flights that took no part are foretold with causes in the simulation.

log p(apart | fitted, hypothesis) = log p(apart and fitted) − log p(fitted): how probable what took
no part is to one who knows what the fitted flights say, each hypothesis with all its uncertainty.
No fit to what took no part comes into it. What no cause frees stays as the file has it: left to
small ordinary errors, nothing being wrong would learn from a flight what is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

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
    fitted: Information, apart: Information, unknowns: Unknowns, causes: Sequence[Candidate]
) -> float:
    """What causes gain, per measurement that took no part [nat]; nan without any.

    Over the file as it is in what they are about: an ordinary error of the same kind, left free
    without them, would have been learned from what was fitted as well as the cause is with them.
    """
    if not apart.count:
        return float(np.nan)
    with_causes = foretold(fitted, apart, unknowns, causes)
    return (with_causes - foretold(fitted, apart, unknowns.as_it_is(causes), ())) / apart.count
