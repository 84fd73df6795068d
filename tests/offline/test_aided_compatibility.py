"""The check of the sensors inside the aided filter, also with sensors that are made wrong."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid.estimate import filter_error, scoring, settling
from gcs_sysid.estimate import flight_rows as rows
from gcs_sysid.estimate.filter_error import Fit
from gcs_sysid.estimate.intensities import Prior
from gcs_sysid.estimate.settling import Beliefs
from gcs_sysid.model import aided
from gcs_sysid.model.kinematics import Measurements
from gcs_sysid.offline import aided_compatibility, aided_summary, summary
from gcs_sysid.offline.flight import Flight
from gcs_sysid.reconstruct import causal
from gcs_sysid.reconstruct.compatibility import CONSISTENT, Compatibility
from gcs_sysid.report import tables
from tests.estimate import made_flight as made

pytestmark = pytest.mark.slow

TRUE, WRONG = made.unknowns(1.0), made.unknowns(0.7)
LAG = 0.2
USED = {"gyro": "RAW_IMU", "airspeed": "VFR_HUD", "velocity": "GPS", "attitude": "ATTITUDE"}
TIME = made.STEP * np.arange(made.COUNT)
COMES_AND_GOES = np.sign(np.sin(2.0 * np.pi * TIME / 3.0))


@pytest.fixture(scope="module", autouse=True)
def _short_chunks() -> Iterator[None]:
    with made.halved():
        yield


def beliefs() -> Beliefs:
    """Nothing of the derivatives; of sensors, gusts and noises what is ordinary."""
    flat, unravel = ravel_pytree(WRONG.means)
    count = sum(len(terms) for terms in made.TERMS.values())
    sigma = unravel(jnp.where(jnp.arange(flat.size) < count, 1e3, 0.0))
    sensors = sigma.sensors._replace(
        gyro_bias=jnp.full(3, 0.01),
        accelerometer_bias=jnp.full(3, 0.1),
        airspeed_scale=jnp.asarray(0.03),
        airspeed_lag=jnp.asarray(0.1),
        attitude_tilt=jnp.full(2, aided.ATTITUDE_TILT),
    )
    sigma = sigma._replace(sensors=sensors)
    held, two = jax.tree.map(jnp.zeros_like, TRUE.log_noise), jnp.asarray(2.0)
    free = held._replace(
        turbulence=held.turbulence._replace(gust=jnp.full(3, 2.0)),
        gyro=two,
        accelerometer=two,
        airspeed=two,
        airspeed_error=jnp.asarray(1.0),
        velocity=jnp.full(2, 2.0),
    )
    covariance = np.diag(np.asarray(ravel_pytree(sigma)[0]) ** 2)
    return Beliefs(np.asarray(flat), covariance, Prior(TRUE.log_noise, free))


def fitted(flight: rows.Flight) -> Fit:
    every = np.ones(made.COUNT, dtype=bool)
    return filter_error.fit(made.MODEL, flight, WRONG, beliefs(), every, lambda _: None)


def described() -> Flight:
    flight = Mock(spec=Flight, aircraft=made.AIRCRAFT, reconstruction=Mock())
    flight.reconstruction.data.used = USED
    flight.reconstruction.data.has_accelerometer = True
    return flight


def document(fit: Fit) -> dict[str, Any]:
    found: dict[str, Any] = {"sensor": {}, "delays": {}}
    aided_summary.put_reconstruction(found, fit, described())
    return found


@pytest.fixture(scope="module")
def flown(_short_chunks: None) -> rows.Flight:
    """Whose airspeed lags, and nothing else is wrong."""
    return made.made_flight(airspeed_lag=LAG)


@pytest.fixture(scope="module")
def right(flown) -> Fit:
    return fitted(flown)


def test_only_what_is_wrong_stands_out_of_a_flight_made_by_the_model(right) -> None:
    """Innovations of 400 samples: 95 % of mean squares within 0.14 of 1, here all within 0.28."""
    assert right.converged
    found = aided_compatibility.check(right, described())
    assert found.filter == "aided"
    odd = {name for name, channel in found.channels.items() if channel.verdict != CONSISTENT}
    assert odd == {"airspeed"}
    assert "lag +" in found.channels["airspeed"].verdict
    assert len(found.channels) == aided.ROW_COUNT - 2
    for name, channel in found.channels.items():
        assert channel.nis == pytest.approx(1.0, abs=0.28), name
        assert abs(channel.whiteness or 0.0) < 0.2, name
        for error in (channel.bias, channel.scale):
            assert error is None or abs(error.value) < 3.0 * error.deviation, name


def test_the_lag_the_wind_and_the_gusts_are_told_within_their_intervals(right, flown) -> None:
    found = document(right)
    lag = found["sensor"]["airspeed_lag"]
    assert lag["sd"] < 0.08
    assert lag["value"] == pytest.approx(LAG, abs=3.0 * lag["sd"])
    wind, true = found["wind_ned"], np.asarray(flown.nominal.air.wind).mean(axis=0)
    assert np.all(np.abs(wind["value"] - true) < 3.0 * wind["sd"])
    assert np.all(wind["sd"] < 0.15)
    gust = found["gust_sd_vertical"]
    assert gust["sd"] < 0.1
    assert gust["value"] == pytest.approx(0.3, abs=3.0 * gust["sd"])
    level = found["gust_sd"]
    # Eight seconds are not three of their correlation times.
    assert level["value"] == pytest.approx(0.3, abs=3.0 * level["sd"])
    # What was held is not told to a deviation.
    assert found["sensor"]["gyro_drift"] == {
        "value": pytest.approx(5e-4),
        "sd": 0.0,
        "unit": "rad/s",
    }


def airspeed(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Measurements], Measurements]:
    return lambda measured: measured._replace(airspeed=change(np.asarray(measured.airspeed)))


def north(change: np.ndarray) -> Callable[[Measurements], Measurements]:
    more = change[:, None] * np.array([1.0, 0.0, 0.0])
    return lambda measured: measured._replace(velocity=np.asarray(measured.velocity) + more)


NOISE = np.random.default_rng(1).standard_normal((made.COUNT, 1))
CASES = {
    "reads high": (airspeed(lambda value: 1.15 * value), "airspeed", "scale error +15"),
    "comes and goes": (
        airspeed(lambda value: value + 1.5 * COMES_AND_GOES[:, None]),
        "airspeed",
        "lasting error +",
    ),
    "is noisy": (airspeed(lambda value: value + NOISE), "airspeed", "noise +0.9"),
    "leaps": (north(1.5 * COMES_AND_GOES), "velocity_north", "successive innovations correlate"),
}


def test_what_comes_and_goes_is_told_at_its_size(flown) -> None:
    """Of a Markov error of known time, σ² = Σ (x(k) − a x(k−1))² / (n (1 − a²)): here 0.955 m/s."""
    wave = 1.5 * COMES_AND_GOES
    kept = math.exp(-made.STEP / aided.AIRSPEED_TIME)
    size = math.sqrt(np.mean((wave[1:] - kept * wave[:-1]) ** 2) / (1.0 - kept**2))
    measured = CASES["comes and goes"][0](flown.rows.measured)
    found = aided_compatibility.check(
        fitted(replace(flown, rows=flown.rows._replace(measured=measured))), described()
    )
    told = re.search(r"lasting error \+([\d.]+) ± ([\d.]+) m/s", found.channels["airspeed"].verdict)
    assert told is not None
    value, deviation = map(float, told.groups())
    assert abs(value - size) < 2.0 * deviation < 0.3 * size


@pytest.mark.parametrize("case", CASES)
def test_a_sensor_that_is_wrong_is_flagged_by_its_channel(flown, case) -> None:
    """Also where the filter takes it all for noise, so that innovations are as it expects."""
    wrong, name, words = CASES[case]
    measured = wrong(flown.rows.measured)
    found = aided_compatibility.check(
        fitted(replace(flown, rows=flown.rows._replace(measured=measured))), described()
    )
    assert words in found.channels[name].verdict
    assert name in found.verdict
    group = name.partition("_")[0]
    others = {k: v.verdict for k, v in found.channels.items() if not k.startswith(group)}
    others.pop("airspeed", None)
    assert set(others.values()) == {CONSISTENT}, others


def test_the_summary_and_the_report_have_it_where_the_kinematic_one_stands(right) -> None:
    checked = aided_compatibility.check(right, described())
    flight = described()
    flight.compatibility = checked
    told = summary.compatibility(flight)
    assert told["filter"] == "aided"
    assert told["channels"]["airspeed"]["lag"] == pytest.approx(LAG, abs=0.1)
    assert told["channels"]["roll"]["lag"] is None
    rows_shown = {one.name: one for one in tables.channels({"compatibility": told})}
    assert rows_shown["airspeed"].lag.endswith("ms")
    assert rows_shown["velocity north"].lag == ""
    assert rows_shown["gyro x"].nis.startswith(("0.", "1."))
    assert Compatibility({}, "").filter == "kinematic"


def test_the_last_state_moves_with_a_parameter_as_two_filters_differ(flown) -> None:
    """By a central difference; what is left is how gains move, times innovations."""
    path = settling.along(made.MODEL, flown, TRUE)
    every = np.ones(made.COUNT, dtype=bool)
    moved = causal.passed(made.MODEL, *TRUE, path, every).moved
    [place] = np.flatnonzero(scoring.marked(TRUE.means, ("airspeed_scale",)))
    flat, unravel = ravel_pytree(TRUE.means)
    ends = []
    for step in (1e-4, -1e-4):
        means = unravel(flat.at[place].add(step))
        linear = causal.joined(made.MODEL, means, TRUE.log_noise, path)
        ends.append(np.asarray(causal.filtered(path, linear)[1].mean))
    differs = (ends[0] - ends[1]) / 2e-4
    wind = aided.BLOCKS["wind"]
    assert np.abs(moved[wind, place]).max() > 0.5
    np.testing.assert_allclose(moved[wind, place], differs[wind], atol=0.05)


def test_sensors_with_several_axes_are_marked_too() -> None:
    marked = scoring.marked(TRUE.means, ("gyro_bias", "airspeed_lag"))
    assert marked.sum() == 4
