"""From samples to parts that earned their place, and the learned model in place of a polynomial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import COEFFICIENTS, CoefficientModel, Value
from gcs_sysid.errors import UsageError
from gcs_sysid.estimate.result import AeroModel, CoefficientFit
from gcs_sysid.gp import confidence, fitting, local, noise, samples
from gcs_sysid.gp.aerodynamics import LearnedModel, beyond, untold
from gcs_sysid.gp.confidence import Flown
from gcs_sysid.gp.fitting import Data, Effort, Fitted
from gcs_sysid.gp.learning import Structure
from gcs_sysid.gp.refresh import Settings
from gcs_sysid.model import aerodynamics, rigid_body
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.offline import learned

AIRCRAFT = Path(__file__).resolve().parents[2] / "data" / "aircraft" / "aerosonde.toml"
BREAK = 0.06
NOISE = 0.01
EFFORT = Effort(
    settings=Settings(
        structure=Structure(latents=1), points=60, rows=150, scaffold=12, candidates=80,
        starts=1, steps=25,
    ),
    store=500,
    queries=64,
)  # fmt: skip
INPUTS = ("alpha", "elevator")
OUTPUTS = ("CZ", "Cm")


def missed(alpha: np.ndarray) -> np.ndarray:
    """What a straight line misses of CZ: the stall."""
    return 3.0 * np.maximum(alpha - BREAK, 0.0)


def data(seed: int, count: int = 900) -> Data:
    """CZ stalls, Cm is exactly what its polynomial says; twelve stretches of flight."""
    random = np.random.default_rng(seed)
    inputs = random.uniform((-0.1, -0.2), (0.2, 0.2), (count, 2))
    left = np.stack([missed(inputs[:, 0]), np.zeros(count)], axis=1)
    return Data(
        inputs=inputs,
        values=left + NOISE * random.normal(size=left.shape),
        variance=np.full(left.shape, NOISE**2),
        input_variance=np.zeros(inputs.shape),
        slopes=np.zeros((count, 2, 2)),
        piece=np.arange(count) // (count // 12),
        step=0.1,
    )


def polynomial() -> AeroModel:
    """CZ = −0.3 − 4 α, Cm = −0.5 elevator, each known to a hundredth."""

    def one(keys: tuple[str, ...], value: tuple[float, ...]) -> CoefficientFit:
        size = len(keys)
        return CoefficientFit(
            keys=keys, value=np.array(value), covariance=1e-4 * np.eye(size),
            flight_value=np.array(value), deviations={}, late=np.zeros(size),
            white_deviation=np.ones(size),
            repeated_covariance=1e-4 * np.eye(size), discrepancy=0.15, calibration=1.0,
            residual=0.1, correlation=np.eye(size), excitation=np.ones(size),
            lowest=np.full(size, -1.0), highest=np.ones(size), spread=np.ones(size), samples=900,
            effective_samples=900.0,
        )  # fmt: skip

    return AeroModel(
        fits={"CZ": one(("1", "alpha"), (-0.3, -4.0)), "Cm": one(("elevator",), (-0.5,))},
        controls=("elevator",),
    )


@pytest.fixture(scope="module")
def found() -> Fitted:
    return fitting.fit(data(1), EFFORT)


@pytest.fixture(scope="module")
def model(found: Fitted) -> LearnedModel:
    plain = polynomial()
    return LearnedModel(plain.fits, plain.controls, found, INPUTS, OUTPUTS)


@pytest.fixture(scope="module")
def asked() -> dict[str, np.ndarray]:
    random = np.random.default_rng(2)
    return {"alpha": random.uniform(-0.08, 0.18, 200), "elevator": random.uniform(-0.2, 0.2, 200)}


def test_the_stall_earns_a_process_and_the_straight_line_does_not(found):
    assert found.use_global.tolist() == [True, False]
    assert found.gain.global_part[0] > 0.5
    assert found.gain.global_part[1] < 0.02


def test_the_stall_is_found_within_its_intervals(model, asked):
    predicted = model.predict(asked, measured=True)["CZ"]
    error = predicted.mean - (-0.3 - 4.0 * asked["alpha"] + missed(asked["alpha"]))
    assert np.sqrt(np.mean(error**2)) < 0.01
    # One sd is mostly that of the polynomial, 0.01 √(1 + α²): few of 200 leave two of them.
    assert np.mean(np.abs(error) < 1.96 * predicted.deviation) > 0.95


def test_without_a_process_the_polynomial_answers_alone(model, asked):
    plain, found = (one.predict(asked, measured=True)["Cm"] for one in (polynomial(), model))
    np.testing.assert_array_equal(found.mean, plain.mean)
    np.testing.assert_array_equal(found.deviation, plain.deviation)


def test_derivatives_are_those_of_finite_differences(model, asked):
    step = 1e-5
    ends = [
        model.predict({**asked, "alpha": asked["alpha"] + sign * step}, measured=True)["CZ"].mean
        for sign in (1.0, -1.0)
    ]
    slope = model.derivative("CZ", "alpha", asked)
    if model.process.use_local[0]:
        pytest.fail("the example is meant to have no local part")
    np.testing.assert_allclose(slope.mean, (ends[0] - ends[1]) / (2.0 * step), rtol=1e-5, atol=1e-4)
    below, above = asked["alpha"] < BREAK - 0.04, asked["alpha"] > BREAK + 0.04
    assert abs(slope.mean[below].mean() + 4.0) < 0.3
    assert abs(slope.mean[above].mean() + 1.0) < 0.4


def test_beyond_the_data_it_is_the_polynomial_and_says_so(model):
    far = {"alpha": np.array([0.05, 8.0]), "elevator": np.array([0.0, 0.0])}
    known = model.known("CZ", far)
    assert known[0] > 0.9
    assert known[1] < 1e-3
    gained = (
        model.predict(far, measured=True)["CZ"].mean
        - polynomial().predict(far, measured=True)["CZ"].mean
    )
    np.testing.assert_allclose(gained[1], 0.0, atol=1e-6)
    # Cm has no process, and says nothing of it.
    assert {name: one.tolist() for name, one in untold(model, far).items()} == {"CZ": [False, True]}
    assert untold(polynomial(), far) == {}


def test_inside_the_flight_model_it_is_the_same_and_differentiable(model, asked):
    models = {
        "CZ": CoefficientModel({"1": Value(-0.3, 0.0), "alpha": Value(-4.0, 0.0)}),
        "Cm": CoefficientModel({"elevator": Value(-0.5, 0.0)}),
    }
    described = aircraft_file.load(AIRCRAFT)
    plain = replace(described, aerodynamics=models)
    learned_too = replace(plain, beyond=beyond(model))
    flow = {name: jnp.asarray(value) for name, value in asked.items()}

    def six(aircraft: FlightModel, at: Mapping[str, jax.Array]) -> jax.Array:
        # Values come from elsewhere, as in the filter.
        terms = rigid_body.parameters(plain).aerodynamics
        return aerodynamics.of_aircraft(aircraft.aircraft, at, terms=terms)

    found = np.asarray(jax.jit(six)(FlightModel(learned_too), flow))
    wanted = model.predict(asked, measured=True)
    for name in OUTPUTS:
        column = COEFFICIENTS.index(name)
        np.testing.assert_allclose(found[:, column], wanted[name].mean, atol=1e-9)
    alone = np.asarray(jax.jit(six)(FlightModel(plain), flow))
    np.testing.assert_array_equal(found[:, 0], alone[:, 0])

    def lift(alpha: jax.Array) -> jax.Array:
        return six(FlightModel(learned_too), {"alpha": alpha, "elevator": jnp.asarray(0.0)})[2]

    one = {"alpha": np.array([0.1]), "elevator": np.array([0.0])}
    np.testing.assert_allclose(
        float(jax.jit(jax.grad(lift))(jnp.asarray(0.1))),
        model.derivative("CZ", "alpha", one).mean[0],
    )


def test_another_process_of_the_same_size_is_compiled_once(model):
    made = beyond(model)
    other = replace(made, unit=2.0 * made.unit)
    aircraft = aircraft_file.load(AIRCRAFT)
    one, two = (FlightModel(replace(aircraft, beyond=each)) for each in (made, other))
    assert jax.tree.structure(one) == jax.tree.structure(two)


def test_what_it_adds_to_linear_terms_is_the_rest_of_a_derivative_s_variance(model):
    at = {"alpha": np.array([0.07]), "elevator": np.array([0.05])}
    added = model.linear_variance("CZ", ("1", "alpha", "alpha^2"), at)
    whole, plain = (each.derivative("CZ", "alpha", at).deviation for each in (model, polynomial()))
    np.testing.assert_allclose(added[1], (whole**2 - plain**2)[0], rtol=1e-9)
    here, far = fitting.predict(model.process, np.array([[0.07, 0.05], [50.0, 0.05]])).variance
    # Either way it is what samples leave of a variance ten thousand times as large.
    np.testing.assert_allclose(added[0], here[0], rtol=0.0, atol=1e-10 * far[0])
    assert added[2] == 0.0
    np.testing.assert_array_equal(model.linear_variance("Cm", ("1", "elevator"), at), [0.0, 0.0])


def test_regions_are_the_nearest_points_where_there_is_a_local_part(model, asked):
    assert set(model.region(asked)) == {0}
    rows = samples.rows(model.process.scaling, data(1).inputs, data(1).values, data(1).variance)
    shape = local.Shape(np.ones(3), np.ones(2), np.ones(2))
    process = replace(model.process, local=local.built(shape, local.stored(rows, data(1).piece)))
    points = np.asarray(process.posterior.points.inputs)
    here = points[7] * process.scaling.spread + process.scaling.centre
    at = {name: here[None, column] for column, name in enumerate(INPUTS)}
    number = replace(model, process=process).region(at)[0]
    np.testing.assert_allclose(points[number - 1], points[7])


def test_a_missing_input_is_named(model):
    with pytest.raises(UsageError, match="needs elevator, given: alpha"):
        model.predict({"alpha": np.zeros(1)}, measured=True)


def test_it_comes_back_from_its_arrays(model, asked):
    entry = {"inputs": list(INPUTS), "outputs": list(OUTPUTS)}
    again = learned.from_arrays(polynomial(), entry, learned.arrays(model))
    for name, wanted in model.predict(asked, measured=False).items():
        found = again.predict(asked, measured=False)[name]
        np.testing.assert_array_equal(found.mean, wanted.mean)
        np.testing.assert_array_equal(found.deviation, wanted.deviation)
    with pytest.raises(ValueError, match="do not fit its inputs"):
        learned.from_arrays(polynomial(), {**entry, "inputs": ["alpha"]}, learned.arrays(model))


def test_more_samples_in_place_of_the_first_keep_what_was_judged(found):
    again = fitting.more(found, data(3), EFFORT)
    assert again.use_global.tolist() == [True, False]
    here = np.array([[0.15, 0.0]])
    np.testing.assert_allclose(float(fitting.predict(again, here).mean[0, 0]), 0.27, atol=0.02)


def bent(seed: int, count: int = 900) -> Data:
    """Both coefficients over the angle of attack alone; CZ has a sharp bend and Cm is nothing."""
    made = data(seed, count)
    bend = 3.0 * np.abs(made.inputs[:, :1] - BREAK) * (1.0, 0.0)
    return replace(
        made,
        inputs=made.inputs[:, :1],
        values=made.values - np.stack([missed(made.inputs[:, 0]), np.zeros(count)], 1) + bend,
        input_variance=made.input_variance[:, :1],
        slopes=made.slopes[:, :, :1],
    )


def test_a_bend_earns_the_local_part():
    """Five inducing points round off the bend; neighbours bring back most of what is lost."""
    effort = replace(EFFORT, settings=replace(EFFORT.settings, points=5))
    found = fitting.fit(bent(1), effort)
    assert found.use_local.tolist() == [True, False]
    assert found.gain.local_part[0] > 0.05
    inputs = np.linspace(-0.09, 0.19, 200)[:, None]

    def missing(one: Fitted) -> float:
        wanted = 3.0 * np.abs(inputs[:, 0] - BREAK)
        return float(np.sqrt(np.mean((fitting.predict(one, inputs).mean[:, 0] - wanted) ** 2)))

    for one in (found, fitting.more(found, bent(2), effort)):
        assert one.use_local.tolist() == [True, False]
        alone = replace(one, use_local=np.zeros(2, dtype=bool), local=None)
        assert missing(one) < 0.5 * missing(alone)


def unsure(seed: int, *, told: bool) -> Data:
    """Every other stretch has an angle of attack that is wrong by 0.03, and says so if `told`.

    The polynomial's slope of −4 makes an error of the values of it.
    """
    made = data(seed)
    deviation = 0.03 * (made.piece % 2 == 0)
    wrong = deviation * np.random.default_rng(seed + 7).normal(size=deviation.size)
    inputs, values, slopes = made.inputs.copy(), made.values.copy(), made.slopes.copy()
    inputs[:, 0] += wrong
    values[:, 0] += 4.0 * wrong
    slopes[:, 0, 0] = -4.0
    variance = np.zeros(inputs.shape)
    variance[:, 0] = told * deviation**2
    return replace(made, inputs=inputs, values=values, slopes=slopes, input_variance=variance)


def test_errors_of_inputs_count_where_they_are_told():
    """Density of clean samples under the function that was learned, told and untold [nat]."""
    clean = data(77)
    density = []
    for told in (True, False):
        found = fitting.fit(unsure(1, told=told), replace(EFFORT, local=False))
        belief = fitting.predict(found, clean.inputs)
        total = belief.variance[:, 0] + NOISE**2
        error = clean.values[:, 0] - belief.mean[:, 0]
        density.append(np.mean(0.5 * (np.log(2.0 * np.pi * total) + error**2 / total)))
    assert density[0] < density[1] - 0.3


def wavy(seed: int, count: int) -> Data:
    """Waves with noise of `NOISE`, of which a ninth of the variance is stated."""
    made = data(seed, count)
    alpha, elevator = 20.0 * made.inputs.T
    waves = np.stack([np.sin(alpha) * np.cos(0.5 * elevator), np.cos(alpha + 0.5 * elevator)], 1)
    noise = NOISE * np.random.default_rng(seed + 3).normal(size=waves.shape)
    return replace(made, values=0.1 * waves + noise, variance=made.variance / 9.0)


def test_what_is_not_stated_is_found_on_samples_that_were_not_fitted():
    """Judged by itself the fit is too sure: the waves fit part of the noise away."""
    many = replace(EFFORT.settings, points=120, candidates=120, scaffold=40)
    found = fitting.fit(wavy(1, 240), replace(EFFORT, settings=many, local=False))
    assert found.use_global.all()
    # The variance of 240 samples is itself known to a tenth.
    np.testing.assert_allclose(found.discrepancy, 8.0 / 9.0 * NOISE**2, rtol=0.3)
    fresh = wavy(51, 3000)
    belief = fitting.predict(found, fresh.inputs)
    deviation = np.sqrt(belief.variance + found.discrepancy + fresh.variance)
    inside = np.mean(np.abs(fresh.values - belief.mean) < 1.959964 * deviation, axis=0)
    assert np.all((inside > 0.93) & (inside < 0.97))


def test_the_map_tells_no_data_from_noisy_data(model):
    random = np.random.default_rng(4)
    values = {
        "alpha": random.uniform(0.0, 0.1, 3000),
        "beta": random.uniform(-0.1, 0.1, 3000),
        "elevator": random.uniform(-0.2, 0.2, 3000),
    }
    measured = {"CZ": 0.1 * random.normal(size=3000), "Cm": 0.02 * random.normal(size=3000)}
    flown = Flown(values=MappingProxyType(values), measured=measured, step=0.02)
    found = confidence.over_envelope(model, flown, alpha=(-0.2, 0.3), beta=(-0.1, 0.1))
    told = confidence.document(found)
    lift = np.array(told["coefficients"]["CZ"]["reason"])
    middles = 0.5 * (found.alpha[1:] + found.alpha[:-1])
    assert set(lift[middles > 0.15].ravel()) == {"no data"}
    assert set(lift[middles < -0.1].ravel()) == {"no data"}
    # An elevator known to 0.01 a radian moved by 0.12: 6 % of Cm's spread, and no cell is low.
    assert set(np.array(told["derivatives"]["Cm"]["elevator"]["reason"]).ravel()) == {""}
    lowest = [one for one in told["low"] if one["coefficient"] == "CZ"]
    assert {one["reason"] for one in lowest} >= {"no data"}
    assert told["coefficients"]["CZ"]["sd"].shape == confidence.CELLS
    # Where the coefficient itself varies half as much, what it is known to is no longer enough.
    half = replace(flown, measured={**measured, "CZ": 0.5 * measured["CZ"]})
    noisy = confidence.over_envelope(model, half, alpha=(-0.2, 0.3), beta=(-0.1, 0.1))
    told = confidence.document(noisy)
    lift = np.array(told["coefficients"]["CZ"]["reason"])
    assert set(lift[noisy.seconds >= confidence.SHORTEST]) == {"noisy data"}
    # Its slope is known well enough wherever there was flight.
    slopes = {one["reason"] for one in told["low"] if one["derivative"] == "alpha"}
    assert slopes == {"no data"}


def test_samples_that_repeat_each_other_are_counted():
    """A first-order process of correlation r has (1 + r)/(1 − r) samples that say the same."""
    random = np.random.default_rng(5)
    process = np.zeros(20_000)
    for index in range(1, process.size):
        process[index] = 0.8 * process[index - 1] + random.normal()
    piece = np.zeros(process.size, dtype=int)
    assert noise.repeats(process, piece, 0.02) == pytest.approx(9.0, rel=0.15)
    assert noise.repeats(random.normal(size=20_000), piece, 0.02) == pytest.approx(1.0, abs=0.2)


def test_uncertain_inputs_add_to_the_noise():
    found = noise.with_inputs(np.array([[0.04]]), np.array([[[2.0, 0.0]]]), np.array([[0.01, 9.0]]))
    np.testing.assert_allclose(found, [[0.08]])
