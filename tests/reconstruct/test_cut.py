"""Rates and forces that were cut to whole steps, against what they were before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.reconstruct import cut
from gcs_sysid.recording import Stream

COUNT = 3000
Encoded = Callable[[np.ndarray], np.ndarray]


def motion() -> np.ndarray:
    """Swings of a few steps through zero, and noise of two."""
    rng = np.random.default_rng(5)
    swing = 4.0 * np.sin(2.0 * np.pi * np.arange(COUNT) / 300.0)
    return swing[:, None] + 2.0 * rng.standard_normal((COUNT, 6)) + np.linspace(-5.0, 5.0, 6)


def sent(values: np.ndarray, encoded: Encoded, name: str = "RAW_IMU") -> Stream:
    time = 0.02 * np.arange(len(values))
    columns = (encoded(values) * cut.STEPS).T
    return Stream(name, time, time, dict(zip(cut.CHANNELS, columns, strict=True)))


def test_what_was_cut_is_told_from_what_was_rounded() -> None:
    assert cut.was_cut(sent(motion(), np.trunc))
    assert not cut.was_cut(sent(motion(), np.round))
    assert not cut.was_cut(sent(motion(), lambda values: values))


def test_an_inertial_unit_at_rest_that_reports_zeros_was_not_cut_for_that() -> None:
    still = np.zeros((COUNT, 6))
    still[::7] = 1.0
    assert not cut.was_cut(sent(still, np.round))


def test_a_message_of_other_units_and_one_without_forces_are_left_alone() -> None:
    whole = sent(motion(), np.trunc)
    assert not cut.was_cut(replace(whole, name="HIGHRES_IMU"))
    rates = {name: whole.channels[name] for name in cut.CHANNELS[:3]}
    assert not cut.was_cut(replace(whole, channels=rates))


@pytest.mark.parametrize("turn", [-4.3, 0.0, 2.6])
def test_a_slow_turn_is_as_long_as_it_was_and_no_noisier(turn: float) -> None:
    """Cut, a rate of a few steps loses half of one."""
    noise = np.random.default_rng(6).standard_normal((COUNT, 6))
    known = np.trunc(turn + noise) * cut.STEPS
    left = (cut.restored(known, cut.STEPS) / cut.STEPS - turn - noise).mean(axis=0)
    before = (known / cut.STEPS - turn - noise).mean(axis=0)
    np.testing.assert_allclose(before, -0.5 * np.sign(turn), atol=0.1)
    np.testing.assert_allclose(left, 0.0, atol=0.1)
    rough = [np.std(np.diff(one, n=3, axis=0)) for one in (known, cut.restored(known, cut.STEPS))]
    assert rough[1] < 1.01 * rough[0]


@pytest.mark.parametrize("count", [0, 1, 10])
def test_few_samples_are_restored_too(count: int) -> None:
    known = np.full((count, 6), 3.0) * cut.STEPS
    np.testing.assert_allclose(cut.restored(known, cut.STEPS), known + 0.5 * cut.STEPS)


def test_samples_that_come_one_by_one_are_restored_once_it_shows() -> None:
    for encoded, expected in ((np.trunc, True), (np.round, False)):
        values = encoded(motion()) * cut.STEPS
        watch = cut.Watch()
        given = [watch.restored(sample) for sample in values]
        assert watch.cut is expected
        np.testing.assert_array_equal(given[0], values[0])
        back = cut.restored(values[-cut.WINDOW :], cut.STEPS)[cut.WINDOW // 2]
        added = back - values[-cut.WINDOW :][cut.WINDOW // 2] if expected else 0.0
        np.testing.assert_allclose(given[-1] - values[-1], added)
