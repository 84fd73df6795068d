"""Slope and information of the likelihood against the filter run again."""

from __future__ import annotations

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid.estimate import intensities, likelihood
from gcs_sysid.reconstruct import aided_smoother, causal
from gcs_sysid.reconstruct.causal import Path
from tests.estimate import made_flight as made

pytestmark = pytest.mark.slow

KNOWN = made.unknowns(1.0)
FLAT, UNRAVEL = ravel_pytree(KNOWN.means)
LOGS, UNRAVEL_LOGS = ravel_pytree(KNOWN.log_noise)
NAMES = [
    jax.tree_util.keystr(place)
    for place, leaf in jax.tree_util.tree_flatten_with_path(KNOWN.log_noise)[0]
    for _ in range(leaf.size)
]
DERIVATIVES = sum(len(terms) for terms in made.TERMS.values())


@pytest.fixture(scope="module", autouse=True)
def _short_chunks() -> Iterator[None]:
    # Two chunks, so that what is carried from one to the next counts.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(aided_smoother, "CHUNK", made.COUNT // 2)
        yield


@pytest.fixture(scope="module")
def path() -> Path:
    flight = made.made_flight()
    return run(FLAT, LOGS, causal.along(flight.rows, flight.nominal, flight.beginning))[0]


def run(values: jax.Array, logs: jax.Array, path: Path, times: int = 4) -> tuple[Path, list]:
    """The filter about the flight that it predicts itself, or once about the one given."""
    for _ in range(times):
        rows = causal.joined(made.MODEL, UNRAVEL(values), UNRAVEL_LOGS(logs), path)
        path, _, steps = causal.filtered(path, rows)
    return path, steps


@pytest.fixture(scope="module")
def curved(path: Path) -> tuple[likelihood.Instruments, likelihood.Curvature]:
    free = np.arange(FLAT.size) < DERIVATIVES + 7, np.ones(LOGS.size, dtype=bool)
    # No vanes: nothing is to be known of their noise.
    free[1][-1] = False
    sizes = np.full(FLAT.size, 1e-4)
    every = np.ones(made.COUNT, dtype=bool)
    by_likelihood = np.ones(FLAT.size, dtype=bool)
    return likelihood.curved(
        likelihood.Asking(made.MODEL, *KNOWN, path, every, free, sizes, by_likelihood)
    )


def differences(index: int, path: Path) -> tuple[float, np.ndarray, np.ndarray]:
    """Of log-likelihood, whitened innovations and their covariance, by an unknown."""
    size = 1e-4
    count, ends = DERIVATIVES + 7, []
    for sign in (1.0, -1.0):
        if index < count:
            _, steps = run(FLAT.at[index].add(sign * size), LOGS, path)
        else:
            _, steps = run(FLAT, LOGS.at[index - count].add(sign * size), path, times=1)
        ends.append(jax.tree.map(lambda *parts: np.concatenate(parts), *steps))
    _, steps = run(FLAT, LOGS, path)
    here = jax.tree.map(lambda *parts: np.concatenate(parts), *steps)
    factors = [np.linalg.inv(end.root) for end in ends]
    raw = [np.einsum("kij,kj->ki", f, end.whitened) for f, end in zip(factors, ends, strict=True)]
    spreads = [f @ f.swapaxes(1, 2) for f in factors]
    turned = here.root @ ((spreads[0] - spreads[1]) / (2 * size)) @ here.root.swapaxes(1, 2)
    change = np.einsum("kij,kj->ki", here.root, (raw[0] - raw[1]) / (2 * size))
    slope = (ends[0].log_likelihood.sum() - ends[1].log_likelihood.sum()) / (2 * size)
    return slope, change, turned


def test_slope_and_information_are_those_of_the_filter_run_again(path, curved) -> None:
    """Of every unknown by itself, and of each with the first.

    The path follows parameters; intensities hardly move it.
    """
    asked, curvature = curved
    _, steps = run(FLAT, LOGS, path)
    white = np.concatenate([done.whitened for done in steps])
    found = likelihood.scores(asked, white).sum(axis=0)
    size = np.sqrt(np.diagonal(curvature.information))
    _, first, first_turned = differences(0, path)
    for index in range(len(found)):
        slope, change, turned = differences(index, path)
        told = np.sum(change**2) + 0.5 * np.sum(turned * turned.swapaxes(1, 2))
        both = np.sum(first * change) + 0.5 * np.sum(first_turned * turned.swapaxes(1, 2))
        # The path moves as it would with the gains held: to a twentieth of a deviation.
        assert found[index] / size[index] == pytest.approx(slope / size[index], abs=0.05), index
        assert curvature.information[index, index] == pytest.approx(told, rel=0.02), index
        scale = size[0] * size[index]
        assert curvature.information[0, index] / scale == pytest.approx(both / scale, abs=0.01), (
            index
        )


def test_rows_that_are_not_asked_tell_nothing(path, curved) -> None:
    curvature = curved[1]
    free = np.arange(FLAT.size) < 2, np.zeros(LOGS.size, dtype=bool)
    half = np.arange(made.COUNT) < made.COUNT // 2
    sizes = np.full(FLAT.size, 1e-4)
    both = [
        likelihood.curved(
            likelihood.Asking(
                made.MODEL, *KNOWN, path, counts, free, sizes, np.ones(FLAT.size, dtype=bool)
            )
        )[1].information
        for counts in (half, ~half)
    ]
    np.testing.assert_allclose(both[0] + both[1], curvature.information[:2, :2], rtol=1e-5)
    assert np.all(np.diagonal(both[0]) > 0.0)
    assert np.all(np.diagonal(both[1]) > 0.0)
    assert jnp.isfinite(both[0]).all()


def test_asked_at_held_gains_it_is_the_estimating_equation(path, curved) -> None:
    """Sums and their scatter are those of `causal.passed`; they move by Jᵀ T."""
    free = np.arange(FLAT.size) < DERIVATIVES, np.zeros(LOGS.size, dtype=bool)
    every, none = np.ones(made.COUNT, dtype=bool), np.zeros(FLAT.size, dtype=bool)
    sizes = np.full(FLAT.size, 1e-4)
    held, told = likelihood.curved(
        likelihood.Asking(made.MODEL, *KNOWN, path, every, free, sizes, none)
    )
    done = causal.passed(made.MODEL, *KNOWN, path, every)
    taken = np.ix_(free[0], free[0])
    size = np.sqrt(np.diagonal(done.told.matrix)[free[0]])
    unit = np.outer(size, size)
    np.testing.assert_allclose(told.scatter / unit, done.told.matrix[taken] / unit, atol=1e-5)
    score = likelihood.scores(held, done.whitened).sum(axis=0)
    np.testing.assert_allclose(score / size, done.told.score[free[0]] / size, atol=1e-4)
    # What the likelihood itself would know does not hang on how it is asked.
    known = curved[1].information[:DERIVATIVES, :DERIVATIVES]
    np.testing.assert_allclose(told.information / unit, known / unit, atol=1e-4)
    white = np.concatenate(held.innovations, axis=1)
    for place in (0, 4):
        _, change, _ = differences(place, path)
        wanted = np.einsum("ukr,kr->u", white, change)
        scale = size * size[place]
        np.testing.assert_allclose(told.slope[:, place] / scale, wanted / scale, atol=0.02)


def test_with_the_curvature_of_a_stretch_only_what_the_likelihood_finds_is_worked_out(path) -> None:
    """Sums are the same; of a stretch that is the whole flight the curvature is, too."""
    free = np.arange(FLAT.size) < DERIVATIVES, np.arange(LOGS.size) < 4
    every, sizes = np.ones(made.COUNT, dtype=bool), np.full(FLAT.size, 1e-4)
    first = np.arange(FLAT.size) == 2
    _, steps = run(FLAT, LOGS, path)
    white = np.concatenate([done.whitened for done in steps])
    of = likelihood.Asking(made.MODEL, *KNOWN, path, every, free, sizes, first)
    whole, curvature = likelihood.curved(of)
    part = likelihood.instruments(of)
    np.testing.assert_array_equal(
        part.by_likelihood, [False, False, True, *whole.by_likelihood[3:]]
    )
    np.testing.assert_allclose(likelihood.scores(part, white), likelihood.scores(whole, white))
    carried = curvature.on(likelihood.scatter(part, every), np.zeros_like(curvature.slope))
    size = np.sqrt(np.diagonal(curvature.scatter))
    for mine, other in zip(carried, curvature, strict=True):
        np.testing.assert_allclose(
            mine / np.outer(size, size), other / np.outer(size, size), atol=1e-6
        )


def test_sums_and_scatter_of_some_rows_are_those_of_their_blocks(path, curved) -> None:
    """As `scores` has them, row block by row block, and the scatter of parts adds up."""
    asked, curvature = curved
    _, steps = run(FLAT, LOGS, path)
    white = np.concatenate([done.whitened for done in steps])
    size = np.sqrt(np.diagonal(curvature.scatter))
    blocks = likelihood.scores(asked, white)
    early = np.arange(made.COUNT) < 3 * causal.BLOCK
    found = likelihood.sums(asked, white, early)
    np.testing.assert_allclose(found / size, blocks[:3].sum(axis=0) / size, atol=1e-6)
    parts = likelihood.scatter(asked, early) + likelihood.scatter(asked, ~early)
    np.testing.assert_allclose(
        parts / np.outer(size, size), curvature.scatter / np.outer(size, size), atol=1e-12
    )


def test_a_flight_of_four_stretches_is_four_times_as_curved() -> None:
    """And of what the stretch does not tell, the whole flight's own scatter is all there is."""
    slope = np.array([[2.0, 0.5, 0.0], [0.3, 1.0, 0.0], [0.0, 0.0, 0.0]])
    scatter = np.array([[3.0, 0.6, 0.0], [0.6, 1.5, 0.0], [0.0, 0.0, 0.0]])
    information = 1.2 * scatter
    stretch = likelihood.Curvature(slope, scatter, information)
    prior = np.zeros((3, 3))
    flight = 4.0 * scatter
    flight[2, 2] = 7.0
    found = stretch.on(flight, prior)
    np.testing.assert_allclose(found.slope[:2, :2], 4.0 * slope[:2, :2])
    np.testing.assert_allclose(found.information[:2, :2], 4.0 * information[:2, :2])
    np.testing.assert_allclose(found.slope[2], flight[2], atol=1e-12)
    np.testing.assert_array_equal(found.scatter, flight)


def test_what_only_gains_know_of_a_stretch_is_not_taken_over() -> None:
    """A bend that the stretch hardly reaches moves its sums a hundred times as far as they scatter.

    The flight that reaches it more often is not said to know more than some times its scatter,
    and what it knows of everything else is as it was without the bend.
    """
    slope = np.array([[2.0, 0.5, 0.0], [0.3, 1.0, 0.0], [0.0, 0.0, -1.0]])
    scatter = np.array([[3.0, 0.6, 0.0], [0.6, 1.5, 0.0], [0.0, 0.0, 0.01]])
    stretch = likelihood.Curvature(slope, scatter, scatter)
    prior = np.zeros((3, 3))
    flight = 4.0 * scatter
    flight[2, 2] = 7.0
    flight[0, 2] = flight[2, 0] = 0.7
    found = stretch.on(flight, prior)
    told = found.slope.T @ np.linalg.solve(flight, found.slope)
    assert told[2, 2] <= likelihood.SWOLLEN**2 * flight[2, 2]
    alone = stretch.slope[:2, :2].T @ np.linalg.solve(scatter[:2, :2], slope[:2, :2])
    np.testing.assert_allclose(np.diagonal(told)[:2], 4.0 * np.diagonal(alone), rtol=0.05)


def test_an_intensity_that_fades_moves_covariances_by_as_much_less(path) -> None:
    """V made anew at half an intensity, and as it is foretold; at an eighth of what is hardly seen.

    Of gusts and of what drives the velocity the filter sees little, of noise most. At an eighth of
    the latter what is foretold is far too little (0.14 of 0.59 of an accelerometer's).
    """
    free = np.zeros(FLAT.size, dtype=bool), np.ones(LOGS.size, dtype=bool)
    free[1][-1] = False
    none, sizes = np.zeros(FLAT.size, dtype=bool), np.full(FLAT.size, 1e-4)
    every = np.ones(made.COUNT, dtype=bool)

    def made_at(logs: jax.Array) -> likelihood.Instruments:
        known = (made.MODEL, KNOWN.means, UNRAVEL_LOGS(logs), path)
        return likelihood.instruments(likelihood.Asking(*known, every, free, sizes, none))

    def moved(asked: likelihood.Instruments) -> np.ndarray:
        return np.sqrt(sum(np.einsum("ukp,ukp->u", each, each) for each in asked.spreads))

    asked = made_at(LOGS)
    assert asked.about.same(KNOWN)
    shares = likelihood.shares(asked, LOGS.size - 1)
    assert np.all((shares >= 0.0) & (shares <= 1.0))
    faint = (".turbulence.gust", ".force")
    for name in (*faint, ".accelerometer", ".attitude"):
        at = NAMES.index(name)
        for factor, within in ((0.5, 0.15), (0.125, 0.05))[: 2 if name in faint else 1]:
            louder = np.log(factor)
            less = moved(made_at(LOGS.at[at].add(louder)))[at] / moved(asked)[at]
            foretold = likelihood.faded(np.array([louder]), shares[at : at + 1])[0]
            assert abs(less - foretold) < within, (name, factor)


def test_lengths_and_turns_go_by_the_gusts_that_they_are_of() -> None:
    places = intensities.deviations(KNOWN.log_noise)
    by = dict(zip(range(LOGS.size), places, strict=True))
    gust, spin = NAMES.index(".turbulence.gust"), NAMES.index(".turbulence.spin")
    length, over = NAMES.index(".turbulence.gust_length"), NAMES.index(".turbulence.spin_length")
    assert [by[length + axis] for axis in range(3)] == [gust + axis for axis in range(3)]
    assert [by[over + axis] for axis in range(3)] == [spin + axis for axis in range(3)]
    noise = NAMES.index(".accelerometer")
    assert by[noise] == noise


def test_a_length_far_below_the_shortest_moves_nothing() -> None:
    """By differences of the length that the filter has."""
    at, size = NAMES.index(".turbulence.gust_length"), 1e-5

    def length(logs: jax.Array) -> float:
        return float(aided_smoother.positive(UNRAVEL_LOGS(logs)).turbulence.gust_length[0])

    for log in (np.log(30.0), np.log(0.5), np.log(0.05)):
        logs = LOGS.at[at].set(log)
        ends = [np.log(length(logs.at[at].add(sign * size))) for sign in (1.0, -1.0)]
        found = intensities.floors(UNRAVEL_LOGS(logs))
        assert np.exp(found[at]) == pytest.approx((ends[0] - ends[1]) / (2.0 * size), rel=1e-4)
        assert found[NAMES.index(".turbulence.gust")] == 0.0
