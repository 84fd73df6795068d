"""What a settled flight tells of all its parameters, by the likelihood itself.

Turns go by scores at held gains, which are quick and right at the truth. How far from it an error
of the parameters is, they say by less than their information: how gusts turn an aircraft tells most
of an inertia, and of the scale of all derivatives of an axis, and that is in how gains change. To
weigh causes against each other, slope and information are those of the likelihood, with intensities
integrated out (a Gaussian integral about the settled point, with what was believed of them).
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float

from gcs_sysid.estimate import likelihood
from gcs_sysid.estimate.likelihood import Quadratic
from gcs_sysid.estimate.settling import Beliefs, Settled
from gcs_sysid.model.aided import Means
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.reconstruct import causal
from gcs_sysid.reconstruct.causal import Told

PASSES = 2
"""Of the filter, after which its path has followed the last turn."""


def told(model: FlightModel, like: Means, done: Settled, beliefs: Beliefs) -> tuple[Told, Told]:
    """What the rows that were fitted say of all parameters, and what the others say.

    Args:
        model: the aircraft.
        like: parameters of the mean, of which the form is taken.
        done: where the flight settled.
        beliefs: about its intensities and, for the size of steps, its parameters.
    """
    means = ravel_pytree(like)[1](jnp.asarray(done.values))
    path = done.last.path
    for _ in range(PASSES):
        path = causal.filtered(path, causal.joined(model, means, done.log_noise, path))[0]
    held = done.last.told.matrix + done.last.apart.matrix
    free = np.diagonal(held) > 0.0, np.asarray(ravel_pytree(beliefs.noise.sigma)[0]) > 0.0
    sizes = np.zeros(free[0].size)
    sizes[free[0]] = 1.0 / np.sqrt(np.diagonal(held)[free[0]])
    believed = np.sqrt(np.diagonal(beliefs.covariance))
    sizes = np.where(believed > 0.0, np.minimum(sizes, believed), sizes)
    given = (model, means, done.log_noise, path, done.fitted, free, sizes)
    parts = likelihood.quadratic(*given)
    spread = np.asarray(ravel_pytree(beliefs.noise.sigma)[0])[free[1]]
    off = ravel_pytree(done.log_noise)[0] - ravel_pytree(beliefs.noise.mean)[0]
    pull = Quadratic(np.diag(spread**-2.0), -np.asarray(off)[free[1]] * spread**-2.0)
    mine, others = (
        Told(*_without_intensities(part, pull, free[0]), last.count)
        for part, last in zip(parts, (done.last.told, done.last.apart), strict=True)
    )
    return mine, others


def _without_intensities(
    part: Quadratic, believed: Quadratic, free: Bool[np.ndarray, " parameter"]
) -> tuple[Float[np.ndarray, "parameter parameter"], Float[np.ndarray, " parameter"]]:
    """Information and score of the parameters, those behind them integrated out; 0 where held."""
    count = int(free.sum())
    inner = part.information[count:, count:] + believed.information
    across = np.linalg.solve(inner, part.information[count:, :count]).T
    matrix, score = np.zeros((free.size, free.size)), np.zeros(free.size)
    matrix[np.ix_(free, free)] = (
        part.information[:count, :count] - across @ part.information[count:, :count]
    )
    score[free] = part.score[:count] - across @ (part.score[count:] + believed.score)
    return matrix, score
