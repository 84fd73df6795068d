"""What an autopilot's commands answered to, from flights of a loop with known gains."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid import atmosphere
from gcs_sysid.maneuvers import flown_hold, holding
from gcs_sysid.maneuvers.axes import Axes
from gcs_sysid.maneuvers.flown_hold import Flight, FlownHold
from gcs_sysid.model import trim
from tests.maneuvers.made_loop import GAIN, PRESSURE, flown
from tests.maneuvers.made_model import aircraft

AXES = Axes("elevator", "aileron", None)


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
    """Least squares over everything would find the roll angle held much less tightly."""
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


def test_an_integral_of_the_pitch_rate_is_part_of_what_the_elevator_answered_to() -> None:
    """It is found with the pitch angle's gain, and must not act once more beside that."""
    rate, attitude, integral, slow = 0.05, 0.1, 0.5, 0.6
    generator = np.random.default_rng(0)
    one = flown()
    surface = q = theta = wound = 0.0
    asked, rows = [0.0, 0.0], []
    for _ in one.time:
        rows.append((q, theta, surface))
        wound += 0.02 * (q + slow * theta)
        asked.append(-(rate * q + attitude * theta + integral * wound))
        surface += (1.0 - np.exp(-0.02 / 0.04)) * (asked[-2] - surface)
        push = 3.0 * generator.standard_normal()
        q, theta = q + 0.02 * (-3.0 * q + 40.0 * surface + push), theta + 0.02 * q
    told = np.array(rows)
    turned = np.zeros((one.time.size, 6))
    turned[:, [1, 4]] = told[:, :2]
    flight = one._replace(turned=turned, controls={**one.controls, "elevator": told[:, 2]})
    answer = found(flight).answers["elevator"]
    assert answer.told
    assert answer.gain[4] == pytest.approx(attitude + integral, rel=0.15)

    made = aircraft()
    level = trim.find(made, 20.0, 100.0, float(atmosphere.density(np.array(100.0))))
    linear = holding.linearised(made, level)
    assert np.any(linear.unwinding != 0.0)
    sign = np.sign(linear.gain[made.control_names.index("elevator"), 7])
    hold = FlownHold(PRESSURE, {"elevator": answer._replace(gain=sign * answer.gain)})
    np.testing.assert_array_equal(hold.on(linear, level, made.control_names).unwinding, 0.0)
    rolls = FlownHold(PRESSURE, {"aileron": found(one).answers["aileron"]})
    kept = rolls.on(linear, level, made.control_names)
    np.testing.assert_array_equal(kept.unwinding, linear.unwinding)
