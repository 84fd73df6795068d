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


@pytest.mark.parametrize("turn", [-4.3, 2.6])
def test_a_slow_turn_is_as_long_as_it_was(turn: float) -> None:
    """Cut, a rate of a few steps loses half of one."""
    noise = 0.8 * np.random.default_rng(6).standard_normal((COUNT, 6))
    true = (turn + noise) * cut.STEPS
    known = np.trunc(turn + noise) * cut.STEPS
    short = np.mean(np.abs(true.mean(axis=0)) - np.abs(known.mean(axis=0))) / cut.STEPS.mean()
    left = (cut.restored(known, cut.STEPS) - true).mean(axis=0) / cut.STEPS
    assert short > 0.3
    np.testing.assert_allclose(left, 0.0, atol=0.03)


def test_samples_that_come_one_by_one_tell_the_same() -> None:
    for encoded, expected in ((np.trunc, True), (np.round, False)):
        values = encoded(motion()) * cut.STEPS
        watch = cut.Watch()
        for sample in values:
            watch.take(sample)
        assert watch.cut is expected
        batches = cut.BATCH + (COUNT - cut.BATCH) // (cut.BATCH - 2) * (cut.BATCH - 2)
        assert watch._evidence == pytest.approx(cut.evidence(values[:batches]))
