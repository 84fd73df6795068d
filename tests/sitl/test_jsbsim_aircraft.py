"""JSBSim flies what the file says: forces, moments and motion against direct evaluation."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from gcs_sysid.aircraft import Aircraft, Control
from gcs_sysid.errors import UsageError
from gcs_sysid.sitl import units
from gcs_sysid.sitl.jsbsim_aircraft import STEP, JsbsimAircraft, Start, State, Wind
from gcs_sysid.sitl.jsbsim_xml import Fuel
from tests.sitl import examples

# JSBSim's weight of a slug has eight digits; everything else is double precision.
POSITIONS = ("position/rotational", "position/translational")
EXACT = {"rel": 1e-7, "abs": 1e-9}


def interpolated(breakpoints, values, *at):
    held = [min(max(x, b[0]), b[-1]) for x, b in zip(at, breakpoints, strict=True)]
    return float(RegularGridInterpolator(breakpoints, np.array(values))(held)[0])


def expected_coefficients(state: State, controls: dict[str, float], thrust: float) -> list[float]:
    """The coefficients of `examples.everything`, written out by hand."""
    de, da, dr = (controls[name] for name in ("elevator", "aileron", "rudder"))
    alpha, beta = state.alpha, state.beta
    phat = state.p_air * 1.3 / (2.0 * state.V)
    qhat = state.q_air * 0.25 / (2.0 * state.V)
    rhat = state.r_air * 1.3 / (2.0 * state.V)
    tc = thrust / (state.qbar * 0.3)
    drag = interpolated([(0.0, 0.01, 0.05)], [0.0, -0.02, -0.03], beta**2)
    tail = interpolated(
        [(-0.1, 0.0, 0.2), (-0.3, 0.1)], [[0.01, 0.03], [0.02, -0.02], [-0.05, 0.04]], alpha, de
    )
    return [
        -0.04 + 0.2 * alpha + 2.9 * alpha**2 + 0.1 * tc + drag,
        -0.5 * beta - 0.04 * phat + 0.15 * rhat + 0.19 * dr,
        -0.1 - 4.6 * alpha - 8.1 * qhat - 0.1 * de + 1.5 * max(0.0, alpha - 0.02),
        -0.05 * beta - 0.45 * phat + 0.1 * rhat + 0.16 * da - 1e-4 * da * state.qbar,
        -0.03 - 0.7 * alpha - 13.0 * qhat - 0.2 * de * tc + 1e-3 * state.V + tail,
        0.07 * beta
        + 0.1 * phat
        - 0.18 * rhat
        - 0.18 * dr
        + 1e-4 * state.height / 1.3
        + 0.3 * max(0.0, -beta) ** 2,
    ]


def expected_thrust(aircraft: Aircraft, state: State, throttles: list[float]) -> list[float]:
    return [
        interpolated((t.throttle, t.airspeed), t.thrust, x, state.V) * state.density / 1.225
        for t, x in zip(aircraft.propulsion, throttles, strict=True)
    ]


def expected_loads(aircraft: Aircraft, state: State, throttles: list[float]):
    """Force and moment about the centre of gravity [N, N·m], gravity left out."""
    span, chord = aircraft.geometry.wing_span, aircraft.geometry.mean_chord
    scale = state.qbar * aircraft.geometry.wing_area
    cg = np.array(aircraft.mass.cg)
    force = scale * np.array([state.CX, state.CY, state.CZ])
    moment = scale * np.array([span * state.Cl, chord * state.Cm, span * state.Cn])
    moment = moment + np.cross(-cg, force)
    thrusts = expected_thrust(aircraft, state, throttles)
    for thruster, thrust, throttle in zip(aircraft.propulsion, thrusts, throttles, strict=True):
        axis = np.array(thruster.axis) / np.linalg.norm(thruster.axis)
        force = force + thrust * axis
        moment = moment + np.cross(np.array(thruster.position) - cg, thrust * axis)
        if thruster.torque is not None:
            torque = interpolated(
                (thruster.throttle, thruster.airspeed), thruster.torque, throttle, state.V
            )
            moment = moment + torque * state.density / 1.225 * axis
    return force, moment


def close(found, wanted):
    scale = np.max(np.abs(wanted))
    assert np.asarray(found) == pytest.approx(np.asarray(wanted), rel=1e-6, abs=1e-6 * scale)


@pytest.fixture(scope="module")
def flown() -> list[tuple[JsbsimAircraft, State, dict[str, float], list[float]]]:
    """States in turbulence, wind and sideslip, with controls that change all the time."""
    aircraft = JsbsimAircraft(
        examples.everything(),
        start=Start(airspeed=19.0, heading=0.7, alpha=0.07),
        wind=Wind((2.0, -3.0, 0.5), gust=0.8),
        seed=4,
    )
    rng = np.random.default_rng(5)
    found = []
    for _ in range(12):
        for _ in range(8):
            names = ("elevator", "aileron", "rudder")
            controls = dict(zip(names, rng.uniform(-0.2, 0.2, 3).tolist(), strict=True))
            throttles = rng.uniform(0.0, 1.0, 2).tolist()
            aircraft.advance(controls, throttles)
        found.append((aircraft, aircraft.state(), controls, throttles))
        assert aircraft.thrusts() == pytest.approx(
            expected_thrust(aircraft.aircraft, aircraft.state(), throttles), **EXACT
        )
    return found


def test_the_air_has_moved_and_rotated(flown):
    states = [state for _, state, _, _ in flown]
    assert min(abs(s.p_air - s.p) for s in states) > 1e-4
    assert max(abs(s.beta) for s in states) > 0.05
    assert any(s.alpha > 0.02 for s in states)
    assert any(s.beta < 0.0 for s in states)


def test_coefficients_are_those_of_the_file(flown):
    for aircraft, state, controls, throttles in flown:
        thrust = sum(expected_thrust(aircraft.aircraft, state, throttles))
        found = [state.CX, state.CY, state.CZ, state.Cl, state.Cm, state.Cn]
        assert found == pytest.approx(expected_coefficients(state, controls, thrust), **EXACT)


def test_forces_are_those_of_the_file(flown):
    for aircraft, state, _, throttles in flown:
        force, _ = expected_loads(aircraft.aircraft, state, throttles)
        close([state.force_x, state.force_y, state.force_z], force)


def test_angular_acceleration_is_eulers(flown):
    """Signs of lever arms, of all products of inertia, and of the gyroscopic terms."""
    for aircraft, state, _, throttles in flown:
        _, moment = expected_loads(aircraft.aircraft, state, throttles)
        rates = np.array([state.p, state.q, state.r])
        inertia = aircraft.aircraft.mass.inertia
        wanted = np.linalg.solve(inertia, moment - np.cross(rates, inertia @ rates))
        close([state.p_dot, state.q_dot, state.r_dot], wanted)


def test_the_flow_is_velocity_over_ground_less_wind(flown):
    for _, state, _, _ in flown:
        ground = np.array([state.v_north, state.v_east, state.v_down])
        air = ground - [state.wind_north, state.wind_east, state.wind_down]
        assert np.linalg.norm(air) == pytest.approx(state.V, **EXACT)
        assert state.qbar == pytest.approx(0.5 * state.density * state.V**2, **EXACT)
        assert math.atan2(state.w_air, state.u_air) == pytest.approx(state.alpha, **EXACT)
        assert math.asin(state.v_air / state.V) == pytest.approx(state.beta, **EXACT)
        # The body's nose is where heading and pitch say: along it the air comes at u_air.
        nose = [
            math.cos(state.theta) * math.cos(state.psi),
            math.cos(state.theta) * math.sin(state.psi),
            -math.sin(state.theta),
        ]
        assert float(air @ nose) == pytest.approx(state.u_air, **EXACT)


def test_a_body_without_air_forces_falls():
    """Against normal gravity of WGS 84 (Somigliana), less 3.086e-6 /s² times the height."""
    aircraft = JsbsimAircraft(examples.plain({"CX": examples.terms(one=0.0)}))
    start = aircraft.state()
    for _ in range(800):
        aircraft.advance({}, [])
    end = aircraft.state()
    sin2 = math.sin(start.latitude) ** 2
    gravity = 9.7803253359 * (1 + 0.00193185265241 * sin2) / math.sqrt(1 - 0.00669437999014 * sin2)
    gravity -= 3.086e-6 * start.altitude
    # East motion makes weight: 2·Ω·cos(latitude)·v, here none; 2e-5 is left of the height.
    assert end.v_down / end.time == pytest.approx(gravity, rel=1e-4)
    assert start.height - end.height == pytest.approx(0.5 * gravity * end.time**2, rel=1e-3)
    assert end.v_north == pytest.approx(start.v_north, rel=1e-3)
    assert (end.force_x, end.force_y, end.force_z) == (0.0, 0.0, 0.0)


def test_roll_rate_follows_a_ramp_of_the_aileron():
    """p(t) = -2V/b·Clδ/Clp·k·(t - τ·(1 - exp(-t/τ))) for δ = k·t; τ = -4·Ixx/(ρ·V·S·b²·Clp)."""
    lateral = {"Cl": examples.terms(phat=-0.45, aileron=0.16)}
    aircraft = JsbsimAircraft(examples.plain(lateral), start=Start(airspeed=60.0))
    state = aircraft.state()
    slope = 2.0 * state.V / 1.3 * 0.16 / 0.45 * 0.4
    tau = 4.0 * 0.07 / (state.density * state.V * 0.3 * 1.3**2 * 0.45)
    for step in range(1, 61):
        time = step * STEP
        aircraft.advance({"aileron": 0.4 * time}, [])
        if step in (15, 30, 60):
            wanted = slope * (time - tau * (1.0 - math.exp(-time / tau)))
            # Falling for 0.24 s adds 0.1 % of speed.
            assert aircraft.state().p == pytest.approx(wanted, rel=2e-3)


# JSBSim's Python layer answers with numpy.matrix.
@pytest.mark.filterwarnings("ignore:the matrix subclass:PendingDeprecationWarning")
def test_mass_and_inertia_reach_jsbsim_unrounded(flown):
    fdm, mass = flown[0][0]._fdm, flown[0][0].aircraft.mass
    assert fdm["inertia/mass-slugs"] * units.SLUG == pytest.approx(mass.mass, rel=1e-12)
    found = np.asarray(fdm.get_mass_balance().get_J()) * units.SLUG_FOOT2
    assert found == pytest.approx(mass.inertia, rel=1e-12)


def test_turbulence_has_the_specified_intensities():
    """MIL-F-8785C at low altitude, with sigma_p of JSBSim's reference (Yeager 1998, equation 8)."""
    height, speed, gust = 140.0, 20.0, 0.7
    columns = {name: [] for name in ("u", "v", "w", "p")}
    for seed in (1, 2):
        for name, samples in frozen_air(height, speed, gust, seed).items():
            columns[name].append(samples)
    spread = {name: float(np.std(np.concatenate(parts))) for name, parts in columns.items()}
    feet = height / units.FOOT
    horizontal = gust / (0.177 + 0.000823 * feet) ** 0.4
    # 2000 s hold 140 correlation times of u, 280 of v and 570 of w: 6 %, 4 % and 3 % of scatter.
    assert spread["w"] == pytest.approx(gust, rel=0.08)
    assert spread["u"] == pytest.approx(horizontal, rel=0.15)
    assert spread["v"] == pytest.approx(horizontal, rel=0.15)
    assert spread["p"] == pytest.approx(1.9 * gust / math.sqrt(height * 1.3), rel=0.05)


def frozen_air(height: float, speed: float, gust: float, seed: int) -> dict[str, np.ndarray]:
    """Turbulence past an aircraft held in its place, headed along the wind's axis, 1000 s."""
    aircraft = JsbsimAircraft(
        examples.plain({"CX": examples.terms(one=0.0)}),
        start=Start(height=height, elevation=0.0, airspeed=speed),
        wind=Wind(gust=gust),
        seed=seed,
        step=0.02,
    )
    for name in ("rate/rotational", "rate/translational", *POSITIONS):
        aircraft._fdm[f"simulation/integrator/{name}"] = 0.0
    scales = {
        "atmosphere/total-wind-north-fps": units.FOOT,
        "atmosphere/total-wind-east-fps": units.FOOT,
        "atmosphere/total-wind-down-fps": units.FOOT,
        "velocities/p-aero-rad_sec": 1.0,
    }
    found = []
    for _ in range(50_000):
        aircraft._fdm.run()
        found.append([aircraft._fdm[name] for name in scales])
    samples = np.array(found) * list(scales.values())
    return dict(zip("uvwp", samples.T, strict=True))


def test_an_aircraft_without_aerodynamics_is_refused():
    with pytest.raises(UsageError, match=r"`\[aerodynamics\]` is empty"):
        JsbsimAircraft(examples.plain({}))


def test_thrust_over_speed_is_thrust_over_the_throttle_that_makes_it():
    aircraft = examples.everything()
    speeds = (0.0, 3600.0, 9000.0)
    turning = [
        dataclasses.replace(thruster, throttle=(), rpm=speeds, rpm_channel=1 + i)
        for i, thruster in enumerate(aircraft.propulsion)
    ]
    states = []
    for flown in (aircraft, dataclasses.replace(aircraft, propulsion=tuple(turning))):
        jsb = JsbsimAircraft(flown)
        for _ in range(5):
            jsb.advance({}, [0.3, 0.7])
        states.append((jsb.thrusts(), jsb.state()))
    assert states[0] == states[1]
    assert min(states[0][0]) > 1.0


def test_fuel_is_burnt_by_throttle_and_taken_from_the_mass():
    aircraft = examples.everything()
    jsb = JsbsimAircraft(aircraft, fuel=Fuel(mass=0.5, burn=0.1))
    assert jsb.mass() == pytest.approx(2.1, rel=1e-9)
    for _ in range(500):
        jsb.advance({}, [0.4, 0.8])
    # Two seconds at six tenths; JSBSim takes the mass of the step before.
    assert jsb.mass() == pytest.approx(2.1 - 0.12, abs=0.1 * 0.004)
    for _ in range(5000):
        jsb.advance({}, [1.0, 1.0])
    assert jsb.mass() == pytest.approx(1.6, rel=1e-9), "the tank is empty"


def test_a_term_of_a_control_uses_the_control():
    """Names of controls are free text, also where JSBSim has a property of that name."""
    aircraft = examples.plain({"CY": examples.terms(flap_differential=0.2)})
    flap = Control("flap_differential", {"aileron": 1.0})
    jsb = JsbsimAircraft(dataclasses.replace(aircraft, controls=(flap,)))
    jsb.advance({"flap_differential": 0.3}, [])
    assert jsb.state().CY == pytest.approx(0.06, rel=1e-12)
