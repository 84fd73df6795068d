"""Reconstruction of made flights: the truth lies in the bands, and the bands are as wide as needed.

Sensor errors are drawn from the prior, so normalised errors over many flights have unit variance if
the filter is consistent. One flight of 40 s takes a few seconds; all tests share the same ones.
"""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np
import pytest
from scipy.stats import chi2

from gcs_sysid import frames
from gcs_sysid.reconstruct import measurements
from gcs_sysid.reconstruct.reconstruction import Reconstruction, first_noise, reconstruct
from tests.reconstruct import kinematic_flights
from tests.reconstruct.kinematic_flights import Errors, Flight, without

SEEDS = tuple(range(1, 11))
MIDDLE = 1000
CONSTANTS = (
    "accelerometer_bias",
    "gyro_bias",
    "accelerometer_scale",
    "gyro_scale",
    "airspeed_scale",
    "airspeed_delay",
    "velocity_delay",
    "attitude_delay",
)


class Flown(NamedTuple):
    flight: Flight
    states: Reconstruction


@functools.cache
def flown(seed: int, *, vanes: bool = False) -> Flown:
    flight = kinematic_flights.flight(seed)
    return Flown(flight, solve(flight, vanes=vanes))


def solve(flight: Flight, *, vanes: bool = False) -> Reconstruction:
    aircraft = kinematic_flights.aircraft(vanes=vanes)
    data = measurements.select(flight.recording, aircraft, (-np.inf, np.inf))
    return reconstruct(data, aircraft)


def normalised(name: str, truth: np.ndarray | float, states: Reconstruction) -> np.ndarray:
    error = states.block(name)[MIDDLE] - np.atleast_1d(truth)
    return error / states.deviation(name)[MIDDLE]


def errors_of(one: Flown) -> dict[str, np.ndarray]:
    """Errors over stated deviations, in the middle of a flight."""
    flight, states = one
    found = {name: normalised(name, getattr(flight.errors, name), states) for name in CONSTANTS}
    found["wind"] = normalised("wind", flight.steady_wind[MIDDLE], states)
    true = np.stack([flight.airspeed, flight.alpha, flight.beta], axis=-1)
    flow = np.stack([states.airspeed, states.alpha, states.beta], axis=-1)
    spread = np.sqrt(np.diagonal(states.flow_covariance, axis1=1, axis2=2))
    found["flow"] = ((flow - true) / spread)[MIDDLE]
    turn = frames.logarithm(
        frames.multiply(
            frames.conjugate(frames.quaternion_from_euler(flight.euler[MIDDLE])),
            frames.quaternion_from_euler(states.euler[MIDDLE]),
        )
    )
    found["attitude"] = turn / states.deviation("attitude")[MIDDLE]
    return found


def test_the_made_flights_obey_the_kinematics() -> None:
    """Their own rates and forces, integrated by the trapezoidal rule, give their motion back."""
    flight = kinematic_flights.flight(0, errors=Errors(), duration=20.0)
    attitude = frames.quaternion_from_euler(flight.euler)
    step = 0.02
    middle = 0.5 * (flight.rate[1:] + flight.rate[:-1])
    turned = frames.multiply(attitude[:-1], frames.exponential(step * middle))
    back = frames.logarithm(frames.multiply(frames.conjugate(turned), attitude[1:]))
    assert np.abs(back).max() < 1e-5  # trapezoid: dt³/12 of the second derivative of the rate
    assert np.abs(flight.alpha).max() > 0.05


@pytest.mark.slow
def test_bands_hold_the_truth_over_ten_flights() -> None:
    """Mean square of normalised errors: every quantity inside a wide chi-square band, all tight.

    Ten flights give each number ten independent squares; the band for one holds 99.98 %, as some
    thirty are looked at. Errors within a flight are correlated, so the band for all counts flights
    only, with a handful of independent numbers in each.
    """
    found = [errors_of(flown(seed)) for seed in SEEDS]
    count = len(SEEDS)
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], count) / count
    everything = []
    for name in found[0]:
        squares = np.mean([one[name] ** 2 for one in found], axis=0)
        everything.extend(squares)
        # Nothing is seen to be wrong of what the prior alone tells, nor may bands be too narrow.
        assert (squares < high).all(), f"{name}: {squares}"
        assert (squares > 0.1 * low).all(), f"{name}: {squares}"
    assert 0.5 < np.mean(everything) < 1.7


@pytest.mark.slow
def test_alpha_and_sideslip_bands_hold_their_share_of_samples() -> None:
    """Two thirds within one deviation and 95 % within two, over ten flights without vanes."""
    inside = {1.0: [], 2.0: []}
    for seed in SEEDS:
        flight, states = flown(seed)
        spread = np.sqrt(np.diagonal(states.flow_covariance, axis1=1, axis2=2))[:, 1:]
        true = np.stack([flight.alpha, flight.beta], axis=-1)
        error = np.abs(np.stack([states.alpha, states.beta], axis=-1) - true) / spread
        for limit, shares in inside.items():
            shares.append(np.mean(error[50:-50] < limit))
    assert np.mean(inside[1.0]) == pytest.approx(0.68, abs=0.15)
    assert np.mean(inside[2.0]) > 0.88


def test_a_late_velocity_is_found() -> None:
    """GPS filters are 0.1 to 0.2 s late; uncorrected, a turn shows it as 0.6 m/s."""
    errors = replace(kinematic_flights.drawn_errors(3), velocity_delay=0.15)
    flight = kinematic_flights.flight(3, errors=errors)
    states = solve(flight)
    value = states.block("velocity_delay")[0, 0]
    deviation = states.deviation("velocity_delay")[0, 0]
    assert deviation < 0.02
    assert abs(value - 0.15) < 3.0 * deviation


def test_vanes_sharpen_alpha_and_tell_gusts() -> None:
    """Vanes reduce the error of alpha; their scale is not blown up by gusts.

    A filter that lets gusts teach the vanes' scale made it 0.2 to 0.35 too large here.
    """
    flight, states = flown(4, vanes=True)
    _, blind = flown(4)
    error = np.std(states.alpha - flight.alpha)
    assert error < 0.7 * np.std(blind.alpha - flight.alpha)
    off = states.block("vane_scale")[0] - flight.errors.vane_scale
    assert (np.abs(off) < 3.0 * states.deviation("vane_scale")[0]).all()
    assert (np.abs(off) < 0.15).all()
    assert float(states.noise.gust[0]) == pytest.approx(1.0, abs=0.3)
    assert float(states.noise.gust[2]) == pytest.approx(1.4, abs=0.5)


def test_white_noise_is_found_from_the_flight() -> None:
    """Within 20 %: what gusts do between samples is added to a pitot tube's own noise."""
    states = flown(5).states
    expected = [0.3, 0.15, 0.15, 0.15, 0.004, 0.004, 0.004]
    np.testing.assert_allclose(states.noise.measured[:3], expected[:3], rtol=0.35)
    np.testing.assert_allclose(states.noise.measured[4:6], expected[4:6], rtol=0.2)
    assert float(states.noise.gyro) == pytest.approx(np.hypot(0.004, 0.002), rel=0.1)
    assert float(states.noise.accelerometer) == pytest.approx(np.hypot(0.1, 0.05), rel=0.1)


def test_a_strong_wind_is_no_obstacle() -> None:
    """A filter that began in still air took 20 m/s of wind for sideslip and lost the vanes."""
    flight = kinematic_flights.flight(6, wind=(-20.0, 10.0, 0.0))
    states = solve(flight, vanes=True)
    off = np.abs(states.block("wind")[MIDDLE] - flight.steady_wind[MIDDLE])
    assert (off < 3.0 * states.deviation("wind")[MIDDLE] + 0.1).all()
    assert np.rad2deg(np.std(states.alpha - flight.alpha)) < 1.5


def test_without_accelerometer_bands_are_wider_and_still_hold() -> None:
    flight = kinematic_flights.flight(7)
    blind = replace(flight, recording=without(flight.recording, "RAW_IMU"))
    states = solve(blind)
    assert not states.data.has_accelerometer
    truth = np.interp(states.time, flight.time, flight.airspeed)
    spread = np.sqrt(states.flow_covariance[:, 0, 0])
    share = np.mean(np.abs(states.airspeed - truth)[20:-20] < 2.0 * spread[20:-20])
    assert share > 0.85
    with_unit = flown(7).states
    own = np.sqrt(with_unit.flow_covariance[:, 1, 1]).mean()
    assert np.sqrt(states.flow_covariance[:, 1, 1]).mean() > own


def test_first_and_refined_intensities_share_one_compilation() -> None:
    """Weakly typed first guesses used to compile the smoother twice in every process."""
    states = flown(5).states
    first = jax.tree.leaves(first_noise(states.data))
    refined = jax.tree.leaves(states.noise)
    assert [one.aval for one in first] == [one.aval for one in refined]


def test_what_the_file_says_of_a_sensor_sets_its_prior() -> None:
    believed = kinematic_flights.aircraft()
    stated = replace(
        believed,
        pitot=replace(believed.pitot, error=replace(believed.pitot.error, scale_sigma=0.002)),
    )
    flight = kinematic_flights.flight(8, duration=10.0)
    data = measurements.select(flight.recording, stated, (-np.inf, np.inf))
    assert reconstruct(data, stated).deviation("airspeed_scale")[0, 0] <= 0.002
