"""Passes about the filter's own predictions, on a flight made with the model's equations."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid import regressors
from gcs_sysid.estimate import in_common, intensities
from gcs_sysid.estimate.intensities import Prior, Search
from gcs_sysid.model import aided, aided_linear, aided_step, air, departures
from gcs_sysid.model.aided import Means, Noise, Row
from gcs_sysid.reconstruct import aided_smoother, causal, linear_filter
from gcs_sysid.reconstruct.aided_ekf import MEMORY, AidedFilter
from gcs_sysid.reconstruct.aided_smoother import Beginning
from gcs_sysid.reconstruct.causal import More, Pass, Path
from gcs_sysid.reconstruct.linear_filter import Belief
from tests.estimate import made_flight as made

pytestmark = pytest.mark.slow
EVERY = np.ones(made.COUNT, dtype=bool)
LOG_NOISE = made.unknowns(1.0).log_noise
BEGUN = 0.01
"""Of a state that was found before, as one deviation of each of its parts [SI]."""


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(aided_smoother, "CHUNK", made.COUNT)
    monkeypatch.setattr(intensities, "SAMPLE_ROWS", made.COUNT)


@pytest.fixture(scope="module")
def flight() -> made.Flight:
    return made.made_flight()


def settled(
    flight: made.Flight,
    means: Means,
    rounds: int = 4,
    log_noise: Noise = LOG_NOISE,
) -> Path:
    """The path that the filter predicts."""
    path = causal.along(flight.rows, flight.nominal, flight.beginning)
    for _ in range(rounds):
        rows = causal.joined(made.MODEL, means, log_noise, path)
        path, _, _ = causal.filtered(path, rows)
    return path


def passed(path: Path, means: Means, **asked: object) -> Pass:
    return causal.passed(made.MODEL, means, made.unknowns(1.0).log_noise, path, EVERY, **asked)


def test_a_settled_path_is_what_the_filter_predicts(flight) -> None:
    """Its predictions deviate from it by nothing: the extended Kalman filter's fixed point."""
    means = made.unknowns(1.0).means
    path = settled(flight, means, rounds=6)
    rows = causal.joined(made.MODEL, means, made.unknowns(1.0).log_noise, path)
    _, _, steps = causal.filtered(path, rows)
    assert float(jnp.max(jnp.abs(steps[0].predicted.mean))) < 1e-6


def test_a_path_settles_also_in_air_that_turns_within_a_step(flight) -> None:
    """3 cm, of which 34 are passed in a step: Runge–Kutta's own answer to that grows."""
    means, log_noise = made.unknowns(1.0)
    fine = log_noise.turbulence._replace(spin_length=jnp.log(jnp.full(3, 0.03)))
    log_noise = log_noise._replace(turbulence=fine)
    path = settled(flight, means, 6, log_noise)
    _, _, steps = causal.filtered(path, causal.joined(made.MODEL, means, log_noise, path))
    assert float(jnp.max(jnp.abs(steps[0].predicted.mean))) < 1e-5


def test_a_path_settles_in_calm_air_whatever_grows_with_height(flight) -> None:
    """Along its own direction a wind of some cm/s grew otherwise at every row, and none settled."""
    means, log_noise = made.unknowns(1.0)
    by = departures.none(made.AIRCRAFT, 0)._replace(shear=jnp.asarray(0.002))
    means = means._replace(departures=by)
    high = replace(flight, rows=flight.rows._replace(climbed=np.full(made.COUNT, 50.0)))
    path = settled(high, means, 6)
    _, _, steps = causal.filtered(path, causal.joined(made.MODEL, means, log_noise, path))
    assert float(jnp.max(jnp.abs(steps[0].predicted.mean))) < 1e-5


@pytest.mark.parametrize("own_rates", [False, True])
def test_row_by_row_on_filterpy_it_is_the_same_filter(*, own_rates: bool) -> None:
    """Predicted states, whitened innovations and covariances, to 1e-9.

    With every sensor at every row, and with streams of their own, ages and a hole. Covariances in
    units of their deviations: gyros' drift is known to 1e-7 (rad/s)².
    """
    flight = made.made_flight(own_rates=own_rates)
    known = made.unknowns(1.0)
    path = settled(flight, known.means, rounds=12)
    [rows] = causal.joined(made.MODEL, known.means, known.log_noise, path)
    _, done = linear_filter.run(path.start, rows)
    live = started(flight, known.means)
    with pytest.raises(ValueError, match="no row was predicted"):
        live.observe()
    predicted, innovations, spreads, excess = [], [], [], []
    for row in each_row(flight):
        live.predict(row)
        predicted.append(live.state)
        live.observe()
        innovations.append(live.y)
        spreads.append(live.P)
        excess.append(live.excess)
    found = jax.tree.map(lambda *parts: jnp.stack(parts), *predicted)
    off = jax.vmap(aided.difference)(found, path.chunks[0].after)
    assert float(jnp.max(jnp.abs(off))) < 1e-9
    whitened = np.einsum("kij,kj->ki", done.root, innovations)
    np.testing.assert_allclose(whitened, done.whitened, rtol=0, atol=1e-7)
    other, unit = np.stack(spreads), units(np.stack(spreads))
    np.testing.assert_allclose(done.updated.covariance / unit, other / unit, rtol=0, atol=1e-9)
    # Of MEMORY rows with six to twelve measurements: to 0.06, one deviation.
    assert not live.lost
    assert excess[-1] == pytest.approx(1.0, abs=0.25)


def units(covariances: np.ndarray) -> np.ndarray:
    """What makes correlations of them."""
    size = np.sqrt(np.diagonal(covariances, axis1=-2, axis2=-1))
    return size[..., :, None] * size[..., None, :]


def started(flight: made.Flight, means: Means) -> AidedFilter:
    noise = aided_smoother.positive(LOG_NOISE)
    size = ravel_pytree(means)[0].size
    held, apart = np.zeros((size, size)), np.zeros((aided.SIZE, size))
    return AidedFilter(made.MODEL, means, held, noise, flight.beginning, apart, held)


def each_row(flight: made.Flight) -> list[Row]:
    return [
        jax.tree.map(lambda part, index=index: part[index], flight.rows)
        for index in range(made.COUNT)
    ]


def test_row_by_row_it_says_that_it_lost_the_aircraft(flight) -> None:
    """One that is unstable ten times over in its equations; and a reading that is no number."""
    means = made.unknowns(1.0).means
    terms = {name: dict(each) for name, each in means.aerodynamics.items()}
    terms["Cm"]["alpha"] = -10.0 * terms["Cm"]["alpha"]
    live = started(flight, means._replace(aerodynamics=terms))
    assert not live.lost
    for row in each_row(flight)[: 2 * MEMORY]:
        live.predict(row)
        live.observe()
    assert live.lost
    live = started(flight, means)
    first = each_row(flight)[0]
    live.predict(first._replace(gyro=np.full(3, np.nan)))
    live.observe()
    assert live.lost


def test_covariances_are_safe_where_all_that_is_known_comes_from_one_sensor() -> None:
    """Four thousand rows with an exact attitude, begun with deviations of ten of everything.

    Of 10² an exact reading leaves (2e-4)²: a difference that is good to 1e-16 · 10²/(2e-4)² = 3e-7,
    and that Joseph's form takes otherwise. What follows forgets it.
    """
    flight = made.made_flight(own_rates=True)
    exact = LOG_NOISE._replace(attitude=jnp.log(jnp.full(2, 1e-5)))
    (chunk,) = aided_smoother.chunks(flight.rows, flight.nominal)
    rows = aided_smoother.linearised(made.MODEL, made.unknowns(1.0).means, exact, chunk)
    begun = Belief(jnp.zeros(aided.SIZE), 100.0 * jnp.eye(aided.SIZE))
    joseph, pieces, others = 100.0 * np.eye(aided.SIZE), [], []
    transition, process, view, variance = (
        np.asarray(part)
        for part in (rows.transition, rows.process, rows.sensitivity, rows.variance)
    )
    for _ in range(10):
        begun, done = linear_filter.run(begun, rows)
        pieces.append(np.asarray(done.updated.covariance))
        for index in range(made.COUNT):
            turned, seen, noise = transition[index], view[index], np.diag(variance[index])
            joseph = turned @ joseph @ turned.T + process[index]
            gain = np.linalg.solve(seen @ joseph @ seen.T + noise, seen @ joseph).T
            left = np.eye(aided.SIZE) - gain @ seen
            joseph = left @ joseph @ left.T + gain @ noise @ gain.T
            others.append(joseph)
    found, wanted = np.concatenate(pieces), np.stack(others)
    unit = units(wanted)
    assert np.linalg.eigvalsh(found / units(found)).min() > -1e-12
    off = np.abs(found - wanted) / unit
    assert off.max() < 1e-5
    assert off[len(off) // 2 :].max() < 1e-9


def test_what_was_not_measured_changes_nothing_whatever_stands_there() -> None:
    """Nor do rows in a hole tell of the parameters what no sensor saw there."""
    flight, means = made.made_flight(own_rates=True), made.unknowns(1.0).means
    measured, valid = flight.rows.measured, flight.rows.measured.valid
    none = np.asarray(np.nan)
    rows = flight.rows._replace(
        gyro=np.where(flight.rows.inertial[:, None], flight.rows.gyro, none),
        accelerometer=np.where(flight.rows.inertial[:, None], flight.rows.accelerometer, none),
        measured=measured._replace(
            airspeed=np.where(valid[:, :1], measured.airspeed, none),
            velocity=np.where(valid[:, 1:2], measured.velocity, none),
            attitude=np.where(valid[:, 2:3], measured.attitude, none),
            vanes=np.full_like(measured.vanes, none),
        ),
    )
    unread = replace(flight, rows=rows)
    plain, told = (passed(settled(one, means), means) for one in (flight, unread))
    assert told.told.count == 6 * (made.COUNT - 15) + 80 + 3 * 40 + 3 * 200
    np.testing.assert_array_equal(told.told.matrix, plain.told.matrix)
    np.testing.assert_array_equal(told.told.score, plain.told.score)
    np.testing.assert_array_equal(told.log_likelihood, plain.log_likelihood)
    np.testing.assert_array_equal(told.blocks, plain.blocks)
    assert np.isfinite(told.told.score).all()
    assert not told.whitened[made.HOLE, :6].any()
    slopes = [
        intensities._slope(LOG_NOISE, intensities.lined(made.MODEL, means, done.path, LOG_NOISE))[1]
        for done in (plain, told)
    ]
    np.testing.assert_array_equal(slopes[0], slopes[1])
    assert np.isfinite(slopes[1]).all()


def test_innovations_are_white_at_the_truth(flight) -> None:
    done = passed(settled(flight, made.unknowns(1.0).means), made.unknowns(1.0).means)
    seen = done.whitened[:, :6]
    assert np.mean(seen**2) == pytest.approx(1.0, abs=0.1)
    assert abs(np.mean(seen[1:] * seen[:-1])) < 0.06


@pytest.mark.parametrize("own_rates", [False, True])
def test_sensitivities_are_those_of_the_innovations_but_for_the_gains(*, own_rates: bool) -> None:
    """Along a parameter, gains and matrices held: differences of the filter's own innovations."""
    flight, like = made.made_flight(own_rates=own_rates), made.unknowns(1.0)
    path = settled(flight, like.means)
    flat, unravel = ravel_pytree(like.means)
    [rows] = causal.joined(made.MODEL, like.means, like.log_noise, path)
    bare = aided_smoother.linearised(made.MODEL, like.means, like.log_noise, path.chunks[0])
    done = passed(path, like.means)
    every = jnp.arange(flat.size)
    _, steps = linear_filter.run(path.start, rows)
    told = causal.sensitivities(made.MODEL, *like, path.chunks[0], rows, every)
    begin = jnp.zeros((aided.SIZE, flat.size))
    white = np.asarray(causal.followed(begin, rows, steps, *told)[2])
    for index in range(9):
        size = 1e-5 * max(abs(float(flat[index])), 0.1)
        whitened = []
        for sign in (1.0, -1.0):
            means = unravel(flat.at[index].add(sign * size))
            moved = aided_smoother.linearised(made.MODEL, means, like.log_noise, path.chunks[0])
            # The leaps are handed on as they are: at a settled path they meet what they undo.
            held = rows._replace(
                offset=rows.offset + moved.offset - bare.offset, residual=moved.residual
            )
            _, step = linear_filter.run(path.start, held)
            whitened.append(np.asarray(step.whitened))
        slope = (whitened[0] - whitened[1]) / (2.0 * size)
        mine, size = white[:, :, index], np.linalg.norm(slope)
        # Within a step Simpson's rule stands for the scheme's own four stages.
        assert np.linalg.norm(slope - mine) < 0.025 * size, index
        assert done.told.matrix[index, index] == pytest.approx(np.sum(mine**2), rel=1e-9)
        score = -np.sum(mine * done.whitened)
        assert done.told.score[index] == pytest.approx(score, abs=1e-9 * size)


@pytest.mark.parametrize(("lag", "off"), [(0.0, 1e-9), (0.005, 0.01)])
def test_a_term_acts_through_its_coefficient_as_it_does_by_itself(
    flight, lag: float, off: float
) -> None:
    """Of moments that lag, what a term is made of is taken at one rate, where it has two rounds."""
    like = made.unknowns(1.0)
    late = like.means.sensors._replace(moment_lag=jnp.asarray(lag))
    means = like.means._replace(sensors=late)
    path = settled(flight, means)
    [rows], [chunk] = causal.joined(made.MODEL, means, like.log_noise, path), path.chunks
    flat, unravel = ravel_pytree(means.aerodynamics)
    about = (made.MODEL, means, like.log_noise, chunk, rows)
    motion, seen = causal.sensitivities(*about, jnp.arange(flat.size))
    assert [part.shape[-1] for part in causal.sensitivities(*about, jnp.arange(0))] == [0, 0]

    def changed(values: jax.Array, part: aided_smoother.Chunk) -> tuple[jax.Array, jax.Array]:
        other = means._replace(aerodynamics=unravel(values))
        middle = aided.compose(part.before, 0.5 * aided.difference(part.after, part.before))
        moved = part.row.step * aided.motion(made.MODEL.aircraft, other, middle, part.row)
        return moved, aided.innovation(made.MODEL.aircraft, other, part.after, part.row)

    added, left = jax.vmap(jax.jacfwd(changed), in_axes=(None, 0))(flat, chunk)
    # What is added in the middle of the step, carried to its end by rows about the same path.
    inner = aided_smoother.mechanics(made.MODEL, means, chunk)
    decay = aided_linear.decay(aided_smoother.positive(like.log_noise))
    half = jax.vmap(aided_step.half, in_axes=(0, None, 0))(inner, decay, chunk.row)
    first = np.zeros((made.COUNT, aided.SIZE, aided.SIZE))
    first[:, : aided.MOVING] = half.motion
    carried = (added + (4.0 * first + np.asarray(rows.transition)) @ added) / 6.0
    direct = np.concatenate([carried[:, : aided.MOVING], left], axis=1)
    told = np.concatenate([motion[:, : aided.MOVING], seen], axis=1)
    wrong, size = (np.linalg.norm(each, axis=(0, 1)) for each in (told - direct, direct))
    assert np.all(size > 0.0)
    assert np.all(wrong <= off * size), wrong / size


def test_what_is_not_asked_is_not_told_and_what_is_stays_the_same(flight) -> None:
    means = made.unknowns(1.0).means
    path = settled(flight, means)
    whole = passed(path, means)
    chosen = np.zeros(whole.told.score.size, dtype=bool)
    chosen[[1, 4, 7]] = True
    part = passed(path, means, chosen=chosen)
    np.testing.assert_allclose(part.told.matrix[1, 4], whole.told.matrix[1, 4], rtol=1e-9)
    np.testing.assert_allclose(part.told.score[chosen], whole.told.score[chosen], rtol=1e-9)
    assert not part.told.score[~chosen].any()


def test_rows_set_apart_and_rows_that_count_make_the_whole(flight) -> None:
    like = made.unknowns(1.0)
    path = settled(flight, like.means)
    half = np.arange(made.COUNT) < 150
    parts = causal.passed(made.MODEL, like.means, like.log_noise, path, half)
    whole = passed(path, like.means)
    np.testing.assert_allclose(
        parts.told.matrix + parts.apart.matrix, whole.told.matrix, rtol=1e-9, atol=1e-9
    )
    assert parts.told.count + parts.apart.count == whole.told.count
    np.testing.assert_allclose(whole.blocks.sum(axis=0), whole.told.score, rtol=1e-6, atol=1e-6)


def test_rows_of_neither_count_for_nobody(flight) -> None:
    like = made.unknowns(1.0)
    path = settled(flight, like.means)
    every, late = np.ones(made.COUNT, dtype=bool), np.arange(made.COUNT) >= 100
    asked = (made.MODEL, like.means, like.log_noise, path)
    whole = causal.passed(*asked, every)
    kept, both = causal.passed(*asked, late, apart=~every), causal.passed(*asked, late)
    np.testing.assert_allclose(kept.told.matrix, both.told.matrix, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(kept.blocks, whole.blocks)
    assert not kept.apart.matrix.any()
    assert kept.apart.count == 0.0
    assert kept.told.count + both.apart.count == whole.told.count
    beside = causal.passed(*asked, ~every, apart=late)
    np.testing.assert_allclose(beside.apart.matrix, kept.told.matrix, rtol=1e-9, atol=1e-9)


def test_a_term_asked_beside_is_told_as_the_models_own(flight) -> None:
    """Cm's slope in qhat is a parameter; asked for as one more term it must tell the same."""
    means = made.unknowns(1.0).means
    flat, _ = ravel_pytree(means)
    keys = [(name, key) for name in sorted(made.TERMS) for key in sorted(made.TERMS[name])]
    constant, slope = keys.index(("CZ", "1")), keys.index(("CZ", "alpha"))
    path = settled(flight, means)
    done = passed(path, means, more=More((regressors.parse("alpha"),), (constant,)))
    assert done.told.score.size == flat.size + 1
    assert done.told.matrix[-1, -1] == pytest.approx(done.told.matrix[slope, slope], rel=1e-3)
    assert done.told.score[-1] == pytest.approx(done.told.score[slope], rel=1e-3, abs=1e-2)


def test_the_slope_of_intensities_is_that_of_the_likelihood(flight) -> None:
    like = made.unknowns(1.0)
    path = settled(flight, like.means)
    flat, unravel = ravel_pytree(like.log_noise)
    about = intensities.lined(made.MODEL, like.means, path, like.log_noise)
    density, slope, _ = intensities._slope(like.log_noise, about)

    def likelihood(values: np.ndarray) -> float:
        [moved] = causal.joined(made.MODEL, like.means, unravel(values), path)
        return float(linear_filter.likelihood(path.start, moved)[1])

    assert density == pytest.approx(likelihood(flat), rel=1e-12)
    names = [
        jax.tree_util.keystr(place)
        for place, leaf in jax.tree_util.tree_flatten_with_path(like.log_noise)[0]
        for _ in range(np.size(leaf))
    ]
    for index, name in enumerate(names):
        step = 1e-4
        numeric = (likelihood(flat.at[index].add(step)) - likelihood(flat.at[index].add(-step))) / (
            2.0 * step
        )
        # Of how the air decays within a step, the series' fourth order is left out.
        decays = any(word in name for word in ("_time", "_length", "coupling", "azimuth"))
        allowed = 0.05 if decays else 1e-3
        assert slope[index] == pytest.approx(numeric, rel=1e-4, abs=allowed), name


def test_intensities_three_times_too_large_come_down(flight) -> None:
    like = made.unknowns(1.0)
    path = settled(flight, like.means)
    wrong = like.log_noise._replace(
        gyro=like.log_noise.gyro + np.log(3.0),
        accelerometer=like.log_noise.accelerometer + np.log(3.0),
    )
    sigma = like.log_noise._replace(
        **{name: jnp.ones_like(getattr(like.log_noise, name)) for name in ("gyro", "accelerometer")}
    )
    zeros = ravel_pytree(like.log_noise)[1](jnp.zeros(ravel_pytree(like.log_noise)[0].size))
    held = zeros._replace(gyro=sigma.gyro, accelerometer=sigma.accelerometer)
    search = Search(wrong)
    for _ in range(4):
        search = intensities.climbed(made.MODEL, like.means, path, Prior(wrong, held), search, 2)
    assert float(search.log_noise.gyro) == pytest.approx(float(like.log_noise.gyro), abs=0.1)
    assert float(search.log_noise.accelerometer) == pytest.approx(
        float(like.log_noise.accelerometer), abs=0.1
    )


def test_the_field_of_the_gusts_is_found_by_looking_all_around(flight) -> None:
    """It lies 0.6 rad from north; eight seconds tell that to 0.4 rad, one standard deviation."""
    like = made.unknowns(1.0)
    path = settled(flight, like.means)
    turbulence = like.log_noise.turbulence
    unknown = like.log_noise._replace(
        turbulence=turbulence._replace(coupling=jnp.zeros(2), azimuth=jnp.asarray(-2.0))
    )
    held = jax.tree.map(jnp.zeros_like, unknown)
    free = held.turbulence._replace(coupling=turbulence.coupling, azimuth=jnp.asarray(2.0))
    prior = Prior(unknown, held._replace(turbulence=free))
    found = intensities.oriented(made.MODEL, like.means, path, prior, unknown).turbulence
    # Turned by half a circle it is the same with the signs changed: what turns what is compared.
    told, flew = (np.ravel(air.coupling_matrix(one)) for one in (found, turbulence))
    assert told @ flew > np.cos(0.8) * np.linalg.norm(told) * np.linalg.norm(flew)


@pytest.mark.parametrize(("sign", "turn"), [(1.0, 0.2), (-1.0, np.pi - 0.2)])
def test_a_field_that_was_found_is_left_as_it_is(flight, sign, turn) -> None:
    like = made.unknowns(1.0)
    path = settled(flight, like.means)
    turbulence = like.log_noise.turbulence
    held = jax.tree.map(jnp.zeros_like, like.log_noise)
    free = held.turbulence._replace(coupling=turbulence.coupling, azimuth=jnp.asarray(2.0))
    prior = Prior(like.log_noise, held._replace(turbulence=free))
    best = intensities.oriented(made.MODEL, like.means, path, prior, like.log_noise).turbulence
    near = best._replace(coupling=sign * best.coupling, azimuth=best.azimuth + turn)
    begun = like.log_noise._replace(turbulence=near)
    assert intensities.oriented(made.MODEL, like.means, path, prior, begun) is begun


def test_derivatives_are_found_row_by_row_as_well_as_is_said() -> None:
    """Twelve flights, each with other noise and another belief, drawn as it is stated.

    The sum of squares of normalised errors has the mean of a χ², to three of the deviations that
    a mean of twelve has. What is held stays, and what is sought is known better.
    """
    true = made.unknowns(1.0).means
    flat, unravel = ravel_pytree(true)
    derivatives = len(in_common.derivative_keys(true.aerodynamics))
    sizes = np.zeros(flat.size)
    sizes[:derivatives] = 0.15 * np.abs(flat[:derivatives])
    sizes[derivatives : derivatives + 6] = [0.005] * 3 + [0.1] * 3
    sizes[1] = 0.0
    noise, sought = aided_smoother.positive(LOG_NOISE), np.flatnonzero(sizes)
    squares, shrunk = [], []
    for seed in range(12):
        flight, rng = made.made_flight(seed=400 + 3 * seed), np.random.default_rng(seed)
        drawn = unravel(flat + sizes * rng.standard_normal(flat.size))
        off = jnp.asarray(BEGUN * rng.standard_normal(aided.SIZE))
        begun = Beginning(aided.compose(flight.beginning.state, off), BEGUN**2 * np.eye(aided.SIZE))
        apart, still = np.zeros((aided.SIZE, flat.size)), np.zeros((flat.size, flat.size))
        live = AidedFilter(made.MODEL, drawn, np.diag(sizes**2), noise, begun, apart, still)
        for row in each_row(flight):
            live.predict(row)
            live.observe()
        found, spread = np.asarray(ravel_pytree(live.means)[0]), live.covariance
        assert found[1] == flat[1]
        error, spread = (found - flat)[sought], spread[np.ix_(sought, sought)]
        squares.append(error @ np.linalg.solve(spread, error))
        shrunk.append(np.sqrt(np.diagonal(spread)) / sizes[sought])
    count = sought.size
    assert np.mean(squares) == pytest.approx(count, abs=3.0 * np.sqrt(2.0 * count / 12.0))
    assert np.max(shrunk) < 1.0
    assert np.median(shrunk) < 0.6


def test_a_path_is_taken_up_with_other_surfaces_and_not_by_another_flight(flight) -> None:
    path = settled(flight, made.unknowns(1.0).means, 1)
    rows = flight.rows._replace(controls=2.0 * flight.rows.controls)
    found = causal.taken_up(path, rows, flight.nominal)
    assert found is not None
    for new, old in zip(found.chunks, path.chunks, strict=True):
        np.testing.assert_array_equal(new.after.velocity, old.after.velocity)
        np.testing.assert_array_equal(new.row.controls, 2.0 * np.asarray(old.row.controls))
    other = flight.rows._replace(gyro=flight.rows.gyro + 1e-3)
    assert causal.taken_up(path, other, flight.nominal) is None
