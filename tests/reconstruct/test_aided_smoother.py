"""The smoother with the aerodynamics inside, against the truth of made flights."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2

from gcs_sysid.estimate.flight_rows import Flight
from gcs_sysid.model import aided
from gcs_sysid.model.aided import State
from gcs_sysid.reconstruct import aided_smoother, causal, linear_filter
from tests.estimate import made_flight as made

KNOWN = made.unknowns(1.0)
SEEDS = (21, 31, 41, 51, 61, 71)


class Against(NamedTuple):
    """Errors at every row, and the covariances that are stated of them."""

    error: np.ndarray
    covariance: np.ndarray


@pytest.fixture(scope="module", autouse=True)
def _short_chunks() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        # Those of `test_causal`, so that they are compiled once.
        patch.setattr(aided_smoother, "CHUNK", made.COUNT)
        yield


def flown(seed: int) -> Flight:
    """With a belief of its beginning that is as far off as is said of it.

    Every other one has streams of their own, and a hole.
    """
    flight = made.made_flight(seed=seed, own_rates=seed % 20 == 1)
    deviation = np.sqrt(np.diagonal(flight.beginning.covariance))
    off = jnp.asarray(deviation * np.random.default_rng(seed + 5).standard_normal(aided.SIZE))
    begun = flight.beginning._replace(state=aided.compose(flight.beginning.state, off))
    return replace(flight, beginning=begun)


def against(truth: State, found: State, covariance: np.ndarray) -> Against:
    truth, found = (jax.tree.map(jnp.asarray, each) for each in (truth, found))
    error = np.asarray(jax.vmap(aided.difference)(truth, found))
    return Against(error, np.asarray(covariance)[: made.COUNT])


def smoothed(flight: Flight) -> Against:
    """About a first guess that is off all along by as much as the beginning."""
    first = jax.tree.map(lambda part: jnp.asarray(part)[0], flight.nominal)
    off = jnp.tile(aided.difference(flight.beginning.state, first), (made.COUNT, 1))
    guess = jax.tree.map(np.asarray, causal.moved(flight.nominal, off))
    states, done = aided_smoother.iterated(
        made.MODEL, *KNOWN, flight.rows, guess, flight.beginning, rounds=4
    )
    return against(flight.nominal, states, done.covariance)


def filtered(flight: Flight) -> tuple[Against, np.ndarray]:
    """And the variances of the smoother about the filter's own path."""
    path = causal.along(flight.rows, flight.nominal, flight.beginning)
    for _ in range(4):
        [rows] = causal.joined(made.MODEL, *KNOWN, path)
        about, (path, _, _) = path, causal.filtered(path, [rows])
    [chunk] = about.chunks
    end, done = linear_filter.run(about.start, rows)
    _, later = linear_filter.smooth(end, about.start, rows, done)
    found = against(
        flight.nominal, causal.moved(chunk.after, done.updated.mean), done.updated.covariance
    )
    return found, np.diagonal(later.covariance, axis1=1, axis2=2)


def squares(one: Against) -> np.ndarray:
    """Errors squared over their covariance, at every row."""
    size = np.sqrt(np.diagonal(one.covariance, axis1=1, axis2=2))
    error = one.error / size
    spread = one.covariance / (size[:, :, None] * size[:, None, :])
    return np.einsum("ki,ki->k", error, np.linalg.solve(spread, error[..., None])[..., 0])


@pytest.fixture(scope="module")
def both(_short_chunks: None) -> list[tuple[Against, Against, np.ndarray]]:
    """By the smoother and by the filter."""
    return [(smoothed(flight), *filtered(flight)) for flight in map(flown, SEEDS)]


def test_errors_are_of_the_size_that_is_stated_of_them(both) -> None:
    """Rows of one flight count as one: slow errors are the same all along it."""
    low, high = chi2.ppf([5e-4, 1.0 - 5e-4], aided.SIZE * len(SEEDS)) / len(SEEDS)
    for by in (0, 1):
        mean = float(np.mean([squares(each[by]) for each in both]))
        assert low < mean < high


def test_what_comes_later_makes_errors_smaller(both) -> None:
    """And variances, about the same path: those of the smoother are nowhere larger."""
    kinds: dict[str, list[float]] = {}
    for smoother, by_filter, later in both:
        variance = np.diagonal(by_filter.covariance, axis1=1, axis2=2)
        assert np.max(later / variance) < 1.0 + 1e-9
        for name, block in aided.BLOCKS.items():
            ends = [np.mean(each.error[:, block] ** 2) for each in (smoother, by_filter)]
            kinds.setdefault(name, []).append(ends)
    ratio = {name: np.divide(*np.sum(ends, axis=0)) for name, ends in kinds.items()}
    # Most of these are told again by every row; what is hardly told may come out either way.
    for name in ("attitude", "velocity", "rate", "tube", "gust", "spin", "push"):
        assert ratio[name] < 1.0, name
    for name in ratio:
        assert ratio[name] < 1.2, name
