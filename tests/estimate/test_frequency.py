"""Running transforms against closed forms; complex least squares against known truth."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.errors import UsageError
from gcs_sysid.estimate import frequency
from gcs_sysid.estimate.frequency import Spectrum
from tests.estimate.made_problems import coloured
from tests.estimate.made_short_period import STEP, TRUE, elevator, flown

BAND = frequency.band(0.1, 2.0)


def taken(time: np.ndarray, values: np.ndarray, at: np.ndarray = BAND) -> Spectrum:
    spectrum = frequency.begin(at, float(time[0]), values[0])
    for when, row in zip(time[1:], values[1:], strict=True):
        spectrum = frequency.advance(spectrum, float(when), row)
    return spectrum


def test_a_decaying_exponential_has_its_closed_transform() -> None:
    """∫₀ᵀ e^(−at) e^(−jωt) dt = (1 − e^(−(a+jω)T))/(a + jω); the rule's error is (|a+jω|h)²/12."""
    time = np.arange(0.0, 5.0 + 1e-9, 0.001)
    found = taken(time, np.exp(-0.7 * time)[:, None]).sums[:, 0]
    rate = 0.7 + 2j * np.pi * BAND
    exact = (1.0 - np.exp(-rate * 5.0)) / rate
    np.testing.assert_allclose(found, exact, atol=1e-5 * np.abs(exact).max())


def test_the_sums_are_those_of_a_fast_fourier_transform() -> None:
    """Of a signal that begins and ends at zero, at the transform's own frequencies."""
    generator = np.random.default_rng(1)
    count = 500
    signal = generator.standard_normal(count + 1)
    signal[[0, -1]] = 0.0
    time = STEP * np.arange(count + 1)
    at = np.arange(1, 20) / (count * STEP)
    found = taken(time, signal[:, None], at).sums[:, 0]
    np.testing.assert_allclose(found, STEP * np.fft.rfft(signal[:-1])[1:20], atol=1e-13)


def test_the_derivative_is_that_of_the_closed_form() -> None:
    time = np.arange(0.0, 8.0 + 1e-9, 0.002)
    spectrum = taken(
        time, np.column_stack([np.sin(3.0 * time + 0.4), 3.0 * np.cos(3.0 * time + 0.4)])
    )
    direct = spectrum.sums[:, 1]
    found = frequency.derivative(spectrum, 0)
    np.testing.assert_allclose(found, direct, atol=1e-4 * np.abs(direct).max())


def test_an_exact_equation_is_found_whatever_its_offset_and_drift() -> None:
    generator = np.random.default_rng(2)
    time = STEP * np.arange(900) + 1234.5
    terms = np.stack([coloured(generator, 900, 0.97) for _ in range(3)], axis=1)
    measured = terms @ [2.0, -0.7, 0.1] + 5.0 - 0.3 * time
    spectrum = taken(time, np.column_stack([terms, measured]))
    found = frequency.regress(spectrum, (0, 1, 2), spectrum.sums[:, 3])
    np.testing.assert_allclose(found.value, [2.0, -0.7, 0.1], rtol=1e-8)
    assert found.residual < 1e-8


def test_pitch_derivatives_come_from_a_measured_rate_without_differences() -> None:
    """20 s of the short period: M_alpha, M_q and M_delta from alpha, q and elevator alone."""
    command = elevator(20.0)
    motion = flown(command, np.array([0.01, -0.02]))
    time = STEP * np.arange(len(command))
    spectrum = taken(time, np.column_stack([motion, command]))
    found = frequency.regress(spectrum, (0, 1, 2), frequency.derivative(spectrum, 1))
    np.testing.assert_allclose(found.value, TRUE[1:], rtol=3e-3)


@pytest.mark.parametrize(("memory", "seconds"), [(0.0, 20.0), (0.9, 40.0), (0.98, 60.0)])
def test_intervals_hold_whatever_the_colour_of_the_noise(memory: float, seconds: float) -> None:
    """Noise in the measured coefficient, from white to a correlation time of a second."""
    command = elevator(seconds)
    motion = flown(command, np.array([0.01, -0.02]))
    time = STEP * np.arange(len(command))
    terms = np.column_stack([motion, command])
    truth = np.array([-6.0, -2.5, -9.0])
    ratios = []
    for seed in range(60):
        generator = np.random.default_rng(500 + seed)
        noise = 0.3 * coloured(generator, len(command), memory)
        values = np.column_stack([terms, terms @ truth + noise])
        # All samples at once are the same sums.
        spectrum = bulk(time, values)
        found = frequency.regress(spectrum, (0, 1, 2), spectrum.sums[:, 3])
        ratios.append((found.value - truth) / found.deviation)
    assert np.mean(np.abs(ratios) < 1.96) > 0.88
    assert 0.75 < np.std(ratios) < 1.25


def test_the_density_of_white_noise_is_its_variance_by_the_interval() -> None:
    found = []
    for seed in range(30):
        noise = 0.3 * np.random.default_rng(seed).standard_normal(1500)
        time = STEP * np.arange(1500)
        spectrum = bulk(time, np.column_stack([np.sin(2.0 * time), noise]))
        found.append(frequency.regress(spectrum, (0,), spectrum.sums[:, 1]).density.mean())
    assert np.mean(found) == pytest.approx(0.09 * STEP, rel=0.05)


def bulk(time: np.ndarray, values: np.ndarray) -> Spectrum:
    """The sums of all samples in one product."""
    every = np.column_stack([values, np.ones_like(time), time - time[0]])
    weight = np.full(time.size, STEP)
    weight[[0, -1]] *= 0.5
    sums = (np.exp(-2j * np.pi * np.outer(BAND, time - time[0])) * weight) @ every
    return Spectrum(BAND, sums, float(time[0]), float(time[-1]), every[0], every[-1])


def test_sums_in_bulk_are_the_running_ones() -> None:
    generator = np.random.default_rng(3)
    time = STEP * np.arange(300)
    values = generator.standard_normal((300, 2))
    np.testing.assert_allclose(bulk(time, values).sums, taken(time, values).sums, atol=1e-12)


def test_what_is_kept_does_not_grow() -> None:
    time = STEP * np.arange(200)
    short, long = (taken(time[:n], np.ones((n, 3))) for n in (2, 200))
    assert short.sums.shape == long.sums.shape == (BAND.size, 5)


def test_a_term_that_never_moved_is_unknown() -> None:
    time = STEP * np.arange(500)
    moving = np.sin(2.0 * time)
    spectrum = taken(time, np.column_stack([moving, np.zeros(500), 3.0 * moving]))
    found = frequency.regress(spectrum, (0, 1), spectrum.sums[:, 2])
    assert found.value[0] == pytest.approx(3.0)
    assert found.deviation[1] > 100.0


def test_a_band_must_be_one() -> None:
    with pytest.raises(UsageError, match="0 < low < high"):
        frequency.band(2.0, 0.1)
