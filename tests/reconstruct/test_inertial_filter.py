"""The delay of an autopilot's inertial filter, against the filter itself and on its own flights."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft, Imu, SensorError
from gcs_sysid.reconstruct import compatibility, inertial_filter, measurements
from gcs_sysid.reconstruct.airborne import airborne
from gcs_sysid.reconstruct.reconstruction import reconstruct
from gcs_sysid.sources.registry import open_recording
from tests.reconstruct import kinematic_flights

RATE = 1000.0
EVERYTHING = (-np.inf, np.inf)
PARAMETERS = {"INS_GYRO_FILTER": 20.0, "INS_ACCEL_FILTER": 10.0}


@pytest.fixture(scope="module")
def aircraft() -> Aircraft:
    return kinematic_flights.aircraft()


@pytest.mark.parametrize("cutoff", [10.0, 20.0, 80.0])
def test_motion_comes_out_of_the_filter_later_and_otherwise_as_it_was(cutoff: float) -> None:
    """SciPy's Butterworth filter, run on an aircraft's motion of up to a seventh of its cut-off."""
    time = np.arange(0.0, 20.0, 1.0 / RATE)

    def motion(at: np.ndarray) -> np.ndarray:
        return sum(
            np.sin(2.0 * np.pi * share * cutoff * at + share) for share in (0.02, 0.07, 0.15)
        )

    shown = signal.lfilter(*signal.butter(2, cutoff, fs=RATE), motion(time))
    late = motion(time - inertial_filter.delay(cutoff))
    settled = time > 5.0 / cutoff
    undone = np.std((shown - late)[settled])
    left = np.std((shown - motion(time))[settled])
    assert undone < 0.02 * np.std(motion(time))
    assert undone < 0.15 * left


def test_a_filter_that_is_off_delays_nothing(aircraft: Aircraft) -> None:
    assert inertial_filter.delay(0.0) == 0.0
    assert inertial_filter.behind(aircraft, {"INS_GYRO_FILTER": 0.0}) == aircraft
    assert inertial_filter.behind(aircraft, {}) == aircraft


def test_samples_lie_when_the_aircraft_moved_so(aircraft: Aircraft) -> None:
    recording = kinematic_flights.flight(21, duration=10.0).recording
    plain = measurements.select(recording, aircraft, EVERYTHING)
    told = replace(recording, parameters={**recording.parameters, **PARAMETERS})
    behind = measurements.select(told, aircraft, EVERYTHING)
    late = inertial_filter.delay(20.0)
    assert late == pytest.approx(0.01125, abs=1e-5)
    np.testing.assert_allclose(behind.time, plain.time - late, atol=1e-12)
    np.testing.assert_array_equal(behind.gyro, plain.gyro)
    # Specific force comes later still: at the gyros' times it is between its own samples.
    inside = slice(2, -2)
    wanted = np.stack(
        [
            np.interp(behind.time + inertial_filter.delay(10.0), plain.time, axis)
            for axis in plain.accelerometer.T
        ],
        axis=-1,
    )
    np.testing.assert_allclose(behind.accelerometer[inside], wanted[inside], atol=1e-9)


def test_what_the_file_states_stays(aircraft: Aircraft) -> None:
    stated = replace(aircraft, imu=Imu(gyro=SensorError(bias=(0.0, 0.0, 0.0), lag=0.003)))
    found = inertial_filter.behind(stated, PARAMETERS).imu
    assert found.gyro.lag == 0.003
    assert found.accelerometer.lag == inertial_filter.delay(10.0)


@pytest.mark.shared
@pytest.mark.slow
@pytest.mark.parametrize("name", ["A", "B"])
def test_attitude_of_an_autopilot_is_not_early(name: str, shared: Path) -> None:
    """Attitude and velocity lead rates by 12 ms without, by less than 3 with the filter known."""
    folder = shared / "data" / "arduplane_sitl"
    flown = aircraft_file.load(folder / "aircraft.toml")
    recording = open_recording(folder / f"{name}.tlog", vehicle=None)
    start = airborne(recording, flown)[0][0] + 60.0

    def early(parameters: dict[str, float]) -> list[float]:
        told = replace(recording, parameters=parameters)
        data = measurements.select(told, flown, (start, start + 90.0))
        channels = compatibility.check(reconstruct(data, flown)).channels
        delays = [channels[name].delay for name in ("roll", "velocity_north")]
        return [-delay.value for delay in delays if delay is not None]

    without, known = early({}), early(dict(recording.parameters))
    assert len(without) == len(known) == 2
    assert all(0.010 < one < 0.016 for one in without)
    assert all(abs(one) < 0.003 for one in known)
