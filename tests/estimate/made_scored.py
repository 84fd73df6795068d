"""Where a search ended, by hand: the first parameters were sought, and no intensities."""

from __future__ import annotations

import numpy as np
from jax.flatten_util import ravel_pytree

from gcs_sysid.estimate.flight_rows import Unknowns
from gcs_sysid.estimate.likelihood import Curvature
from gcs_sysid.estimate.scoring import Scored
from tests.estimate import made_flight as made


def scored(
    slope: np.ndarray,
    *,
    unknowns: Unknowns | None = None,
    scatter: np.ndarray | None = None,
    precision: np.ndarray | None = None,
    blocks: np.ndarray | None = None,
    log_likelihood: float = 0.0,
    ended: bool = True,
    moving: float = 0.0,
) -> Scored:
    """As many parameters as the slope has rows.

    Args:
        slope: of the sums by the parameters.
        unknowns: where it ended; None for those of the made flight.
        scatter: of the sums; None where it is their slope, as in an ordinary likelihood.
        precision: of what was believed; None for nothing.
        blocks: sums of stretches; None for two that say nothing.
        log_likelihood: there.
        ended: whether nothing more was to be gained.
        moving: how far the last step wanted to go.
    """
    at = made.unknowns(1.0) if unknowns is None else unknowns
    count, everything = slope.shape[0], ravel_pytree(at.means)[0].size
    free = np.zeros(everything, dtype=bool)
    free[:count] = True
    scatter = slope if scatter is None else scatter
    return Scored(
        unknowns=at,
        free=(free, np.zeros(ravel_pytree(at.log_noise)[0].size, dtype=bool)),
        curvature=Curvature(slope, scatter, scatter),
        blocks=np.zeros((2, count)) if blocks is None else blocks,
        precision=np.zeros((count, count)) if precision is None else precision,
        whitened=np.zeros((1, 1)),
        log_likelihood=(log_likelihood,),
        ended=ended,
        moving=moving,
        moved=np.zeros((1, everything)),
    )
