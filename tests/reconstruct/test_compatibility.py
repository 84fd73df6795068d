"""Sensor errors put into made flights are named with sign and size; clean ones tell one story."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.reconstruct import compatibility, measurements
from gcs_sysid.reconstruct.compatibility import Compatibility, Estimate
from gcs_sysid.reconstruct.reconstruction import reconstruct
from tests.reconstruct import kinematic_flights
from tests.reconstruct.kinematic_flights import Errors


@functools.cache
def judged(case: str) -> Compatibility:
    """A flight of 40 s in light gusts with one error, or several that do not touch each other."""
    errors = {
        "clean": Errors(),
        "wrong": Errors(
            airspeed_scale=-0.08,
            accelerometer_bias=np.array([0.0, 0.45, 0.0]),
            vane_bias=np.array([0.0, np.deg2rad(3.0)]),
        ),
        "tilted": Errors(attitude_offset=np.deg2rad([0.0, 4.0, 0.0])),
    }[case]
    flight = kinematic_flights.flight(40, errors=errors, gust=0.4, wind=(4.0, -2.0, 0.0))
    aircraft = kinematic_flights.aircraft()
    data = measurements.select(flight.recording, aircraft, (-np.inf, np.inf))
    return compatibility.check(reconstruct(data, aircraft))


def found(estimate: Estimate | None, truth: float) -> None:
    """The value lies within three deviations of the truth and as far from zero."""
    assert estimate is not None
    assert abs(estimate.value - truth) < 3.0 * estimate.deviation
    assert abs(estimate.value) > 3.0 * estimate.deviation
    assert np.sign(estimate.value) == np.sign(truth)


def test_a_clean_flight_tells_one_story() -> None:
    clean = judged("clean")
    assert "one story" in clean.verdict
    assert {channel.verdict for channel in clean.channels.values()} == {"consistent"}


def test_an_airspeed_that_reads_low_is_named() -> None:
    channel = judged("wrong").channels["airspeed"]
    found(channel.scale, -0.08)
    assert "scale error -" in channel.verdict
    assert "%" in channel.verdict


def test_an_accelerometer_bias_is_named_with_its_axis() -> None:
    channels = judged("wrong").channels
    found(channels["accelerometer_y"].bias, 0.45)
    assert "bias +" in channels["accelerometer_y"].verdict
    assert channels["accelerometer_x"].verdict == "consistent"


def test_a_bent_vane_is_named() -> None:
    channel = judged("wrong").channels["beta"]
    found(channel.bias, np.deg2rad(3.0))
    assert "°" in channel.verdict


def test_a_tilted_attitude_source_is_named() -> None:
    tilted = judged("tilted")
    bias = tilted.channels["pitch"].bias
    assert bias is not None
    assert np.rad2deg(bias.value) == pytest.approx(4.0, abs=1.5)
    assert tilted.channels["pitch"].verdict != "consistent"
    assert "pitch" in tilted.verdict


def test_the_whole_verdict_names_every_odd_channel_and_no_other() -> None:
    wrong = judged("wrong")
    odd = {name for name, channel in wrong.channels.items() if channel.verdict != "consistent"}
    assert {"airspeed", "accelerometer_y", "beta"} <= odd
    assert all(name in wrong.verdict for name in odd)
    assert "one story" not in wrong.verdict


def test_every_channel_has_unit_noise_and_where_measured_innovations() -> None:
    channels = judged("clean").channels
    assert {"airspeed", "velocity_north", "roll", "alpha", "gyro_x"} <= set(channels)
    for name, channel in channels.items():
        assert channel.unit
        assert channel.noise > 0.0
        assert (channel.nis is None) == name.startswith(("gyro", "accelerometer"))


def test_innovations_of_a_consistent_filter_lie_in_their_band() -> None:
    """White normal numbers: 95 % of mean squares and of correlations within the limits."""
    rng = np.random.default_rng(6)
    inside = []
    for _ in range(400):
        nis, (low, high), whiteness, limit = compatibility.innovations(rng.standard_normal(300))
        inside.append((low < nis < high, abs(whiteness) < limit))
    # Binomial: 400 trials at 0.95 have a standard deviation of 0.011.
    np.testing.assert_allclose(np.mean(inside, axis=0), 0.95, atol=0.035)


def test_coloured_innovations_are_told_from_white_ones() -> None:
    rng = np.random.default_rng(7)
    white = rng.standard_normal(500)
    coloured = white[1:] + 0.5 * white[:-1]
    _, _, whiteness, limit = compatibility.innovations(coloured)
    assert whiteness == pytest.approx(0.5 / 1.25, abs=0.1)  # lag one of a moving average
    assert whiteness > limit


@pytest.mark.parametrize(
    ("estimate", "words"),
    [
        (Estimate(0.1, 0.01, "1"), "+10 ± 1 %"),
        (Estimate(-0.0345, 0.0017, "rad"), "-1.98 ± 0.097°"),
        (Estimate(0.15, 0.004, "s"), "+150 ± 4 ms"),
        (Estimate(0.45, 0.02, "m/s²"), "+0.45 ± 0.02 m/s²"),
    ],
)
def test_numbers_are_told_in_units_a_person_uses(estimate: Estimate, words: str) -> None:
    assert compatibility.readable(estimate) == words
    assert replace(estimate).document() == {
        "value": estimate.value,
        "sd": estimate.deviation,
        "unit": estimate.unit,
    }
