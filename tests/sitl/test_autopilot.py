"""The autopilot: its outputs mean what it commands, and it flies any aircraft file."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from gcs_sysid.aircraft import Control
from gcs_sysid.errors import UsageError
from gcs_sysid.sitl import plan
from gcs_sysid.sitl.autopilot import Mixer, neutral
from gcs_sysid.sitl.inputs import THROTTLE
from gcs_sysid.sitl.servo import interpolate
from gcs_sysid.sitl.slopes import slopes
from tests.sitl import examples


def test_pulses_give_the_controls_that_were_commanded():
    aircraft = examples.ultra_stick()
    commands = {"elevator": -0.1, "aileron": 0.05, "rudder": 0.2, THROTTLE: 0.4}
    pulses = Mixer(aircraft).pulses(commands)
    surfaces = {
        servo.surface: interpolate(float(pulses[servo.channel]), servo.pwm, servo.deflection)
        for servo in aircraft.servos
    }
    assert surfaces["aileron_left"] == pytest.approx(-surfaces["aileron_right"])
    for control in aircraft.controls:
        found = sum(gain * surfaces[name] for name, gain in control.mix.items())
        # Half a pulse of 1 µs is 0.00044 rad.
        assert found == pytest.approx(commands[control.name], abs=5e-4)
    assert pulses[3] == 1400


def test_outputs_stay_inside_their_calibration():
    pulses = Mixer(examples.ultra_stick()).pulses({"elevator": 9.0, "rudder": -9.0, THROTTLE: 3.0})
    assert (pulses[2], pulses[4], pulses[3]) == (2000, 1000, 2000)


def test_neutral_is_where_nothing_is_deflected():
    servo = dataclasses.replace(
        examples.servo(1, "s"), pwm=(1900.0, 1600.0, 1100.0), deflection=(-0.3, 0.1, 0.5)
    )
    assert neutral(servo) == 1675


def test_slopes_of_the_published_linear_model():
    """A[p,p] = -16.09, A[q,q] = -15.81 1/s at 17 m/s: UASLab/OpenFlightAnalysis, US25e_Lin.py.

    Its mass properties and density are not all known: 10 %. Its Cm_q leaves the alpha-dot term out.
    """
    found = slopes(examples.ultra_stick(), 17.0)
    assert found.roll_damping == pytest.approx(-16.09, rel=0.1)
    assert found.pitch_damping == pytest.approx(-15.81, rel=0.1)
    assert (found.pitch_name, found.roll_name, found.yaw_name) == ("elevator", "aileron", "rudder")


def test_the_standard_flight_is_planned_inside_the_envelope():
    aircraft = examples.ultra_stick()
    envelope = aircraft.envelope
    assert envelope is not None
    legs = plan.standard(aircraft)
    assert 240.0 < sum(leg.duration for leg in legs) < 300.0
    assert len({leg.airspeed for leg in legs}) == 3
    for leg in legs:
        assert envelope.airspeed[0] < leg.airspeed < envelope.airspeed[1]
        assert leg.height > envelope.height_min
        assert leg.bank < envelope.bank
        assert all(test.start + test.duration <= leg.duration for test in leg.inputs)
    flown = {test.control for leg in legs for test in leg.inputs}
    assert flown == {"elevator", "aileron", "rudder", THROTTLE}


def test_inputs_flown_together_share_no_line():
    for leg in plan.standard(examples.ultra_stick()):
        lines = [line for test in leg.inputs for line in test.lines]
        assert len(lines) == len(set(lines))


def test_without_an_envelope_the_standard_flight_is_refused():
    with pytest.raises(UsageError, match=r"\[envelope\]"):
        plan.standard(dataclasses.replace(examples.ultra_stick(), envelope=None))


def test_without_a_control_in_roll_it_says_so():
    aircraft = examples.plain({"Cm": examples.terms(elevator=-1.0)})
    with pytest.raises(UsageError, match="Cl"):
        slopes(aircraft, 20.0)


def test_elevons_are_mixed():
    aircraft = dataclasses.replace(
        examples.plain({}),
        servos=(examples.servo(1, "elevon_left"), examples.servo(2, "elevon_right")),
        controls=(
            Control("elevator", {"elevon_left": 0.5, "elevon_right": 0.5}),
            Control("aileron", {"elevon_left": 0.5, "elevon_right": -0.5}),
        ),
    )
    pulses = Mixer(aircraft).pulses({"elevator": 0.1, "aileron": 0.05, THROTTLE: 0.0})
    deflections = [(pulses[channel] - 1500) / 1000 for channel in (1, 2)]
    assert np.allclose(deflections, [0.15, 0.05], atol=5e-4)
    assert math.isclose(sum(deflections) / 2, 0.1, abs_tol=5e-4)
