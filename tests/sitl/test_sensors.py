"""Sensors: where they sit, what is wrong with them, and what their noise is."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from gcs_sysid.aircraft import Aircraft, Imu, Mass, Pitot, SensorError, Vanes
from gcs_sysid.sitl.autopilot import PERIOD
from gcs_sysid.sitl.jsbsim_aircraft import State
from gcs_sysid.sitl.sensors import Measurement, Noise, Sensors
from tests.sitl import examples

SILENT = Noise(**{field.name: 0.0 for field in dataclasses.fields(Noise)})
LEVEL = State(**{field.name: 0.0 for field in dataclasses.fields(State)})
FLYING = dataclasses.replace(
    LEVEL, u_air=20.0, V=20.0, density=1.225, pressure=1e5, temperature=288.0, force_z=-20.0
)


def sensors(aircraft: Aircraft, noise: Noise = SILENT) -> Sensors:
    return Sensors(aircraft, noise, elevation=20.0, generator=np.random.default_rng(1))


def measured(state: State, **parts) -> Measurement:
    return sensors(examples.plain({}, **parts)).measure(state)


def test_perfect_sensors_say_what_is():
    found = measured(dataclasses.replace(FLYING, altitude=150.0, v_north=21.0, psi=0.4))
    assert found.specific_force == (0.0, 0.0, -10.0)
    assert found.indicated_airspeed == pytest.approx(20.0)
    assert (found.altitude, found.height) == (150.0, 130.0)
    assert found.velocity == (21.0, 0.0, 0.0)
    assert found.attitude == (0.0, 0.0, 0.4)
    assert math.isnan(found.alpha)


def test_an_imu_ahead_of_the_centre_of_gravity_feels_it_pitch():
    """At (x, 0, 0): -q²·x along x and -dq/dt·x along z, measured from the centre of gravity."""
    state = dataclasses.replace(FLYING, q=2.0, q_dot=5.0)
    mass = Mass(2.0, 0.07, 0.09, 0.15, cg=(0.1, 0.0, 0.0))
    found = measured(state, imu=Imu(position=(0.4, 0.0, 0.0)), mass=mass)
    assert found.specific_force == pytest.approx((-4.0 * 0.3, 0.0, -10.0 - 5.0 * 0.3))


def test_an_imu_on_the_right_wing_feels_it_roll():
    """At (0, y, 0): -p²·y along y and dp/dt·y along z."""
    state = dataclasses.replace(FLYING, p=2.0, p_dot=5.0)
    found = measured(state, imu=Imu(position=(0.0, 0.3, 0.0)))
    assert found.specific_force == pytest.approx((0.0, -4.0 * 0.3, -10.0 + 5.0 * 0.3))


def test_a_unit_that_is_tilted_sees_other_axes():
    """Rolled to the right by its mounting, it sees a share of the lift from the left."""
    imu = Imu(misalignment=(0.1, 0.0, 0.0))
    found = measured(dataclasses.replace(FLYING, q=1.0), imu=imu)
    assert found.specific_force[1] == pytest.approx(-10.0 * math.sin(0.1))
    assert found.rates == pytest.approx((0.0, math.cos(0.1), -math.sin(0.1)))


def test_bias_and_scale_act_on_each_axis():
    error = SensorError(bias=(0.1, 0.2, 0.3), scale=(0.01, 0.02, 0.03))
    state = dataclasses.replace(FLYING, p=1.0, q=2.0, r=3.0)
    found = measured(state, imu=Imu(gyro=error))
    assert found.rates == pytest.approx((1.11, 2.24, 3.39))


def test_a_lag_is_a_first_order_lag():
    """What rises steadily is shown as it was a lag ago; what jumps comes in by exp(−t/τ)."""
    lagging = sensors(examples.plain({}, pitot=Pitot(error=SensorError(lag=0.1))))
    speeds = 20.0 + 2.0 * PERIOD * np.arange(200)
    rising = [dataclasses.replace(FLYING, u_air=speed, V=speed) for speed in speeds]
    found = [lagging.measure(state).indicated_airspeed for state in rising]
    assert found[-1] == pytest.approx(speeds[-1] - 2.0 * 0.1, abs=1e-6)
    # From the middle of the step in which it rose, but for a second order in it.
    lagging = sensors(examples.plain({}, pitot=Pitot(error=SensorError(lag=0.1))))
    lagging.measure(FLYING)
    faster = dataclasses.replace(FLYING, u_air=30.0, V=30.0)
    found = [lagging.measure(faster).indicated_airspeed for _ in range(5)]
    wanted = [30.0 - 10.0 * math.exp(-PERIOD * (n - 0.5) / 0.1) for n in range(1, 6)]
    assert found == pytest.approx(wanted, abs=10.0 * (PERIOD / 0.1) ** 2 / 24.0)


@pytest.mark.parametrize(("measures", "wanted"), [("EAS", 20.0 * math.sqrt(0.9)), ("TAS", 20.0)])
def test_a_pitot_tube_measures_the_airspeed_of_the_file(measures, wanted):
    state = dataclasses.replace(FLYING, density=0.9 * 1.225)
    found = measured(state, pitot=Pitot(measures=measures))
    assert found.indicated_airspeed == pytest.approx(wanted)
    assert found.dynamic_pressure == pytest.approx(0.5 * 1.225 * wanted**2)


def test_vanes_see_the_flow_where_they_sit():
    """A probe out on the right wing sinks when the aircraft rolls right, so it sees more alpha."""
    vanes = Vanes(position=(0.2, 0.4, 0.0), upwash=0.1, alpha=SensorError(bias=(0.02,)))
    state = dataclasses.replace(FLYING, w_air=1.0, p_air=1.5, q_air=0.5, r_air=2.0)
    found = measured(state, vanes=vanes)
    u, v, w = 20.0 - 2.0 * 0.4, 2.0 * 0.2, 1.0 + 1.5 * 0.4 - 0.5 * 0.2
    assert found.alpha == pytest.approx(1.1 * math.atan2(w, u) + 0.02)
    assert found.beta == pytest.approx(math.atan2(v, math.hypot(u, w)))


def test_noise_is_as_large_as_it_says():
    noise = dataclasses.replace(SILENT, accelerometer=0.1, gyro=0.01, vane=0.02, heading_drift=0.03)
    noisy = sensors(examples.plain({}, vanes=Vanes()), noise)
    found = [noisy.measure(FLYING) for _ in range(3000)]
    forces = np.array([m.specific_force for m in found])
    rates = np.array([m.rates for m in found])
    # 3000 samples know a standard deviation to 1.3 %.
    assert forces.std(axis=0) == pytest.approx(0.1, rel=0.05)
    assert rates.std(axis=0) == pytest.approx(0.01, rel=0.05)
    assert np.std([m.alpha for m in found]) == pytest.approx(0.02, rel=0.05)
    heading = np.array([m.attitude[2] for m in found])
    assert np.abs(np.diff(heading)).max() < 0.005, "drift, not noise"
    assert 0.005 < np.abs(heading).max() < 0.12
