"""Test inputs have the shapes of the books."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from gcs_sysid.errors import UsageError
from gcs_sysid.sitl.inputs import TestInput, signal


def sampled(test: TestInput, *, points: int = 7000) -> np.ndarray:
    value = signal(test)
    step = test.duration / points
    return np.array([value(test.start + (i + 0.5) * step) for i in range(points)])


def test_a_multistep_goes_three_two_one_one():
    values = sampled(TestInput("elevator", "multistep", 2.0, 1.4, -0.1), points=7)
    assert values == pytest.approx([-0.1, -0.1, -0.1, 0.1, 0.1, -0.1, 0.1])


def test_a_doublet_has_no_mean():
    values = sampled(TestInput("rudder", "doublet", 0.0, 1.0, 0.2))
    assert values.mean() == pytest.approx(0.0, abs=1e-12)
    assert values[0] == 0.2
    assert values[-1] == -0.2


def test_a_step_holds():
    assert set(sampled(TestInput("throttle", "step", 1.0, 3.0, 0.3))) == {0.3}


@pytest.mark.parametrize("kind", ["doublet", "multistep", "step"])
def test_nothing_before_and_nothing_after(kind):
    value = signal(TestInput("elevator", kind, 1.0, 0.5, 0.1))
    assert [value(time) for time in (0.0, 0.999, 1.5, 9.0)] == [0.0] * 4


def test_multisines_of_disjoint_lines_are_orthogonal_and_keep_their_peak():
    tests = [
        TestInput(str(i), "multisine", 0.0, 15.0, 0.08, tuple(range(3 + i, 40, 3)))
        for i in range(3)
    ]
    signals = [sampled(test) for test in tests]
    for values in signals:
        assert np.abs(values).max() == pytest.approx(0.08, rel=0.02)
        # Schroeder's phases: a relative peak factor near that of a sine, √2.
        assert np.abs(values).max() / values.std() < 1.5 * math.sqrt(2.0)
    for first, second in itertools.combinations(signals, 2):
        assert abs(first @ second) < 1e-9 * np.linalg.norm(first) * np.linalg.norm(second)


def test_a_multisine_without_lines_is_refused():
    with pytest.raises(UsageError, match="lines"):
        signal(TestInput("elevator", "multisine", 0.0, 1.0, 0.1))


def test_samples_are_held_each_in_its_turn():
    test = TestInput("elevator", "samples", 1.0, 0.06, 2.0, values=(0.5, -1.0, 0.25))
    value = signal(test)
    times = (0.99, 1.0, 1.019, 1.021, 1.041, 1.059, 1.061)
    assert [value(time) for time in times] == [0.0, 1.0, 1.0, -2.0, 0.5, 0.5, 0.0]


def test_samples_without_values_are_refused():
    with pytest.raises(UsageError, match="samples"):
        signal(TestInput("elevator", "samples", 0.0, 1.0, 1.0))
