"""What a file predicts, against the rigid body's own equations with the same thing wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft, CoefficientModel, TableTerm, Value
from gcs_sysid.diagnose import extended, motion
from gcs_sysid.diagnose.motion import Motion
from gcs_sysid.model import rigid_body
from gcs_sysid.model.rigid_body import Inputs, State
from tests.offline.made_aircraft import small

COUNT = 5
IMU = np.array([0.05, 0.02, -0.03])


def believed() -> Aircraft:
    """Every coefficient, a table, an offset centre of gravity."""
    made = small()
    table = TableTerm("wash", ("alpha",), ((-0.1, 0.0, 0.2),), (0.0, 0.02, -0.05), 0.2)
    models = {
        **made.aerodynamics,
        "CX": CoefficientModel({"1": Value(-0.04, 0.004)}, (table,)),
        "CY": CoefficientModel({"beta": Value(-0.9, 0.09)}),
    }
    return replace(made, aerodynamics=models, mass=replace(made.mass, cg=(0.02, 0.0, 0.01)))


def flown(true: Aircraft, file: Aircraft, *, indicated: float = 1.0) -> Motion:
    """What sensors without noise give of an aircraft that is not the file's.

    Controls are what the file makes of them; `indicated` over true airspeed is in the airspeed.
    """
    random = np.random.default_rng(3)
    speed, alpha, beta = 20.0 + random.random(COUNT), 0.05 + 0.1 * random.random(COUNT), 0.05
    rate = random.standard_normal((COUNT, 3)) * 0.5
    through = speed[:, None] * np.stack(
        [np.cos(alpha) * np.cos(beta), np.full(COUNT, np.sin(beta)), np.sin(alpha) * np.cos(beta)],
        1,
    )
    controls = {
        name: jnp.asarray(0.1 * random.standard_normal(COUNT)) for name in file.control_names
    }
    throttle = 0.3 + 0.5 * random.random((COUNT, 1))
    states = State(
        position=jnp.zeros((COUNT, 3)),
        velocity=jnp.asarray(through),
        attitude=jnp.tile(jnp.array([1.0, 0.0, 0.0, 0.0]), (COUNT, 1)),
        rate=jnp.asarray(rate),
    )
    given = Inputs(
        controls,
        jnp.asarray(throttle),
        jnp.zeros((COUNT, 3)),
        jnp.zeros((COUNT, 3)),
        jnp.full(COUNT, 1.2),
    )
    values = rigid_body.parameters(true)
    change = jax.vmap(lambda one, acting: rigid_body.derivative(true, values, one, acting))(
        states, given
    )
    force = np.asarray(change.velocity) - np.array([0.0, 0.0, rigid_body.GRAVITY])
    turning = np.asarray(change.rate)
    lever = np.broadcast_to(IMU - np.array(true.mass.cg), rate.shape)
    force = force + frames.cross(turning, lever) + frames.cross(rate, frames.cross(rate, lever))
    bare = replace(file, aerodynamics={}, mass=replace(file.mass, cg=(0.0, 0.0, 0.0)))
    pushed = jax.vmap(
        lambda one, acting: rigid_body.loads(bare, rigid_body.parameters(bare), one, acting)
    )(states, given)
    return Motion(
        airspeed=jnp.asarray(speed * indicated),
        alpha=jnp.asarray(alpha),
        beta=jnp.full(COUNT, beta),
        alpha_rate=jnp.zeros(COUNT),
        rate=jnp.asarray(rate),
        acceleration=jnp.asarray(turning),
        force=jnp.asarray(force),
        lever=jnp.asarray(IMU - np.array(file.mass.cg)),
        thrust=pushed.force,
        thrust_moment=pushed.moment,
        density=jnp.full(COUNT, 1.2),
        height=jnp.zeros(COUNT),
        controls=controls,
        control_rates={name: jnp.zeros(COUNT) for name in controls},
        airspeed_scale=jnp.asarray(0.0),
    )


def left(file: Aircraft, seen: Motion, wrong: dict[str, float]) -> np.ndarray:
    every = motion.nothing(file, seen) | {name: jnp.asarray(value) for name, value in wrong.items()}
    return np.asarray(motion.measured(file, seen) - motion.predicted(file, every, seen))


def heavier(file: Aircraft) -> Aircraft:
    return replace(file, mass=replace(file.mass, mass=1.1 * file.mass.mass))


def forward(file: Aircraft) -> Aircraft:
    x, y, z = file.mass.cg
    return replace(file, mass=replace(file.mass, cg=(x + 0.08 * file.geometry.mean_chord, y, z)))


def stiffer(file: Aircraft) -> Aircraft:
    return replace(file, mass=replace(file.mass, Iyy=1.2 * file.mass.Iyy))


def weaker(file: Aircraft) -> Aircraft:
    """An elevator of 70 % effect is elevator derivatives of 70 %."""
    models = {
        name: replace(
            model,
            terms={
                key: replace(item, value=item.value * (0.7 if key == "elevator" else 1.0))
                for key, item in model.terms.items()
            },
        )
        for name, model in file.aerodynamics.items()
    }
    return replace(file, aerodynamics=models)


def lighter_tail(file: Aircraft) -> Aircraft:
    """Two of its sigmas more of one derivative, one more of a table."""
    cm, cx = file.aerodynamics["Cm"], file.aerodynamics["CX"]
    item = cm.terms["alpha"]
    moved = {**cm.terms, "alpha": replace(item, value=item.value + 2.0 * item.sigma)}
    table = cx.tables[0]
    scaled = replace(table, values=tuple(1.2 * value for value in table.values))
    models = {
        **file.aerodynamics,
        "Cm": replace(cm, terms=moved),
        "CX": replace(cx, tables=(scaled,)),
    }
    return replace(file, aerodynamics=models)


CASES: list[tuple[Callable[[Aircraft], Aircraft], dict[str, float]]] = [
    (lambda file: file, {}),
    (heavier, {"mass": 0.1}),
    (forward, {"cg.x": 0.08}),
    (stiffer, {"inertia.y": 0.2}),
    (weaker, {"effectiveness.elevator": -0.3}),
    (lighter_tail, {"Cm.alpha": 2.0, "CX.wash": 1.0}),
]


@pytest.mark.parametrize(("make", "wrong"), CASES, ids=["file", *(str([*w]) for _, w in CASES[1:])])
def test_what_is_wrong_explains_the_motion_and_nothing_else_does(make, wrong) -> None:
    file = believed()
    seen = flown(make(file), file)
    np.testing.assert_allclose(left(file, seen, wrong), 0.0, atol=1e-10)
    if wrong:
        assert np.abs(left(file, seen, {})).max() > 1e-3


def test_an_airspeed_that_reads_too_much() -> None:
    file = believed()
    seen = flown(file, file, indicated=1.08)
    np.testing.assert_allclose(left(file, seen, {"airspeed": 0.08}), 0.0, atol=1e-10)
    assert np.abs(left(file, seen, {})).max() > 1e-3
    # Taken off already, and nothing is left to be wrong.
    corrected = seen._replace(airspeed=seen.airspeed / 1.08, airspeed_scale=jnp.asarray(0.08))
    np.testing.assert_allclose(left(file, corrected, {}), 0.0, atol=1e-10)


@pytest.mark.parametrize(("make", "wrong"), CASES[1:3] + CASES[4:5])
def test_the_file_put_right_is_the_aircraft_that_flew(make, wrong) -> None:
    file = believed()
    put_right = extended.corrected(file, {name: (value, 0.01) for name, value in wrong.items()})
    true = make(file)
    if "effectiveness.elevator" in wrong:
        servo = next(item for item in put_right.servos if item.surface == "elevator")
        assert servo.effectiveness == pytest.approx(0.7)
        return
    np.testing.assert_allclose(put_right.mass.cg, true.mass.cg)
    assert put_right.mass.mass == pytest.approx(true.mass.mass)
