"""Angular acceleration against closed forms, SciPy's smoothing spline and simulated processes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from gcs_sysid.reconstruct import rates

STEP = 0.02
COUNT = 1000
TIME = STEP * np.arange(COUNT)
INSIDE = slice(50, -50)
"""Away from the ends, where a smoother sees one side only."""


def test_a_straight_line_passes_through_unchanged() -> None:
    line = np.stack([0.3 + 0.1 * TIME, -0.2 * TIME, np.full(COUNT, 0.7)], axis=-1)
    found = rates.smooth(TIME, line, 1e4)
    # The first sample starts at rest with variance q/r·1 s²: its pull dies within a few samples.
    np.testing.assert_allclose(found.value[INSIDE], line[INSIDE], atol=1e-9)
    np.testing.assert_allclose(found.derivative[INSIDE], [[0.1, -0.2, 0.0]] * 900, atol=1e-8)


@pytest.mark.parametrize("frequency", [0.5, 1.5])
def test_a_sinusoid_gives_its_derivative_damped_as_a_spline_does(frequency: float) -> None:
    """A smoothing spline passes 1/(1 + ω⁴ r·dt/q) of a sinusoid, without a shift in time."""
    omega, ratio = 2.0 * np.pi * frequency, 1e6
    gain = 1.0 / (1.0 + omega**4 * STEP / ratio)
    found = rates.smooth(TIME, np.sin(omega * TIME)[:, None], ratio)
    middle = slice(300, -300)
    expected = gain * omega * np.cos(omega * TIME[middle])
    # Sampling at 50 Hz adds (ω·dt)²/12 and higher to a derivative taken between samples.
    atol = omega * 1e-3
    np.testing.assert_allclose(found.derivative[middle, 0], expected, atol=atol)


def test_the_smoother_is_scipys_smoothing_spline() -> None:
    """The posterior mean minimises Σ(y - s)² + (r/q)∫s''²: SciPy's spline with lambda = r/q.

    Ours holds the first sample and its slope by a weak prior, so the beginning is left out.
    """
    rng = np.random.default_rng(1)
    uneven = np.sort(rng.uniform(0.0, 12.0, 600))
    uneven = uneven[np.insert(np.diff(uneven) > 2e-3, 0, True)]
    signal = np.sin(2.0 * uneven) + 0.1 * rng.standard_normal(uneven.size)
    ratio = 300.0
    spline = make_smoothing_spline(uneven, signal, lam=1.0 / ratio)
    found = rates.smooth(uneven, signal[:, None], ratio)
    inner = slice(120, None)
    np.testing.assert_allclose(found.value[inner, 0], spline(uneven)[inner], atol=1e-6)
    slope = spline.derivative()(uneven)[inner]
    np.testing.assert_allclose(found.derivative[inner, 0], slope, atol=1e-5)


def test_the_last_sample_is_not_bent_by_the_padding() -> None:
    """Padding used to be smoothed as if the last rate had been measured on and on: no slope."""
    time = STEP * np.arange(rates.BLOCK)
    signal = np.sin(1.3 * time)[:, None]
    whole = rates.smooth(time, signal, 1e5)
    cut = rates.smooth(time[:-37], signal[:-37], 1e5)
    spline = make_smoothing_spline(time[-637:-37], signal[-637:-37, 0], lam=1e-5)
    assert cut.derivative[-1, 0] == pytest.approx(float(spline.derivative()(time[-38])), abs=2e-3)
    np.testing.assert_allclose(cut.derivative[:-200], whole.derivative[:-237], atol=1e-9)


def test_linear_and_blind_to_the_origin_of_time_and_to_units() -> None:
    rng = np.random.default_rng(2)
    x, y = rng.standard_normal((2, COUNT, 2))
    ratio = 1e4
    one, two = rates.smooth(TIME, x, ratio), rates.smooth(TIME, y, ratio)
    both = rates.smooth(TIME, 2.0 * x - 0.5 * y, ratio)
    np.testing.assert_allclose(both.value, 2.0 * one.value - 0.5 * two.value, atol=1e-10)
    np.testing.assert_allclose(
        both.derivative, 2.0 * one.derivative - 0.5 * two.derivative, atol=1e-8
    )
    later = rates.smooth(TIME + 1000.0, x, ratio)
    np.testing.assert_allclose(later.derivative, one.derivative, atol=1e-6)
    # Twice the time: half the slope, an eighth of the ratio [1/s³].
    slower = rates.smooth(2.0 * TIME, x, ratio / 8.0)
    np.testing.assert_allclose(slower.derivative[INSIDE], 0.5 * one.derivative[INSIDE], atol=1e-6)


def simulated(seed: int, *, noise: float, ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """Rates [rad/s] that are integrated Wiener processes, and their true derivatives.

    Exact discretisation: over a step the slope grows by w₁, the value by slope·dt + w₂.
    """
    rng = np.random.default_rng(seed)
    spectral = noise**2 * ratio
    covariance = spectral * np.array([[STEP, STEP**2 / 2.0], [STEP**2 / 2.0, STEP**3 / 3.0]])
    kicks = rng.standard_normal((COUNT, 3, 2)) @ np.linalg.cholesky(covariance).T
    slope = np.cumsum(kicks[:, :, 0], axis=0)
    before = np.vstack([np.zeros((1, 3)), slope[:-1]])
    value = np.cumsum(before * STEP + kicks[:, :, 1], axis=0)
    return value + noise * rng.standard_normal(value.shape), slope


def test_the_most_likely_ratio_and_noise_are_those_simulated() -> None:
    """Mean over twelve flights within three of its own standard deviations (seen: 10 % of r)."""
    ratio, noise = 3e4, 0.01
    logarithms, noises = [], []
    for seed in range(12):
        seen, _ = simulated(seed, noise=noise, ratio=ratio)
        motion = rates.angular_motion(TIME, seen)
        logarithms.append(np.log(motion.ratio / ratio))
        noises.append(np.mean(motion.noise) / noise)
    scatter = np.std(logarithms, ddof=1) / np.sqrt(12)
    assert abs(np.mean(logarithms)) < 3.0 * scatter + 0.05  # a parabola between candidates
    assert scatter < 0.15
    assert np.mean(noises) == pytest.approx(1.0, abs=3.0 * np.std(noises) / np.sqrt(12) + 0.01)


def test_stated_deviation_of_the_acceleration_covers_the_truth() -> None:
    """Holds for a motion as lively all along as on average, which is what is simulated here.

    Normalised errors have unit variance; neighbours are correlated over about five samples, so the
    mean of 12·3·900 squares has a standard deviation near 0.02.
    """
    squares = []
    for seed in range(100, 112):
        seen, slope = simulated(seed, noise=0.01, ratio=3e4)
        motion = rates.angular_motion(TIME, seen)
        error = (motion.acceleration - slope) / motion.acceleration_deviation
        squares.append(np.mean(error[INSIDE] ** 2))
    assert np.mean(squares) == pytest.approx(1.0, abs=0.08)


def test_noise_free_motion_is_recovered() -> None:
    """A smooth motion without noise: the ratio runs to its upper end, differences vanish."""
    rate = np.stack([np.sin(3.0 * TIME), np.cos(2.0 * TIME), 0.2 * np.sin(TIME)], axis=-1)
    true = np.stack([3.0 * np.cos(3.0 * TIME), -2.0 * np.sin(2.0 * TIME), 0.2 * np.cos(TIME)],
                    axis=-1)  # fmt: skip
    motion = rates.angular_motion(TIME, rate)
    # A cubic spline through samples at dt errs by about (ω·dt)⁴·ω/30.
    np.testing.assert_allclose(motion.acceleration[INSIDE], true[INSIDE], atol=1e-4)
