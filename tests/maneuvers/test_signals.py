"""Shapes of test inputs against closed forms: peaks, lines, plateaus, ends at zero."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.maneuvers.signals import multisine, smooth, steps, sweep

TIME = np.arange(0.0, 18.0, 0.005)
DURATION = 15.0
LINES = multisine.interleaved(3, 30, 2)


def test_lines_are_dealt_out_without_sharing() -> None:
    assert LINES == (tuple(range(3, 31, 2)), tuple(range(4, 31, 2)))
    assert multisine.interleaved(2, 4, 1) == ((2, 3, 4),)


def test_a_multisine_has_its_lines_in_equal_measure_and_no_others() -> None:
    grid = DURATION * np.arange(3000) / 3000
    spectrum = np.abs(np.fft.rfft(multisine.multisine(LINES[0], DURATION, grid))) / 1500
    lines = np.array(LINES[0])
    np.testing.assert_allclose(spectrum[lines], spectrum[lines].mean(), rtol=1e-9)
    others = np.delete(spectrum, lines)
    assert others.max() < 1e-9


def test_four_inputs_flown_together_are_orthogonal() -> None:
    grid = DURATION * np.arange(3000) / 3000
    dealt = multisine.interleaved(3, 30, 4)
    inputs = np.stack([multisine.multisine(lines, DURATION, grid) for lines in dealt])
    correlation = np.corrcoef(inputs)
    np.testing.assert_allclose(correlation, np.eye(4), atol=1e-9)


@pytest.mark.parametrize("first", [2, 3])
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_phases_keep_the_peak_low_and_the_ends_at_zero(first: int, count: int) -> None:
    """Morelli 2003 takes 1.1 to 1.2 for low; Schroeder's phases give about 1.2 for many lines."""
    for lines in multisine.interleaved(first, 30, count):
        value = multisine.multisine(lines, DURATION, TIME)
        assert np.abs(value).max() == pytest.approx(1.0, abs=0.02)
        assert value[0] == pytest.approx(0.0, abs=1e-9)
        assert np.all(value[TIME > DURATION] == 0.0)
        assert abs(value[np.searchsorted(TIME, DURATION) - 1]) < 0.1
        assert multisine.relative_peak(value[TIME <= DURATION]) < 1.16


def test_phases_keep_the_largest_of_several_outputs_low() -> None:
    """Each output as it answers: the peak is that of the sums in time, below phases at random."""
    generator = np.random.default_rng(2)
    harmonic = np.array([2.0, 5.0, 7.0, 11.0, 18.0])
    answers = generator.standard_normal((4, 5)) + 1j * generator.standard_normal((4, 5))
    phases, peak = multisine.phased(harmonic, answers)
    time = np.arange(4000) / 4000

    def largest(of: np.ndarray) -> float:
        lines = 2.0 * np.pi * harmonic[:, None] * time + of[:, None]
        waves = np.abs(answers)[:, :, None] * np.sin(lines + np.angle(answers)[:, :, None])
        return float(np.abs(waves.sum(axis=1)).max())

    assert largest(phases) == pytest.approx(peak, rel=0.02)
    drawn = [largest(generator.uniform(-np.pi, np.pi, 5)) for _ in range(200)]
    assert peak < np.min(drawn)


def test_the_peak_factor_of_a_sine_is_one() -> None:
    sine = np.sin(2.0 * np.pi * TIME / 3.0)
    assert multisine.relative_peak(sine) == pytest.approx(1.0, abs=1e-4)


def test_pulses_without_edges_by_hand() -> None:
    time = np.array([-0.1, 0.0, 2.9, 3.1, 4.9, 5.1, 5.9, 6.1, 6.9, 7.0])
    wanted = [0.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 0.0]
    np.testing.assert_array_equal(steps.steps(steps.THREE_TWO_ONE_ONE, 7.0, time), wanted)
    doublet = steps.steps(steps.DOUBLET, 2.0, np.array([0.5, 1.5, 2.5]))
    np.testing.assert_array_equal(doublet, [1.0, -1.0, 0.0])


def test_edges_take_their_time_and_areas_stay() -> None:
    """Each plateau's area is its share of what the edges leave: a trapezium's."""
    time = np.linspace(0.0, 4.0, 40001)
    shape = steps.steps(steps.TWO_ONE_ONE, 4.0, time, rise=0.2)
    assert shape[0] == 0.0
    assert shape[-1] == pytest.approx(0.0, abs=1e-12)
    assert np.trapezoid(shape, time) == pytest.approx(3.8 * (2.0 - 1.0 + 1.0) / 4.0, abs=1e-6)
    assert np.abs(np.diff(shape)).max() / 1e-4 == pytest.approx(2.0 / 0.2, rel=1e-6)


def test_an_edge_is_what_the_servo_follows() -> None:
    assert steps.rise_time(0.2, 0.05, None) == pytest.approx(0.1)
    assert steps.rise_time(0.2, 0.05, 1.0) == pytest.approx(0.4)


def test_a_sweep_goes_from_its_first_to_its_last_frequency() -> None:
    """Zero crossings of sin φ(t): their spacing is half the period of the frequency there."""
    time = np.linspace(0.0, 20.0, 200001)
    shape = sweep.sweep(0.2, 2.0, 20.0, time)
    crossings = time[1:][np.diff(np.sign(shape)) != 0]
    spacing = np.diff(crossings)
    middle = 0.5 * (crossings[1:] + crossings[:-1])
    expected = 0.5 / (0.2 * 10.0 ** (middle / 20.0))
    # Half a period at the geometric mean of its ends, where frequency grows by a factor in it.
    np.testing.assert_allclose(spacing[2:-2], expected[2:-2], rtol=0.06)
    assert shape[0] == shape[-1] == 0.0
    assert np.abs(shape).max() <= 1.0


def test_energy_of_a_sweep_is_in_its_band() -> None:
    time = np.arange(0.0, 20.0, 0.01)
    power = np.abs(np.fft.rfft(sweep.sweep(0.2, 2.0, 20.0, time))) ** 2
    frequency = np.fft.rfftfreq(time.size, 0.01)
    inside = (frequency >= 0.15) & (frequency <= 2.2)
    assert power[inside].sum() > 0.98 * power.sum()


def test_slow_shapes_begin_and_end_at_rest() -> None:
    time = np.linspace(0.0, 10.0, 10001)
    for shape in (
        smooth.push_pull(10.0, time),
        smooth.cycles(3, 10.0, time),
        smooth.plateau(10.0, 2.0, time),
        smooth.winding(10.0, 3.0, time),
    ):
        slope = np.gradient(shape, time)
        np.testing.assert_allclose(shape[[0, -1]], 0.0, atol=1e-12)
        np.testing.assert_allclose(slope[[0, -1]], 0.0, atol=5e-3)  # of a grid of 1 ms
        assert np.abs(shape).max() == pytest.approx(1.0, abs=1e-3)
    assert np.trapezoid(smooth.cycles(3, 10.0, time), time) == pytest.approx(0.0, abs=1e-9)
    assert np.trapezoid(smooth.plateau(10.0, 2.0, time), time) == pytest.approx(8.0, abs=1e-6)
