"""A rigid body flown in the test itself: the exact motion, and the aerodynamics that made it.

Newton and Euler with full inertia, centre of gravity off the airframe point, a tilted engine off
the centre of gravity and the reaction of its propeller, integrated by SciPy. Nothing of the package
takes part but the plain data it is handed over in.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from gcs_sysid.aircraft import Aircraft, Control, Geometry, Imu, Mass, Propulsion
from gcs_sysid.estimate.coefficients import Thrust
from gcs_sysid.model.kinematics import Noise
from gcs_sysid.reconstruct.rates import AngularMotion
from gcs_sysid.reconstruct.reconstruction import States

GRAVITY = 9.80665
DENSITY = 1.17
THRUST = 4.5  # N
TORQUE = -0.06  # N·m, reaction about the thrust axis

TRUE: Mapping[str, Mapping[str, float]] = {
    "CX": {"1": -0.05, "alpha": 0.2, "elevator": -0.014},
    "CY": {"1": 0.0, "beta": -0.49, "phat": -0.04, "rhat": 0.15, "rudder": 0.19},
    "CZ": {"1": -0.11, "alpha": -4.6, "qhat": -8.1, "elevator": -0.1},
    "Cl": {"1": 0.0, "beta": -0.055, "phat": -0.45, "rhat": 0.11, "aileron": 0.165, "rudder": 0.01},
    "Cm": {"1": -0.028, "alpha": -0.72, "qhat": -13.6, "elevator": -0.85},
    "Cn": {"1": 0.0, "beta": 0.072, "phat": 0.1, "rhat": -0.18, "aileron": -0.05, "rudder": -0.18},
}


def aircraft() -> Aircraft:
    """A small aircraft with nothing in its symmetry plane."""
    return Aircraft(
        name="crooked",
        mass=Mass(
            1.96, 0.0715, 0.0864, 0.1536, 0.014, 0.004, -0.003,
            cg=(-0.012, 0.006, 0.021), mass_sigma=0.01, inertia_sigma=0.05,
        ),
        geometry=Geometry(0.31, 1.27, 0.25),
        imu=Imu(position=(0.08, -0.03, 0.05)),
        controls=tuple(Control(name, {name: 1.0}) for name in ("elevator", "aileron", "rudder")),
        propulsion=(
            Propulsion(
                3, (1000.0, 2000.0), (0.0, 1.0), (10.0, 30.0), ((0.0, 0.0), (10.0, 8.0)),
                axis=(0.99, 0.03, -0.08), position=(0.31, 0.02, -0.04), thrust_sigma=0.1,
            ),
        ),
    )  # fmt: skip


@dataclass(frozen=True)
class Motion:
    """An exact flight: states, controls, thrust, and what the formulas should give."""

    states: States
    angular: AngularMotion
    controls: dict[str, np.ndarray]
    thrust: Thrust
    true: dict[str, np.ndarray]


def deflections(time: np.ndarray | float) -> dict[str, np.ndarray]:
    """Smooth inputs on all three controls [rad], none at a multiple of another's frequency."""
    return {
        "elevator": -0.015 + 0.06 * np.sin(5.1 * time) * np.sin(0.7 * time),
        "aileron": 0.05 * np.sin(7.3 * time) * np.sin(0.9 * time + 1.0),
        "rudder": 0.06 * np.sin(3.7 * time + 0.5) * np.sin(0.5 * time + 0.3),
    }


def _engine(plane: Aircraft) -> tuple[np.ndarray, np.ndarray]:
    """Thrust [N] and its moment about the centre of gravity [N·m]."""
    engine = plane.propulsion[0]
    axis = np.array(engine.axis) / np.linalg.norm(engine.axis)
    lever = np.array(engine.position) - np.array(plane.mass.cg)
    return THRUST * axis, np.cross(lever, THRUST * axis) + TORQUE * axis


def _flow(plane: Aircraft, velocity: np.ndarray, rate: np.ndarray) -> dict[str, float]:
    speed = float(np.linalg.norm(velocity))
    span, chord = plane.geometry.wing_span, plane.geometry.mean_chord
    return {
        "1": 1.0,
        "V": speed,
        "alpha": np.arctan2(velocity[2], velocity[0]),
        "beta": np.arcsin(velocity[1] / speed),
        "phat": rate[0] * span / (2 * speed),
        "qhat": rate[1] * chord / (2 * speed),
        "rhat": rate[2] * span / (2 * speed),
    }


def _derivative(
    plane: Aircraft, time: float, state: np.ndarray
) -> tuple[np.ndarray, dict[str, float]]:
    """Time derivative of (velocity, rate, attitude matrix rows), and the coefficients."""
    velocity, rate, attitude = state[:3], state[3:6], state[6:].reshape(3, 3)
    flow = _flow(plane, velocity, rate) | {k: float(v) for k, v in deflections(time).items()}
    coefficients = {
        name: sum(value * flow[key] for key, value in terms.items()) for name, terms in TRUE.items()
    }
    shape = plane.geometry
    push = 0.5 * DENSITY * flow["V"] ** 2 * shape.wing_area
    force = push * np.array([coefficients[name] for name in ("CX", "CY", "CZ")])
    about_point = push * np.array(
        [
            coefficients["Cl"] * shape.wing_span,
            coefficients["Cm"] * shape.mean_chord,
            coefficients["Cn"] * shape.wing_span,
        ]
    )
    thrust, thrust_moment = _engine(plane)
    # The point of reference is at −cg from the centre of gravity.
    moment = about_point + np.cross(-np.array(plane.mass.cg), force) + thrust_moment
    inertia = plane.mass.inertia
    specific = (force + thrust) / plane.mass.mass
    turn = np.linalg.solve(inertia, moment - np.cross(rate, inertia @ rate))
    down = attitude.T @ np.array([0.0, 0.0, GRAVITY])
    skew = np.array([[0, -rate[2], rate[1]], [rate[2], 0, -rate[0]], [-rate[1], rate[0], 0]])
    moved = specific + down - np.cross(rate, velocity)
    return np.concatenate([moved, turn, (attitude @ skew).ravel()]), coefficients


def fly(*, rate_hz: float = 100.0, length: float = 12.0) -> Motion:
    """Flies the crooked aircraft on its inputs and says what an ideal inertial unit saw."""
    plane = aircraft()
    time = np.arange(round(rate_hz * length)) / rate_hz
    start = np.concatenate([[17.0, 0.1, 0.9], np.zeros(3), np.eye(3).ravel()])
    answer = solve_ivp(
        lambda t, y: _derivative(plane, t, y)[0],
        (0.0, time[-1]), start, method="DOP853", t_eval=time, rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    rows = [_derivative(plane, t, y) for t, y in zip(time, answer.y.T, strict=True)]
    rate = answer.y[3:6].T
    acceleration = np.array([row[0][3:6] for row in rows])
    flow = [_flow(plane, y[:3], y[3:6]) for y in answer.y.T]
    force = np.array(
        [
            row[0][:3] + np.cross(y[3:6], y[:3]) - y[6:].reshape(3, 3).T @ [0.0, 0.0, GRAVITY]
            for row, y in zip(rows, answer.y.T, strict=True)
        ]
    )
    lever = np.array(plane.imu.position) - np.array(plane.mass.cg)
    force = force + np.cross(acceleration, lever) + np.cross(rate, np.cross(rate, lever))
    push, moment = _engine(plane)
    count = time.size
    return Motion(
        states=states(
            time,
            rate,
            force,
            {name: np.array([item[name] for item in flow]) for name in ("V", "alpha", "beta")},
            lever=lever,
        ),
        angular=exact(rate, acceleration),
        controls={name: np.asarray(value) for name, value in deflections(time).items()},
        thrust=Thrust(np.tile(push, (count, 1)), np.tile(moment, (count, 1)), 0.1),
        true={name: np.array([row[1][name] for row in rows]) for name in TRUE},
    )


def exact(rate: np.ndarray, acceleration: np.ndarray) -> AngularMotion:
    """Angular motion that went through no smoother."""
    return AngularMotion(rate, acceleration, np.full(rate.shape, 0.1), np.full(3, 0.001), 1e6)


def states(
    time: np.ndarray,
    rate: np.ndarray,
    force: np.ndarray,
    flow: Mapping[str, np.ndarray],
    *,
    lever: np.ndarray,
    flow_sigma: tuple[float, float, float] = (0.0, 0.0, 0.0),
    gust: float = 0.0,
) -> States:
    """What a reconstruction would be if it knew these states."""
    count = time.size
    return States(
        time=time,
        noise=Noise(
            gyro=np.array(0.002),
            accelerometer=np.array(0.05),
            gyro_change=np.array(0.1),
            accelerometer_change=np.array(1.0),
            accelerometer_drift=np.array(1e-3),
            gyro_drift=np.array(1e-5),
            wind_drift=np.full(3, 0.05),
            gust=np.full(3, gust),
            gust_time=np.array(3.0),
            attitude_error=np.zeros(3),
            attitude_error_time=np.array(20.0),
            measured=np.ones(9),
        ),
        airspeed=flow["V"],
        alpha=flow["alpha"],
        beta=flow["beta"],
        flow_covariance=np.tile(np.diag(np.square(flow_sigma)), (count, 1, 1)),
        rate=rate,
        force=force,
        lever=lever,
        density=np.full(count, DENSITY),
        height=np.full(count, 100.0),
    )
