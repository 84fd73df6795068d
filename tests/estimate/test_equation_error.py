from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.estimate import coefficients, equation_error
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.estimate.equation_error import Problem
from gcs_sysid.estimate.result import CoefficientFit, Prior
from gcs_sysid.estimate.verdict import judge
from tests.estimate import made_motion, made_problems
from tests.estimate.made_problems import KEYS, TRUE, coloured, columns, problem


def solve(stated: Problem, prior: Prior | None = None) -> CoefficientFit:
    return equation_error.solve(stated, prior)


def noisy(seed: int, *, count: int = 2000, memory: float = 0.9) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    matrix = columns(generator, count)
    return matrix, matrix @ TRUE + 0.01 * coloured(generator, count, memory)


def test_noise_free_data_give_the_parameters_back() -> None:
    """Limited by the condition of XᵀX, about 1e6 here, times the rounding of a double."""
    matrix = columns(np.random.default_rng(1), 2000)
    fit = solve(problem(matrix, matrix @ TRUE))
    assert fit.value == pytest.approx(TRUE, rel=1e-9)
    assert fit.flight_value == pytest.approx(TRUE, rel=1e-9)
    assert fit.deviation == pytest.approx(np.zeros(TRUE.size), abs=1e-9)


def test_weighted_by_the_noise_it_is_the_textbook_estimate() -> None:
    """Against NumPy's least squares on rows divided by their own standard deviation."""
    matrix, measured = noisy(2)
    noise = np.random.default_rng(3).uniform(0.005, 0.05, measured.size)
    expected = np.linalg.lstsq(matrix / noise[:, None], measured / noise, rcond=None)[0]
    assert solve(problem(matrix, measured, noise=noise)).value == pytest.approx(expected, rel=1e-9)


def test_white_standard_errors_are_those_of_the_textbook() -> None:
    matrix, measured = noisy(4)
    value, square = np.linalg.lstsq(matrix, measured, rcond=None)[:2]
    assert value == pytest.approx(solve(problem(matrix, measured)).value)
    covariance = np.linalg.inv(matrix.T @ matrix) * square[0] / (measured.size - TRUE.size)
    assert solve(problem(matrix, measured)).white_deviation == pytest.approx(
        np.sqrt(np.diagonal(covariance)), rel=1e-6
    )


def naive_covariance(matrix: np.ndarray, measured: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """The double sum over samples of the same piece, written out."""
    inverse = np.linalg.inv(matrix.T @ matrix)
    residual = measured - matrix @ inverse @ matrix.T @ measured
    lags = round(equation_error.LONGEST_LAG / made_problems.STEP)
    count, terms = matrix.shape
    products, pairs = np.zeros(lags + 1), np.zeros(lags + 1)
    for i in range(count):
        for j in range(i, min(i + lags + 1, count)):
            if piece[i] == piece[j]:
                products[j - i] += residual[i] * residual[j]
                pairs[j - i] += 1
    total = np.zeros((terms, terms))
    for i in range(count):
        for j in range(max(0, i - lags), min(i + lags + 1, count)):
            lag = abs(i - j)
            if piece[i] == piece[j]:
                taper = 1.0 - lag / (lags + 1.0)
                weight = taper * products[lag] / pairs[lag]
                total += weight * np.outer(matrix[i], matrix[j])
    return inverse @ total @ inverse * count / (count - terms)


def test_coloured_covariance_is_the_double_sum() -> None:
    """Second implementation, two pieces of which one is shorter than the longest lag."""
    matrix, measured = noisy(5, count=420)
    piece = np.where(np.arange(420) < 330, 7, 8)
    fit = solve(problem(matrix, measured, piece=piece))
    assert fit.covariance == pytest.approx(naive_covariance(matrix, measured, piece), rel=1e-8)


@pytest.mark.parametrize("memory", [0.0, 0.9, 0.95])
def test_intervals_hold_the_truth_as_often_as_they_say(memory: float) -> None:
    """300 flights of a minute: a share of 0.95 is found within 0.013, so 0.90 is four sigmas off.

    Residuals remembered for 0.2 and 0.4 s at 50 Hz are those seen in flights.
    """
    held, white = made_problems.coverage(memory, seeds=range(300))
    assert np.all((held >= 0.90) & (held <= 0.98)), held
    if memory > 0.0:
        assert np.all(white < 0.6), "textbook intervals must fail, or the test proves nothing"


def systematic_coverage(sigma: tuple[float, float], *, part: str) -> tuple[float, float]:
    """Share of intervals that hold CZ_alpha, by all parts and without the scale part."""
    generator = np.random.default_rng(6)
    matrix = columns(generator, 500)
    truth = matrix @ TRUE
    thrust = 0.05 + 0.3 * matrix[:, 1]
    held = without = 0
    for _ in range(400):
        mass, push = generator.standard_normal(2) * sigma
        inertial = truth + thrust
        measured = truth + mass * inertial - push * thrust
        measured = measured + 0.0005 * coloured(generator, 500, 0.5)
        fit = solve(
            problem(matrix, measured, systematic=np.stack([inertial, -thrust], axis=1), sigma=sigma)
        )
        error = abs(fit.value[1] - TRUE[1])
        held += error < 1.96 * fit.deviation[1]
        without += error < 1.96 * fit.deviations["noise"][1]
    assert part in fit.deviations
    return held / 400, without / 400


@pytest.mark.parametrize("sigma", [(0.03, 0.0), (0.0, 0.15), (0.02, 0.1)], ids=str)
def test_wrong_mass_and_thrust_are_inside_the_interval(sigma: tuple[float, float]) -> None:
    """400 draws: 0.95 within 0.011. What does not shrink with samples must not be left out."""
    held, without = systematic_coverage(sigma, part="scale")
    assert 0.92 < held < 0.98
    assert without < 0.6


def test_scale_errors_do_not_shrink_with_more_samples() -> None:
    deviation = []
    for count in (1000, 16000):
        matrix, measured = noisy(7, count=count, memory=0.0)
        part = np.stack([measured, np.zeros(count)], axis=1)
        fit = solve(problem(matrix, measured, systematic=part, sigma=(0.05, 0.0)))
        deviation.append((fit.deviations["noise"][1], fit.deviations["scale"][1]))
    (noise_short, scale_short), (noise_long, scale_long) = deviation
    assert noise_long < 0.4 * noise_short
    assert scale_long == pytest.approx(scale_short, rel=0.1)
    assert scale_long == pytest.approx(0.05 * abs(TRUE[1]), rel=0.1)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.6])
def test_errors_of_alpha_are_inside_the_interval(share: float) -> None:
    """Classical measurement error: `share` of what was seen of alpha is error.

    The estimate is pulled to (1 − share) of the truth every time; the interval must hold that
    at least nine times in ten, and one without this part must not.
    """
    variance = np.array([0.0, share * made_problems.SIZE[1] ** 2, 0.0, 0.0])
    held = without = 0
    for seed in range(200):
        generator = np.random.default_rng(seed)
        matrix = columns(generator, 1000)
        seen = matrix.copy()
        seen[:, 1] = np.sqrt(1.0 - share) * matrix[:, 1]
        true = seen @ TRUE
        seen[:, 1] += np.sqrt(variance[1]) * generator.standard_normal(1000)
        measured = true + 0.002 * coloured(generator, 1000, 0.9)
        fit = solve(problem(seen, measured, error=variance))
        error = abs(fit.value[1] - TRUE[1])
        held += error < 1.96 * fit.deviation[1]
        without += error < 1.96 * np.hypot(fit.deviations["noise"], fit.deviations["scale"])[1]
    assert held / 200 >= 0.9
    assert without / 200 < 0.1


def test_the_pull_is_the_classical_attenuation() -> None:
    """With one regressor the truth is estimate/(1 − share) (Fuller 1987, eq. 1.1.7)."""
    generator = np.random.default_rng(8)
    seen = 0.05 * generator.standard_normal((5000, 1))
    measured = -0.7 * seen[:, 0]
    share = 0.25
    variance = np.array([share * float(np.mean(seen**2))])
    fit = solve(problem(seen, measured, keys=("alpha",), error=variance))
    assert fit.deviations["regressor"][0] == pytest.approx(0.7 * share / (1.0 - share), rel=1e-9)


def test_a_slope_that_gusts_hide_is_looked_for_in_what_is_left() -> None:
    """y = θ(x − g), and the aircraft turns into its gusts until nothing is seen of θ.

    With x and n alike in size and without anything in common, g = x + d n gives a slope of 0 and
    leaves θ d |x|. Errors of the stated share s that hid a slope Δ would have left √((1−s)/s) Δ;
    what is noise of the measurement hides nothing.
    """
    generator = np.random.default_rng(9)
    both, _ = np.linalg.qr(generator.standard_normal((5000, 2)))
    seen, other = 0.05 * np.sqrt(5000.0) * both.T
    slope, off, share = -5.0, 0.7, 0.3
    measured = slope * (seen - (seen + off * other))
    variance = np.array([share * float(np.mean(seen**2))])
    left, noise = abs(slope) * off * 0.05, 0.1
    fit = solve(problem(seen[:, None], measured, keys=("alpha",), noise=noise, error=variance))
    assert fit.value[0] == pytest.approx(0.0, abs=1e-9)
    beyond = np.sqrt(left**2 - noise**2)
    wanted = np.hypot(beyond, equation_error.ANSWERED * left) / 0.05
    wanted *= np.sqrt(share / (1.0 - share))
    assert fit.deviations["regressor"][0] == pytest.approx(wanted, rel=1e-9)
    assert abs(slope) < 3.0 * wanted


@pytest.mark.parametrize(("answered", "least", "most"), [(None, 0.9, 1.0), (0.0, 0.0, 0.5)])
def test_a_control_that_answers_gusts_is_inside_the_interval(
    answered: float | None, least: float, most: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half of what is seen of alpha is gust; the elevator goes with it by a correlation of 0.1.

    Where the slope over alpha is believed, rightly, what the gust does is put down to the elevator:
    without what its answers may do, intervals of 95 % hold less than half as often. A correlation
    of ρ moves it by ρ/√(1−s) of what is left, of which `ANSWERED` √(s/(1−s)) is counted: here up to
    a correlation of 0.14.
    """
    if answered is not None:
        monkeypatch.setattr(equation_error, "ANSWERED", answered)
    size, truth = made_problems.SIZE[1:4:2], TRUE[1:4:2]
    held = 0
    for seed in range(100):
        generator = np.random.default_rng(seed)
        felt, gust, other = generator.standard_normal((3, 2000))
        turned = np.clip(generator.normal(0.0, 0.1), -0.9, 0.9)
        moved = turned * gust + np.sqrt(1.0 - turned**2) * other
        seen = np.stack([(felt + gust) / np.sqrt(2.0), moved], axis=1) * size
        measured = truth[0] * size[0] * felt / np.sqrt(2.0) + truth[1] * seen[:, 1]
        stated = problem(
            seen, measured, keys=("alpha", "elevator"), error=np.array([0.5 * size[0] ** 2, 0.0])
        )
        fit = solve(stated, belief({"alpha": truth[0]}, 0.01))
        held += abs(fit.value[1] - truth[1]) < 1.96 * fit.deviation[1]
    assert least <= held / 100 <= most


def test_a_control_that_never_moved_leaves_the_intervals_of_the_others_numbers() -> None:
    generator = np.random.default_rng(10)
    seen = np.zeros((2000, 2))
    seen[:, 0] = 0.05 * generator.standard_normal(2000)
    measured = -0.7 * seen[:, 0] + 0.01 * generator.standard_normal(2000)
    error = np.array([0.3 * 0.05**2, 0.0])
    both = solve(problem(seen, measured, keys=("alpha", "rudder"), error=error))
    alone = solve(problem(seen[:, :1], measured, keys=("alpha",), error=error[:1]))
    assert np.isfinite(both.covariance).all()
    assert both.deviations["regressor"][0] == pytest.approx(
        alone.deviations["regressor"][0], rel=1e-9
    )


def belief(values: dict[str, float], sigma: float) -> Prior:
    return Prior(values, dict.fromkeys(values, sigma))


def test_a_prior_is_weighed_as_bayes_says() -> None:
    """Sum of precisions, written with inverses instead of gains."""
    matrix, measured = noisy(9)
    flight = solve(problem(matrix, measured))
    believed = np.array([0.0, -0.9, -10.0, -1.0])
    sigma = np.array([0.01, 0.02, 3.0, 0.05])
    prior = Prior(
        dict(zip(KEYS, believed.tolist(), strict=True)),
        dict(zip(KEYS, sigma.tolist(), strict=True)),
    )
    precision = np.linalg.inv(flight.covariance)
    covariance = np.linalg.inv(precision + np.diag(sigma**-2.0))
    mean = covariance @ (precision @ flight.value + believed / sigma**2)
    posterior = solve(problem(matrix, measured), prior)
    assert posterior.value == pytest.approx(mean, rel=1e-7)
    assert posterior.covariance == pytest.approx(covariance, rel=1e-6, abs=1e-15)
    assert posterior.flight_value == pytest.approx(flight.value)


def test_a_prior_on_some_terms_leaves_the_others_free() -> None:
    """As with an infinitely wide prior on the rest."""
    matrix, measured = noisy(10)
    some = solve(problem(matrix, measured), belief({"alpha": -0.9}, 0.01))
    wide = Prior(
        {"1": 0.0, "alpha": -0.9, "qhat": 0.0, "elevator": 0.0},
        {"1": 1e5, "alpha": 0.01, "qhat": 1e5, "elevator": 1e5},
    )
    assert some.value == pytest.approx(solve(problem(matrix, measured), wide).value, rel=1e-6)


def test_a_firm_prior_wins_and_a_vague_one_does_not_matter() -> None:
    matrix, measured = noisy(11)
    free = solve(problem(matrix, measured))
    firm = solve(problem(matrix, measured), belief({"alpha": -2.0}, 1e-9))
    vague = solve(problem(matrix, measured), belief({"alpha": -2.0}, 1e6))
    assert firm.value[1] == pytest.approx(-2.0, rel=1e-6)
    assert firm.deviation[1] == pytest.approx(1e-9, rel=1e-3)
    assert vague.value == pytest.approx(free.value, rel=1e-6)


@given(st.lists(st.floats(0.01, 100.0), min_size=4, max_size=4), st.floats(0.01, 100.0))
def test_units_of_regressors_and_coefficient_do_not_matter(units: list[float], unit: float) -> None:
    """Degrees for radians divide the derivative and its deviations alike."""
    matrix, measured = noisy(12, count=300)
    error = np.array([0.0, 4e-4, 0.0, 1e-4])
    scale = np.array(units)
    part = np.stack([measured, 0.1 * measured], axis=1)
    usual = solve(problem(matrix, measured, error=error, systematic=part, sigma=(0.02, 0.1)))
    other = solve(
        problem(
            matrix * scale,
            measured * unit,
            noise=0.01 * unit,
            error=error * scale**2,
            systematic=part * unit,
            sigma=(0.02, 0.1),
        )
    )
    assert other.value == pytest.approx(usual.value * unit / scale, rel=1e-6)
    for origin, deviation in usual.deviations.items():
        assert other.deviations[origin] == pytest.approx(deviation * unit / scale, rel=1e-5)


def test_columns_that_never_moved_are_reported_as_not_known() -> None:
    """A control held still left least squares with a zero column and a deviation of zero: `yes`."""
    matrix, measured = noisy(13)
    still = matrix.copy()
    still[:, 3] = 0.0
    fit = solve(problem(still, measured))
    assert np.all(np.isfinite(fit.covariance))
    verdict = judge(fit, 3, None)
    assert verdict.answer == "no"
    assert verdict.reason == "elevator hardly moved: 0 % of the variation"
    assert fit.deviation[3] > 100.0 * abs(TRUE[3])
    others = solve(problem(still[:, :3], measured, keys=KEYS[:3]))
    assert fit.value[:3] == pytest.approx(others.value, rel=1e-9)
    # One term more was counted as fitted: 1/4000 of the deviation.
    assert fit.deviation[:3] == pytest.approx(others.deviation, rel=1e-3)


def test_a_control_that_followed_another_is_reported_with_its_name() -> None:
    """Only their sum is known; a pseudo-inverse alone splits it between them and calls it sure."""
    matrix, measured = noisy(14)
    tied = matrix.copy()
    tied[:, 3] = -0.5 * tied[:, 1]
    fit = solve(problem(tied, measured))
    for index, other in ((1, "elevator"), (3, "alpha")):
        verdict = judge(fit, index, None)
        assert verdict.answer == "no"
        assert verdict.reason == f"{KEYS[index]} moved together with {other} (correlation -1.00)"
    spread = np.einsum("si,ij,sj->s", tied, fit.covariance, tied)
    assert np.sqrt(spread.max()) < 0.02, "along what was flown the prediction is known all the same"


def test_a_control_held_off_centre_cannot_be_told_from_the_constant() -> None:
    matrix, measured = noisy(15)
    held = matrix.copy()
    held[:, 3] = -0.1
    fit = solve(problem(held, measured))
    constant = judge(fit, 0, None)
    assert constant.answer == "no"
    assert constant.reason == "elevator did not move and cannot be told from the constant"
    assert judge(fit, 3, None).answer == "no"
    assert judge(fit, 1, None).answer != "no"


def test_a_prior_steps_in_where_the_flight_says_nothing() -> None:
    matrix, measured = noisy(16)
    matrix[:, 3] = 0.0
    fit = solve(problem(matrix, measured), belief({"elevator": -0.9}, 0.05))
    assert fit.value[3] == pytest.approx(-0.9, rel=1e-4)
    assert fit.deviation[3] == pytest.approx(0.05, rel=1e-4)


# Whole fits, from samples


@pytest.fixture(scope="module")
def samples() -> Samples:
    motion = made_motion.fly()
    return coefficients.measure(
        motion.states,
        made_motion.aircraft(),
        controls=motion.controls,
        thrust=motion.thrust,
        refused={},
        motion=motion.angular,
    )


STRUCTURE = {name: tuple(terms) for name, terms in made_motion.TRUE.items()}


def part_of(samples: Samples, rows: slice) -> Samples:
    def cut(values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {name: value[rows] for name, value in values.items()}

    fields = (
        "regressors", "regressor_variance", "measured", "noise", "mass_part", "thrust_part",
    )  # fmt: skip
    return replace(
        samples,
        time=samples.time[rows],
        qbar=samples.qbar[rows],
        **{field: cut(dict(getattr(samples, field))) for field in fields},
    )


def forces(model: object) -> np.ndarray:
    return np.concatenate([model.fits[name].value for name in COEFFICIENTS[:3]])


def test_two_flights_weigh_as_one_of_their_length(samples: Samples) -> None:
    """Forces, which no smoother joins across the cut."""
    aircraft = made_motion.aircraft()
    whole = equation_error.fit([samples], aircraft, STRUCTURE, [np.zeros(1200, dtype=int)])
    halves = [part_of(samples, slice(0, 600)), part_of(samples, slice(600, 1200))]
    pieces = [np.zeros(600, dtype=int), np.zeros(600, dtype=int)]
    both = equation_error.fit(halves, aircraft, STRUCTURE, pieces)
    assert forces(both) == pytest.approx(forces(whole), rel=1e-7, abs=1e-9)
    assert both.fits["CZ"].samples == 1200


def test_equal_maneuver_numbers_of_two_flights_are_different_maneuvers(samples: Samples) -> None:
    """Residuals of two flights were never neighbours, so they cannot be correlated."""
    aircraft = made_motion.aircraft()
    halves = [part_of(samples, slice(0, 600)), part_of(samples, slice(600, 1200))]
    same = [np.full(600, 3), np.full(600, 3)]
    other = [np.full(600, 3), np.full(600, 4)]
    assert equation_error.fit(halves, aircraft, STRUCTURE, same).fits[
        "CZ"
    ].covariance == pytest.approx(
        equation_error.fit(halves, aircraft, STRUCTURE, other).fits["CZ"].covariance
    )


def test_rows_outside_any_maneuver_take_no_part(samples: Samples) -> None:
    aircraft = made_motion.aircraft()
    spoiled = replace(
        samples, measured={k: np.where(np.arange(1200) < 900, v, 9.0) for k, v in
                           samples.measured.items()}
    )  # fmt: skip
    piece = np.where(np.arange(1200) < 900, 1, -1)
    model = equation_error.fit([spoiled], aircraft, STRUCTURE, [piece])
    for name in COEFFICIENTS[:3]:
        assert model.fits[name].value == pytest.approx(
            list(made_motion.TRUE[name].values()), rel=1e-4, abs=1e-6
        )
        assert model.fits[name].samples == 900


def test_a_coefficient_refused_in_one_flight_is_fitted_in_none(samples: Samples) -> None:
    without = replace(samples, refused={"CX": "no accelerometer"})
    piece = np.zeros(1200, dtype=int)
    model = equation_error.fit(
        [samples, without], made_motion.aircraft(), STRUCTURE, [piece, piece]
    )
    assert set(model.fits) == set(COEFFICIENTS) - {"CX"}


def test_sigmas_of_the_aircraft_file_enter_forces_and_moments(samples: Samples) -> None:
    """mass_sigma scales forces, inertia_sigma moments: one and five per cent of every derivative.

    The parts of mass and thrust add up to the coefficient, so that without thrust error the scale
    part is the relative error itself.
    """
    stated = made_motion.aircraft()
    engine = replace(stated.propulsion[0], thrust_sigma=0.0)
    piece = [np.zeros(1200, dtype=int)]
    model = equation_error.fit([samples], replace(stated, propulsion=(engine,)), STRUCTURE, piece)
    force, moment = model.fits["CY"], model.fits["Cl"]
    beta = force.keys.index("beta")
    assert force.deviations["scale"][beta] == pytest.approx(0.01 * 0.49, rel=0.2)
    aileron = moment.keys.index("aileron")
    assert moment.deviations["scale"][aileron] == pytest.approx(0.05 * 0.165, rel=0.2)
