"""Flights with and without an effect, for the tests of effects."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import numpy as np

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.aircraft_toml.section import Section
from gcs_sysid.sitl.effects import catalogue
from gcs_sysid.sitl.flight import Flight
from gcs_sysid.sitl.jsbsim_aircraft import JsbsimAircraft, Start, State
from gcs_sysid.sitl.link import Link
from gcs_sysid.sitl.plan import Leg
from gcs_sysid.sitl.sensors import Measurement, Noise, Sensors
from tests.sitl import examples

SILENT = Noise(**{field.name: 0.0 for field in dataclasses.fields(Noise)})
START = Start(airspeed=18.0, alpha=0.06)

SIZES: dict[str, dict[str, Any]] = {
    "mass": {"mass_ratio": 1.1},
    "cg_shift": {"cg_x_chord": 0.08},
    "inertia": {"Iyy_ratio": 1.25},
    "airspeed_scale": {"airspeed_scale": -0.1},
    "pitot_lag": {"pitot_lag": 0.2},
    "accelerometer_bias": {"bias_z": 0.4},
    "gyro_scale": {"scale_x": 0.03},
    "imu_misalignment": {"tilt_y": 0.05},
    "imu_position": {"dx": 0.1},
    "vane_bias": {"alpha_bias": 0.03},
    "heading_bias": {"heading_bias": 0.1},
    "time_skew": {"stream": "ATTITUDE", "delay": 0.05},
    "actuator_lag": {"control": "elevator", "time_constant": 0.15},
    "actuator_rate_limit": {"control": "aileron", "rate_limit": 0.8},
    "actuator_backlash": {"control": "aileron", "width": 0.03},
    "surface_effectiveness": {"control": "elevator", "ratio": 0.7},
    "surface_offset": {"control": "aileron", "offset": 0.05},
    "aeroelastic": {"control": "elevator", "loss": -0.3, "qbar_ref": 120.0},
    "thrust_scale": {"ratio": 0.75},
    "thrust_offset": {"z": 0.04, "tilt": 0.03, "torque": 0.02},
    "propwash": {"gain": 0.6},
    "wind_shear": {"gradient": 0.05},
    "drag_increase": {"CX0": -0.02},
    "stall": {"alpha_break": 0.12, "slope_loss": 0.6},
    "asymmetry": {"Cl0": 0.008, "Cn0": -0.002},
    "cross_coupling": {"Cm_beta": 0.2, "Cl_alpha": -0.1},
    "ground_effect": {"lift": 0.3, "drag": 0.5, "moment": 0.1},
    "aero_derivative": {"derivative": "Cm.alpha", "ratio": 0.8},
    "unlisted": {"terms": {"Cn": {"rudder*qhat": 0.5}, "CY": {"alpha^2*beta": -2.0}}},
}
"""One size of every effect."""


def section(name: str, **parameters: Any) -> Section:
    return Section("effect.toml", "", {"name": name, **parameters})


def flight(aircraft: Aircraft | None = None, **parts: Any) -> Flight:
    believed = aircraft or examples.ultra_stick()
    legs = (Leg("level", 2.0, 18.0, 120.0),)
    usual: dict[str, Any] = {"start": START, "noise": SILENT, "link": Link(loss=0.0)}
    return Flight(believed, believed, legs, **(usual | parts))


def hide(name: str, base: Flight | None = None, **parameters: Any) -> Flight:
    """A flight with one effect, of the size in `SIZES` unless given."""
    entry = section(name, **(parameters or SIZES[name]))
    return catalogue.hide(base or flight(), [entry])


def flying(made: Flight, *, height: float | None = None, **more: Any) -> JsbsimAircraft:
    start = made.start if height is None else dataclasses.replace(made.start, height=height)
    return JsbsimAircraft(
        made.flown,
        start=start,
        wind=made.wind,
        feel=made.hidden.feel,
        stall_lag=made.hidden.stall_lag,
        **more,
    )


def at_start(
    made: Flight,
    controls: dict[str, float] | None = None,
    *,
    throttle: float = 0.5,
    height: float | None = None,
) -> tuple[State, float]:
    """State and thrust at the start with the controls held: the state is kept from moving on."""
    aircraft = flying(made, height=height)
    for name in itertools.product(("rate", "position"), ("rotational", "translational")):
        aircraft._fdm[f"simulation/integrator/{'/'.join(name)}"] = 0.0
    held = dict.fromkeys(made.flown.control_names, 0.0) | (controls or {})
    aircraft.advance(held, [throttle] * len(made.flown.propulsion))
    return aircraft.state(), sum(aircraft.thrusts())


def measured(made: Flight, *states: State) -> Measurement:
    """What the sensors say of the last of some states, a period apart."""
    sensors = Sensors(
        made.flown,
        made.noise,
        elevation=20.0,
        generator=np.random.default_rng(1),
        heading_bias=made.hidden.heading_bias,
    )
    found = [sensors.measure(state) for state in states]
    return found[-1]


STILL = State(**{field.name: 0.0 for field in dataclasses.fields(State)})
MOVING = dataclasses.replace(
    STILL,
    u_air=20.0,
    w_air=20.0 * math.tan(0.1),
    v_air=1.0,
    V=20.0,
    density=1.225,
    pressure=1e5,
    temperature=288.0,
    force_x=1.0,
    force_z=-20.0,
    p=0.5,
    q=-0.4,
    r=0.3,
    q_dot=2.0,
    psi=1.0,
)
