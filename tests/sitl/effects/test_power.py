"""Thrust: how much, where it acts, what its stream does."""

from __future__ import annotations

import math

import pytest

from tests.sitl.effects import hidden
from tests.sitl.effects.test_surfaces import share_of


def test_a_tired_engine_pulls_less():
    _, before = hidden.at_start(hidden.flight())
    state, after = hidden.at_start(hidden.hide("thrust_scale", ratio=0.75))
    assert after == pytest.approx(0.75 * before)
    assert after > 0.0
    assert state.force_x - state.CX * state.qbar * 0.3097 == pytest.approx(after)


def test_thrust_below_the_centre_of_gravity_pitches_up():
    before, thrust = hidden.at_start(hidden.flight())
    after, _ = hidden.at_start(hidden.hide("thrust_offset", z=0.04))
    assert after.q_dot - before.q_dot == pytest.approx(0.04 * thrust / 0.08636, rel=1e-6)


def test_thrust_tilted_up_lifts():
    before, thrust = hidden.at_start(hidden.flight())
    after, _ = hidden.at_start(hidden.hide("thrust_offset", tilt=0.1))
    assert after.force_z - before.force_z == pytest.approx(-thrust * math.sin(0.1), rel=1e-6)
    assert after.force_x - before.force_x == pytest.approx(thrust * (math.cos(0.1) - 1.0))


def test_torque_rolls_by_thrust_and_span():
    before, thrust = hidden.at_start(hidden.flight())
    after, _ = hidden.at_start(hidden.hide("thrust_offset", torque=0.02))
    rolling = (after.Cl - before.Cl) * after.qbar * 0.3097 * 1.27
    assert rolling == pytest.approx(0.02 * thrust * 1.27, rel=1e-6)
    assert after.p_dot > before.p_dot


def test_the_propellers_stream_makes_the_tail_stronger():
    washed = hidden.hide("propwash", gain=0.6)
    state, thrust = hidden.at_start(washed, throttle=1.0)
    share = 1.0 + 4.0 * 0.6 * thrust / (state.qbar * 0.3097)
    assert share_of(washed, "elevator", "Cm", throttle=1.0) == pytest.approx(share)
    assert share_of(washed, "rudder", "Cn", throttle=1.0) == pytest.approx(share)
    assert share_of(washed, "aileron", "Cl", throttle=1.0) == pytest.approx(1.0)
    # A windmilling propeller takes from it.
    assert share_of(washed, "elevator", "Cm", throttle=0.0) < 1.0
