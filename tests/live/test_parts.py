"""The small parts of listening, each held to what it promises."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from gcs_sysid.aircraft import Aircraft, Geometry, Mass
from gcs_sysid.estimate import equation_error
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.estimate.result import Prior
from gcs_sysid.live.coefficients import KEPT
from gcs_sysid.live.flying import BEGIN, END, FlyingWatch, slowest
from gcs_sysid.live.latency import NEWEST, STEP, Latency
from gcs_sysid.live.regression import UNCERTAIN, Regressors, RunningModel
from gcs_sysid.live.ring import Ring
from gcs_sysid.reconstruct import rates
from gcs_sysid.reconstruct.airborne import LANDED, LIFT_OFF
from gcs_sysid.reconstruct.running_rates import RunningRates

AIRCRAFT = Aircraft("kite", Mass(1.0, 0.1, 0.1, 0.2), Geometry(0.3, 1.2, 0.25))


@given(st.integers(1, 7), st.integers(0, 30))
def test_a_ring_holds_the_newest_rows_in_order(size: int, added: int) -> None:
    ring = Ring(size, 2)
    for index in range(added):
        ring.add(np.array([index, -index], dtype=float))
    newest = list(range(added))[-size:]
    assert_allclose(ring.rows()[:, 0], newest)
    assert ring.full == (added >= size)
    if added:
        assert_allclose(
            ring.padded()[:, 1], [-newest[0]] * (size - len(newest)) + [-n for n in newest]
        )


def test_latencies_are_of_the_newest_updates_and_of_all() -> None:
    latency = Latency()
    assert set(latency.percentiles().values()) == {None}
    for milliseconds in range(1, 101):
        latency.add(milliseconds * 1e-3)
    told = latency.percentiles()
    assert (told["p50_ms"], told["p99_ms"]) == (50.5, 99.01)
    assert told["all_p50_ms"] == pytest.approx(50.0, rel=STEP - 1.0)
    assert told["all_p99_ms"] == pytest.approx(99.0, rel=STEP - 1.0)


def test_what_was_slow_long_ago_is_forgotten_by_the_newest_only() -> None:
    """A run's percentiles were those of its last minute, whatever had happened before."""
    durations = np.random.default_rng(3).lognormal(-6.0, 1.0, 3 * NEWEST)
    durations[:200] = 3.0
    durations[-1] = 0.0  # a clock that stood still
    latency = Latency()
    for one in durations:
        latency.add(float(one))
    told, size = latency.percentiles(), latency._all.size
    half, most = 1e3 * np.quantile(durations, [0.5, 0.99], method="inverted_cdf")
    assert told["all_p50_ms"] == pytest.approx(half, rel=STEP - 1.0)
    assert told["all_p99_ms"] == pytest.approx(most, rel=STEP - 1.0) == pytest.approx(3e3)
    assert told["p99_ms"] == pytest.approx(1e3 * np.quantile(durations[-NEWEST:], 0.99), rel=1e-3)
    latency.add(1e6)
    assert latency._all.size == size


def flown(watch: FlyingWatch, speed: float, seconds: float, since: float) -> bool:
    for tick in range(int(seconds * 10) + 1):
        watch.take(since + 0.1 * tick, speed)
    return watch.flying


def test_flying_begins_and_ends_with_memory() -> None:
    watch = FlyingWatch(AIRCRAFT)
    speed = slowest(AIRCRAFT)
    assert not flown(watch, 1.1 * BEGIN * speed, 0.5 * LIFT_OFF, 0.0)
    assert not flown(watch, 0.5 * BEGIN * speed, 1.0, 10.0)
    assert flown(watch, 1.1 * BEGIN * speed, 2.0 * LIFT_OFF, 20.0)
    assert flown(watch, 0.9 * END * speed, 0.5 * LANDED, 30.0)
    assert flown(watch, 1.1 * END * speed, 5.0, 40.0)
    assert not flown(watch, 0.9 * END * speed, 1.5 * LANDED, 50.0)
    assert watch.fast_enough(np.array([1.1, 1.5]) * END * speed)
    assert not watch.fast_enough(np.array([0.9, 1.5]) * END * speed)


def test_without_an_envelope_the_wing_sets_the_slowest_speed() -> None:
    """2 m g = ρ S V² C_L with C_L = 1.4: 6.2 m/s for 1 kg on 0.3 m²."""
    assert slowest(AIRCRAFT) == pytest.approx(np.sqrt(2 * 9.80665 / (1.225 * 0.3 * 1.4)), rel=1e-6)


def test_the_running_smoothing_is_that_of_the_whole_flight() -> None:
    rng = np.random.default_rng(3)
    time = np.arange(1024) * 0.02
    rate = np.stack([np.sin(3 * time), np.cos(2 * time), np.sin(time)], axis=1)
    rate = rate + rng.normal(0.0, 0.02, rate.shape)
    running = RunningRates()
    with pytest.raises(ValueError, match="take"):
        running.found()
    step = np.diff(time, prepend=time[0] - 0.02)
    for first in range(0, time.size, 32):
        running.take(step[first : first + 32], rate[first : first + 32])
    ratio, noise = running.found()
    assert ratio == pytest.approx(rates.most_likely_ratio(time, rate), rel=1e-9)
    assert_allclose(noise, 0.02, rtol=0.2)


def made_samples(count: int) -> Samples:
    """CZ = −0.3 − 4.5 α + noise, with noise of changing size; nothing else measured."""
    rng = np.random.default_rng(7)
    time = np.arange(count) * 0.02
    alpha = 0.05 + 0.03 * np.sin(1.3 * time) + 0.02 * np.sin(0.31 * time)
    names = ("beta", "phat", "qhat", "rhat", "alphadot_hat", "Tc", "qbar", "h_over_b", "V")
    others = {name: rng.normal(0.0, 0.01, count) for name in names}
    noise = 0.02 * (1.5 + np.sin(time))
    measured = -0.3 - 4.5 * alpha - 5.0 * others["qhat"] + noise * rng.normal(size=count)
    return Samples(
        time=time,
        qbar=np.full(count, 150.0),
        regressors={"alpha": alpha, **others},
        regressor_variance={name: np.full(count, 1e-6) for name in UNCERTAIN},
        measured={"CZ": measured},
        noise={"CZ": noise},
        mass_part={"CZ": measured},
        thrust_part={"CZ": np.zeros(count)},
        smoothing=1e4,
        refused={},
    )


def window(whole: Samples, end: int) -> Samples:
    rows = slice(end - rates.WINDOW, end)

    def cut(table: dict) -> dict:
        return {name: values[rows] for name, values in table.items()}

    return Samples(
        time=whole.time[rows],
        qbar=whole.qbar[rows],
        regressors=cut(whole.regressors),
        regressor_variance=cut(whole.regressor_variance),
        measured=cut(whole.measured),
        noise=cut(whole.noise),
        mass_part=cut(whole.mass_part),
        thrust_part=cut(whole.thrust_part),
        smoothing=whole.smoothing,
        refused={},
    )


@pytest.mark.parametrize(
    "prior", [None, {"CZ": Prior({"alpha": -4.0}, {"alpha": 0.05})}], ids=["free", "believed"]
)
def test_sums_give_the_least_squares_of_all_samples(prior) -> None:
    """Against `equation_error.solve` on the same rows: same value, intervals of the same size but

    for what is wrong of the flow angles for minutes, which only the live model has to fear.
    """
    structure = {"CZ": ("1", "alpha", "qhat"), "Cm": ("1", "alpha")}
    model = RunningModel(AIRCRAFT, Regressors(structure, ()), prior)
    assert model.estimates() == {}
    whole = made_samples(6000)
    hop = KEPT.stop - KEPT.start
    used = np.zeros(whole.time.size, dtype=int) - 1
    for end in range(rates.WINDOW, whole.time.size, hop):
        model.take(window(whole, end), KEPT)
        used[end - rates.WINDOW + KEPT.start : end - rates.WINDOW + KEPT.stop] = 0
    found = model.estimates()["CZ"]
    assert set(model.estimates()) == {"CZ"}
    batch = equation_error.solve(
        equation_error.problem("CZ", [whole], AIRCRAFT, structure["CZ"], [used]),
        None if prior is None else prior["CZ"],
    )
    values = [found[key].value for key in batch.keys]
    if prior is None:
        assert_allclose(values, batch.value, rtol=1e-9)
    else:
        assert_allclose(values, batch.value, atol=0.3 * np.max(batch.deviation))
    # An angle of attack that is 1e-3 rad off throughout is in the constant, and nowhere else.
    lasting = np.where(np.array(batch.keys) == "1", 1e-3 * found["alpha"].value, 0.0)
    scattered = np.array([found[key].deviation for key in batch.keys]) ** 2 - lasting**2
    sizes = np.sqrt(scattered) / batch.deviation
    assert np.all((sizes > 0.6) & (sizes < 1.6))
