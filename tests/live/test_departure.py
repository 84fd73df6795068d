"""When the simulation is said to depart from the flight, and when not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.aircraft import Aircraft, CoefficientModel, Value
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.live.departure import BEGIN, WINDOWS, Departures, DerivativeDepartures
from gcs_sysid.live.regression import Solution

ROWS = 32
ALL = slice(0, ROWS)
SLOPE, SIGMA, NOISE = -0.8, 0.04, 0.003


@pytest.fixture
def simulated(aircraft: Aircraft) -> Aircraft:
    """The example aircraft with one line in its simulation."""
    terms = {"1": Value(0.02, 0.0), "alpha": Value(SLOPE, SIGMA)}
    return replace(aircraft, aerodynamics={"Cm": CoefficientModel(terms=terms)})


def window(start: float, *, off: float = 0.0, alpha_sd: float = 0.0, mass: float = 0.0) -> Samples:
    """A window whose Cm is the simulation's, and `off` more."""
    time = start + 0.02 * np.arange(ROWS)
    alpha = 0.1 + 0.01 * np.sin(time)
    names = ("V", "alpha", "beta", "phat", "qhat", "rhat", "elevator", "aileron", "rudder")
    flat = dict.fromkeys(("Cm",), np.full(ROWS, mass))
    return Samples(
        time=time,
        qbar=np.full(ROWS, 200.0),
        regressors={name: np.zeros(ROWS) for name in names} | {"alpha": alpha},
        regressor_variance={"alpha": np.full(ROWS, alpha_sd**2)},
        measured={"Cm": 0.02 + SLOPE * alpha + off},
        noise={"Cm": np.full(ROWS, NOISE)},
        mass_part=flat,
        thrust_part=dict.fromkeys(("Cm",), np.zeros(ROWS)),
        smoothing=0.0,
        refused={},
    )


def after(aircraft: Aircraft, count: int, **parts: float) -> Departures:
    found = Departures(aircraft)
    for number in range(count):
        found.take(window(0.64 * number, **parts), ALL)
    return found


def test_a_simulation_that_is_right_departs_nowhere(simulated: Aircraft) -> None:
    assert after(simulated, 10).told() == {}


def test_size_and_deviations_are_those_of_the_closed_form(simulated: Aircraft) -> None:
    told = after(simulated, WINDOWS, off=0.02).told()["Cm"]
    newest = window(0.64 * (WINDOWS - 1))
    spread = np.sqrt(NOISE**2 + np.mean((SIGMA * newest.regressors["alpha"]) ** 2))
    assert told.since == 0.0
    assert told.size == pytest.approx(0.02)
    assert told.deviations == pytest.approx(0.02 / spread, rel=1e-3)


def test_it_is_told_after_some_windows_and_over_when_it_ends(simulated: Aircraft) -> None:
    found = after(simulated, WINDOWS - 1, off=0.02)
    assert found.told() == {}
    found.take(window(5.0, off=0.02), ALL)
    assert found.told()["Cm"].since == 0.0
    found.take(window(6.0), ALL)
    assert found.told() == {}


def test_what_jumps_from_side_to_side_is_no_departure(simulated: Aircraft) -> None:
    found = Departures(simulated)
    for number in range(20):
        found.take(window(0.64 * number, off=0.02 * (-1.0) ** number), ALL)
        assert found.told() == {}


@pytest.mark.parametrize("parts", [{"alpha_sd": 0.01}, {"mass": 0.2}], ids=["flow", "inertia"])
def test_what_is_not_known_does_not_accuse(simulated: Aircraft, parts: dict[str, float]) -> None:
    """An offset beyond `BEGIN` of the noise, but not of what flow or inertia may be wrong by."""
    off = 1.05 * BEGIN * np.hypot(NOISE, SIGMA * 0.11)
    assert after(simulated, WINDOWS, off=off).told()
    assert after(simulated, WINDOWS, off=off, **parts).told() == {}


def found(slope: float, *, constant: float = 0.02, sd: float = 0.03) -> dict[str, Solution]:
    """Derivatives of Cm as a filter knows them."""
    value = np.array([constant, slope, -1.0])
    return {"Cm": Solution(("1", "alpha", "elevator"), value, np.diag([1e-6, sd**2, sd**2]))}


@pytest.fixture
def steered(simulated: Aircraft) -> Aircraft:
    """With an elevator whose effect the file knows to a tenth."""
    terms = {**simulated.aerodynamics["Cm"].terms, "elevator": Value(-1.0, 0.1)}
    return replace(simulated, aerodynamics={"Cm": CoefficientModel(terms=terms)})


def test_a_derivative_departs_by_more_than_both_may_be_off_by(steered: Aircraft) -> None:
    watched = DerivativeDepartures(steered)
    for number in range(WINDOWS):
        assert watched.told() == {}
        watched.take(5.0 + number, found(SLOPE + 0.2))
    told = watched.told()["Cm"]
    assert (told.since, told.derivative) == (5.0, "alpha")
    assert told.size == pytest.approx(0.2)
    assert told.deviations == pytest.approx(0.2 / np.hypot(SIGMA, 0.03))
    assert watched.lately(30.0)
    watched.take(9.0, found(SLOPE))
    assert watched.told() == {}
    assert not watched.lately(60.0)


def test_a_derivative_within_what_file_and_flight_are_unsure_of_departs_not(
    steered: Aircraft,
) -> None:
    watched = DerivativeDepartures(steered)
    off = 1.05 * BEGIN * np.hypot(SIGMA, 0.03)
    for number in range(WINDOWS):
        watched.take(float(number), found(SLOPE + off, sd=0.06))
    assert watched.told() == {}


def test_a_trim_that_ordinary_rigging_explains_departs_not(steered: Aircraft) -> None:
    """Half a degree of elevator is 0.0087 of Cm: twice that is ordinary, four times is not."""
    half = np.deg2rad(0.5)
    for times, departs in ((2.0, False), (4.0, True)):
        watched = DerivativeDepartures(steered)
        for number in range(WINDOWS):
            watched.take(float(number), found(SLOPE, constant=0.02 + times * half))
        assert bool(watched.told()) == departs
