"""What innovations tell by frequency, beside what the filter says of the very same flight."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid import atmosphere, regressors
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate import basis, innovation_spectrum, traces
from gcs_sysid.estimate.innovation_spectrum import GROUPS, Spectrum
from gcs_sysid.model import aided, rigid_body, trim
from gcs_sysid.model.aided import Means, Noise, Row, State
from gcs_sysid.model.air import Air
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.model.kinematics import Measurements
from gcs_sysid.model.trim import Trim
from gcs_sysid.reconstruct import causal
from gcs_sysid.reconstruct.aided_smoother import Beginning
from tests.estimate.made_sensing import EVERY, STEP, sensing
from tests.maneuvers import made_model

COUNT = 3600
MOVED = slice(2600, 3200)
"""Rows in which surfaces move, once the filter has settled."""


class Case(NamedTuple):
    """A flight in calm air, and what both say of it."""

    names: list[tuple[str, str]]
    by_filter: np.ndarray
    by_spectrum: np.ndarray


def level(aircraft: Aircraft) -> Trim:
    height = 100.0
    return trim.find(aircraft, 22.0, height, float(atmosphere.density(np.array(height))))


def inputs(count: int) -> np.ndarray:
    """Of the three surfaces [rad]: smooth pulses both ways, so small that the answer is linear."""
    time = STEP * np.arange(count)
    window = np.sin(np.pi * np.arange(count) / count) ** 2
    return np.stack(
        [
            0.05 * window * np.sin(2.0 * np.pi * 0.9 * time),
            0.02 * window * np.sin(2.0 * np.pi * 1.3 * time),
            0.06 * window * np.sin(2.0 * np.pi * 0.6 * time),
        ],
        axis=1,
    )


def rows(at: Trim, *, moving: bool, vanes: bool = False) -> Row:
    time = np.arange(COUNT)
    surfaces = np.tile(np.asarray(at.controls), (COUNT, 1))
    if moving:
        surfaces[MOVED] += inputs(MOVED.stop - MOVED.start)
    slopes = -np.gradient(surfaces, STEP, axis=0)
    seen = time % 2 == 1 if vanes else time < 0
    valid = np.stack([*(time % one == 0 for one in EVERY), seen], axis=1)
    none = np.zeros((COUNT, 3))
    return Row(
        step=np.where(time > 0, STEP, 0.0),
        controls=np.repeat(surfaces[:, None], 3, axis=1),
        control_slopes=np.repeat(slopes[:, None], 3, axis=1),
        control_changes=np.zeros((COUNT, 3, 3, 0)),
        settings=np.tile(np.asarray(at.settings), (COUNT, 3, 1)),
        setting_changes=np.zeros((COUNT, 3, len(at.settings), 0)),
        density=np.full(COUNT, at.density),
        height=np.full(COUNT, 100.0),
        climbed=np.zeros(COUNT),
        passing=np.full(COUNT, at.airspeed),
        gyro=none,
        accelerometer=none,
        inertial=np.ones(COUNT, dtype=bool),
        modelled=np.ones(COUNT, dtype=bool),
        measured=Measurements(
            airspeed=np.full((COUNT, 1), at.airspeed),
            velocity=none,
            attitude=np.tile(np.asarray(at.state.attitude), (COUNT, 1)),
            vanes=np.zeros((COUNT, 2)),
            valid=valid,
            age=np.zeros((COUNT, len(GROUPS))),
        ),
    )


def begun(at: Trim) -> State:
    none = np.zeros(3)
    return State(
        *(np.asarray(at.state.attitude), np.asarray(at.state.velocity), none),
        *(np.array([at.airspeed]), Air(*[none] * 4), none, np.zeros(1), none, np.zeros(1), none),
    )


@partial(jax.jit, static_argnums=0)
def flown(model: FlightModel, means: Means, noise: Noise, first: State, row: Row) -> State:
    def ahead(now: State, one: Row) -> tuple[State, State]:
        moved = aided.advance(model.aircraft, means, noise, now, one)
        return moved, moved

    return jax.lax.scan(ahead, first, row)[1]


def variables(aircraft: Aircraft, means: Means, states: State, row: Row) -> dict[str, np.ndarray]:
    """Of the motion, by the filter's own equations."""
    one = jax.jit(jax.vmap(lambda at, seen: aided.flow(aircraft, means, at, seen, 2)))
    found = {name: np.asarray(value) for name, value in one(states, row).items()}
    found = {name: np.broadcast_to(value, COUNT) for name, value in found.items()}
    return found | traces.values(found, aircraft.control_names, STEP * np.arange(COUNT))


@pytest.fixture(scope="module", params=[False, True], ids=["no-vanes", "vanes"])
def cases(request) -> dict[bool, Case]:
    """The same quiet flight without and with moving surfaces."""
    vanes = request.param
    aircraft, sensed = made_model.aircraft(), sensing(vanes=vanes)
    at, fitted = level(aircraft), made_model.model()
    parameters = rigid_body.parameters(aircraft).aerodynamics
    zero = jax.tree.map(lambda part: jnp.zeros(np.shape(part)), sensed.deviation)
    means = jax.tree.map(lambda part: jnp.asarray(part, jnp.float64), Means(parameters, zero))
    noise = jax.tree.map(jnp.asarray, sensed.log_noise)
    heard = innovation_spectrum.spectrum(aircraft, at, sensed, tuple(fitted.fits))
    names = [(name, key) for name, fit in fitted.fits.items() for key in fit.keys]
    model, found = FlightModel(aircraft), {}
    for moving in (False, True):
        flight = rows(at, moving=moving, vanes=vanes)
        row = jax.tree.map(jnp.asarray, flight)
        first = jax.tree.map(lambda part: jnp.asarray(part, jnp.float64), begun(at))
        states = jax.tree.map(np.asarray, flown(model, means, noise, first, row))
        beginning = Beginning(first, jnp.eye(aided.SIZE) * 0.01**2)
        path = causal.along(flight, states, beginning)
        done = causal.passed(model, means, noise, path, np.ones(COUNT, dtype=bool))
        ordered = [(name, key) for name in sorted(parameters) for key in sorted(parameters[name])]
        numbered = ravel_pytree(means)[1](jnp.arange(len(done.told.score), dtype=float)).sensors
        places = [ordered.index(one) for one in names]
        for error in innovation_spectrum.ERRORS:
            places += [int(place) for place in np.ravel(getattr(numbered, error))]
        values = variables(aircraft, means, states, row)
        found[moving] = Case(
            names,
            done.told.matrix[np.ix_(places, places)],
            heard.information(fitted, values, STEP),
        )
    return found


ERRORS = np.array([1e-3] * 3 + [0.01] * 3 + [0.005] + [0.01] * 2 + [0.03] * 2 + [0.002]) ** -2.0
"""Of the sensors, known as well as `sensing` has it."""


def of_derivatives(matrix: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """What is told of the derivatives whatever the errors, and whatever the constants in a file."""
    terms = moving.size
    known = matrix.copy()
    known[terms:, terms:] += np.diag(ERRORS)
    known[:terms, :terms] += np.diag(np.where(moving, 0.0, 1.0))
    own = np.concatenate([moving, np.zeros(ERRORS.size, dtype=bool)])
    across = known[np.ix_(own, ~own)]
    return known[np.ix_(own, own)] - across @ np.linalg.solve(known[np.ix_(~own, ~own)], across.T)


@pytest.mark.slow
def test_it_is_the_information_of_the_filter(cases) -> None:
    """Every derivative, alone and with all that is unknown, in a maneuver of all axes.

    Drag is the exception: what slowly pushes is not known as well after a minute as for ever.
    """
    case = cases[True]
    count = len(case.names)
    alone = [np.diagonal(one)[:count] for one in (case.by_filter, case.by_spectrum)]
    drag = np.array([name == "CX" for name, _ in case.names])
    np.testing.assert_allclose(alone[1][~drag], alone[0][~drag], rtol=0.03)
    np.testing.assert_allclose(alone[1][drag], alone[0][drag], rtol=0.25)
    moving = np.array([key != regressors.CONSTANT for _, key in case.names])
    value = np.array([made_model.TERMS[name][key] for name, key in case.names])[moving]
    file = np.diag((0.1 * value) ** -2.0)
    exact, found = (
        np.sqrt(np.diagonal(np.linalg.inv(file + of_derivatives(one, moving))))
        for one in (case.by_filter, case.by_spectrum)
    )
    assert np.median(exact / np.abs(value)) < 0.07  # the maneuver tells, not the file
    np.testing.assert_allclose(found, exact, rtol=0.1)


@pytest.mark.slow
def test_what_bends_derivatives_looks_like_what_it_looks_like_to_the_filter(cases) -> None:
    """Sign and size of what ties late surfaces, and vanes that show too much, to derivatives."""
    case = cases[True]
    count, vanes = len(case.names), innovation_spectrum.VANE_SCALES
    bending = [count + innovation_spectrum.DELAY]
    if case.by_filter[count + vanes, count + vanes] > 0.0:
        bending += [count + vanes, count + vanes + 1]

    def correlation(matrix: np.ndarray) -> np.ndarray:
        size = np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
        return (matrix / np.outer(size, size))[bending, :count]

    exact, found = map(correlation, (case.by_filter, case.by_spectrum))
    assert np.all(np.abs(exact).max(axis=1) > 0.1)
    np.testing.assert_allclose(found, exact, atol=0.05)


@pytest.mark.slow
def test_level_flight_tells_of_no_change(cases) -> None:
    """What moves with the surfaces is told by their moving alone."""
    still, case = cases[False], cases[True]
    for place, (name, key) in enumerate(case.names):
        if key in ("phat", "qhat", "rhat", "beta", "aileron", "rudder"):
            quiet = still.by_spectrum[place, place]
            assert quiet < 1e-6 * case.by_spectrum[place, place], (name, key)


@pytest.mark.parametrize("count", [400, 401])
def test_where_rows_count_alike_it_is_plain_regression(count: int) -> None:
    """Parseval: Σ x xᵀ/v over samples, errors of airspeed and surfaces among them."""
    fitted, controls = made_model.model(), made_model.aircraft().control_names
    rng, step, variance = np.random.default_rng(3), 0.01, 0.03
    flown = {name: 0.1 * rng.standard_normal(count) for name in (*controls, "alpha", "beta")}
    flown |= {name: 0.01 * rng.standard_normal(count) for name in ("phat", "qhat", "rhat")}
    flown |= {f"{name}_rate": rng.standard_normal(count) for name in controls}
    names = tuple(fitted.fits)
    channels = len(names) + innovation_spectrum.CONSTANTS
    density = np.zeros((3, channels, channels), dtype=complex)
    density[:, : len(names), : len(names)] = np.eye(len(names)) / variance
    heard = Spectrum(
        *(2.0 * step, np.array([0.0, 1.0, 25.0]), density, names, np.ones(12)),
        *(made_model.TERMS, tuple(controls)),
    )
    found = heard.information(fitted, flown, step)
    whole, first = np.zeros_like(found), 0
    for name, fit in fitted.fits.items():
        columns = basis.columns(fit.keys, controls, flown)
        both = np.zeros((count, len(found)))
        both[:, first : first + len(fit.keys)] = columns
        first += len(fit.keys)
        growing = {"1": 2.0, "alpha^2": 0.0}  # and once with all that is linear in the motion
        power = [2.0 if key in controls else growing.get(key, 1.0) for key in fit.keys]
        total = columns @ (np.array(power) * fit.value)
        both[:, -12 + innovation_spectrum.AIRSPEED] = total[0] - total
        late = {key: value for key, value in made_model.TERMS[name].items() if key in controls}
        both[:, -1] = -sum(value * flown[f"{key}_rate"] for key, value in late.items())
        # Rows come half as often as these samples.
        whole += 0.5 * both.T @ both / variance
    np.testing.assert_allclose(found, whole, rtol=1e-4, atol=1e-5 * np.abs(whole).max())


def test_stronger_gusts_are_those_asked_for() -> None:
    asked = sensing().in_gusts(0.9)
    air, before = asked.log_noise.turbulence, sensing().log_noise.turbulence
    np.testing.assert_allclose(np.exp(air.gust), 0.9)
    np.testing.assert_allclose(np.exp(air.spin - before.spin), 3.0)
    np.testing.assert_array_equal(air.gust_length, before.gust_length)
    assert np.all(np.isfinite(sensing().in_gusts(0.0).log_noise.turbulence.gust))


def test_what_is_usual_is_the_mean_of_flights() -> None:
    one = sensing()
    other = one.in_gusts(1.2)._replace(shares=np.ones(4), step=0.04)
    found = innovation_spectrum.usual([one, other])
    np.testing.assert_allclose(np.exp(found.log_noise.turbulence.gust), 0.6)
    np.testing.assert_allclose(found.shares, 0.5 * (one.shares + 1.0))
    assert found.step == pytest.approx(0.03)


def test_what_a_filter_had_to_go_by_is_read_off_its_rows() -> None:
    at = level(made_model.aircraft())
    one = sensing()
    found = innovation_spectrum.sensing(rows(at, moving=False), one.log_noise, one.deviation)
    assert found.step == pytest.approx(STEP)
    np.testing.assert_allclose(found.shares, one.shares, atol=1e-3)
