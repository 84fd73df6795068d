"""Gain and phase of a simulated motion against the measured one, by closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.offline import coherence

STEP, COUNT, WINDOWS = 0.01, 301, 12
TIME = STEP * np.arange(COUNT) + 3.0 * np.arange(WINDOWS)[:, None]


def noise(seed: int, size: float) -> np.ndarray:
    return size * np.random.default_rng(seed).standard_normal(TIME.shape)


def test_a_delayed_sine_has_its_gain_and_lags_by_its_delay() -> None:
    """0.8 sin ω(t − 0.05) against sin ωt: gain 0.8, phase −0.05 ω; a mean does not count."""
    omega = 2.0 * np.pi
    measured = 4.0 + np.sin(omega * TIME)
    simulated = 1.0 + 0.8 * np.sin(omega * (TIME - 0.05))
    found = coherence.response(measured, simulated + noise(0, 1e-9), STEP)
    assert found is not None
    assert found["gain"] == pytest.approx(0.8, rel=1e-6)
    assert found["phase"] == pytest.approx(-0.05 * omega, rel=1e-6)
    assert found["band_hz"][0] <= 1.0 <= found["band_hz"][1]
    place = int(np.argmin(np.abs(np.array(found["hz"]) - 1.0)))
    assert found["hz"][place] == pytest.approx(1.0)
    assert found["gains"][place] == pytest.approx(0.8, rel=1e-6)
    assert found["coherences"][place] == pytest.approx(1.0)


def test_the_band_ends_where_the_motion_is_not_shared() -> None:
    """Both move alike below 2 Hz, and each by itself above."""
    generator = np.random.default_rng(1)

    def sines(hz: np.ndarray, phases: np.ndarray) -> np.ndarray:
        turns = 2.0 * np.pi * (hz * TIME[..., None] + phases)
        return np.sin(turns).sum(axis=-1)

    shared, own = np.arange(1, 7) / 3.0, np.arange(9, 30) / 3.0
    same = sines(shared, generator.uniform(size=(WINDOWS, 1, 6)))
    each = [0.3 * sines(own, generator.uniform(size=(WINDOWS, 1, own.size))) for _ in range(2)]
    found = coherence.response(same + each[0], same + each[1], STEP)
    assert found is not None
    low, high = found["band_hz"]
    assert low == pytest.approx(1.0 / 3.0)
    assert 2.0 <= high <= 3.0
    assert found["gain"] == pytest.approx(1.0, abs=0.02)
    assert min(found["coherences"]) >= coherence.COHERENT


def test_what_has_nothing_in_common_has_no_band() -> None:
    assert coherence.response(noise(2, 1.0), noise(3, 1.0), STEP) is None


def test_too_few_windows_and_no_motion_have_none() -> None:
    sine = np.sin(2.0 * np.pi * TIME)
    few = coherence.LEAST - 1
    assert coherence.response(sine[:few], sine[:few], STEP) is None
    assert coherence.response(0.0 * sine, sine, STEP) is None
    broken = sine.copy()
    broken[: WINDOWS - few, 7] = np.nan
    assert coherence.response(broken, sine, STEP) is None
