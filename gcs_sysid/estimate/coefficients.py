"""Measured aerodynamic coefficients: what the equations of motion leave to the air.

With f the specific force at the inertial unit, ω the rate, r the unit's lever arm from the centre
of gravity and r_cg that from the airframe point to which the moments refer (Klein & Morelli 2006,
eqs. 5.100–5.101, extended by the lever arms and the full inertia tensor):

    a_cg = f − ω̇ × r − ω × (ω × r)          X, Y, Z = m a_cg − T
    M_cg = I ω̇ + ω × I ω − Σ (r_T − r_cg) × T + Q        M = M_cg + r_cg × (X, Y, Z)
    CX = X / (q̄ S), …,  Cl = L / (q̄ S b),  Cm = M / (q̄ S c̄),  Cn = N / (q̄ S b)

T is thrust and Q the reaction of propeller torque. Errors of two kinds are kept apart: noise, new
at every sample, and scale errors of mass, inertia and thrust, the same for the whole flight.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from gcs_sysid import frames
from gcs_sysid.aircraft import COEFFICIENTS, Aircraft
from gcs_sysid.reconstruct import rates
from gcs_sysid.reconstruct.rates import AngularMotion
from gcs_sysid.reconstruct.reconstruction import States


@dataclass(frozen=True)
class Thrust:
    """Thrust of all engines on the samples of a flight, body axes.

    Attributes:
        force: sum of thrusts [N].
        moment: of the thrusts about the centre of gravity, torque reaction included [N·m].
        sigma: relative standard deviation, a scale error common to the flight.
    """

    force: Float[np.ndarray, "sample axis"]
    moment: Float[np.ndarray, "sample axis"]
    sigma: float


@dataclass(frozen=True)
class Samples:
    """One flight's measured coefficients with the flow and the controls they belong to.

    Attributes:
        time: s after the recording's epoch.
        qbar: dynamic pressure [Pa].
        regressors: every variable that a regressor may use, by name, dimensionless or rad.
        regressor_variance: variance of the regressors that are themselves uncertain: flow angles as
            the reconstruction knows them, rates by the gust's own rotation.
        measured: CX…Cn.
        noise: one standard deviation of each, new at every sample.
        mass_part: what a relative error of one in mass (forces) or inertia (moments) adds to it.
        thrust_part: what a relative error of one in thrust adds.
        smoothing: ratio of the smoother that the moments went through, see `rates`.
        refused: coefficients that this flight cannot give, with the reason.
        regressor_lasting: variance of the part of the flow angles' errors that lasts all flight
            and is not in `regressor_variance`: what the model is unsure of, where states come
            from a filter that holds one.
    """

    time: Float[np.ndarray, " sample"]
    qbar: Float[np.ndarray, " sample"]
    regressors: Mapping[str, Float[np.ndarray, " sample"]]
    regressor_variance: Mapping[str, Float[np.ndarray, " sample"]]
    measured: Mapping[str, Float[np.ndarray, " sample"]]
    noise: Mapping[str, Float[np.ndarray, " sample"]]
    mass_part: Mapping[str, Float[np.ndarray, " sample"]]
    thrust_part: Mapping[str, Float[np.ndarray, " sample"]]
    smoothing: float
    refused: Mapping[str, str]
    regressor_lasting: Mapping[str, Float[np.ndarray, " sample"]] = field(default_factory=dict)


def measure(
    states: States,
    aircraft: Aircraft,
    *,
    controls: Mapping[str, Float[np.ndarray, " sample"]],
    thrust: Thrust,
    refused: Mapping[str, str],
    motion: AngularMotion | None = None,
) -> Samples:
    """Coefficients at every sample of a reconstructed flight.

    Args:
        states: the flight's, reconstructed.
        aircraft: mass properties and reference geometry.
        controls: deflections as the air feels them [rad], delays already taken off.
        thrust: of the aircraft file, on the same samples.
        refused: coefficients not to be computed, with the reason.
        motion: angular motion where it is known already; None finds it in the flight.
    """
    if motion is None:
        motion = rates.angular_motion(states.time, states.rate)
    speed = states.airspeed
    qbar = 0.5 * states.density * speed**2
    loads = _loads(states, aircraft, motion, thrust)
    scale = _reference(aircraft, qbar)
    total = loads.aerodynamic / scale
    noise = np.concatenate(
        [
            np.full(motion.rate.shape, aircraft.mass.mass * states.noise.accelerometer),
            np.abs(np.diagonal(aircraft.mass.inertia)) * motion.acceleration_deviation,
        ],
        axis=1,
    ) / np.abs(scale)
    relative = 2.0 * np.sqrt(states.flow_covariance[:, 0, 0]) / speed
    noise = np.hypot(noise, np.abs(total) * relative[:, None])
    kept = [name for name in COEFFICIENTS if name not in refused]
    column = {name: index for index, name in enumerate(COEFFICIENTS)}
    mass_part, thrust_part = loads.inertial / scale, -loads.thrust / scale
    return Samples(
        time=states.time,
        qbar=qbar,
        regressors=regressor_values(states, aircraft, motion, controls, thrust, qbar),
        regressor_variance=_regressor_variance(states, aircraft),
        measured={name: total[:, column[name]] for name in kept},
        noise={name: noise[:, column[name]] for name in kept},
        mass_part={name: mass_part[:, column[name]] for name in kept},
        thrust_part={name: thrust_part[:, column[name]] for name in kept},
        smoothing=motion.ratio,
        refused=dict(refused),
    )


def _reference(
    aircraft: Aircraft, qbar: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, "sample six"]:
    """q̄S for the forces, q̄S times span, chord, span for the moments."""
    shape = aircraft.geometry
    lengths = np.array([1.0, 1.0, 1.0, shape.wing_span, shape.mean_chord, shape.wing_span])
    return qbar[:, None] * shape.wing_area * lengths


@dataclass(frozen=True)
class _Loads:
    """Forces [N] and moments about the airframe point [N·m], columns X Y Z L M N.

    `aerodynamic` is the whole less the thrust's; `inertial` is the part proportional to mass
    (forces) or to inertia (moments).
    """

    aerodynamic: Float[np.ndarray, "sample six"]
    inertial: Float[np.ndarray, "sample six"]
    thrust: Float[np.ndarray, "sample six"]


def _loads(states: States, aircraft: Aircraft, motion: AngularMotion, thrust: Thrust) -> _Loads:
    rate, acceleration = motion.rate, motion.acceleration
    lever = np.broadcast_to(states.lever, rate.shape)
    specific = states.force - (
        frames.cross(acceleration, lever) + frames.cross(rate, frames.cross(rate, lever))
    )
    push = aircraft.mass.mass * specific
    inertia = aircraft.mass.inertia
    turn = acceleration @ inertia.T + frames.cross(rate, rate @ inertia.T)
    force = push - thrust.force
    offset = np.broadcast_to(np.array(aircraft.mass.cg), force.shape)
    moment = turn - thrust.moment + frames.cross(offset, force)
    about_point = thrust.moment + frames.cross(offset, thrust.force)
    return _Loads(
        aerodynamic=np.concatenate([force, moment], axis=1),
        inertial=np.concatenate([push, turn], axis=1),
        thrust=np.concatenate([thrust.force, about_point], axis=1),
    )


def _regressor_variance(
    states: States, aircraft: Aircraft
) -> dict[str, Float[np.ndarray, " sample"]]:
    """Variance of the regressors as values of what the aerodynamics feel.

    A gust varies over the span and the length of the aircraft, which acts as a rotation that no
    gyro sees; its intensity follows from the gust's, its scale length L and the span b
    (MIL-F-8785C, section 3.7.2): σ_p = 1.9 σ_w/√(L b), σ_q = σ_w √(π/(2 L b)), σ_r = σ_v √(2π/(3 L
    b)).
    """
    noise = states.noise
    speed = states.airspeed
    shape = aircraft.geometry
    scale = float(noise.gust_time) * speed * shape.wing_span
    sideways, vertical = float(noise.gust[1]) ** 2, float(noise.gust[2]) ** 2
    half_span = (shape.wing_span / (2.0 * speed)) ** 2
    half_chord = (shape.mean_chord / (2.0 * speed)) ** 2
    return {
        "alpha": states.flow_covariance[:, 1, 1],
        "beta": states.flow_covariance[:, 2, 2],
        "phat": half_span * 1.9**2 * vertical / scale,
        "qhat": half_chord * np.pi / 2.0 * vertical / scale,
        "rhat": half_span * 2.0 * np.pi / 3.0 * sideways / scale,
    }


def regressor_values(
    states: States,
    aircraft: Aircraft,
    motion: AngularMotion,
    controls: Mapping[str, Float[np.ndarray, " sample"]],
    thrust: Thrust,
    qbar: Float[np.ndarray, " sample"],
) -> dict[str, Float[np.ndarray, " sample"]]:
    """Every variable that a regressor may use (rates made dimensionless; α̇ by the smoother)."""
    speed = states.airspeed
    shape = aircraft.geometry
    alpha_rate = rates.smooth(states.time, states.alpha[:, None], motion.ratio).derivative[:, 0]
    rate = states.rate
    return {
        "alpha": states.alpha,
        "beta": states.beta,
        "phat": rate[:, 0] * shape.wing_span / (2.0 * speed),
        "qhat": rate[:, 1] * shape.mean_chord / (2.0 * speed),
        "rhat": rate[:, 2] * shape.wing_span / (2.0 * speed),
        "alphadot_hat": alpha_rate * shape.mean_chord / (2.0 * speed),
        "Tc": np.sum(thrust.force, axis=1) / (qbar * shape.wing_area),
        "qbar": qbar,
        "h_over_b": states.height / shape.wing_span,
        "V": speed,
        **controls,
    }
