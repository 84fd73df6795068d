"""Controls worked out together: against JSBSim's own equations of motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.sitl.autopilot import Sensed, autopilot
from gcs_sysid.sitl.coupling import coupling, is_coupled
from gcs_sysid.sitl.inputs import THROTTLE
from gcs_sysid.sitl.jsbsim_aircraft import JsbsimAircraft, Start
from gcs_sysid.sitl.pilot import Pilot
from gcs_sysid.sitl.plan import Leg
from gcs_sysid.sitl.slopes import slopes, trim
from tests.sitl import examples

NAMES = ("aileron", "elevator", "rudder")
AIRSPEED = 70.0


@pytest.fixture(scope="module")
def swept():
    return aircraft_file.load(examples.ROOT / "data" / "aircraft" / "ad1_60.toml")


def accelerations(aircraft, controls, *, alpha=0.0):
    """Angular accelerations in level flight through still air [rad/s²], and the true airspeed."""
    start = Start(airspeed=AIRSPEED, alpha=alpha, elevation=0.0, height=60.0)
    flying = JsbsimAircraft(aircraft, start=start)
    flying.advance(dict.fromkeys(aircraft.control_names, 0.0) | controls, [0.0, 0.0])
    state = flying.state()
    return np.array([state.p_dot, state.q_dot, state.r_dot]), state


def test_controls_accelerate_as_demanded(swept):
    """At zero angle of attack; the rest of the acceleration is that of no control at all."""
    nothing, state = accelerations(swept, {})
    found = coupling(swept, state.V, NAMES, state.density)
    for wanted in np.eye(3) * 0.2:
        controls = found.controls(tuple(wanted.tolist()), (0.0, 0.0, 0.0))
        with_them, _ = accelerations(swept, controls)
        # One step of 4 ms has moved the aircraft a little.
        assert with_them - nothing == pytest.approx(wanted, abs=2e-3)


def test_without_a_rudder_roll_and_pitch_are_met_and_yaw_is_left_alone(swept):
    found = coupling(swept, AIRSPEED, NAMES[:2], 1.225)
    controls = found.controls((0.3, -0.2, 9.0), (0.0, 0.0, 0.0))
    assert found.accelerations(controls)[:2] == pytest.approx([0.3, -0.2])


def test_in_balance_nothing_turns(swept):
    level = trim(swept, AIRSPEED)
    turning, _ = accelerations(
        swept,
        {"elevator": level.control, **level.others},
        alpha=level.alpha,
    )
    # The aileron alone would roll it by 3 rad/s²; idle engines pitch it by 0.005 rad/s².
    assert turning == pytest.approx([0.0, 0.0, 0.0], abs=0.03)


def test_the_side_force_is_carried_by_the_bank(swept):
    level = trim(swept, AIRSPEED)
    assert 0.02 < level.bank < 0.2
    _, state = accelerations(
        swept,
        {"elevator": level.control, **level.others},
        alpha=level.alpha,
    )
    weight_aside = swept.mass.mass * 9.81 * math.sin(level.bank)
    # CY of a step's flow against that of the trim.
    assert state.force_y == pytest.approx(-weight_aside, rel=0.03)


def test_the_rates_of_other_axes_are_met(swept):
    """Rolling pitches it by Cm_phat, and by the roll's share through Ixy."""
    found = coupling(swept, AIRSPEED, NAMES, 1.225)
    rate = 0.5
    geometry = swept.geometry
    force = 0.5 * 1.225 * AIRSPEED**2 * geometry.wing_area
    phat = rate * geometry.wing_span / (2.0 * AIRSPEED)
    aerodynamics = swept.aerodynamics
    moment = force * np.array(
        [
            length * aerodynamics[name].terms["phat"].value * phat
            for name, length in (
                ("Cl", geometry.wing_span),
                ("Cm", geometry.mean_chord),
                ("Cn", geometry.wing_span),
            )
        ]
    )
    turning = np.linalg.solve(swept.mass.inertia, moment)
    turning[0] = 0.0  # its own axis is left to the rate loop
    controls = found.controls((0.0, 0.0, 0.0), (rate, 0.0, 0.0))
    assert found.accelerations(controls) == pytest.approx(-turning, rel=1e-9)


def test_an_aircraft_with_a_plane_of_symmetry_is_not_coupled(swept):
    assert is_coupled(swept, NAMES)
    assert not is_coupled(examples.ultra_stick(), NAMES)
    assert slopes(examples.ultra_stick(), 17.0).coupling is None
    assert trim(examples.ultra_stick(), 17.0).bank == 0.0


def test_sticks_let_go_leave_the_surfaces_on_trim(swept):
    level = trim(swept, AIRSPEED)
    commands = Pilot(swept, AIRSPEED).direct(pitch=0.0, roll=0.0, yaw=0.0, throttle=0.5)
    wanted = {"elevator": level.control, **level.others, THROTTLE: 0.5}
    assert commands == pytest.approx(wanted)


def test_on_its_trim_the_autopilot_commands_the_trim(swept):
    level = trim(swept, AIRSPEED)
    pilot = autopilot(swept, AIRSPEED)
    sensed = Sensed(level.bank, level.alpha, 0.3, 0.0, 0.0, 0.0, AIRSPEED, 120.0, 0.0)
    leg = Leg("on trim", 1.0, AIRSPEED, 120.0, 0.3)
    commands, _ = pilot.command(pilot.settled(level), sensed, leg)
    # Beside the small pitch rate of a banked turn that it does not fly.
    assert commands["elevator"] == pytest.approx(level.control, abs=2e-3)
    assert commands["aileron"] == pytest.approx(level.others["aileron"], abs=5e-3)
    assert commands["rudder"] == pytest.approx(level.others["rudder"], abs=2e-3)
