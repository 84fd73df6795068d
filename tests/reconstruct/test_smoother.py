"""The smoother against a dense solution of the same problem, and cut into other chunks."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from gcs_sysid import frames
from gcs_sysid.model import kinematics
from gcs_sysid.model.kinematics import MEASURED, SIZE, State
from gcs_sysid.reconstruct import smoother
from gcs_sysid.reconstruct.kinematic_ekf import _compiled
from gcs_sysid.reconstruct.smoother import Inputs
from tests.reconstruct.filtered_example import Example, example, row, smoothed, with_measured

STEPS = 20
SMALL = 1e-3
"""Uncertainties are scaled by this, so that what is not linear is a thousandth of them."""


def small_problem() -> tuple[Example, list[State]]:
    """Twenty rows whose measurements lie within noise of the trajectory of the first state."""
    flight = example()
    rng = np.random.default_rng(5)
    noise = flight.noise._replace(
        **{
            name: SMALL * getattr(flight.noise, name)
            for name in flight.noise._fields
            if not name.endswith("_time")
        }
    )
    move, look, _ = _compiled()
    covariance = jnp.asarray(SMALL**2 * flight.covariance)
    state, nominal, measured = flight.state, [], []
    for index in range(STEPS):
        now = row(flight.inputs, index)
        state, _, _ = move(state, now.before, now.after, now.step, noise)
        nominal.append(state)
        residual, *_ = look(state, covariance, now.after, now.measured, flight.levers, noise)
        off = SMALL * np.asarray(flight.noise.measured) * rng.standard_normal(9) - residual
        seen = now.measured
        parts = {name: off[rows] for name, rows in MEASURED.items()}
        turn = frames.exponential(jnp.asarray(-residual[MEASURED["attitude"]]))
        noisy = frames.exponential(jnp.asarray((off + residual)[MEASURED["attitude"]]))
        measured.append(
            with_measured(
                seen,
                airspeed=seen.airspeed + parts["airspeed"],
                velocity=seen.velocity + parts["velocity"],
                attitude=frames.multiply(frames.multiply(seen.attitude, turn), noisy),
                vanes=seen.vanes + parts["vanes"],
            )
        )
    rows = jax.tree.map(lambda values: np.asarray(values)[:STEPS], flight.inputs)
    stacked = jax.tree.map(lambda *values: np.stack(values), *measured)
    inputs = Inputs(rows.before, rows.after, rows.step, stacked)
    problem = flight._replace(covariance=np.asarray(covariance), inputs=inputs, noise=noise)
    return problem, nominal


def dense(problem: Example, nominal: list[State]) -> tuple[np.ndarray, np.ndarray]:
    """Posterior mean and deviation of all error states at once, by Gaussian conditioning.

    The joint covariance of the whole trajectory is written down, no recursion over measurements.
    """
    move, look, _ = _compiled()
    before, prior = problem.state, problem.covariance
    covariances, jumps, observed, seen, variances = [], [], [], [], []
    for index in range(STEPS):
        now = row(problem.inputs, index)
        _, jump, drift = move(before, now.before, now.after, now.step, problem.noise)
        jumps.append(np.asarray(jump))
        prior = jumps[-1] @ prior @ jumps[-1].T + np.asarray(drift)
        covariances.append(prior)
        before = nominal[index]
        residual, jacobian, variance, _ = look(
            before, jnp.asarray(prior), now.after, now.measured, problem.levers, problem.noise
        )
        seen.append(np.asarray(residual))
        observed.append(np.asarray(jacobian))
        variances.append(np.asarray(variance))
    joint = np.zeros((STEPS, SIZE, STEPS, SIZE))
    for first in range(STEPS):
        cross = covariances[first]
        joint[first, :, first] = cross
        for later in range(first + 1, STEPS):
            cross = jumps[later] @ cross
            joint[later, :, first] = cross
            joint[first, :, later] = cross.T
    joint = joint.reshape(STEPS * SIZE, STEPS * SIZE)
    rows = np.zeros((STEPS, 9, STEPS, SIZE))
    for index, jacobian in enumerate(observed):
        rows[index, :, index] = jacobian
    rows = rows.reshape(STEPS * 9, STEPS * SIZE)
    across = joint @ rows.T
    inverse = np.linalg.inv(rows @ across + np.diag(np.concatenate(variances)))
    mean = across @ inverse @ np.concatenate(seen)
    variance = np.diagonal(joint - across @ inverse @ across.T)
    return mean.reshape(STEPS, SIZE), np.sqrt(np.maximum(variance, 0.0)).reshape(STEPS, SIZE)


def test_smoothed_states_and_bands_are_those_of_the_dense_solution() -> None:
    problem, nominal = small_problem()
    found = problem.smooth()
    mean, deviation = dense(problem, nominal)
    differ = jax.jit(kinematics.difference)
    errors = np.stack(
        [
            np.asarray(
                differ(
                    State(jnp.asarray(found.attitude[k]), jnp.asarray(found.rest[k])), nominal[k]
                )
            )
            for k in range(STEPS)
        ]
    )
    moving = deviation > 1e-12
    assert (np.abs(mean) / np.where(moving, deviation, 1.0)).max() > 0.5  # there is much to find
    np.testing.assert_allclose((errors - mean)[moving] / deviation[moving], 0.0, atol=0.02)
    np.testing.assert_allclose(found.deviation[moving], deviation[moving], rtol=0.01)


def test_another_cut_gives_the_same_flight() -> None:
    """The flight cut where it is, and elsewhere by rows before it in which nothing happens."""
    whole, flight = smoothed(), example()
    still = smoother.CHUNK // 3

    def later(values: np.ndarray) -> np.ndarray:
        return np.concatenate([np.repeat(np.asarray(values)[:1], still, axis=0), values])

    rows = jax.tree.map(later, flight.inputs)
    rows.step[:still] = 0.0
    rows.measured.valid[:still] = False
    pieces = flight._replace(inputs=rows).smooth()
    for name, values in whole._asdict().items():
        scale = np.nanmax(np.abs(values), initial=1e-12)
        np.testing.assert_allclose(
            getattr(pieces, name)[still:], values, atol=1e-7 * scale, rtol=1e-6, err_msg=name
        )


def test_bands_are_finite_and_positive() -> None:
    found = smoothed()
    assert np.isfinite(found.deviation).all()
    assert (found.deviation > 0.0).all()
    eigenvalues = np.linalg.eigvalsh(found.flow_covariance)
    assert (eigenvalues > 0.0).all()


def test_absent_messages_have_no_innovation_and_no_residual() -> None:
    found = smoothed()
    valid = np.asarray(example().inputs.measured.valid)
    for group, rows in enumerate(MEASURED.values()):
        absent = ~valid[:, group]
        assert np.isnan(found.residual[absent][:, rows]).all()
        assert np.isnan(found.innovation_deviation[absent][:, rows]).all()
        assert np.isfinite(found.residual[~absent][:, rows]).all()
        assert (found.innovation[absent][:, rows] == 0.0).all()


def test_constants_are_one_number_and_one_band_for_the_whole_flight() -> None:
    found = smoothed()
    first, spread = found.rest[:, 21:], found.deviation[:, 21:]
    np.testing.assert_allclose(first, np.broadcast_to(first[0], first.shape), atol=1e-7)
    np.testing.assert_allclose(spread, np.broadcast_to(spread[0], spread.shape), rtol=1e-4)
