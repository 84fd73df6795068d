from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.maneuvers import signals

TIME = np.arange(0.0, 18.0, 0.005)
DURATION = 15.0
LINES = signals.interleaved(3, 30, 2)


def test_lines_are_dealt_out_without_sharing() -> None:
    assert LINES == (tuple(range(3, 31, 2)), tuple(range(4, 31, 2)))
    assert signals.interleaved(2, 4, 1) == ((2, 3, 4),)


def test_a_multisine_has_its_lines_in_equal_measure_and_no_others() -> None:
    grid = DURATION * np.arange(3000) / 3000
    spectrum = np.abs(np.fft.rfft(signals.multisine(LINES[0], DURATION, grid))) / 1500
    lines = np.array(LINES[0])
    np.testing.assert_allclose(spectrum[lines], spectrum[lines].mean(), rtol=1e-9)
    others = np.delete(spectrum, lines)
    assert others.max() < 1e-9


def test_inputs_flown_together_are_orthogonal() -> None:
    grid = DURATION * np.arange(3000) / 3000
    first, second = (signals.multisine(lines, DURATION, grid) for lines in LINES)
    assert abs(np.corrcoef(first, second)[0, 1]) < 1e-9


def test_phases_keep_the_peak_low_and_the_ends_at_zero() -> None:
    """Morelli 2003 asks for a relative peak factor near one; Schroeder's phases give about 1.2."""
    value = signals.multisine(LINES[0], DURATION, TIME)
    assert np.abs(value).max() == pytest.approx(1.0, abs=0.02)
    assert value[0] == pytest.approx(0.0, abs=1e-9)
    assert np.all(value[TIME > DURATION] == 0.0)
    assert abs(value[np.searchsorted(TIME, DURATION) - 1]) < 0.1
    assert signals.relative_peak(value[TIME <= DURATION]) < 1.15
    assert signals.relative_peak(np.sin(2.0 * np.pi * TIME / 3.0)) == pytest.approx(1.0, abs=1e-4)


def test_pulses_by_hand() -> None:
    time = np.array([-0.1, 0.0, 2.9, 3.1, 4.9, 5.1, 5.9, 6.1, 6.9, 7.0])
    wanted = [0.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 0.0]
    np.testing.assert_array_equal(signals.multistep(7.0, time), wanted)
    np.testing.assert_array_equal(signals.doublet(2.0, np.array([0.5, 1.5, 2.5])), [1.0, -1.0, 0.0])
