"""What an autopilot's commands answered to, from flights of a loop written here."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from gcs_sysid import atmosphere
from gcs_sysid.maneuvers import axes, flown_hold, holding
from gcs_sysid.maneuvers.axes import Axes
from gcs_sysid.maneuvers.flown_hold import Flight, FlownHold
from gcs_sysid.model import trim
from tests.maneuvers.made_model import aircraft, model

STEP, AIRSPEED, GRAVITY = 0.02, 20.0, 9.81
PRESSURE = 0.5 * 1.2 * AIRSPEED**2
GAIN = {"p": 0.05, "phi": 0.4, "psi": 0.5}
AXES = Axes("elevator", "aileron", None)


def flown(
    seconds: float = 60.0, *, seed: int = 0, pulses: int = 8, size: float = 0.1, sign: float = 1.0
) -> Flight:
    """Rolls in gusts under `GAIN`, pulses of a second on top; pitch follows a target nobody tells.

    The servos are those of the made-up aircraft: 20 ms of delay, 40 ms of lag.
    """
    generator = np.random.default_rng(seed)
    count = round(seconds / STEP)
    added = np.zeros(count)
    for begin in np.linspace(2.0, seconds - 4.0, pulses):
        first = round(begin / STEP)
        added[first : first + 25], added[first + 25 : first + 50] = size, -size
    push = 4.0 * generator.standard_normal(count)
    target = 0.1 * np.cumsum(generator.standard_normal(count)) * np.sqrt(STEP)
    turned, moved = np.zeros((count, 6)), np.zeros((count, 2))
    roll = pitch = np.zeros(2)
    heading, yaw = 0.0, signal.lfilter([0.1], [1.0, -0.9], 0.1 * generator.standard_normal(count))
    asked = [np.zeros(2), np.zeros(2)]
    surfaces = np.zeros(2)
    for row in range(count):
        turning = GRAVITY / AIRSPEED * roll[1] + yaw[row]
        turned[row] = roll[0], pitch[0], turning, roll[1], pitch[1], heading
        moved[row] = surfaces
        answer = GAIN["p"] * roll[0] + GAIN["phi"] * roll[1] + GAIN["psi"] * heading
        elevator = 0.1 * pitch[0] + 0.3 * (pitch[1] - target[row])
        asked.append(np.array([elevator, added[row] - sign * answer]))
        surfaces = surfaces + (1.0 - np.exp(-STEP / 0.04)) * (asked[row + 1] - surfaces)
        heading += STEP * turning
        roll = roll + STEP * np.array([-8.0 * roll[0] + 60.0 * surfaces[1] + push[row], roll[0]])
        pitch = pitch + STEP * np.array([-6.0 * pitch[0] - 40.0 * surfaces[0], pitch[0]])
    controls = {"elevator": moved[:, 0], "aileron": moved[:, 1], "rudder": np.zeros(count)}
    return Flight(STEP * np.arange(count), np.full(count, PRESSURE), controls, turned)


def found(*flights: Flight) -> FlownHold:
    told = flown_hold.found(aircraft(), AXES, flights)
    assert told is not None
    return told


def test_gains_are_found_whatever_the_gusts() -> None:
    for seed in range(4):
        one = found(flown(seed=seed)).answers["aileron"]
        assert one.told
        for name, value in GAIN.items():
            assert one.gain[flown_hold.TURNED.index(name)] == pytest.approx(value, rel=0.03)


def test_deviations_hold_where_something_else_moves_the_control() -> None:
    off = []
    for seed in range(25):
        one = flown(seed=seed, pulses=0)
        noise = 0.05 * np.random.default_rng(100 + seed).standard_normal(one.time.size)
        moved = {**one.controls, "aileron": one.controls["aileron"] + noise}
        told = found(one._replace(controls=moved)).answers["aileron"]
        for name, value in GAIN.items():
            place = flown_hold.TURNED.index(name)
            off.append((told.gain[place] - value) / told.deviation[place])
    assert np.mean(np.abs(off) < 1.96) > 0.85
    assert np.std(off) > 0.6


def test_inputs_of_a_test_do_not_pull() -> None:
    """Least squares over everything would find the roll angle held half as tightly."""
    one = flown(pulses=12, size=0.3)
    place = flown_hold.TURNED.index("phi")
    assert found(one).answers["aileron"].gain[place] == pytest.approx(GAIN["phi"], rel=0.05)
    rows = one.turned[:, [0, 3, 5]]
    everything = -np.linalg.lstsq(rows, one.controls["aileron"])[0]
    assert everything[1] < 0.7 * GAIN["phi"]


def test_what_follows_targets_that_nobody_tells_is_not_told() -> None:
    answers = found(flown()).answers
    assert not answers["elevator"].told
    assert answers["aileron"].told


def test_turns_and_gaps_tell_nothing() -> None:
    one = flown()
    turned = one.turned.copy()
    turned[:, 3] += 0.6
    assert flown_hold.found(aircraft(), AXES, [one._replace(turned=turned)]) is None
    late = one.time + 5.0 * (np.arange(one.time.size) // 100)
    assert flown_hold.found(aircraft(), AXES, [one._replace(time=late)]) is None
    short = Flight(one.time[:1], one.pressure[:1], one.controls, one.turned[:1])
    assert flown_hold.found(aircraft(), AXES, [short]) is None


def test_a_hold_serves_at_other_airspeeds_by_dynamic_pressure() -> None:
    made = aircraft()
    told, names = found(flown()), made.control_names
    gains = []
    for airspeed in (18.0, 27.0):
        level = trim.find(made, airspeed, 100.0, float(atmosphere.density(np.array(100.0))))
        linear = holding.linearised(made, level)
        flies = told.on(linear, level, names)
        aileron, elevator = names.index("aileron"), names.index("elevator")
        np.testing.assert_array_equal(flies.gain[elevator], linear.gain[elevator])
        np.testing.assert_array_equal(flies.gain[aileron, :3], 0.0)
        gains.append(flies.gain[aileron, 6] * 0.5 * level.density * airspeed**2)
    assert gains[0] == pytest.approx(gains[1])
    assert gains[0] == pytest.approx(PRESSURE * GAIN["phi"], rel=0.1)


def test_what_pushes_away_is_no_hold() -> None:
    """Nor is an aileron that goes with the roll rate that it makes."""
    made = aircraft()
    level = trim.find(made, 20.0, 100.0, float(atmosphere.density(np.array(100.0))))
    linear = holding.linearised(made, level)
    one = found(flown()).answers["aileron"]
    for name in ("p", "phi"):
        gain = one.gain.copy()
        gain[flown_hold.TURNED.index(name)] *= -1.0
        away = FlownHold(PRESSURE, {"aileron": one._replace(gain=gain)})
        np.testing.assert_array_equal(away.on(linear, level, made.control_names).gain, linear.gain)


def test_a_flight_full_of_test_inputs_tells_no_hold() -> None:
    """Controls and motion go together there, by the aircraft and not by its autopilot."""
    one = flown(pulses=56, size=0.1)
    made = aircraft()
    level = trim.find(made, 20.0, 100.0, float(atmosphere.density(np.array(100.0))))
    linear = holding.linearised(made, level)
    assert found(one).answers["aileron"].told
    assert not found(one).flies(linear, made.control_names)


def test_the_made_up_aircraft_is_held_by_what_its_model_says() -> None:
    assert axes.found(aircraft(), model()).roll == "aileron"
