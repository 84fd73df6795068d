"""The kinematic filter and its fixed-interval smoother over a whole flight, inside `lax.scan`.

Forward: the equations of the live filter. Backward: Rauch–Tung–Striebel in the error state,
x_s(k) = x_f(k) ⊞ G [x_s(k+1) ⊟ x_p(k+1)], G = P_f Fᵀ P_p⁻¹ (Särkkä, *Bayesian Filtering and
Smoothing*, 2013, algorithm 9.1). The flight is cut into chunks of fixed length: one compilation
serves flights of any length, and since the backward run repeats the forward run of its chunk,
memory holds the covariances of one chunk only.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid.frames import Array
from gcs_sysid.model.kinematic_jacobians import (
    Transition,
    flow_sensitivity,
    linearised,
    transition,
)
from gcs_sysid.model.kinematics import (
    MEASURED,
    Imu,
    Levers,
    Measurements,
    Noise,
    State,
    compose,
    difference,
    flow,
    process_covariance,
)
from gcs_sysid.reconstruct.observation import observation

CHUNK = 256
"""Rows at a time: their covariances, 5 MB, stay in the processor's cache."""


class Inputs(NamedTuple):
    """What the filter reads, one row a sample of the inertial unit.

    Attributes:
        before: inertial sample at the start of the step.
        after: inertial sample at its end, to which the row belongs.
        step: length of the step [s]; zero for the first row and for padding.
        measured: what arrived around the end of the step.
    """

    before: Imu
    after: Imu
    step: Float[Array, " sample"]
    measured: Measurements


class Smoothed(NamedTuple):
    """Smoothed flight, one row a sample.

    Attributes:
        attitude: quaternion, body to NED.
        rest: additive state.
        deviation: one standard deviation of the error state.
        flow: true airspeed [m/s], angle of attack, sideslip [rad] at the reference point.
        flow_covariance: their covariance.
        innovation: measured minus predicted, zero where nothing arrived.
        innovation_deviation: its standard deviation by the filter.
        nis: normalised innovation squared of each group.
        residual: measured minus smoothed.
        residual_variance: what the smoothed state adds to the variance of the residual.
    """

    attitude: Float[np.ndarray, "sample four"]
    rest: Float[np.ndarray, "sample state"]
    deviation: Float[np.ndarray, "sample state"]
    flow: Float[np.ndarray, "sample three"]
    flow_covariance: Float[np.ndarray, "sample three three"]
    innovation: Float[np.ndarray, "sample row"]
    innovation_deviation: Float[np.ndarray, "sample row"]
    nis: Float[np.ndarray, "sample group"]
    residual: Float[np.ndarray, "sample row"]
    residual_variance: Float[np.ndarray, "sample row"]


class _Belief(NamedTuple):
    state: State
    covariance: Float[Array, "state state"]


def _predict(belief: _Belief, row: Inputs, noise: Noise) -> tuple[_Belief, Transition]:
    ahead, jacobian = transition(belief.state, row.before, row.after, row.step, noise)
    spread = jacobian.carried(belief.covariance)
    return _Belief(ahead, spread + jnp.diag(process_covariance(row.step, noise))), jacobian


def _update(
    belief: _Belief, row: Inputs, levers: Levers, noise: Noise
) -> tuple[_Belief, tuple[Array, Array, Array]]:
    residual, jacobian, variance, nis = observation(
        belief.state, belief.covariance, row.after, row.measured, levers, noise
    )
    seen = jacobian @ belief.covariance
    spread = seen @ jacobian.T + jnp.diag(variance)
    gain = jax.scipy.linalg.cho_solve(jax.scipy.linalg.cho_factor(spread), seen).T
    # Joseph's form multiplied out: K is thin, so that no product of two square matrices is needed.
    taken = gain @ (seen - 0.5 * spread @ gain.T)
    covariance = belief.covariance - taken - taken.T
    state = compose(belief.state, gain @ residual)
    return _Belief(state, covariance), (residual, jnp.sqrt(jnp.diagonal(spread)), nis)


@jax.jit
def _forward(
    start: _Belief, rows: Inputs, levers: Levers, noise: Noise
) -> tuple[_Belief, tuple[Array, Array, Array]]:
    """End of a chunk, and the innovations on the way."""

    def step(belief: _Belief, row: Inputs) -> tuple[_Belief, tuple[Array, Array, Array]]:
        ahead, _ = _predict(belief, row, noise)
        return _update(ahead, row, levers, noise)

    return jax.lax.scan(step, start, rows)


@jax.jit
def _backward(
    start: _Belief,
    end: _Belief,
    rows: Inputs,
    levers: Levers,
    reference: Float[Array, " axis"],
    noise: Noise,
) -> tuple[_Belief, Any]:
    """Smoothed start of a chunk from its smoothed end, and the smoothed samples in between."""

    def ahead(belief: _Belief, row: Inputs) -> tuple[_Belief, tuple[_Belief, _Belief, Transition]]:
        predicted, jacobian = _predict(belief, row, noise)
        updated, _ = _update(predicted, row, levers, noise)
        return updated, (belief, predicted, jacobian)

    def back(later: _Belief, item: tuple[_Belief, _Belief, Transition]) -> tuple[_Belief, _Belief]:
        filtered, predicted, jacobian = item
        gain = jax.scipy.linalg.cho_solve(
            jax.scipy.linalg.cho_factor(predicted.covariance), jacobian.times(filtered.covariance)
        ).T
        state = compose(filtered.state, gain @ difference(later.state, predicted.state))
        covariance = filtered.covariance + gain @ (later.covariance - predicted.covariance) @ gain.T
        return _Belief(state, 0.5 * (covariance + covariance.T)), later

    _, filtered = jax.lax.scan(ahead, start, rows)
    before, smoothed = jax.lax.scan(back, end, filtered, reverse=True)
    describe = jax.vmap(_describe, in_axes=(0, 0, None, None))
    return before, describe(smoothed, rows, levers, reference)


def _describe(
    belief: _Belief, row: Inputs, levers: Levers, reference: Float[Array, " axis"]
) -> tuple[Array, ...]:
    """What is kept of a smoothed sample."""
    sensitivity = flow_sensitivity(belief.state, row.after, reference)
    residual, jacobian = linearised(belief.state, row.after, row.measured, levers)
    return (
        belief.state.attitude,
        belief.state.rest,
        jnp.sqrt(jnp.maximum(jnp.diagonal(belief.covariance), 0.0)),
        flow(belief.state, row.after, reference),
        sensitivity @ belief.covariance @ sensitivity.T,
        residual,
        jnp.sum((jacobian @ belief.covariance) * jacobian, axis=1),
    )


def smooth(
    state: State,
    covariance: Float[np.ndarray, "state state"],
    inputs: Inputs,
    levers: Levers,
    reference: Float[np.ndarray, " axis"],
    noise: Noise,
) -> Smoothed:
    """Smooths a flight.

    Args:
        state: estimate before the first row.
        covariance: its error covariance; must be positive definite.
        inputs: the flight, arrays of NumPy.
        levers: sensor positions.
        reference: position, from the inertial unit [m], at which airspeed and flow angles are
            asked.
        noise: intensities.

    Returns:
        One row a sample of `inputs`.
    """
    count = inputs.step.shape[0]
    chunks = [_chunk(inputs, first) for first in range(0, count, CHUNK)]
    point = jnp.asarray(reference)
    beliefs = [_Belief(state, jnp.asarray(covariance))]
    innovations = []
    for rows in chunks:
        end, seen = _forward(beliefs[-1], rows, levers, noise)
        beliefs.append(end)
        innovations.append(jax.tree.map(np.asarray, seen))
    later = beliefs[-1]
    pieces = []
    for start, rows in zip(reversed(beliefs[:-1]), reversed(chunks), strict=True):
        later, seen = _backward(start, later, rows, levers, point, noise)
        pieces.append(jax.tree.map(np.asarray, seen))
    pieces.reverse()

    def joined(parts: list[Any], index: int) -> np.ndarray:
        return np.concatenate([part[index] for part in parts])[:count]

    present = np.repeat(
        np.asarray(inputs.measured.valid),
        [rows.stop - rows.start for rows in MEASURED.values()],
        axis=1,
    )
    return Smoothed(
        *(joined(pieces, index) for index in range(5)),
        innovation=joined(innovations, 0),
        innovation_deviation=np.where(present, joined(innovations, 1), np.nan),
        nis=np.where(np.asarray(inputs.measured.valid), joined(innovations, 2), np.nan),
        residual=np.where(present, joined(pieces, 5), np.nan),
        residual_variance=np.where(present, joined(pieces, 6), np.nan),
    )


def _chunk(inputs: Inputs, first: int) -> Inputs:
    """`CHUNK` rows from `first`, padded with rows that change nothing."""

    def piece(values: Any) -> Array:
        part = np.asarray(values)[first : first + CHUNK]
        missing = CHUNK - part.shape[0]
        return jnp.asarray(np.concatenate([part, np.repeat(part[-1:], missing, axis=0)]))

    rows = jax.tree.map(piece, inputs)
    kept = jnp.arange(CHUNK) < inputs.step.shape[0] - first
    return rows._replace(
        step=jnp.where(kept, rows.step, 0.0),
        measured=rows.measured._replace(valid=rows.measured.valid & kept[:, None]),
    )
