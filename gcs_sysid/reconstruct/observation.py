"""What the filter sees in a row of measurements: innovations, their noise, outliers among them."""

from __future__ import annotations

from collections.abc import Collection

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gcs_sysid.model.kinematic_jacobians import linearised
from gcs_sysid.model.kinematics import MEASURED, Imu, Levers, Measurements, Noise, State

ROWS = 9
NIS_LIMIT = 25.0
"""Squared normalised innovation beyond which a group counts as an outlier (5 sigma in one row)."""


def observation(
    state: State,
    covariance: Float[Array, "state state"],
    imu: Imu,
    measured: Measurements,
    levers: Levers,
    noise: Noise,
    groups: Collection[str] = MEASURED.keys(),
) -> tuple[
    Float[Array, " row"], Float[Array, "row state"], Float[Array, " row"], Float[Array, " group"]
]:
    """Innovation, Jacobian, noise variance per row, and normalised innovation squared per group.

    Rows of absent groups are zero with unit noise, so that they change nothing. The noise of a
    group whose innovation is beyond `NIS_LIMIT` is raised until it is not: a gross outlier pulls no
    more than a five-sigma one (Huber's idea, in the form for a filter of Karlgaard & Schaub, 2007).
    """
    residual, jacobian = linearised(state, imu, measured, levers, groups)
    widths = np.array([rows.stop - rows.start for rows in MEASURED.values()])
    present = jnp.repeat(measured.valid, widths, total_repeat_length=ROWS)
    residual = jnp.where(present, residual, 0.0)
    jacobian = jnp.where(present[:, None], jacobian, 0.0)
    variance = jnp.where(present, noise.measured**2, 1.0)
    spread = jacobian @ covariance @ jacobian.T + jnp.diag(variance)

    def surprise(rows: slice) -> Array:
        factor = jnp.linalg.cholesky(spread[rows, rows])
        return jnp.sum(jax.scipy.linalg.solve_triangular(factor, residual[rows], lower=True) ** 2)

    nis = jnp.stack(
        [surprise(rows) if name in groups else jnp.zeros(()) for name, rows in MEASURED.items()]
    )
    excess = jnp.repeat(jnp.maximum(1.0, nis / NIS_LIMIT), widths, total_repeat_length=ROWS)
    inflated = jnp.where(excess > 1.0, variance + (excess - 1.0) * jnp.diagonal(spread), variance)
    return residual, jacobian, inflated, nis
