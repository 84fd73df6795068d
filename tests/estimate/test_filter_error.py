"""Filter error on a made flight: derivatives found within what is stated of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid.aircraft import CoefficientModel, Control, Value
from gcs_sysid.estimate import (
    filter_error,
    in_common,
    inside_filter,
    scoring,
    settling,
    verdict,
)
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.estimate.filter_error import Fit
from gcs_sysid.estimate.flight_rows import Flight, Unknowns
from gcs_sysid.estimate.inside_filter import Derivatives
from gcs_sysid.estimate.intensities import Prior
from gcs_sysid.estimate.likelihood import Curvature
from gcs_sysid.estimate.scoring import LostError, Scored
from gcs_sysid.estimate.settling import Beliefs, Settled
from gcs_sysid.model import aided, departures
from gcs_sysid.model.aided import Noise, Row, State
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.offline import aided_fit
from gcs_sysid.reconstruct.causal import Pass, Path, Told
from gcs_sysid.reconstruct.linear_filter import Belief
from tests.estimate import made_flight as made
from tests.estimate.made_scored import scored

pytestmark = pytest.mark.slow


SURE = 0.15, 0.05
"""What is believed of the ailerons, that never move, and its deviation."""
AILERON = {("Cl", "aileron"), ("Cn", "aileron")}
TERMS = {
    name: {**terms, **{key: SURE[0] for other, key in AILERON if other == name}}
    for name, terms in made.TERMS.items()
}
AIRCRAFT = replace(
    made.AIRCRAFT,
    controls=(*made.AIRCRAFT.controls, Control("aileron", {"aileron": 1.0})),
    aerodynamics={
        name: CoefficientModel({key: Value(value, 0.1) for key, value in terms.items()})
        for name, terms in TERMS.items()
    },
)
MODEL = FlightModel(AIRCRAFT)
EVERY = np.ones(made.COUNT, dtype=bool)


def unknowns(scale: float) -> Unknowns:
    """As `made.unknowns`, with the ailerons as they are believed."""
    known = made.unknowns(scale)
    terms = {
        name: {
            key: jnp.asarray(value if key == "aileron" else scale * value)
            for key, value in each.items()
        }
        for name, each in TERMS.items()
    }
    return known._replace(means=known.means._replace(aerodynamics=terms))


def flown(**how: object) -> Flight:
    """A made flight with ailerons that never move."""
    flight = made.made_flight(**how)
    rows = flight.rows
    both = {
        name: np.concatenate([getattr(rows, name), np.zeros((made.COUNT, 3, 1))], axis=2)
        for name in ("controls", "control_slopes")
    }
    none = np.zeros((made.COUNT, 3, 2, 0))
    return replace(flight, rows=rows._replace(**both, control_changes=none))


FIRST, WRONG = unknowns(1.0), unknowns(0.7)
KEYS = in_common.keys(FIRST.means)
DERIVATIVES = len(KEYS)
LAG = DERIVATIVES + 7
"""Of the airspeed, behind two biases of three axes and a scale."""
HELD = jax.tree.map(jnp.zeros_like, FIRST.log_noise)


def believed(covariance: np.ndarray, centre: Unknowns, noise: Noise = HELD) -> Beliefs:
    """Sensors held at what they are, as are intensities where nothing else is said."""
    mean = np.asarray(ravel_pytree(centre.means)[0])
    whole = np.zeros((mean.size, mean.size))
    whole[:DERIVATIVES, :DERIVATIVES] = covariance
    return Beliefs(mean, whole, Prior(FIRST.log_noise, noise))


def wide() -> np.ndarray:
    """Nothing is known of what moves."""
    return np.diag([(SURE[1] if key in AILERON else 1e3) ** 2 for key in KEYS])


@pytest.fixture(scope="module", autouse=True)
def _short_chunks() -> Iterator[None]:
    with made.halved():
        yield


@pytest.fixture(scope="module")
def found(_short_chunks: None) -> Fit:
    """From derivatives a third wrong, of which nothing was believed, and a lag not known."""
    free = HELD._replace(gyro=jnp.asarray(1.0), accelerometer=jnp.asarray(1.0))
    beliefs = believed(wide(), WRONG, free)
    beliefs.covariance[LAG, LAG] = 0.1**2
    flight = flown(airspeed_lag=0.2)
    return filter_error.fit(MODEL, flight, WRONG, beliefs, EVERY, lambda _: None)


def deviations(fit: Fit) -> np.ndarray:
    """Of the derivatives."""
    places = in_common.places(fit.unknowns.means)
    return np.sqrt(np.diagonal(fit.parameters)[places])


def test_derivatives_a_third_wrong_come_back_within_their_bounds(found) -> None:
    assert found.converged
    deviation = deviations(found)
    moved = np.array([key not in AILERON for key in found.keys])
    for index in np.flatnonzero(moved):
        name, key = found.keys[index]
        value = float(found.unknowns.means.aerodynamics[name][key])
        # Four deviations in any of ten: a chance of 6e-4.
        assert abs(value - made.TERMS[name][key]) < 4.0 * deviation[index], (name, key)
    ratio = (deviation / np.sqrt(np.diagonal(found.bound)))[moved]
    # What the gains add has its sign by chance in eight seconds, as has the scatter of four blocks.
    assert ratio.min() > 0.9
    assert ratio.max() < 1.7
    elevator = found.keys.index(("Cm", "elevator"))
    assert deviation[elevator] < 0.1 * abs(made.TERMS["Cm"]["elevator"])
    assert float(found.unknowns.log_noise.gyro) == pytest.approx(np.log(0.004), abs=0.15)


def test_of_ailerons_that_never_moved_the_belief_comes_back_and_is_told_to_be_one(found) -> None:
    """Value and deviation, no bound, and in words that nothing was told."""
    deviation = deviations(found)
    for name, key in AILERON:
        index = found.keys.index((name, key))
        value = float(found.unknowns.means.aerodynamics[name][key])
        assert value == pytest.approx(SURE[0], rel=0.01)
        assert deviation[index] == pytest.approx(SURE[1], rel=0.01)
        assert np.isinf(found.bound[index, index])
    assert np.isfinite(np.diagonal(found.bound)).sum() == DERIVATIVES - len(AILERON)
    mean, sigma = as_terms(lambda key: key[1] == "aileron")
    before = aided_fit._believed(mean, sigma, AIRCRAFT, body=False)
    told = inside_filter.model(
        aided_fit._after(before, found),
        [measured(found)],
        AIRCRAFT,
        {name: tuple(sorted(terms)) for name, terms in TERMS.items()},
        [np.zeros(made.COUNT, dtype=int)],
    )
    for name, key in AILERON:
        fit = told.fits[name]
        said = verdict.judge(fit, fit.keys.index(key), SURE[0])
        assert said.answer == "no"
        assert said.reason.startswith("aileron hardly moved: 0 %")
    elevator = told.fits["Cm"].keys.index("elevator")
    assert verdict.judge(told.fits["Cm"], elevator, None).answer == "yes"


def test_what_the_lag_leaves_open_is_told_apart_from_noise(found) -> None:
    """Together they are what the posterior holds of a derivative that the flight tells."""
    mean, sigma = as_terms(lambda key: False)
    before = aided_fit._believed(mean, sigma, AIRCRAFT, body=False)
    after = aided_fit._after(before, found)
    told = inside_filter.model(
        after,
        [measured(found)],
        AIRCRAFT,
        {name: tuple(sorted(terms)) for name, terms in TERMS.items()},
        [np.zeros(made.COUNT, dtype=int)],
    )
    fit = told.fits["Cm"]
    elevator, row = fit.keys.index("elevator"), KEYS.index(("Cm", "elevator"))
    noise, lag, scale = (fit.deviations[one][elevator] for one in ("noise", "lag", "scale"))
    assert lag == pytest.approx(abs(after.late[row]), rel=0.01)
    assert noise > 0.0
    assert np.sqrt(noise**2 + lag**2 + scale**2) == pytest.approx(fit.deviation[elevator], rel=0.01)


def as_terms(
    sure: Callable[[tuple[str, str]], bool],
) -> tuple[dict[str, dict[str, float]], dict[str, dict[str, float]]]:
    """Beliefs term by term: of those that are sure as of ailerons, of others next to nothing."""
    mean = {name: dict.fromkeys(terms, 0.0) for name, terms in TERMS.items()}
    sigma = {name: dict.fromkeys(terms, 1e3) for name, terms in TERMS.items()}
    for name, key in KEYS:
        mean[name][key] = float(WRONG.means.aerodynamics[name][key])
        if sure((name, key)):
            sigma[name][key] = SURE[1]
    return mean, sigma


def measured(found: Fit) -> Samples:
    """Coefficients at the states that were found, as the model has them and a little noise."""
    rows = jax.tree.map(jnp.asarray, flown(airspeed_lag=0.2).rows)
    states = jax.tree.map(jnp.asarray, found.states)

    def at(state: State, row: Row) -> dict[str, jax.Array]:
        return aided.flow(AIRCRAFT, FIRST.means, state, row, 2)

    flow = {name: np.asarray(each) for name, each in jax.vmap(at)(states, rows).items()}
    rng, one = np.random.default_rng(8), np.ones(made.COUNT)
    values = {
        name: sum(v * (one if k == "1" else flow[k]) for k, v in terms.items())
        + 1e-3 * rng.standard_normal(made.COUNT)
        for name, terms in TERMS.items()
    }
    none = dict.fromkeys(values, 0.0 * one)
    return Samples(
        time=made.STEP * np.arange(made.COUNT),
        qbar=flow["qbar"],
        regressors=flow,
        regressor_variance={"alpha": 1e-6 * one},
        measured=values,
        noise=dict.fromkeys(values, 1e-3 * one),
        mass_part=none,
        thrust_part=none,
        smoothing=1.0,
        refused={},
    )


def test_two_flights_tell_the_same_in_either_order_and_more_than_one() -> None:
    """√½ of one's deviations are left, or nearly; the second begins where the first ended.

    While the posterior of one was the prior of the next, CZ_alpha and Cm_alpha came out up to a
    deviation apart: equations that weigh a flight too little do so as a second one only. What is
    left: a search ends within `NEAR` of a flight's own deviation, √2 of that of both; either order
    takes the mean of two that do.
    """
    mean, sigma = as_terms(lambda key: key[1] == "aileron")
    before = aided_fit._believed(mean, sigma, AIRCRAFT, body=False)
    flights = [flown(seed=seed) for seed in (21, 31)]

    def learned(first: int, second: int) -> list[Derivatives]:
        known = [before]
        for number in (first, second):
            begun = aided_fit._with(WRONG, known[-1])
            beliefs = believed(known[-1].covariance, begun)
            fit = filter_error.fit(MODEL, flights[number], begun, beliefs, EVERY, lambda _: None)
            assert fit.converged
            known.append(aided_fit._after(known[-1], fit))
        return known[1:]

    (one, both), (other, again) = learned(0, 1), learned(1, 0)
    moved = np.array([key not in AILERON for key in KEYS])
    alone, alone_too, sure, sure_too = (
        np.sqrt(np.diagonal(each.covariance)) for each in (one, other, both, again)
    )
    off = np.abs(both.value - again.value) / np.minimum(sure, sure_too)
    assert off.max() < 2.0 * scoring.NEAR * np.sqrt(2.0)
    assert np.median(off[moved]) < 0.3
    together = 1.0 / np.hypot(1.0 / alone, 1.0 / alone_too)[moved]
    np.testing.assert_allclose(sure[moved] / together, 1.0, atol=0.3)
    np.testing.assert_allclose(sure_too[moved] / together, 1.0, atol=0.3)
    assert np.median(sure[moved] / alone[moved]) == pytest.approx(np.sqrt(0.5), abs=0.05)
    np.testing.assert_allclose(sure[~moved], SURE[1], rtol=1e-6)
    assert np.isinf(both.bound[~moved]).all()
    assert np.isfinite(both.bound[moved]).all()


def test_a_flight_of_streams_with_a_hole_and_readings_that_are_none_tells_the_derivatives() -> None:
    """With controls the other way round than they were: the elevator comes out so, and surely."""
    flight = flown(own_rates=True)
    rows, valid = flight.rows, flight.rows.measured.valid
    unread = rows.measured._replace(
        velocity=np.where(valid[:, 1:2], rows.measured.velocity, np.nan),
        airspeed=np.where(valid[:, :1], rows.measured.airspeed, np.nan),
        vanes=np.full((made.COUNT, 2), np.nan),
    )
    turned = replace(
        flight,
        rows=rows._replace(
            controls=-rows.controls,
            gyro=np.where(rows.inertial[:, None], rows.gyro, np.nan),
            measured=unread,
        ),
    )
    fit = filter_error.fit(MODEL, turned, WRONG, believed(wide(), WRONG), EVERY, lambda _: None)
    assert fit.converged
    truth = {name: dict(terms) for name, terms in TERMS.items()}
    truth["Cm"]["elevator"] *= -1.0
    deviation = deviations(fit)
    for (name, key), sure in zip(KEYS, deviation, strict=True):
        value = float(fit.unknowns.means.aerodynamics[name][key])
        assert abs(value - truth[name][key]) < 4.0 * sure, (name, key)
    assert deviation[KEYS.index(("Cm", "elevator"))] < 0.1


def test_an_aircraft_that_never_flew_so_is_no_settled_number(monkeypatch) -> None:
    """Its equations are unstable ten times over, and held: no derivative can make up for that.

    Begun on one stretch, by one set of steps: more lead no further, and take as long each.
    """
    monkeypatch.setattr(settling, "BEGINNINGS", 1)
    monkeypatch.setattr(scoring, "SETS", 1)
    terms = {name: dict(each) for name, each in FIRST.means.aerodynamics.items()}
    terms["Cm"]["alpha"] = -10.0 * terms["Cm"]["alpha"]
    first = FIRST._replace(means=FIRST.means._replace(aerodynamics=terms))
    covariance = wide()
    place = KEYS.index(("Cm", "alpha"))
    covariance[place, place] = 0.0
    try:
        fit = filter_error.fit(
            MODEL, flown(), first, believed(covariance, first), EVERY, lambda _: None
        )
    except LostError:
        return
    assert not fit.converged
    assert fit.moving > scoring.WITHIN


def test_the_lag_of_the_airspeed_is_found(found) -> None:
    sure, lag = found.deviation.means.sensors.airspeed_lag, found.unknowns.means.sensors
    assert float(sure) < 0.08
    assert float(lag.airspeed_lag) == pytest.approx(0.2, abs=3.0 * float(sure))


def test_a_search_that_leads_nowhere_begins_on_another_stretch(monkeypatch) -> None:
    """And where none ends, goes on from the one that came nearest."""
    flight, every = flown(), np.ones(made.COUNT, dtype=bool)
    mean = np.asarray(ravel_pytree(FIRST.means)[0])
    beliefs = Beliefs(
        mean, np.zeros((mean.size, mean.size)), Prior(FIRST.log_noise, FIRST.log_noise)
    )
    told = Told(np.zeros((1, 1)), np.zeros(1), 0.0)
    path = Path([], Belief(jnp.zeros(1), jnp.zeros((1, 1))))
    nothing = Pass(told, told, path, np.zeros((1, 1)), np.zeros(1), *[np.zeros((1, 1))] * 2)
    lefts: list[float] = []

    def begun(*stretches: tuple[float, float]) -> float:
        """By what is left to gain and what is still to move on each: what moves where it went on.

        Where the first value is far from nothing the steps of the second are a last resort.
        """
        lefts.clear()

        def settle(*given, **how) -> Settled:
            lefts.append(stretches[len(lefts)][0])
            rest = (nothing, every, ~every, (0.0,))
            return Settled(np.zeros(1), FIRST.log_noise, *rest, ended=False, left=lefts[-1])

        def climbed(model, like, settled, *given) -> Scored:
            moving = dict(stretches)[settled.left]
            if np.isnan(moving):
                raise LostError
            return scored(np.ones((1, 1)), unknowns=FIRST, ended=moving < 0.25, moving=moving)

        monkeypatch.setattr(settling, "STRETCH", made.COUNT // 4)
        monkeypatch.setattr(settling, "settle", settle)
        monkeypatch.setattr(scoring, "climbed", climbed)
        search = filter_error._Search(MODEL, flight, beliefs, every, lambda _: None)
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
    overall: list[tuple[float, float]] = []
    flight = flown()

    def at(moving: float, likely: float) -> Scored:
        return scored(
            np.ones((1, 1)),
            unknowns=FIRST,
            log_likelihood=likely,
            ended=moving < 0.25,
            moving=moving,
        )

    def reached(*ends: tuple[float, float]) -> tuple[float, float]:
        """Where each stretch leads on the whole flight: what was reached at last."""
        overall[:] = ends
        monkeypatch.setattr(
            filter_error, "_beginnings", lambda *_: ((at(0.1, 0.0), False) for _ in ends)
        )

        def over_all(*_) -> Scored:
            moving, likely = overall.pop(0)
            if np.isnan(moving):
                raise LostError
            return at(moving, likely)

        monkeypatch.setattr(filter_error, "_over_all", over_all)
        none = Beliefs(np.zeros(1), np.zeros((1, 1)), Prior(FIRST.log_noise, FIRST.log_noise))
        every = np.ones(1, dtype=bool)
        search = filter_error._Search(MODEL, flight, none, every, lambda _: None)
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
        moved=np.zeros((1, ravel_pytree(known.means)[0].size)),
    )
    wanted = found + 1e-6 * np.array([[400.0, 20.0], [20.0, 1.0]])
    np.testing.assert_allclose(done.covariance(), wanted, rtol=1e-6)


def test_a_flight_in_pitch_alone_does_not_tell_inertia_from_the_moments_that_it_divides() -> None:
    """Iyy and all of Cm larger by one share are the same motion; roll and yaw tell them apart."""
    none = departures.none(AIRCRAFT, 0)
    by = jax.tree.map(lambda part: jnp.asarray(part, float), none)
    known = FIRST._replace(means=FIRST.means._replace(departures=by))
    every = np.ones(made.COUNT, dtype=bool)
    flight = flown()
    mean = np.asarray(ravel_pytree(known.means)[0])
    chosen = np.zeros(mean.size)
    chosen[in_common.places(known.means)] = 1.0
    held = jax.tree.map(jnp.zeros_like, FIRST.log_noise)
    beliefs = Beliefs(mean, np.diag(chosen), Prior(FIRST.log_noise, held))
    done = settling.rested(MODEL, flight, known, beliefs, every)
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
