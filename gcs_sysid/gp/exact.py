"""The exact dependent Gaussian process: for reference, and where the data are few.

Values of single outputs at points, each with its own noise: outputs that are missing are points
that are not there. n points cost n³; beyond about three thousand use `inducing`.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
from jaxtyping import Float

from gcs_sysid.frames import Array
from gcs_sysid.gp import dependent
from gcs_sysid.gp.dependent import Kernel, Points
from gcs_sysid.gp.posterior import Posterior
from gcs_sysid.gp.samples import Rows


def observed(
    rows: Rows,
) -> tuple[Points, Float[Array, " point"], Float[Array, " point"]]:
    """Points, values and noise variances of all values that are not missing."""
    sample, output = np.nonzero(np.asarray(rows.precision) > 0.0)
    values, precision = (np.asarray(part)[sample, output] for part in rows[1:])
    return Points(np.asarray(rows.inputs)[sample], output), values, 1.0 / precision


@jax.jit
def condition(
    kernel: Kernel,
    points: Points,
    values: Float[Array, " point"],
    noise: Float[Array, " point"],
) -> Posterior:
    """The posterior after noisy values.

    Args:
        kernel: prior covariance.
        points: where the values are.
        values: outputs less the mean, scaled.
        noise: variance of each.
    """
    factor = _factor(kernel, points, noise)
    inverse = jsl.cho_solve((factor, True), jnp.eye(values.shape[0]))
    return Posterior(kernel, points, jsl.cho_solve((factor, True), values), inverse)


@jax.jit
def log_marginal(
    kernel: Kernel,
    points: Points,
    values: Float[Array, " point"],
    noise: Float[Array, " point"],
) -> Float[Array, ""]:
    """Logarithm of the density of the values under the prior, noise included [nat]."""
    factor = _factor(kernel, points, noise)
    white = jsl.solve_triangular(factor, values, lower=True)
    return -0.5 * (
        white @ white
        + 2.0 * jnp.sum(jnp.log(jnp.diagonal(factor)))
        + values.shape[0] * jnp.log(2.0 * jnp.pi)
    )


def _factor(
    kernel: Kernel, points: Points, noise: Float[Array, " point"]
) -> Float[Array, "point point"]:
    return jnp.linalg.cholesky(dependent.covariance(kernel, points, points) + jnp.diag(noise))
