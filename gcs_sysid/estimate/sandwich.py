"""Covariance of parameters and intensities that were found in turns (Godambe, Biometrika 72, 1985).

The parameters of the mean solve g = Σ Jᵀ S⁻¹ ν = 0 with sensitivities J at held gains, the
intensities the slope of their likelihood. At the truth both scatter by M, and an error e of all of
them together moves them by −A e, where the gains move too:

    A = | Jᵀ S⁻¹ T    Jᵀ S⁻¹ T_η                     |        cov = A⁻¹ M A⁻ᵀ
        | T_ηᵀ S⁻¹ T + ½ tr(…)   T_ηᵀ S⁻¹ T_η + ½ tr(…) |

T being sensitivities with all that a filter changes. What a gust explains by itself tells nothing
of the derivatives that it acts through: J counts it, T does not.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float

from gcs_sysid.estimate import intensities
from gcs_sysid.model.aided import Linearised, Means, Noise
from gcs_sysid.reconstruct import causal, linear_filter
from gcs_sysid.reconstruct.aided_smoother import FlightModel
from gcs_sysid.reconstruct.causal import Path

SMALL = 0.1
"""Step of a parameter, in deviations at held gains, over which matrices are taken as linear."""


class Slopes(NamedTuple):
    """How parameters of the mean and intensities, in this order, move the equations that find them.

    Attributes:
        slope: A, without priors.
        scatter: M, likewise.
    """

    slope: Float[np.ndarray, "unknown unknown"]
    scatter: Float[np.ndarray, "unknown unknown"]


def slopes(
    model: FlightModel,
    means: Means,
    log_noise: Noise,
    path: Path,
    counts: Bool[np.ndarray, " sample"],
    free: tuple[Bool[np.ndarray, " parameter"], Bool[np.ndarray, " intensity"]],
    sizes: Float[np.ndarray, " parameter"],
    through_gains: Bool[np.ndarray, " parameter"],
) -> Slopes:
    """Both matrices over a flight.

    Args:
        model: the aircraft.
        means: parameters of the mean.
        log_noise: log intensities.
        path: about which the rows are linearised.
        counts: rows from which the parameters of the mean are taken.
        free: parameters and intensities that were found; rows and columns of the others are 0.
        sizes: one deviation of each parameter.
        through_gains: parameters that change how the filter learns; of the others T is J.
    """
    flat, unravel = ravel_pytree(means)
    logs, unravel_logs = ravel_pytree(log_noise)
    about = intensities.lined(model, means, path, log_noise)
    turning = np.flatnonzero(free[0] & through_gains).tolist()
    found, noises = np.flatnonzero(free[0]), np.flatnonzero(free[1])
    moved = {
        index: causal.joined(
            model, unravel(flat.at[index].add(SMALL * sizes[index])), log_noise, path
        )
        for index in turning
    }
    held = causal.Carried(model, means, log_noise, found)
    changes = {
        key: jax.tree.map(jnp.zeros_like, path.start) for key in (*turning, *(flat.size + noises))
    }
    size = found.size + noises.size
    slope, scatter = np.zeros((size, size)), np.zeros((size, size))
    start, first = path.start, 0
    for number, (chunk, rows, still) in enumerate(zip(path.chunks, *about[1:], strict=True)):
        end, done = linear_filter.run(start, rows)

        def changed(
            key: int,
            other: Linearised,
            by: float,
            begun: linear_filter.Belief = start,
            piece: Linearised = rows,
            steps: linear_filter.Filtered = done,
        ) -> tuple[np.ndarray, np.ndarray]:
            changes[key], told = linear_filter.change(begun, piece, steps, other, changes[key])
            return np.asarray(told.innovation) / by, np.asarray(told.spread) / by

        white = held.chunk(chunk, rows, done)
        wanted = np.zeros(white.shape[0], dtype=bool)
        part = counts[first : first + wanted.size]
        wanted[: part.size] = part
        first += part.size
        instruments = np.where(wanted[:, None, None], white, 0.0)
        total, spread = white.copy(), np.zeros((found.size, white.shape[0] * white.shape[1] ** 2))
        for place, index in enumerate(found.tolist()):
            if index in moved:
                by = SMALL * float(sizes[index])
                total[:, :, place], turned = changed(index, moved[index][number], by)
                spread[place] = turned.ravel()
        of_noise, spread_noise = [], []
        for index in noises.tolist():
            other = unravel_logs(logs.at[index].add(intensities.DIFFERENCE))
            other_rows = intensities.at(other, chunk, rows, still)
            innovation, turned = changed(flat.size + index, other_rows, intensities.DIFFERENCE)
            of_noise.append(innovation)
            spread_noise.append(turned.ravel())
        own = instruments.reshape(-1, found.size)
        every = np.concatenate(
            [total.reshape(-1, found.size), np.stack(of_noise, axis=-1).reshape(len(own), -1)],
            axis=1,
        )
        spreads = np.concatenate([spread, np.array(spread_noise)])
        slope[: found.size] += own.T @ every
        lower = every[:, found.size :].T @ every + 0.5 * spreads[found.size :] @ spreads.T
        slope[found.size :] += lower
        scatter[: found.size, : found.size] += own.T @ own
        scatter[: found.size, found.size :] += own.T @ every[:, found.size :]
        scatter[found.size :, found.size :] += lower[:, found.size :]
        start = end
    scatter[found.size :, : found.size] = scatter[: found.size, found.size :].T
    return Slopes(slope, scatter)


def covariance(
    told: Slopes, precision: Float[np.ndarray, "unknown unknown"], factor: float
) -> Float[np.ndarray, "unknown unknown"]:
    """Covariance with a prior.

    Args:
        told: by the flight.
        precision: of the prior.
        factor: by which scores scatter more than independent innovations would make them.
    """
    slope = told.slope / factor + precision
    scatter = told.scatter / factor + precision
    size = np.sqrt(np.diagonal(scatter))
    inverse = np.linalg.inv(slope / np.outer(size, size))
    return inverse @ (scatter / np.outer(size, size)) @ inverse.T / np.outer(size, size)
