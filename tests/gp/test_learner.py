"""Learning sample by sample: the batch's posterior in any order, forgetting, refreshing."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid.errors import UsageError
from gcs_sysid.gp import exact, inducing, learner, local, posterior, refresh
from gcs_sysid.gp.dependent import Kernel, Points
from gcs_sysid.gp.learner import Learner
from gcs_sysid.gp.learning import Structure
from gcs_sysid.gp.refresh import Refresher, Settings
from gcs_sysid.gp.samples import Rows, some_of

OUTPUTS, INPUTS, POINTS = 2, 2, 40
ENOUGH = 160
"""Points that hold what samples said well enough for a refresh to lose next to nothing."""
KERNEL = Kernel(
    amplitude=jnp.array([[0.8, -0.6]]),
    scale=jnp.full((1, 1, INPUTS), 2.0),
    own_amplitude=jnp.array([0.2, 0.2]),
    own_scale=jnp.full((OUTPUTS, INPUTS), 4.0),
)
NOISE = jnp.array([0.01, 0.04])


def truth(inputs: np.ndarray) -> np.ndarray:
    wave = np.sin(1.5 * inputs[:, 0]) * np.cos(inputs[:, 1])
    return np.stack([wave, -0.7 * wave + 0.1 * inputs[:, 0]], axis=1)


def flown(seed: int, count: int) -> Rows:
    random = np.random.default_rng(seed)
    inputs = random.uniform(-2.0, 2.0, (count, INPUTS))
    values = truth(inputs) + 0.1 * random.normal(size=(count, OUTPUTS))
    precision = np.full((count, OUTPUTS), 1e3)
    precision[::5, 1] = 0.0  # an output is missing now and then
    return Rows(inputs, values, precision)


def make_base(seed: int = 3, count: int = POINTS) -> inducing.Basis:
    random = np.random.default_rng(seed)
    points = Points(random.uniform(-2.0, 2.0, (count, INPUTS)), np.arange(count) % OUTPUTS)
    return inducing.basis(KERNEL, NOISE, jnp.ones(OUTPUTS), points)


def nlpd(known: posterior.Posterior, rows: Rows, noise: np.ndarray) -> float:
    """Mean negative log density of unseen noise-free values plus the noise [nat a sample]."""
    found = posterior.predict(known, rows.inputs)
    total = np.asarray(found.variance) + noise[None, :]
    error = rows.values - np.asarray(found.mean)
    density = 0.5 * (np.log(2.0 * np.pi * total) + error**2 / total)
    return float(np.mean(np.sum(density, axis=1)))


@pytest.fixture(scope="module")
def base() -> inducing.Basis:
    return make_base()


def same(one: posterior.Posterior, other: posterior.Posterior, within: float = 1e-8) -> None:
    inputs = flown(99, 6).inputs
    for found, wanted in zip(
        posterior.predict(one, inputs), posterior.predict(other, inputs), strict=True
    ):
        np.testing.assert_allclose(np.asarray(found), np.asarray(wanted), atol=within)


def test_inducing_points_at_all_samples_give_the_exact_posterior():
    """FITC is exact where every value is an inducing point."""
    rows = flown(1, 30)
    points, values, own = exact.observed(rows)
    base = inducing.basis(KERNEL, NOISE, jnp.ones(OUTPUTS), points)
    known = inducing.posterior(base, inducing.told(base, rows))
    total = own + np.asarray(NOISE)[points.output]
    wanted = exact.condition(KERNEL, points, values, total)
    inputs = flown(2, 6).inputs
    for found, right in zip(
        posterior.predict(known, inputs), posterior.predict(wanted, inputs), strict=True
    ):
        np.testing.assert_allclose(np.asarray(found), np.asarray(right), atol=1e-5)
    np.testing.assert_allclose(
        float(inducing.log_marginal(base, rows)),
        float(exact.log_marginal(KERNEL, points, values, total)),
        rtol=1e-5,
    )


def test_samples_in_any_order_and_by_ones_give_the_batch(base):
    rows = flown(4, 60)
    batch = learner.observe(learner.start(base, capacity=100), rows, 0)
    single = learner.start(base, capacity=100)
    for index in np.random.default_rng(5).permutation(60):
        single = learner.observe(single, some_of(rows, np.array([index])), 0)
    same(learner.posterior(single), learner.posterior(batch))
    assert single.count == batch.count == 60
    ranked = [np.sort(one.store.kept.drawn) for one in (single, batch)]
    np.testing.assert_array_equal(*ranked)


def test_nothing_is_compiled_anew_and_the_store_stays_bounded(base):
    known = learner.start(base, capacity=50)
    rows = flown(6, 700)
    known = learner.observe(known, rows, 0)
    for few in (1, 2):
        known = learner.observe(known, some_of(rows, np.arange(few)), 0)
    before = inducing.told._cache_size()
    for start in range(0, 600, 7):
        known = learner.observe(known, some_of(rows, np.arange(start, start + 1)), start % 3)
        known = learner.observe(known, some_of(rows, np.arange(start, start + 7)), start % 3)
    assert inducing.told._cache_size() == before
    assert known.store.kept.drawn.size == 50


def test_a_forgotten_flight_was_never_there(base):
    first, second = flown(7, 40), flown(8, 40)
    only = learner.observe(learner.start(base, capacity=60), first, 1)
    both = learner.observe(only, second, 2)
    same(learner.posterior(learner.forget(both, 2)), learner.posterior(only))
    same(learner.without(both, 2), learner.posterior(only))
    assert set(learner.forget(both, 2).store.kept.flight) == {1}
    with pytest.raises(UsageError, match=r"no flight 5 to forget; known: 1, 2"):
        learner.forget(both, 5)


def test_carried_information_is_exact_where_the_new_points_hold_the_old(base):
    known = inducing.told(base, flown(9, 80))
    more = np.random.default_rng(10).uniform(-2.0, 2.0, (10, INPUTS))
    wider = Points(
        np.concatenate([np.asarray(base.points.inputs), more]),
        np.concatenate([np.asarray(base.points.output), np.arange(10) % OUTPUTS]),
    )
    new = inducing.basis(KERNEL, NOISE, jnp.ones(OUTPUTS), wider)
    # 1e-8 of the variance is added to the points' covariance, and amplified by its inverse.
    same(
        inducing.posterior(new, inducing.carried(base, known, new)),
        inducing.posterior(base, known),
        within=1e-5,
    )


SETTINGS = Settings(
    structure=Structure(latents=1), points=ENOUGH, rows=150, scaffold=10, candidates=ENOUGH,
    starts=2, steps=25,
)  # fmt: skip


@pytest.mark.parametrize(("capacity", "seed"), [(2000, 11), (600, 11), (600, 19), (600, 30)])
def test_a_refresh_loses_at_most_two_hundredths_of_a_nat(capacity, seed):
    """Against the batch of all samples on the refreshed basis; a store of all, and of 30 %."""
    base, rows = make_base(count=ENOUGH), flown(seed, 2000)
    known = learner.observe(learner.start(base, capacity=capacity), rows, 0)
    fresh = refresh.refreshed(known, SETTINGS)
    batch = learner.observe(learner.start(fresh.base, capacity=1), rows, 0)
    unseen = flown(seed + 1, 500)
    unseen = unseen._replace(values=truth(unseen.inputs))
    noise = np.asarray(NOISE)
    lost = nlpd(learner.posterior(fresh), unseen, noise) - nlpd(
        learner.posterior(batch), unseen, noise
    )
    assert lost < 0.02
    # What was learned of the noise is near what flew: the comparison is not between two failures.
    np.testing.assert_allclose(np.asarray(fresh.base.noise), 0.01, rtol=0.6)
    assert fresh.count == 2000


def test_what_comes_during_a_refresh_is_in_the_new_learner(base):
    rows = flown(13, 300)
    first = learner.observe(learner.start(base, capacity=400), rows, 0)
    held = Refresher(first, SETTINGS, ThreadPoolExecutor(max_workers=1))
    held.begin()
    for index in range(5):
        held.observe(some_of(rows, np.array([index])), 1)
    held.close()
    assert held.learner.count == 305
    whole = learner.observe(learner.start(held.learner.base, capacity=1), rows, 0)
    whole = learner.observe(whole, some_of(rows, np.arange(5)), 1)
    same(learner.posterior(held.learner), learner.posterior(whole))


def test_observing_does_not_wait_for_a_refresh(base, monkeypatch):
    """What is served meanwhile is the old learner with the samples that came, and then the new."""
    go, other = threading.Event(), make_base(14)

    def slow(old: Learner, settings: Settings) -> Learner:
        go.wait()
        return refresh.moved(old, other)

    monkeypatch.setattr(refresh, "refreshed", slow)
    rows = flown(15, 60)
    worker = ThreadPoolExecutor(max_workers=1)
    first = learner.observe(learner.start(base, capacity=100), rows, 0)
    held = Refresher(first, SETTINGS, worker)
    try:
        held.begin()
        for index in range(5):
            held.observe(some_of(rows, np.array([index])), 1)
        assert not go.is_set()
        assert held.learner.base is base
        assert held.learner.count == 65
    finally:
        go.set()
    # The one thread is through with the refresh when it comes to this.
    worker.submit(lambda: None).result()
    held.observe(some_of(rows, np.array([5])), 1)
    assert held.learner.base is other
    assert held.learner.count == 66
    worker.shutdown()


SHAPE = local.Shape(np.array([1.0, 0.5, 0.5]), np.array([0.02, 0.02]), np.array([0.01, 0.04]))


def same_neighbours(known: Learner, rows: Rows) -> None:
    """The local part is that of the samples `rows`, on what the global part leaves of them."""
    explained = np.asarray(posterior.mean(learner.posterior(known), rows.inputs))
    left = (rows.values - explained) * (rows.precision > 0.0)
    one = np.zeros(rows.inputs.shape[0], dtype=int)
    wanted = local.built(SHAPE, local.stored(rows._replace(values=left), one))
    inputs = flown(98, 6).inputs
    for part, right in zip(
        local.predict(learner.local_part(known, SHAPE), inputs),
        local.predict(wanted, inputs),
        strict=True,
    ):
        np.testing.assert_allclose(part, right, atol=1e-8)


def test_the_local_part_follows_what_is_forgotten_and_refreshed(base):
    first, second = flown(16, 50), flown(17, 50)
    known = learner.observe(learner.start(base, capacity=200), first, 1)
    both = learner.observe(known, second, 2)
    same_neighbours(both, Rows(*map(np.concatenate, zip(first, second, strict=True))))
    forgotten = learner.forget(both, 2)
    same_neighbours(forgotten, first)
    same_neighbours(refresh.moved(forgotten, make_base(18)), first)
    with pytest.raises(UsageError, match="nothing is in the store"):
        learner.local_part(learner.forget(forgotten, 1), SHAPE)


@pytest.mark.parametrize("seed", [19, 29, 39])
def test_a_flight_is_forgotten_after_a_refresh_of_both(seed):
    """With half of both in the store: against the other flight alone on the refreshed basis."""
    base, first, second = make_base(count=ENOUGH), flown(seed, 1000), flown(seed + 1, 1000)
    known = learner.observe(learner.start(base, capacity=1000), first, 1)
    fresh = refresh.refreshed(learner.observe(known, second, 2), SETTINGS)
    left = learner.forget(fresh, 2)
    alone = learner.observe(learner.start(fresh.base, capacity=1), first, 1)
    unseen = flown(seed + 2, 500)
    unseen = unseen._replace(values=truth(unseen.inputs))
    noise = np.asarray(NOISE)
    lost = nlpd(learner.posterior(left), unseen, noise) - nlpd(
        learner.posterior(alone), unseen, noise
    )
    assert abs(lost) < 0.02
    assert left.count == 1000
