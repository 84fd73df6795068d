"""The rigid body held to motions with closed solutions, and to the measured coefficients' algebra.

Tolerances are those of the scheme: fourth order in the step.
"""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid import frames
from gcs_sysid.aircraft import (
    Aircraft,
    CoefficientModel,
    Control,
    Geometry,
    Mass,
    Propulsion,
    Value,
)
from gcs_sysid.atmosphere import GRAVITY, SEA_LEVEL_DENSITY
from gcs_sysid.model import rigid_body
from gcs_sysid.model.rigid_body import Inputs, State

BODY = Mass(11.0, 0.82, 1.13, 1.76, Ixz=0.12, Ixy=0.05, Iyz=-0.04, cg=(0.03, 0.0, 0.01))
STILL = Aircraft(name="a stone", mass=BODY, geometry=Geometry(0.55, 2.9, 0.19))


def inputs(count: int, *, wind: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Inputs:
    return Inputs(
        controls={},
        settings=jnp.zeros((count, 0)),
        wind=jnp.tile(jnp.array(wind), (count, 1)),
        gust_rate=jnp.zeros((count, 3)),
        density=jnp.full(count, 1.225),
    )


def state(velocity: list[float], rate: list[float], euler: list[float]) -> State:
    return State(
        position=jnp.array([0.0, 0.0, -100.0]),
        velocity=jnp.array(velocity),
        attitude=frames.quaternion_from_euler(jnp.array(euler)),
        rate=jnp.array(rate),
    )


def flown(aircraft: Aircraft, start: State, given: Inputs, time: np.ndarray) -> State:
    values = rigid_body.parameters(aircraft)
    return jax.jit(lambda: rigid_body.propagate(aircraft, values, start, given, jnp.array(time)))()


def test_without_moments_energy_and_angular_momentum_of_the_rotation_stay() -> None:
    time = np.arange(501) * 0.01
    path = flown(
        STILL, state([20.0, 1.0, 0.0], [2.0, 3.0, -1.0], [0.3, 0.2, 1.0]), inputs(501), time
    )
    inertia = BODY.inertia
    momentum = np.asarray(path.rate) @ inertia.T
    energy = np.sum(np.asarray(path.rate) * momentum, axis=1)
    inertial = np.asarray(frames.rotate(path.attitude, jnp.asarray(momentum)))
    assert np.ptp(path.rate, axis=0).min() > 1.0
    np.testing.assert_allclose(energy, energy[0], rtol=1e-7)
    np.testing.assert_allclose(
        inertial,
        np.broadcast_to(inertial[0], inertial.shape),
        atol=1e-7 * np.abs(inertial[0]).max(),
    )


def test_without_air_forces_the_centre_of_gravity_flies_a_parabola() -> None:
    time = np.linspace(0.0, 4.0, 41)
    path = flown(
        STILL, state([20.0, -3.0, -15.0], [1.0, 2.0, 0.5], [0.0, 0.0, 0.0]), inputs(41), time
    )
    expected = np.array([0.0, 0.0, -100.0]) + np.outer(time, [20.0, -3.0, -15.0])
    expected[:, 2] += 0.5 * GRAVITY * time**2
    np.testing.assert_allclose(path.position, expected, atol=1e-10)


def turning(radius_rate: float, bank: float, speed: float) -> tuple[Aircraft, State]:
    """An aircraft whose constant coefficients hold a level turn, and a state in that turn.

    Level turn at rate Ω: ω = Ω (−sin θ, cos θ sin φ, cos θ cos φ), here at θ = 0 with the flow
    along the body x axis, so that the force needed is m (R^T (a − g)).
    """
    body = replace(BODY, cg=(0.0, 0.0, 0.0))
    rate = radius_rate * np.array([0.0, np.sin(bank), np.cos(bank)])
    start = state([speed, 0.0, 0.0], list(rate), [bank, 0.0, 0.0])
    acceleration = np.array([0.0, speed * radius_rate, -GRAVITY])
    force = body.mass * np.asarray(frames.unrotate(start.attitude, jnp.asarray(acceleration)))
    moment = np.cross(rate, body.inertia @ rate)
    scale = 0.5 * 1.225 * speed**2 * 0.55
    values = np.concatenate([force / scale, moment / (scale * np.array([2.9, 0.19, 2.9]))])
    names = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
    models = {
        name: CoefficientModel({"1": Value(float(value), 0.0)})
        for name, value in zip(names, values, strict=True)
    }
    return replace(STILL, mass=body, aerodynamics=models), start


def test_a_steady_turn_stays_one_in_any_wind() -> None:
    speed, bank = 22.0, np.radians(40.0)
    rate = GRAVITY * np.tan(bank) / speed
    aircraft, start = turning(rate, bank, speed)
    time = np.arange(1001) * 0.02
    wind = np.array([5.0, -3.0, 0.5])
    given = inputs(1001, wind=(5.0, -3.0, 0.5))
    path = flown(aircraft, start._replace(velocity=start.velocity + wind), given, time)
    euler = np.asarray(frames.euler_from_quaternion(path.attitude))
    np.testing.assert_allclose(euler[:, 0], bank, atol=1e-6)
    np.testing.assert_allclose(euler[:, 1], 0.0, atol=1e-6)
    np.testing.assert_allclose(np.unwrap(euler[:, 2]), rate * time, atol=1e-5)
    circle = np.asarray(path.position) - np.outer(time, wind) - np.array([0.0, 0.0, -100.0])
    expected = speed / rate * np.stack([np.sin(rate * time), 1.0 - np.cos(rate * time)], axis=1)
    np.testing.assert_allclose(circle[:, :2], expected, atol=1e-3)


def test_the_scheme_is_of_fourth_order() -> None:
    start = state([20.0, 1.0, 0.0], [6.0, 3.0, -1.0], [0.3, 0.2, 1.0])

    def end(steps: int) -> np.ndarray:
        time = np.linspace(0.0, 1.0, steps + 1)
        return np.asarray(flown(STILL, start, inputs(steps + 1), time).rate[-1])

    exact = end(1600)
    coarse, fine = (np.linalg.norm(end(steps) - exact) for steps in (20, 40))
    assert np.log2(coarse / fine) == pytest.approx(4.0, abs=0.3)


def propelled() -> Aircraft:
    engine = Propulsion(
        3,
        (1000.0, 2000.0),
        (0.0, 1.0),
        (10.0, 30.0),
        ((0.0, 0.0), (40.0, 20.0)),
        position=(0.4, 0.1, -0.2),
        torque=((0.0, 0.0), (-0.8, -0.6)),
    )
    terms = {
        "CX": {"1": -0.03, "alpha^2": 1.5},
        "CZ": {"1": -0.1, "alpha": -5.0, "elevator": -0.4},
        "Cl": {"beta": -0.1, "phat": -0.5},
        "Cm": {"alpha": -1.2, "qhat": -20.0, "elevator": -1.0, "elevator*Tc": 0.3},
        "Cn": {"rhat": -0.1},
    }
    models = {
        name: CoefficientModel({key: Value(value, 0.1) for key, value in entry.items()})
        for name, entry in terms.items()
    }
    return replace(
        STILL,
        controls=(Control("elevator", {"elevator": 1.0}),),
        propulsion=(engine,),
        aerodynamics=models,
    )


def acting() -> tuple[State, Inputs]:
    start = state([21.0, 2.0, 1.0], [0.4, -0.3, 0.2], [0.2, 0.1, 0.3])
    given = Inputs(
        controls={"elevator": jnp.array(-0.07)},
        settings=jnp.array([0.6]),
        wind=jnp.array([1.0, -2.0, 0.3]),
        gust_rate=jnp.array([0.05, 0.0, -0.02]),
        density=jnp.array(1.1),
    )
    return start, given


def test_moments_are_taken_from_the_airframe_point_to_the_centre_of_gravity() -> None:
    """Against the sums written out by hand for one state."""
    aircraft = propelled()
    start, given = acting()
    found = rigid_body.loads(aircraft, rigid_body.parameters(aircraft), start, given)
    through = np.asarray(frames.unrotate(start.attitude, start.velocity - given.wind))
    speed = np.linalg.norm(through)
    alpha, beta = np.arctan2(through[2], through[0]), np.arcsin(through[1] / speed)
    pressure = 0.5 * 1.1 * speed**2
    # Throttle 0.6 between 0 and 40 to 20 N over 10 to 30 m/s, and as dense as the air.
    thrust = 0.6 * (40.0 - (speed - 10.0)) * 1.1 / SEA_LEVEL_DENSITY
    torque = 0.6 * (-0.8 + 0.01 * (speed - 10.0)) * 1.1 / SEA_LEVEL_DENSITY
    tc = thrust / (pressure * 0.55)
    felt = np.asarray(start.rate - given.gust_rate)
    phat, rhat = felt[0] * 2.9 / (2 * speed), felt[2] * 2.9 / (2 * speed)
    qhat = felt[1] * 0.19 / (2 * speed)
    force = (
        pressure * 0.55 * np.array([-0.03 + 1.5 * alpha**2, 0.0, -0.1 - 5.0 * alpha - 0.4 * -0.07])
    )
    point = (
        pressure
        * 0.55
        * np.array(
            [
                2.9 * (-0.1 * beta - 0.5 * phat),
                0.19 * (-1.2 * alpha - 20.0 * qhat + 0.07 - 0.07 * 0.3 * tc),
                2.9 * -0.1 * rhat,
            ]
        )
    )
    cg = np.array(BODY.cg)
    push = np.array([thrust, 0.0, 0.0])
    moment = point - np.cross(cg, force) + np.cross(np.array([0.4, 0.1, -0.2]) - cg, push)
    moment[0] += torque
    np.testing.assert_allclose(found.force, force + push, rtol=1e-12)
    np.testing.assert_allclose(found.moment, moment, rtol=1e-12)


def test_derivatives_with_respect_to_parameters_are_those_of_finite_differences() -> None:
    aircraft = propelled()
    start, given = acting()

    def rate(mass: jax.Array, slope: jax.Array) -> jax.Array:
        values = rigid_body.parameters(aircraft)
        cm = {**values.aerodynamics["Cm"], "alpha": slope}
        changed = values._replace(mass=mass, aerodynamics={**values.aerodynamics, "Cm": cm})
        change = rigid_body.derivative(aircraft, changed, start, given)
        return jnp.concatenate([change.velocity, change.rate])

    mass, slope = jnp.array(11.0), jnp.array(-1.2)
    exact = jax.jacfwd(rate, argnums=(0, 1))(mass, slope)
    for index in range(2):
        step = np.zeros(2)
        step[index] = 1e-5
        difference = (
            rate(mass + step[0], slope + step[1]) - rate(mass - step[0], slope - step[1])
        ) / 2e-5
        np.testing.assert_allclose(exact[index], difference, rtol=1e-6, atol=1e-6)
