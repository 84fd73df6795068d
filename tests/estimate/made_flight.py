"""Eight seconds of flight made with the model's own equations, every noise at its stated size.

Such a flight proves the algebra of an estimator and nothing about aircraft.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft, CoefficientModel, Control, Geometry, Mass, Servo, Value
from gcs_sysid.estimate import intensities, settling
from gcs_sysid.estimate.flight_rows import Flight, Unknowns
from gcs_sysid.model import aided, aided_linear, aided_step, rigid_body
from gcs_sysid.model.aided import Means, Noise, Row, Sensors, State
from gcs_sysid.model.air import Air, Turbulence
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.model.kinematics import Measurements
from gcs_sysid.reconstruct import aided_smoother
from gcs_sysid.reconstruct.aided_smoother import Beginning

TERMS = {
    "CZ": {"1": -0.25, "alpha": -5.0},
    "CY": {"beta": -0.5},
    "Cl": {"beta": -0.05, "phat": -0.45},
    "Cm": {"alpha": -0.8, "qhat": -12.0, "elevator": -0.9},
    "Cn": {"beta": 0.08, "rhat": -0.15},
}
AIRCRAFT = Aircraft(
    name="made up",
    mass=Mass(2.0, 0.07, 0.09, 0.15),
    geometry=Geometry(0.31, 1.27, 0.25),
    servos=(Servo(2, "elevator", (1000.0, 2000.0), (-0.5, 0.5)),),
    controls=(Control("elevator", {"elevator": 1.0}),),
    aerodynamics={
        name: CoefficientModel({key: Value(value, 0.1) for key, value in terms.items()})
        for name, terms in TERMS.items()
    },
)
MODEL = FlightModel(AIRCRAFT)
"""One for all tests: what is compiled belongs to it."""
STEP, COUNT = 0.02, 400
HOLE = slice(150, 165)
"""Rows without the inertial unit, 0.3 s, where sensors tell at rates of their own."""


@contextmanager
def halved() -> Iterator[None]:
    """The flight in two chunks, searches that begin on half of it: alike, so compiled once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(aided_smoother, "CHUNK", COUNT // 2)
        patch.setattr(intensities, "SAMPLE_ROWS", COUNT // 2)
        patch.setattr(settling, "STRETCH", COUNT // 2)
        yield


def unknowns(scale: float, airspeed_lag: float = 0.0) -> Unknowns:
    """Everything at its true value but the derivatives, which are `scale` times theirs."""
    zero, pair = jnp.zeros(()), jnp.zeros(2)
    lag = jnp.asarray(airspeed_lag)
    sensors = Sensors(jnp.zeros(3), jnp.zeros(3), zero, lag, pair, pair, *[zero] * 6, pair)
    values = rigid_body.parameters(AIRCRAFT).aerodynamics
    scaled = {
        name: {key: scale * value for key, value in terms.items()} for name, terms in values.items()
    }
    noise = Noise(
        Turbulence(
            jnp.log(jnp.full(3, 0.3)),
            jnp.log(jnp.full(3, 51.0)),
            jnp.log(jnp.full(3, 0.02)),
            jnp.log(jnp.full(3, 3.4)),
            jnp.array([0.1, 0.15]),
            jnp.asarray(0.6),
        ),
        force=jnp.log(jnp.asarray(0.02)),
        moment=jnp.log(jnp.full(3, 0.02)),
        attitude_error=jnp.log(jnp.full(2, 0.003)),
        attitude_error_time=jnp.log(jnp.full(2, 20.0)),
        push=jnp.log(jnp.asarray(0.05)),
        velocity_error=jnp.log(jnp.asarray(0.03)),
        velocity_error_time=jnp.log(jnp.asarray(4.0)),
        airspeed_error=jnp.log(jnp.asarray(0.03)),
        gyro_error=jnp.log(jnp.asarray(5e-4)),
        gyro=jnp.log(jnp.asarray(0.004)),
        accelerometer=jnp.log(jnp.asarray(0.1)),
        airspeed=jnp.log(jnp.asarray(0.2)),
        velocity=jnp.log(jnp.full(2, 0.1)),
        attitude=jnp.log(jnp.full(2, 0.001)),
        vanes=jnp.log(jnp.asarray(0.01)),
    )
    return Unknowns(Means(scaled, sensors), noise)


def sharp(known: Noise) -> Noise:
    """With gusts of 2 m/s a metre long, as a simulated autopilot may make them."""
    turbulence = known.turbulence._replace(
        gust=jnp.log(jnp.full(3, 2.0)), gust_length=jnp.log(jnp.full(3, 1.0))
    )
    return known._replace(turbulence=turbulence)


def made_flight(
    airspeed_lag: float = 0.0,
    logs: Noise | None = None,
    *,
    seed: int = 21,
    own_rates: bool = False,
) -> Flight:
    """Eight seconds with elevator inputs, every noise drawn at its stated size.

    Args:
        airspeed_lag: of what is indicated [s].
        logs: logarithms of the intensities; None for those of `unknowns`.
        seed: of the draws.
        own_rates: whether sensors tell at `streams` of their own, or all at every row.
    """
    rng, rng_of_slow = np.random.default_rng(seed), np.random.default_rng(seed + 1)
    means, known = unknowns(1.0, airspeed_lag)
    logs = known if logs is None else logs
    noise = aided_smoother.positive(logs)
    time = STEP * np.arange(COUNT)
    elevator = 0.04 * np.sign(np.sin(2.0 * np.pi * 0.9 * time)) - 0.03
    rows = empty(elevator)
    if own_rates:
        rows = streams(rows, np.random.default_rng(seed + 2))
    white = np.sqrt(np.asarray(aided_linear.measurement_variance(noise)))
    pushes, sampled = [], []
    for _ in range(COUNT):
        # Draws of their own for what came later, so that all else stays as it was.
        others, slow = rng.standard_normal(aided.SIZE - 5), rng_of_slow.standard_normal(4)
        # Nothing pushes what a tube shows.
        pushed = np.insert(others, aided.BLOCKS["tube"].start, 0.0)
        pushes.append(np.concatenate([pushed, slow]))
        sampled.append(white * rng.standard_normal(aided.ROW_COUNT))
    nominal, left = jax.tree.map(np.asarray, _flown(means, noise, rows, np.stack(pushes)))
    # What a perfect sensor would read is what leaves no innovation.
    readings = np.stack(sampled) - left
    shown = frames.multiply(frames.exponential(nominal.attitude_error), nominal.attitude)
    measured = rows.measured._replace(
        airspeed=readings[:, aided.ROWS["airspeed"]],
        velocity=readings[:, aided.ROWS["velocity"]],
        attitude=frames.multiply(
            shown, frames.exponential(white[10:13] * rng.standard_normal((COUNT, 3)))
        ),
    )
    rows = rows._replace(
        gyro=readings[:, aided.ROWS["gyro"]],
        accelerometer=readings[:, aided.ROWS["accelerometer"]],
        measured=measured,
    )
    deviation = jnp.full(aided.SIZE, 0.05)
    first = jax.tree.map(lambda part: part[0], nominal)
    return Flight(rows, nominal, Beginning(first, jnp.diag(deviation**2)))


@jax.jit
def _flown(
    means: Means, noise: Noise, rows: Row, pushes: np.ndarray
) -> tuple[State, Float[jax.Array, "sample row"]]:
    """States at the rows, and the innovations of sensors that read nothing."""
    begun = State(
        frames.quaternion_from_euler(jnp.array([0.0, 0.08, 0.5])),
        jnp.array([15.0, 8.2, 0.0]),
        jnp.zeros(3),
        jnp.array([17.1]),
        Air(*[jnp.zeros(3)] * 4),
        jnp.zeros(3),
        jnp.zeros(1),
        jnp.zeros(3),
        jnp.zeros(1),
        jnp.zeros(3),
    )

    def ahead(now: State, item: tuple[Row, jax.Array]) -> tuple[State, tuple[State, jax.Array]]:
        row, white = item
        moved = aided.advance(AIRCRAFT, means, noise, now, row)
        mechanics = aided_linear.jacobian(AIRCRAFT, means, now, row, 1)
        half = aided_step.half(mechanics, aided_linear.decay(noise), row)
        spread = aided_step.process(half, row, aided_linear.driving(noise))
        size = jnp.sqrt(jnp.diagonal(spread)) + 1e-10
        root = size[:, None] * jnp.linalg.cholesky(
            spread / jnp.outer(size, size) + 1e-9 * jnp.eye(aided.SIZE)
        )
        moved = aided.compose(moved, jnp.where(row.step > 0.0, root @ white, 0.0))
        return moved, (moved, aided.innovation(AIRCRAFT, means, moved, row))

    return jax.lax.scan(ahead, begun, (jax.tree.map(jnp.asarray, rows), pushes))[1]


def streams(rows: Row, rng: np.random.Generator) -> Row:
    """Rows whose sensors tell at rates of their own, as telemetry does.

    Airspeed at every fifth row, velocity at every tenth, by up to 8 ms older or newer than it,
    attitude at every second; and `HOLE` without the inertial unit.
    """
    row = np.arange(COUNT)
    valid = np.stack([row % 5 == 0, row % 10 == 3, row % 2 == 1, row < 0], axis=1)
    age = np.zeros((COUNT, 4))
    age[:, 1] = rng.uniform(-8e-3, 8e-3, COUNT)
    return rows._replace(
        inertial=(row < HOLE.start) | (row >= HOLE.stop),
        measured=rows.measured._replace(valid=valid, age=age),
    )


def empty(elevator: np.ndarray) -> Row:
    """Rows whose sensors all read nothing."""
    controls = np.repeat(elevator[:, None, None], 3, axis=1)
    return Row(
        step=np.where(np.arange(COUNT) > 0, STEP, 0.0),
        controls=controls,
        control_slopes=np.zeros_like(controls),
        control_changes=np.zeros((*controls.shape, 0)),
        settings=np.zeros((COUNT, 3, 0)),
        setting_changes=np.zeros((COUNT, 3, 0, 0)),
        density=np.full(COUNT, 1.2),
        height=np.full(COUNT, 100.0),
        climbed=np.full(COUNT, 0.0),
        passing=np.full(COUNT, 17.0),
        gyro=np.zeros((COUNT, 3)),
        accelerometer=np.zeros((COUNT, 3)),
        inertial=np.ones(COUNT, dtype=bool),
        modelled=np.ones(COUNT, dtype=bool),
        measured=Measurements(
            airspeed=np.zeros((COUNT, 1)),
            velocity=np.zeros((COUNT, 3)),
            attitude=np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (COUNT, 1)),
            vanes=np.zeros((COUNT, 2)),
            valid=np.tile(np.array([True, True, True, False]), (COUNT, 1)),
            age=np.zeros((COUNT, 4)),
        ),
    )
