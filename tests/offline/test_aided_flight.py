"""A flight as the aided filter reads it, against the truth of a simulated one in gusts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft, StreamTiming, Value
from gcs_sysid.estimate import first_guess, inside_filter
from gcs_sysid.estimate.inside_filter import Derivatives
from gcs_sysid.model import servo_changes
from gcs_sysid.offline import aided_fit, aided_flight, flight, maneuver_choice
from gcs_sysid.offline.flight import SERVO_STREAM, Flight
from gcs_sysid.sources.registry import open_recording

pytestmark = [pytest.mark.shared, pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def one(shared: Path) -> Flight:
    folder = shared / "cases" / "clean"
    aircraft = aircraft_file.load(folder / "aircraft.toml")
    return flight.read(
        folder / "flight.tlog",
        aircraft,
        vehicle=None,
        segments=maneuver_choice.chooser(None, aircraft),
        delay=None,
        progress=lambda *_: None,
    )


def test_surfaces_are_exact_at_the_delay_about_which_they_are_looked_up(one: Flight) -> None:
    """And nearly so beside it; about the file's delay, corners between spoil it."""
    late = -0.009
    stated = one.aircraft.streams.get(SERVO_STREAM, StreamTiming()).delay

    def moved(further: float) -> np.ndarray:
        streams = {**one.aircraft.streams, SERVO_STREAM: StreamTiming(stated + further)}
        aircraft = replace(one.aircraft, streams=streams)
        rows = aided_flight.prepare(one.recording, aircraft, one.reconstruction)
        return np.asarray(rows.rows.controls)

    rows = aided_flight.prepare(one.recording, one.aircraft, one.reconstruction, late=late).rows
    plain = aided_flight.prepare(one.recording, one.aircraft, one.reconstruction).rows
    controls, slopes = np.asarray(rows.controls), np.asarray(rows.control_slopes)
    np.testing.assert_allclose(controls + late * slopes, moved(late), atol=1e-12)
    near, wanted = controls + (late + 0.001) * slopes, moved(late + 0.001)
    assert np.std(near - wanted) < 1e-3 * np.std(wanted)
    far = np.asarray(plain.controls) + late * np.asarray(plain.control_slopes)
    assert np.std(far - moved(late)) > 3.0 * np.std(near - wanted)


def test_surfaces_are_told_to_move_as_those_of_another_aircraft(one: Flight) -> None:
    """One with the lag that the flight is searched with, of which a delay is another thing."""
    slow = servo_changes.changed(one.aircraft, "elevator", servo_changes.lag(0.15))
    rows = aided_flight.prepare(one.recording, one.aircraft, one.reconstruction, moving=slow).rows
    plain, other = (
        aided_flight.prepare(one.recording, made, one.reconstruction).rows
        for made in (one.aircraft, slow)
    )
    np.testing.assert_array_equal(rows.control_slopes, other.control_slopes)
    np.testing.assert_array_equal(rows.controls, plain.controls)
    assert np.std(plain.control_slopes - other.control_slopes) > 0.1 * np.std(plain.control_slopes)


def test_gusts_are_passed_at_the_speed_through_the_wind_that_carries_them(
    one: Flight, shared: Path
) -> None:
    """And not at the airspeed, that a gust from ahead raises without bringing the next one nearer.

    Both are within a few per cent, and it is their difference that is looked at.
    """
    folder = shared / "cases" / "clean"
    rows = aided_flight.prepare(one.recording, one.aircraft, one.reconstruction).rows
    with np.load(folder / "truth.npz") as file:
        true = {str(name): file["rows"][:, i] for i, name in enumerate(file["cols"])}
        late = (int(file["t0_us"]) - open_recording(folder / "flight.tlog").epoch_us) * 1e-6
    axes = ("north", "east", "down")
    through = np.stack([true[f"v_{axis}"] - np.median(true[f"wind_{axis}"]) for axis in axes])
    steady = np.linalg.norm(through, axis=0)
    time = one.reconstruction.time[0] + np.cumsum(rows.step)
    inside = (time > time[0] + 5.0) & (time < time[-1] - 5.0)
    gusty, calm = (
        np.interp(time, true["t"] + late, speed)[inside] for speed in (true["V"], steady)
    )
    passing = np.asarray(rows.passing)[inside]
    share = np.polyfit(gusty - calm, passing - calm, 1)[0]
    assert abs(share) < 0.2
    assert np.std(gusty - calm) > 0.5
    assert np.std(passing - calm) < 0.5 * np.std(gusty - calm)


def tripled(aircraft: Aircraft) -> Aircraft:
    """The aircraft with every value of its aerodynamics three times as large."""
    models = {
        name: replace(
            model,
            terms={
                key: Value(3.0 * one.value, 3.0 * one.sigma) for key, one in model.terms.items()
            },
        )
        for name, model in aircraft.aerodynamics.items()
    }
    return replace(aircraft, aerodynamics=models)


@pytest.mark.parametrize("body", [False, True])
def test_without_a_prior_nothing_of_the_files_aerodynamics_takes_part(
    one: Flight, *, body: bool
) -> None:
    """Not in the rows and their steps, nor where a search begins, nor in what is believed."""
    structure = {name: tuple(model.terms) for name, model in one.aircraft.aerodynamics.items()}
    assert structure["Cm"]

    def asked(aircraft: Aircraft) -> tuple[tuple, Derivatives]:
        mean, sigma = inside_filter.beliefs(structure, None, aircraft)
        start = first_guess.derivatives(aircraft, structure)
        flown = replace(one, aircraft=aircraft)
        item = aided_fit._prepared(flown, start, (1,), body=body)
        before = aided_fit._believed(mean, sigma, aircraft, body=body)
        beliefs = aided_fit._beliefs(item, aided_fit._with(item.first, before), before.covariance)
        kept = (item.rows.rows, item.rows.nominal, item.rows.beginning, item.held, item.first)
        return (*kept, beliefs.mean, beliefs.covariance, beliefs.noise), before

    first, second = asked(one.aircraft), asked(tripled(one.aircraft))
    assert first[1].keys == second[1].keys
    for left, right in zip(
        jax.tree.leaves((first[0], first[1][1:])), jax.tree.leaves((second[0], second[1][1:])),
        strict=True,
    ):  # fmt: skip
        np.testing.assert_array_equal(left, right)


def test_at_50_hz_every_sample_is_a_row(one: Flight) -> None:
    """Whatever the fastest mode of an aircraft that is described with the program."""
    rows = aided_flight.prepare(one.recording, one.aircraft, one.reconstruction).rows
    time, kept = one.reconstruction.time, aided_flight.kept_rows(rows)
    np.testing.assert_allclose(np.cumsum(rows.step)[kept], time - time[0], atol=1e-9)
    usual = np.diff(time) < aided_flight.HOLE * np.median(np.diff(time))
    assert np.median(np.diff(time)) == pytest.approx(0.02, rel=0.05)
    np.testing.assert_array_equal(np.diff(kept)[usual], 1)
