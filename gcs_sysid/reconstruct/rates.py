"""Angular acceleration from gyro samples, by smoothing rather than by differences.

Each rate is taken as the integral of a Wiener process seen in white noise,

    dω = ω̇ dt,   dω̇ = √q dW,   gyro = ω + e,   e ~ N(0, r),

whose posterior mean is the cubic smoothing spline (Wahba 1978) and whose posterior variance comes
with it. The ratio q/r is the most likely one, shared by the three axes: then the smoother is one
linear, time-symmetric filter, and applying the same filter to the regressors of a moment equation
leaves that equation exactly true (Klein & Morelli 2006, section 5.2: filter both sides alike).
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid.frames import Array

RATIOS = np.logspace(1.0, 10.0, 28)
"""Candidate ratios q/r [1/s³]: cut-offs from about 0.3 Hz to 50 Hz."""
BLOCK = 4096
"""Flights are padded to whole blocks, so that few lengths are ever compiled."""
WINDOW = 128
"""So many samples or fewer are padded to this many: what a live run looks at."""
SIGNALS = 4
"""So many signals are smoothed at a time: one width is compiled."""


class Smooth(NamedTuple):
    """Smoothed signals, their derivative, and standard deviations relative to √r."""

    value: Float[np.ndarray, "sample signal"]
    derivative: Float[np.ndarray, "sample signal"]
    value_gain: Float[np.ndarray, " sample"]
    derivative_gain: Float[np.ndarray, " sample"]


class AngularMotion(NamedTuple):
    """Smoothed angular rate [rad/s] and acceleration [rad/s²] with one standard deviation."""

    rate: Float[np.ndarray, "sample axis"]
    acceleration: Float[np.ndarray, "sample axis"]
    acceleration_deviation: Float[np.ndarray, "sample axis"]
    noise: Float[np.ndarray, " axis"]
    ratio: float


def advance(
    belief: tuple[Array, Array],
    step: Float[Array, ""],
    seen: Float[Array, " signal"],
    ratio: Float[Array, ""],
) -> tuple[tuple[Array, Array], tuple[Array, ...]]:
    """One step of the filter for r = 1.

    Returns the new mean and covariance, and beside them what was predicted: mean, covariance,
    innovation and its variance.
    """
    mean, covariance = belief
    move = jnp.eye(2) + jnp.array([[0.0, 1.0], [0.0, 0.0]]) * step
    ahead = move @ mean
    spread = move @ covariance @ move.T + ratio * jnp.array(
        [[1.0 / 3.0, 0.5], [0.5, 1.0]]
    ) * jnp.array([[step**3, step**2], [step**2, step]])
    variance = spread[0, 0] + 1.0
    gain = spread[:, 0] / variance
    innovation = seen - ahead[0]
    mean = ahead + gain[:, None] * innovation[None, :]
    covariance = spread - jnp.outer(gain, gain) * variance
    return (mean, covariance), (ahead, spread, innovation, variance)


def start(first: Float[Array, " signal"], ratio: Float[Array, ""]) -> tuple[Array, Array]:
    """Belief before the first sample: that sample, at rest."""
    return jnp.stack([first, jnp.zeros_like(first)]), jnp.diag(jnp.stack([jnp.ones(()), ratio]))


def _filter(
    step: Float[Array, " sample"],
    signal: Float[Array, "sample signal"],
    weight: Float[Array, " sample"],
    ratio: Float[Array, ""],
) -> tuple[tuple[Array, ...], tuple[Array, Array]]:
    """Forward pass for r = 1: filtered and predicted moments, innovations and their variance."""

    def take(
        belief: tuple[Array, Array], row: tuple[Array, Array, Array]
    ) -> tuple[tuple[Array, Array], tuple[Array, ...]]:
        length, seen, counts = row
        updated, (ahead, spread, innovation, variance) = advance(belief, length, seen, ratio)
        mean = jnp.where(counts > 0.0, updated[0], ahead)
        covariance = jnp.where(counts > 0.0, updated[1], spread)
        return (mean, covariance), (mean, covariance, ahead, spread, innovation, variance)

    _, out = jax.lax.scan(take, start(signal[0], ratio), (step, signal, weight))
    return out[:4], out[4:]


@jax.jit
def _likelihood(
    step: Float[Array, " sample"],
    signal: Float[Array, "sample signal"],
    weight: Float[Array, " sample"],
    ratio: Float[Array, ""],
) -> Float[Array, ""]:
    """Log-likelihood with each signal's r profiled out; `weight` is zero on padding."""
    _, (innovation, variance) = _filter(step, signal, weight, ratio)
    noise = _most_likely_noise(innovation, variance, weight)
    logarithms = jnp.sum(weight * jnp.log(variance))
    return -0.5 * (signal.shape[1] * logarithms + jnp.sum(weight) * jnp.sum(jnp.log(noise)))


def _most_likely_noise(
    innovation: Float[Array, "sample signal"],
    variance: Float[Array, " sample"],
    weight: Float[Array, " sample"],
) -> Float[Array, " signal"]:
    """The r under which innovations computed for r = 1 are most likely."""
    return weight @ (innovation**2 / variance[:, None]) / jnp.sum(weight)


@jax.jit
def _noise(
    step: Float[Array, " sample"],
    signal: Float[Array, "sample signal"],
    weight: Float[Array, " sample"],
    ratio: Float[Array, ""],
) -> Float[Array, " signal"]:
    """Most likely r of each signal at a given ratio."""
    _, (innovation, variance) = _filter(step, signal, weight, ratio)
    return _most_likely_noise(innovation, variance, weight)


@jax.jit
def _smooth(
    step: Float[Array, " sample"],
    signal: Float[Array, "sample signal"],
    weight: Float[Array, " sample"],
    ratio: Float[Array, ""],
) -> tuple[Float[Array, "sample two signal"], Float[Array, "sample two"]]:
    """Smoothed moments for r = 1."""
    (mean, covariance, ahead, spread), _ = _filter(step, signal, weight, ratio)

    def back(
        later: tuple[Array, Array], row: tuple[Array, ...]
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        filtered, filtered_spread, predicted, predicted_spread, length = row
        move = jnp.eye(2) + jnp.array([[0.0, 1.0], [0.0, 0.0]]) * length
        gain = jnp.linalg.solve(predicted_spread, move @ filtered_spread).T
        value = filtered + gain @ (later[0] - predicted)
        uncertain = filtered_spread + gain @ (later[1] - predicted_spread) @ gain.T
        return (value, uncertain), (value, jnp.diagonal(uncertain))

    end = (mean[-1], covariance[-1])
    rows = (mean[:-1], covariance[:-1], ahead[1:], spread[1:], step[1:])
    _, (values, variances) = jax.lax.scan(back, end, rows, reverse=True)
    return (
        jnp.concatenate([values, mean[-1:]]),
        jnp.concatenate([variances, jnp.diagonal(covariance[-1])[None]]),
    )


def _padded(
    time: Float[np.ndarray, " sample"], signal: Float[np.ndarray, "sample signal"]
) -> tuple[Array, Array, Array]:
    """Steps, signals and weights, padded with rows that neither move nor measure anything."""
    missing = -time.size % (BLOCK if time.size > WINDOW else WINDOW)
    usual = float(np.median(np.diff(time)))
    step = np.concatenate([np.diff(time, prepend=time[0] - usual), np.zeros(missing)])
    values = np.concatenate([signal, np.repeat(signal[-1:], missing, axis=0)])
    weight = np.concatenate([np.ones(time.size), np.zeros(missing)])
    return jnp.asarray(step), jnp.asarray(values), jnp.asarray(weight)


def most_likely_ratio(
    time: Float[np.ndarray, " sample"], rate: Float[np.ndarray, "sample axis"]
) -> float:
    """Ratio q/r [1/s³] under which the rates are most likely, refined between candidates."""
    step, values, weight = _padded(time, rate)
    score = np.array([float(_likelihood(step, values, weight, jnp.asarray(x))) for x in RATIOS])
    return between_candidates(score)


def between_candidates(score: Float[np.ndarray, " candidate"]) -> float:
    """Ratio at the top of the parabola through the best of `RATIOS` and its neighbours."""
    best = int(np.clip(np.argmax(score), 1, RATIOS.size - 2))
    left, middle, right = score[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    offset = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    spacing = np.log(RATIOS[1] / RATIOS[0])
    return float(RATIOS[best] * np.exp(np.clip(offset, -1.0, 1.0) * spacing))


def smooth(
    time: Float[np.ndarray, " sample"],
    signal: Float[np.ndarray, "sample signal"],
    ratio: float,
) -> Smooth:
    """Applies the smoother of a given ratio to any signals on the same clock."""
    count, width = signal.shape
    padded = np.pad(signal, ((0, 0), (0, -width % SIGNALS)))
    means = []
    for first in range(0, width, SIGNALS):
        step, values, weight = _padded(time, padded[:, first : first + SIGNALS])
        moments, variances = _smooth(step, values, weight, jnp.asarray(ratio))
        means.append(np.asarray(moments)[:count])
    mean = np.concatenate(means, axis=2)[:, :, :width]
    gain = np.sqrt(np.maximum(np.asarray(variances)[:count], 0.0))
    return Smooth(mean[:, 0], mean[:, 1], gain[:, 0], gain[:, 1])


def angular_motion(
    time: Float[np.ndarray, " sample"], rate: Float[np.ndarray, "sample axis"]
) -> AngularMotion:
    """Smoothed rate and angular acceleration of a flight.

    Args:
        time: sample times [s], increasing.
        rate: measured body rates, biases taken off [rad/s].

    Returns:
        Rates, accelerations and one standard deviation of the accelerations. The latter holds for
        noise that is white from sample to sample and a motion as lively all along as on average; it
        is too small in the liveliest moments of a flight that is mostly quiet.
    """
    ratio = most_likely_ratio(time, rate)
    step, values, weight = _padded(time, rate)
    noise = np.sqrt(np.asarray(_noise(step, values, weight, jnp.asarray(ratio))))
    return motion(time, rate, ratio, noise)


def motion(
    time: Float[np.ndarray, " sample"],
    rate: Float[np.ndarray, "sample axis"],
    ratio: float,
    noise: Float[np.ndarray, " axis"],
) -> AngularMotion:
    """As `angular_motion`, with a known ratio and a known noise [rad/s] of each rate."""
    smoothed = smooth(time, rate, ratio)
    return AngularMotion(
        rate=smoothed.value,
        acceleration=smoothed.derivative,
        acceleration_deviation=smoothed.derivative_gain[:, None] * noise,
        noise=noise,
        ratio=ratio,
    )
