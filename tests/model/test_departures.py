"""Departures from an aircraft file against the same file written otherwise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid import aircraft_file, frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.model import departures, rigid_body
from gcs_sysid.model.departures import Departures
from gcs_sysid.reconstruct.measurements import known_errors_off

FILE = aircraft_file.load(
    Path(__file__).resolve().parents[2] / "data" / "aircraft" / "ultra_stick_25e.toml"
)
STATE = rigid_body.State(
    position=jnp.array([0.0, 0.0, -80.0]),
    velocity=jnp.array([18.0, 2.0, 1.0]),
    attitude=frames.quaternion_from_euler(jnp.array([0.2, 0.1, 0.4])),
    rate=jnp.array([0.4, -0.3, 0.2]),
)
INPUTS = rigid_body.Inputs(
    controls=dict.fromkeys(FILE.control_names, jnp.asarray(0.05)),
    settings=jnp.array([0.6]),
    wind=jnp.zeros(3),
    gust_rate=jnp.zeros(3),
    density=jnp.asarray(1.1),
)
NONE = departures.none(FILE, 0)


def moved(by: Departures) -> np.ndarray:
    values = departures.body(rigid_body.parameters(FILE), by)
    found = rigid_body.derivative(FILE, values, STATE, INPUTS)
    return np.concatenate([found.velocity, found.rate])


def flown(aircraft: Aircraft) -> np.ndarray:
    found = rigid_body.derivative(aircraft, rigid_body.parameters(aircraft), STATE, INPUTS)
    return np.concatenate([found.velocity, found.rate])


def engines(**changes: object) -> Aircraft:
    return replace(FILE, propulsion=tuple(replace(one, **changes) for one in FILE.propulsion))


def test_none_is_the_file() -> None:
    np.testing.assert_allclose(moved(NONE), flown(FILE), rtol=1e-12)


def test_mass_and_inertia() -> None:
    body = FILE.mass
    other = replace(FILE, mass=replace(body, mass=1.1 * body.mass, Iyy=0.8 * body.Iyy))
    by = NONE._replace(mass=jnp.asarray(0.1), inertia=jnp.array([0.0, -0.2, 0.0]))
    np.testing.assert_allclose(moved(by), flown(other), rtol=1e-12)


def test_centre_of_gravity() -> None:
    x, y, z = FILE.mass.cg
    other = replace(FILE, mass=replace(FILE.mass, cg=(x + 0.02, y, z)))
    np.testing.assert_allclose(moved(NONE._replace(cg=jnp.asarray(0.02))), flown(other), rtol=1e-12)
    np.testing.assert_allclose(
        departures.centre(FILE, NONE._replace(cg=jnp.asarray(0.02))), other.mass.cg
    )


def test_thrust() -> None:
    one = FILE.propulsion[0]
    stronger = tuple(tuple(0.8 * value for value in row) for row in one.thrust)
    by = NONE._replace(thrust=jnp.asarray(-0.2))
    np.testing.assert_allclose(moved(by), flown(engines(thrust=stronger)), rtol=1e-12)
    x, y, z = one.position
    by = NONE._replace(thrust_drop=jnp.asarray(0.05))
    np.testing.assert_allclose(moved(by), flown(engines(position=(x, y, z + 0.05))), rtol=1e-12)


def test_a_thrust_that_points_up_lifts() -> None:
    up = moved(NONE._replace(thrust_tilt=jnp.asarray(0.1))) - moved(NONE)
    force = frames.unrotate(STATE.attitude, jnp.asarray(up[:3]))
    assert force[2] < 0.0
    assert abs(force[0]) < 0.1 * abs(force[2])


def test_shear_blows_along_the_wind_and_grows_with_height() -> None:
    by = NONE._replace(shear=jnp.asarray(0.05))
    wind = jnp.array([3.0, 4.0, 0.0])
    more = departures.sheared(wind, by, jnp.asarray(20.0)) - wind
    # But for 0.24 of 625.24, the fourth powers of a light wind and of this one.
    share = 625.0 / (625.0 + 0.7**4)
    np.testing.assert_allclose(more, [0.6 * share, 0.8 * share, 0.0], rtol=1e-9)


def test_shear_follows_no_direction_that_calm_air_does_not_have() -> None:
    """A filter about a wind that turns with every centimetre a second never came to rest."""
    by, climbed = NONE._replace(shear=jnp.asarray(0.01)), jnp.asarray(50.0)
    turning = jax.jacfwd(lambda wind: departures.sheared(wind, by, climbed) - wind)
    for wind in ([0.0, 0.0, 0.0], [0.003, -0.002, 0.0], [0.4, 0.3, 0.0], [-2.0, 1.0, 0.0]):
        # Of the order of the shear itself: 0.5 m/s over a wind of 0.7 m/s.
        assert np.linalg.norm(turning(jnp.array(wind)), 2) <= 1.3 * 0.5 / departures.LIGHT
    np.testing.assert_array_equal(departures.sheared(jnp.zeros(3), by, climbed), 0.0)
    breath = jnp.array([0.05, 0.0, 0.0])
    assert abs(float((departures.sheared(breath, by, climbed) - breath)[0])) < 1e-4


def test_a_light_wind_grows_nearly_as_much_as_is_said() -> None:
    by = NONE._replace(shear=jnp.asarray(0.05))
    wind = jnp.array([2.0, 0.0, 0.0])
    more = departures.sheared(wind, by, jnp.asarray(20.0)) - wind
    np.testing.assert_allclose(more, [0.985, 0.0, 0.0], atol=5e-4)


def test_a_tilted_unit_sees_a_turned_vector() -> None:
    """As with a file that says so: its own mounting undone gives the vector back."""
    tilt = (0.06, -0.07, 0.05)
    vector = jnp.array([1.0, -2.0, 9.0])
    seen = departures.turned(vector, NONE._replace(imu_tilt=jnp.array(tilt)))
    stated = replace(FILE, imu=replace(FILE.imu, misalignment=tilt))
    _, back = known_errors_off(stated, np.zeros((1, 3)), np.asarray(seen)[None])
    np.testing.assert_allclose(back[0], vector, rtol=1e-12)
    assert np.linalg.norm(np.asarray(seen) - vector) > 0.5


@pytest.mark.parametrize("axis", range(3))
def test_every_moment_of_inertia_by_itself(axis: int) -> None:
    name = ("Ixx", "Iyy", "Izz")[axis]
    other = replace(FILE, mass=replace(FILE.mass, **{name: 1.3 * getattr(FILE.mass, name)}))
    by = NONE._replace(inertia=jnp.zeros(3).at[axis].set(0.3))
    np.testing.assert_allclose(moved(by), flown(other), rtol=1e-12)
