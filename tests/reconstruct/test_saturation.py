"""Sensors at the end of their range: seen where they are, and nowhere else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_sysid.reconstruct import measurements, saturation
from gcs_sysid.recording import Recording
from gcs_sysid.sources.registry import open_recording
from tests.reconstruct import kinematic_flights

ROOT = Path(__file__).resolve().parents[2]
EVERYTHING = (-np.inf, np.inf)
STEP = 1e-3


def rate(seed: int, samples: int = 5000) -> np.ndarray:
    """Roll rate of an aircraft in gusts that rolls left and right, in whole thousandths [rad/s]."""
    rng = np.random.default_rng(seed)
    time = np.arange(samples) / 50.0
    rolled = 0.8 * np.sin(1.3 * time) * np.sin(0.21 * time) + 0.01 * rng.standard_normal(samples)
    return np.round(rolled / STEP) * STEP


@pytest.mark.parametrize("seed", range(20))
def test_extremes_that_were_measured_are_no_ends(seed: int) -> None:
    assert saturation.at_limits(rate(seed)) == {}


@pytest.mark.parametrize("step", [STEP, 0.01, 0.05])
def test_nor_are_those_of_a_slow_motion_in_coarse_steps_without_noise(step: float) -> None:
    """Tops are flat there, and seldomer than what is below them."""
    time = np.arange(5000) / 50.0
    told = np.round((np.sin(0.5 * time) + 0.4 * np.sin(0.23 * time)) / step) * step
    assert saturation.at_limits(told) == {}


@pytest.mark.parametrize("share", [0.5, 0.8, 0.95])
def test_all_beyond_an_end_is_seen_and_nothing_else(share: float) -> None:
    whole = rate(3)
    low, high = (np.round(share * end / STEP) * STEP for end in (whole.min(), whole.max()))
    told = np.clip(whole, low, high)
    found = saturation.at_limits(told)
    assert set(found) == {low, high}
    np.testing.assert_array_equal(found[low], whole <= low)
    np.testing.assert_array_equal(found[high], whole >= high)


def test_what_was_not_measured_does_not_hide_an_end() -> None:
    told = np.clip(rate(4), -0.4, 10.0)
    told[::7] = np.nan
    (found,) = saturation.at_limits(told).values()
    np.testing.assert_array_equal(found, told == -0.4)


def clipped(recording: Recording, stream: str, channel: str, high: float) -> Recording:
    one = recording.streams[stream]
    told = {**one.channels, channel: np.minimum(one.channels[channel], high)}
    return replace(recording, streams={**recording.streams, stream: replace(one, channels=told)})


def test_a_sample_with_an_axis_at_its_end_is_no_row_of_the_filter() -> None:
    """The others of that sample go with it; before take-off a sensor may repeat itself."""
    recording = kinematic_flights.flight(20, duration=20.0).recording
    imu = recording.streams["RAW_IMU"]
    high = float(np.quantile(imu.channels["q"], 0.97))
    told = clipped(recording, "RAW_IMU", "q", high)
    cleared, (line,) = saturation.without_saturated(told, [(0.0, 20.0)])
    there = imu.channels["q"] >= high
    assert "RAW_IMU" in line
    assert f"q {high:.4g} rad/s" in line
    assert f"{there.sum()} samples" in line
    aircraft = kinematic_flights.aircraft()
    kept = measurements.select(cleared, aircraft, EVERYTHING)
    np.testing.assert_allclose(kept.time, imu.time[~there], atol=1e-9)
    assert saturation.without_saturated(told, [(0.0, 0.04)]) == (told, ())


def test_what_accelerometers_missed_is_no_row_either() -> None:
    recording = kinematic_flights.flight(20, duration=20.0).recording
    imu = recording.streams["RAW_IMU"]
    missing = (imu.time > 5.0) & (imu.time < 6.0)
    holed = {**imu.channels, "acc_z": np.where(missing, np.nan, imu.channels["acc_z"])}
    told = replace(
        recording, streams={**recording.streams, "RAW_IMU": replace(imu, channels=holed)}
    )
    kept = measurements.select(told, kinematic_flights.aircraft(), EVERYTHING)
    assert not np.any((kept.time > 5.03) & (kept.time < 5.97))
    assert kept.time.size == pytest.approx(np.sum(~missing), abs=2)


@pytest.mark.parametrize(
    "log", sorted((ROOT / "data" / "flights").glob("*.tlog")), ids=lambda log: log.name
)
def test_flights_that_stayed_within_their_ranges_are_left_alone(log: Path) -> None:
    recording = open_recording(log)
    assert saturation.without_saturated(recording, [EVERYTHING])[1] == ()
