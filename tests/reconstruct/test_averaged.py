"""Means of fast samples are what the motion was in their middle."""

import numpy as np
import pytest

from gcs_sysid.reconstruct.averaged import averaged

RATE = 250.0
TIME = np.arange(0.0, 20.0, 1.0 / RATE)


def motion(time: np.ndarray, frequency: float) -> np.ndarray:
    return np.stack([np.sin(2.0 * np.pi * frequency * time), 1.0 + time], axis=1)


@pytest.mark.parametrize(("frequency", "within"), [(0.5, 1e-6), (2.8, 1e-4), (6.0, 2e-3)])
def test_a_motion_is_neither_late_nor_weaker(frequency: float, within: float) -> None:
    time, values = averaged(TIME, motion(TIME, frequency))
    assert np.diff(time) == pytest.approx(0.02)
    np.testing.assert_allclose(values[1:-1], motion(time[1:-1], frequency), atol=within)


def test_without_its_second_difference_a_mean_would_be_weaker() -> None:
    time, values = averaged(TIME, motion(TIME, 6.0))
    plain = motion(TIME, 6.0).reshape(time.size, 5, 2).mean(axis=1)
    off = np.abs(plain - motion(time, 6.0)).max()
    assert off > 10.0 * np.abs(values - motion(time, 6.0))[1:-1].max()


def test_white_noise_falls_with_the_root_of_their_number_and_stays_white() -> None:
    noise = np.random.default_rng(3).normal(size=(200_000, 1))
    _, values = averaged(np.arange(noise.size) / RATE, noise)
    assert np.std(values) == pytest.approx(1.085 / np.sqrt(5.0), rel=0.01)
    beside = np.mean(values[1:] * values[:-1]) / np.var(values)
    assert -0.09 < beside < -0.05


def test_across_a_hole_nothing_is_averaged() -> None:
    time = np.concatenate([TIME[TIME < 5.003], TIME[TIME > 8.0]])
    means, values = averaged(time, motion(time, 1.0))
    assert not ((means > 5.003) & (means < 8.0)).any()
    np.testing.assert_allclose(values[:, 1], 1.0 + means, atol=1e-9)
    # Beside the hole a mean is as it is, 0.3 % weaker.
    np.testing.assert_allclose(values, motion(means, 1.0), atol=2e-3)


@pytest.mark.parametrize("rate", [25.0, 50.0, 60.0, 95.0])
def test_what_is_slow_enough_stays_as_it_is(rate: float) -> None:
    time = np.arange(0.0, 5.0, 1.0 / rate)
    values = motion(time, 1.0)
    again = averaged(time, values)
    assert again[0] is time
    assert again[1] is values


def test_clocks_that_jitter_are_averaged_too() -> None:
    time = TIME + np.random.default_rng(4).uniform(-4e-4, 4e-4, TIME.size)
    means, values = averaged(time, motion(time, 1.0))
    assert means.size == TIME.size // 5
    np.testing.assert_allclose(values, motion(means, 1.0), atol=2e-3)
