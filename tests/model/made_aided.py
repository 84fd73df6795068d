"""An aircraft, a state and a row for the flight model of the aided filter."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp

from gcs_sysid import frames
from gcs_sysid.aircraft import (
    Aircraft,
    CoefficientModel,
    Control,
    Geometry,
    Imu,
    Mass,
    Pitot,
    Propulsion,
    Servo,
    Value,
    Vanes,
)
from gcs_sysid.model import departures, rigid_body
from gcs_sysid.model.aided import Means, Noise, Row, Sensors, State
from gcs_sysid.model.air import Air, Turbulence
from gcs_sysid.model.departures import Departures
from gcs_sysid.model.kinematics import Measurements

STONE = Aircraft(
    name="a stone with an elevator",
    mass=Mass(11.0, 0.82, 1.13, 1.76, Ixz=0.12, cg=(0.03, 0.0, 0.01)),
    geometry=Geometry(0.55, 2.9, 0.19),
    imu=Imu(position=(0.13, 0.02, -0.05)),
    pitot=Pitot(position=(0.5, -0.3, 0.0)),
    servos=(Servo(2, "elevator", (1000.0, 2000.0), (-0.5, 0.5)),),
    controls=(Control("elevator", {"elevator": 1.0}),),
)
TERMS = {
    "CZ": {"1": -0.2, "alpha": -5.0},
    "Cm": {"alpha": -1.5, "qhat": -20.0, "elevator": -1.0},
    "Cl": {"phat": -0.4},
}
FLYING = replace(
    STONE,
    aerodynamics={
        name: CoefficientModel({key: Value(value, 0.1) for key, value in terms.items()})
        for name, terms in TERMS.items()
    },
)
NOISE = Noise(
    Turbulence(
        gust=jnp.array([1.0, 1.5, 2.0]),
        gust_length=jnp.full(3, 20.0),
        spin=jnp.array([0.05, 0.07, 0.1]),
        spin_length=jnp.full(3, 20.0),
        coupling=jnp.array([0.2, 0.3]),
        azimuth=jnp.asarray(0.4),
    ),
    *(jnp.asarray(0.1), jnp.full(3, 0.1), jnp.full(2, 0.01), jnp.array([20.0, 40.0])),
    *(jnp.asarray(0.1), jnp.asarray(0.05), jnp.asarray(4.0), jnp.asarray(0.03)),
    jnp.asarray(1e-3),
    *(jnp.asarray(0.01), jnp.asarray(0.1), jnp.asarray(0.3)),
    *(jnp.full(2, 0.1), jnp.full(2, 0.001), jnp.asarray(0.01)),
)


def means(aircraft: Aircraft) -> Means:
    zero, pair = jnp.zeros(()), jnp.zeros(2)
    sensors = Sensors(jnp.zeros(3), jnp.zeros(3), zero, zero, pair, pair, *[zero] * 6, pair)
    return Means(rigid_body.parameters(aircraft).aerodynamics, sensors)


def state() -> State:
    return State(
        attitude=frames.quaternion_from_euler(jnp.array([0.2, 0.1, -2.0])),
        velocity=jnp.array([-9.0, -20.0, 1.0]),
        rate=jnp.array([0.3, -0.2, 0.1]),
        tube=jnp.array([21.0]),
        air=Air(
            jnp.array([2.0, -1.0, 0.1]),
            jnp.array([0.5, 0.3, -0.8]),
            jnp.array([0.05, 0.02, 0.0]),
            jnp.array([0.2, -0.1, 0.4]),
        ),
        attitude_error=jnp.array([0.005, -0.003, 0.01]),
        push=jnp.array([0.2]),
        velocity_error=jnp.array([0.05, -0.02, 0.03]),
        airspeed_error=jnp.array([0.15]),
        gyro_error=jnp.array([0.001, -0.002, 0.0015]),
    )


SPEED = 20.0
"""At which gusts are passed [m/s]."""


def row(step: float) -> Row:
    return Row(
        step=jnp.asarray(step),
        controls=jnp.full((3, 1), -0.03),
        control_slopes=jnp.zeros((3, 1)),
        control_changes=jnp.zeros((3, 1, 0)),
        settings=jnp.zeros((3, 0)),
        setting_changes=jnp.zeros((3, 0, 0)),
        density=jnp.asarray(1.2),
        height=jnp.asarray(100.0),
        climbed=jnp.asarray(0.0),
        passing=jnp.asarray(SPEED),
        gyro=jnp.zeros(3),
        accelerometer=jnp.zeros(3),
        inertial=jnp.asarray(True),
        modelled=jnp.asarray(True),
        measured=Measurements(
            airspeed=jnp.zeros(1),
            velocity=jnp.zeros(3),
            attitude=jnp.array([1.0, 0.0, 0.0, 0.0]),
            vanes=jnp.zeros(2),
            valid=jnp.array([True, True, True, False]),
            age=jnp.zeros(4),
        ),
    )


VANED = replace(FLYING, vanes=Vanes(position=(0.7, -0.9, 0.05)))
"""Vanes on a boom ahead of the left wing."""
WHOLE = replace(
    VANED,
    propulsion=(
        Propulsion(
            throttle_channel=3,
            pwm=(1000.0, 2000.0),
            throttle=(0.0, 0.4, 1.0),
            airspeed=(10.0, 30.0),
            thrust=((0.0, -2.0), (12.0, 5.0), (40.0, 22.0)),
            torque=((0.0, 0.0), (-0.2, -0.1), (-0.7, -0.4)),
            axis=(1.0, 0.0, -0.05),
            position=(0.6, 0.02, -0.04),
        ),
    ),
)
"""With an engine too."""


def with_vanes(sample: Row) -> Row:
    """The row with what vanes tell."""
    seen = sample.measured
    return sample._replace(
        measured=seen._replace(vanes=jnp.array([0.05, -0.02]), valid=jnp.full(4, True))
    )


def whole_row(step: float) -> Row:
    """A row of `WHOLE`: every sensor tells something, and two things about actuators may differ."""
    return with_vanes(row(step))._replace(
        controls=jnp.array([[-0.03], [-0.02], [0.0]]),
        control_slopes=jnp.array([[0.4], [0.6], [0.5]]),
        control_changes=jnp.array([[[0.02, -0.01]], [[0.03, 0.01]], [[0.01, 0.02]]]),
        settings=jnp.array([[0.6], [0.62], [0.65]]),
        setting_changes=jnp.array([[[0.1, 0.3]], [[0.2, 0.1]], [[0.1, 0.2]]]),
        climbed=jnp.asarray(40.0),
        gyro=jnp.array([0.2, -0.1, 0.1]),
        accelerometer=jnp.array([0.5, 0.3, -9.0]),
    )


def departed() -> Departures:
    """Everything but the aerodynamics is otherwise than `WHOLE` says."""
    return departures.none(WHOLE, 2)._replace(
        mass=jnp.asarray(0.05),
        inertia=jnp.array([0.1, -0.08, 0.06]),
        cg=jnp.asarray(0.02),
        thrust=jnp.asarray(-0.1),
        thrust_drop=jnp.asarray(0.03),
        thrust_tilt=jnp.asarray(0.04),
        offset=jnp.array([0.015]),
        actuators=jnp.array([0.3, -0.2]),
        gyro_scale=jnp.array([0.01, -0.02, 0.03]),
        imu_tilt=jnp.array([0.03, -0.02, 0.05]),
        imu_position=jnp.array([0.02, -0.01, 0.03]),
        heading=jnp.asarray(0.06),
        shear=jnp.asarray(0.02),
    )


def erring() -> Sensors:
    """Errors of all sensors."""
    return Sensors(
        gyro_bias=jnp.array([0.01, -0.02, 0.005]),
        accelerometer_bias=jnp.array([0.1, -0.2, 0.05]),
        airspeed_scale=jnp.asarray(0.03),
        airspeed_lag=jnp.asarray(0.08),
        vane_bias=jnp.array([0.02, -0.01]),
        vane_scale=jnp.array([0.1, -0.05]),
        surface_delay=jnp.asarray(0.01),
        moment_lag=jnp.asarray(0.004),
        airspeed_delay=jnp.asarray(0.05),
        velocity_delay=jnp.asarray(0.1),
        attitude_delay=jnp.asarray(0.02),
        vane_delay=jnp.asarray(0.03),
        attitude_tilt=jnp.array([0.01, -0.006]),
    )
