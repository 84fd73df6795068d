"""Drawn gusts against the intensities and spectra of the specification."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.maneuvers import gusts

HEIGHT, AIRSPEED, STEP = 100.0, 20.0, 0.02


@pytest.fixture(scope="module")
def drawn() -> np.ndarray:
    return gusts.draw(
        200,
        3000,
        horizontal=1.5,
        airspeed=AIRSPEED,
        height=HEIGHT,
        span=2.0,
        step=STEP,
        generator=np.random.default_rng(5),
    )


def test_intensities_are_those_asked_for(drawn) -> None:
    """MIL-F-8785C: σ_w/σ_u = (0.177 + 0.000823 h)^0.4, h in feet; 0.73 at 100 m."""
    size = drawn.std(axis=(0, 1))
    np.testing.assert_allclose(size[:2], 1.5, rtol=0.06)
    share = (0.177 + 0.000823 * 100.0 / 0.3048) ** 0.4
    assert gusts.vertical_share(HEIGHT) == pytest.approx(share)
    assert size[2] == pytest.approx(1.5 * share, rel=0.06)
    assert size[3] == pytest.approx(1.9 * 1.5 * share / np.sqrt(100.0 * 2.0), rel=0.06)


def test_longitudinal_gusts_forget_exponentially(drawn) -> None:
    feet = HEIGHT / 0.3048
    time = feet / (0.177 + 0.000823 * feet) ** 1.2 * 0.3048 / AIRSPEED
    lag = round(time / STEP)
    along = drawn[:, :, 0]
    found = np.mean(along[:, lag:] * along[:, :-lag]) / np.mean(along**2)
    assert found == pytest.approx(np.exp(-lag * STEP / time), abs=0.06)


def test_vertical_gusts_have_the_spectrum_of_dryden(drawn) -> None:
    """S(ω) = σ² T/π (1 + 3 (ωT)²)/(1 + (ωT)²)², at frequencies well below the sampling."""
    down, time = drawn[:, :, 2], HEIGHT / AIRSPEED
    count = down.shape[1]
    window = np.hanning(count)
    power = np.mean(np.abs(np.fft.rfft(down * window, axis=1)) ** 2, axis=0)
    omega = 2.0 * np.pi * np.fft.rfftfreq(count, STEP)
    shape = (1.0 + 3.0 * (omega * time) ** 2) / (1.0 + (omega * time) ** 2) ** 2
    chosen = (omega > 0.6) & (omega < 12.0)
    ratio = power[chosen] / shape[chosen]
    assert np.log(ratio).std() < 0.25
    assert np.polyfit(np.log(omega[chosen]), np.log(ratio), 1)[0] == pytest.approx(0.0, abs=0.08)


def test_pitching_gusts_are_the_vertical_ones_carried_past(drawn) -> None:
    """q = ẇ/V at frequencies far below V π/4b: the slope of what is flown through."""
    slope = np.gradient(drawn[:, :, 2], STEP, axis=1) / AIRSPEED
    kernel = np.ones(75) / 75.0
    smooth = [np.convolve(row, kernel, "valid") for row in slope[:20]]
    pitch = [np.convolve(row, kernel, "valid") for row in drawn[:20, :, 4]]
    assert np.corrcoef(np.ravel(smooth), np.ravel(pitch))[0, 1] > 0.9


def test_seeds_repeat() -> None:
    one, other = (
        gusts.draw(
            2, 10, horizontal=1.0, airspeed=20.0, height=50.0, span=1.0, step=STEP,
            generator=np.random.default_rng(3),
        )
        for _ in range(2)
    )  # fmt: skip
    np.testing.assert_array_equal(one, other)
