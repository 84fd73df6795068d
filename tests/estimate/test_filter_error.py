"""Filter error on a made flight: derivatives found within what is stated of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid.estimate import filter_error, in_common, intensities, scoring, settling
from gcs_sysid.estimate.filter_error import Fit
from gcs_sysid.estimate.intensities import Prior
from gcs_sysid.estimate.likelihood import Curvature
from gcs_sysid.estimate.scoring import LostError, Scored
from gcs_sysid.estimate.settling import Beliefs, Settled
from gcs_sysid.model import departures
from gcs_sysid.reconstruct import aided_smoother
from gcs_sysid.reconstruct.causal import Pass, Path, Told
from gcs_sysid.reconstruct.linear_filter import Belief
from tests.estimate import made_flight as made

pytestmark = pytest.mark.slow


FIRST, WRONG = made.unknowns(1.0), made.unknowns(0.7)
DERIVATIVES = sum(len(terms) for terms in made.TERMS.values())
LAG = DERIVATIVES + 7
"""Of the airspeed, behind two biases of three axes and a scale."""


@pytest.fixture(scope="module", autouse=True)
def _short_chunks() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        # Those of `test_likelihood`, so that they are compiled once.
        patch.setattr(aided_smoother, "CHUNK", made.COUNT // 2)
        patch.setattr(intensities, "SAMPLE_ROWS", made.COUNT // 2)
        # A search begins on half of the flight.
        patch.setattr(settling, "STRETCH", made.COUNT // 2)
        yield


@pytest.fixture(scope="module")
def found(_short_chunks: None) -> Fit:
    """From derivatives a third wrong, of which nothing was believed, and a lag not known."""
    mean = np.asarray(ravel_pytree(WRONG.means)[0])
    sigma = np.where(np.arange(mean.size) < DERIVATIVES, 1e3, 0.0)
    sigma[LAG] = 0.1
    held = jax.tree.map(jnp.zeros_like, FIRST.log_noise)
    free = held._replace(gyro=jnp.asarray(1.0), accelerometer=jnp.asarray(1.0))
    beliefs = Beliefs(mean, np.diag(sigma**2), Prior(FIRST.log_noise, free))
    every = np.ones(made.COUNT, dtype=bool)
    flight = made.made_flight(airspeed_lag=0.2)
    return filter_error.fit(made.MODEL, flight, WRONG, beliefs, every, lambda _: None)


def test_derivatives_a_third_wrong_come_back_within_their_bounds(found) -> None:
    assert found.converged
    deviation = np.sqrt(np.diagonal(found.covariance))
    for index, (name, key) in enumerate(found.keys):
        value = float(found.unknowns.means.aerodynamics[name][key])
        # Four deviations in any of ten: a chance of 6e-4.
        assert abs(value - made.TERMS[name][key]) < 4.0 * deviation[index], (name, key)
    ratio = deviation / np.sqrt(np.diagonal(found.bound))
    # What the gains add has its sign by chance in eight seconds, as has the scatter of four blocks.
    assert ratio.min() > 0.9
    assert ratio.max() < 1.7
    elevator = found.keys.index(("Cm", "elevator"))
    assert deviation[elevator] < 0.1 * abs(made.TERMS["Cm"]["elevator"])
    assert float(found.unknowns.log_noise.gyro) == pytest.approx(np.log(0.004), abs=0.15)


def test_the_lag_of_the_airspeed_is_found(found) -> None:
    sure, lag = found.deviation.means.sensors.airspeed_lag, found.unknowns.means.sensors
    assert float(sure) < 0.08
    assert float(lag.airspeed_lag) == pytest.approx(0.2, abs=3.0 * float(sure))


def test_a_search_that_leads_nowhere_begins_on_another_stretch(monkeypatch) -> None:
    """And where none ends, goes on from the one that came nearest."""
    flight, every = made.made_flight(), np.ones(made.COUNT, dtype=bool)
    mean = np.asarray(ravel_pytree(FIRST.means)[0])
    beliefs = Beliefs(
        mean, np.zeros((mean.size, mean.size)), Prior(FIRST.log_noise, FIRST.log_noise)
    )
    told = Told(np.zeros((1, 1)), np.zeros(1), 0.0)
    path = Path([], Belief(jnp.zeros(1), jnp.zeros((1, 1))))
    nothing = Pass(told, told, path, np.zeros((1, 1)), np.zeros(1), np.zeros((1, 1)))
    free = np.zeros(1, dtype=bool)
    lefts: list[float] = []

    def begun(*stretches: tuple[float, float]) -> float:
        """By what is left to gain and what is still to move on each: what moves where it went on.

        Where the first value is far from nothing the steps of the second are a last resort.
        """
        lefts.clear()

        def settle(*given, **how) -> Settled:
            lefts.append(stretches[len(lefts)][0])
            rest = (nothing, every, (0.0,))
            return Settled(np.zeros(1), FIRST.log_noise, *rest, ended=False, left=lefts[-1])

        def climbed(model, like, settled, *given) -> Scored:
            moving = dict(stretches)[settled.left]
            if np.isnan(moving):
                raise LostError
            one = np.ones((1, 1))
            return Scored(
                *(FIRST, (free, free), Curvature(one, one, one), one, one, one, (0.0,)),
                ended=moving < 0.25,
                moving=moving,
            )

        monkeypatch.setattr(settling, "STRETCH", made.COUNT // 4)
        monkeypatch.setattr(settling, "settle", settle)
        monkeypatch.setattr(scoring, "climbed", climbed)
        search = filter_error._Search(made.MODEL, flight, beliefs, every, lambda _: None)
        done, whole = next(filter_error._beginnings(search, FIRST))
        assert not whole
        return done.moving

    assert begun((30.0, 0.1)) == 0.1
    assert len(lefts) == 1
    # Near enough: steps over the whole flight follow.
    assert begun((30.0, 4.0)) == 4.0
    assert len(lefts) == 1
    assert begun((4e4, 99.0), (0.5, 0.1)) == 0.1
    assert begun((90.0, 26.0), (0.5, 0.1)) == 0.1
    assert begun((90.0, 26.0), (50.0, 70.0), (4e4, 99.0)) == 26.0
    assert begun((4e4, 99.0), (7e3, 50.0), (5e4, 70.0)) == 50.0
    assert len(lefts) == 3
    # Where the filter loses the aircraft, too; and where it always does, that is said.
    assert begun((30.0, np.nan), (0.5, 0.1)) == 0.1
    with pytest.raises(LostError):
        begun((30.0, np.nan), (20.0, np.nan), (10.0, np.nan))


def test_a_search_that_is_astray_on_the_whole_flight_begins_on_another_stretch(
    monkeypatch,
) -> None:
    """By how much a derivative is still to move, and the log-likelihood, at each end."""
    one, free = np.ones((1, 1)), (np.zeros(1, dtype=bool), np.zeros(1, dtype=bool))
    overall: list[tuple[float, float]] = []
    flight = made.made_flight()

    def scored(moving: float, likely: float) -> Scored:
        return Scored(
            *(FIRST, free, Curvature(one, one, one), one, one, one, (likely,)),
            ended=moving < 0.25,
            moving=moving,
        )

    def reached(*ends: tuple[float, float]) -> tuple[float, float]:
        """Where each stretch leads on the whole flight: what was reached at last."""
        overall[:] = ends
        monkeypatch.setattr(
            filter_error, "_beginnings", lambda *_: ((scored(0.1, 0.0), False) for _ in ends)
        )

        def over_all(*_) -> Scored:
            moving, likely = overall.pop(0)
            if np.isnan(moving):
                raise LostError
            return scored(moving, likely)

        monkeypatch.setattr(filter_error, "_over_all", over_all)
        none = Beliefs(np.zeros(1), np.zeros((1, 1)), Prior(FIRST.log_noise, FIRST.log_noise))
        every = np.ones(1, dtype=bool)
        search = filter_error._Search(made.MODEL, flight, none, every, lambda _: None)
        done, _ = filter_error._from_stretches(search, FIRST)
        return done.moving, done.log_likelihood[-1]

    assert reached((4.0, 10.0), (0.1, 12.0)) == (4.0, 10.0)
    assert len(overall) == 1
    assert reached((22.0, 10.0), (0.1, 8.0)) == (0.1, 8.0)
    assert reached((22.0, 10.0), (23.0, 15.0), (30.0, 3.0)) == (23.0, 15.0)
    assert reached((np.nan, 0.0), (22.0, 5.0)) == (22.0, 5.0)
    with pytest.raises(LostError):
        reached((np.nan, 0.0), (np.nan, 0.0))


@pytest.mark.parametrize(
    ("hoped", "gained", "moving", "ended", "wanted"),
    [
        (150.0, 140.0, 0.1, True, True),
        (90.0, 85.0, 0.1, True, False),
        # Steps that were cut short and still gain.
        (90.0, 20.0, 0.9, False, True),
        (90.0, 0.1, 0.9, False, False),
        # Near the end the equations balance elsewhere than the likelihood does.
        (150.0, -3.0, 0.8, False, True),
        (900.0, 700.0, 25.0, False, True),
        (2500.0, 70.0, 25.0, False, False),
    ],
)
def test_instruments_are_made_anew_where_that_leads_on(
    hoped, gained, moving, ended, wanted
) -> None:
    assert scoring._promising(hoped, gained, moving, ended=ended) is wanted


@pytest.mark.parametrize(
    ("damping", "gained", "farthest", "wanted"),
    [
        ((0.0, 10.0), 0.4, 0.1, True),
        ((0.0, 0.1), -0.4, 0.1, True),
        # Where the mean was held back it may have more to go.
        ((1.0, 10.0), 0.4, 0.1, False),
        ((0.0, 10.0), 3.0, 0.1, False),
        ((0.0, 10.0), 0.4, 0.3, False),
        # An undamped step is judged by the next one.
        ((0.0, 0.0), 0.4, 0.1, False),
    ],
)
def test_a_search_ends_where_intensities_promise_what_is_not_there(
    damping, gained, farthest, wanted
) -> None:
    assert scoring._last(damping, gained, np.array([0.01, farthest])) is wanted


@pytest.mark.parametrize(
    ("ended", "moving", "wanted"), [(True, 0.1, True), (False, 0.7, True), (False, 1.1, False)]
)
def test_a_search_that_stopped_tells_what_it_nearly_reached(ended, moving, wanted) -> None:
    one, free = np.ones((1, 1)), (np.zeros(1, dtype=bool), np.zeros(1, dtype=bool))
    done = Scored(
        *(FIRST, free, Curvature(one, one, one), one, one, one, (0.0,)), ended=ended, moving=moving
    )
    assert done.settled is wanted


def test_what_no_row_tells_is_not_bounded_and_stays_as_believed() -> None:
    """The bound of two derivatives, one without information; what was believed of them is left."""
    known = made.unknowns(1.0)
    parameters = np.zeros(ravel_pytree(known.means)[0].size, dtype=bool)
    parameters[:3] = True
    information = np.array([[4.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 1.0]])
    intensities_ = np.zeros(ravel_pytree(known.log_noise)[0].size, dtype=bool)
    done = Scored(
        unknowns=known,
        free=(parameters, intensities_),
        curvature=Curvature(information, information, information),
        blocks=np.zeros((2, 3)),
        precision=np.diag([10.0, 10.0, 1.0]),
        whitened=np.zeros((1, 1)),
        log_likelihood=(0.0,),
        ended=True,
        moving=0.0,
    )
    bound = filter_error._bound(done, 2)
    np.testing.assert_allclose(np.diagonal(bound), [2.0 / 7.0, np.inf])
    np.testing.assert_allclose(done.covariance()[1], [0.0, 0.1, 0.0], atol=1e-12)


def test_sums_that_move_less_are_known_less() -> None:
    """Godambe: A⁻¹ M A⁻ᵀ, here 2⁻¹ · 4 · 2⁻¹."""
    known = made.unknowns(1.0)
    free = np.zeros(ravel_pytree(known.means)[0].size, dtype=bool)
    free[0] = True
    done = Scored(
        unknowns=known,
        free=(free, np.zeros(ravel_pytree(known.log_noise)[0].size, dtype=bool)),
        curvature=Curvature(np.array([[2.0]]), np.array([[4.0]]), np.array([[4.0]])),
        blocks=np.zeros((2, 1)),
        precision=np.zeros((1, 1)),
        whitened=np.zeros((1, 1)),
        log_likelihood=(0.0,),
        ended=True,
        moving=0.0,
    )
    np.testing.assert_allclose(done.covariance(), [[1.0]])
    stopped = replace(done, ended=False, moving=0.5)
    np.testing.assert_allclose(stopped.covariance(), [[1.25]])


def test_a_search_that_stopped_leaves_what_was_believed_as_it_was() -> None:
    """Of two derivatives the flight tells the sum; their difference is as it was believed."""
    known = made.unknowns(1.0)
    free = np.zeros(ravel_pytree(known.means)[0].size, dtype=bool)
    free[:2] = True
    told, believed = np.full((2, 2), 50.0), np.diag([4.0, 1.0])
    done = Scored(
        unknowns=known,
        free=(free, np.zeros(ravel_pytree(known.log_noise)[0].size, dtype=bool)),
        curvature=Curvature(told, told, told),
        blocks=np.zeros((2, 2)),
        precision=believed,
        whitened=np.zeros((1, 1)),
        log_likelihood=(0.0,),
        ended=False,
        moving=3.0,
    )
    left = np.linalg.inv(done.covariance()) - believed
    np.testing.assert_allclose(left, told / 10.0, rtol=1e-9)


def test_the_lag_of_the_moments_is_believed_to_a_millisecond() -> None:
    """And what goes with it: here a derivative that moves by 20 for a second of lag."""
    known = made.unknowns(1.0)
    flat, unravel = ravel_pytree(jax.tree.map(jnp.zeros_like, known.means))
    marked = unravel(flat)
    marked = marked._replace(sensors=marked.sensors._replace(moment_lag=jnp.ones(())))
    free = np.asarray(ravel_pytree(marked)[0]) > 0.0
    free[0] = True
    found = np.array([[0.01 + 400.0 * 4e-8, 20.0 * 4e-8], [20.0 * 4e-8, 4e-8]])
    information = np.linalg.inv(found)
    done = Scored(
        unknowns=known,
        free=(free, np.zeros(ravel_pytree(known.log_noise)[0].size, dtype=bool)),
        curvature=Curvature(information, information, information),
        blocks=np.zeros((2, 2)),
        precision=np.zeros((2, 2)),
        whitened=np.zeros((1, 1)),
        log_likelihood=(0.0,),
        ended=True,
        moving=0.0,
    )
    wanted = found + 1e-6 * np.array([[400.0, 20.0], [20.0, 1.0]])
    np.testing.assert_allclose(done.covariance(), wanted, rtol=1e-6)


def test_a_flight_in_pitch_alone_does_not_tell_inertia_from_the_moments_that_it_divides() -> None:
    """Iyy and all of Cm larger by one share are the same motion; roll and yaw tell them apart."""
    none = departures.none(made.AIRCRAFT, 0)
    by = jax.tree.map(lambda part: jnp.asarray(part, float), none)
    known = FIRST._replace(means=FIRST.means._replace(departures=by))
    every = np.ones(made.COUNT, dtype=bool)
    flight = made.made_flight()
    mean = np.asarray(ravel_pytree(known.means)[0])
    chosen = np.zeros(mean.size)
    chosen[in_common.places(known.means)] = 1.0
    held = jax.tree.map(jnp.zeros_like, FIRST.log_noise)
    beliefs = Beliefs(mean, np.diag(chosen), Prior(FIRST.log_noise, held))
    done = settling.rested(made.MODEL, flight, known, beliefs, every)
    common = in_common.places(known.means)
    matrix = done.last.told.matrix[np.ix_(common, common)]
    keys, value = in_common.keys(known.means), in_common.values(known.means)
    along = np.array(
        [
            1.0 if key == (in_common.BODY, "Iyy") else (size if key[0] == "Cm" else 0.0)
            for key, size in zip(keys, value, strict=True)
        ]
    )
    row = keys.index((in_common.BODY, "Iyy"))
    assert matrix[row, row] > 100.0
    assert along @ matrix @ along < 1e-2 * matrix[row, row]
