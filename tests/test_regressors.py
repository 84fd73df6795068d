from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_sysid import regressors
from gcs_sysid.aircraft import (
    Aircraft,
    CoefficientModel,
    Control,
    Geometry,
    Mass,
    TableTerm,
    Value,
)
from gcs_sysid.errors import RegressorError, UsageError

CONTROLS = ("elevator", "aileron", "rudder")
NAMES = [name for name in (*regressors.VARIABLES, *CONTROLS) if name != "1"]


def key(text: str) -> str:
    return regressors.parse(text, controls=CONTROLS).key


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("1", "1"),
        ("1 * 1", "1"),
        (" alpha ", "alpha"),
        ("alpha*1", "alpha"),
        ("elevator*alpha", "alpha*elevator"),
        ("rudder * elevator*beta", "beta*elevator*rudder"),
        ("alpha*alpha", "alpha^2"),
        ("alpha ^ 2*alpha", "alpha^3"),
        ("elevator*Tc", "Tc*elevator"),
        ("max(0,alpha-.12)", "max(0, alpha - 0.12)"),
        ("max(0.0, alpha + 0.1)", "max(0, alpha + 0.1)"),
        ("max(0, 0.12 - alpha)", "max(0, 0.12 - alpha)"),
        ("max(0, -0.12 - alpha)", "max(0, -0.12 - alpha)"),
        ("max(0, -alpha)", "max(0, - alpha)"),
        ("max(0, alpha - 0)", "max(0, alpha)"),
        ("max(0, alpha - 1e-3)^2*elevator", "max(0, alpha - 0.001)^2*elevator"),
        ("max(0, alpha - 0.1)*max(0, alpha - 0.10)", "max(0, alpha - 0.1)^2"),
    ],
)
def test_equal_products_have_one_text(text: str, canonical: str) -> None:
    assert key(text) == canonical
    assert key(canonical) == canonical


@st.composite
def factors(draw: st.DrawFn) -> str:
    name = draw(st.sampled_from(NAMES))
    power = f"^{draw(st.integers(1, 3))}" if draw(st.booleans()) else ""
    knot = draw(st.floats(-2.0, 2.0))
    form = draw(st.sampled_from(["plain", "above", "below"]))
    if form == "plain":
        return name + power
    if form == "below":
        return f"max(0, {knot!r} - {name}){power}"
    return f"max(0, {name} {'-' if knot >= 0 else '+'} {abs(knot)!r}){power}"


@given(st.lists(factors(), min_size=1, max_size=3), st.randoms(use_true_random=False))
@settings(deadline=None)
def test_canonical_text_survives_parsing_and_order(products: list[str], random) -> None:
    first = key("*".join(products))
    random.shuffle(products)
    assert key(first) == first
    assert key("*".join(products)) == first


@given(st.lists(factors(), min_size=1, max_size=3), st.integers(0, 2**32 - 1))
@settings(deadline=None)
def test_evaluation_equals_python_arithmetic(products: list[str], seed: int) -> None:
    """The second implementation: each factor's text handed to Python itself."""
    sample = np.random.default_rng(seed).uniform(-1.0, 1.0, len(NAMES))
    values = dict(zip(NAMES, sample, strict=True))
    expected = 1.0
    for text in products:
        expected *= eval(text.replace("^", "**"), {"max": max}, dict(values))
    regressor = regressors.parse("*".join(products), controls=CONTROLS)
    found = regressors.evaluate(regressor, {n: np.array([v]) for n, v in values.items()})
    # Merging equal factors reorders a handful of products of float64.
    np.testing.assert_allclose(found, [expected], rtol=1e-13, atol=1e-300)


def test_numpy_and_jax_answer_in_kind_and_alike() -> None:
    regressor = regressors.parse("max(0, alpha - 0.05)^2*elevator", controls=CONTROLS)
    values = {"alpha": np.linspace(-0.1, 0.2, 7), "elevator": np.linspace(0.3, -0.3, 7)}
    numpy_value = regressors.evaluate(regressor, values)
    jax_value = jax.jit(lambda v: regressors.evaluate(regressor, v))(
        {name: jnp.asarray(v) for name, v in values.items()}
    )
    assert isinstance(numpy_value, np.ndarray)
    assert isinstance(jax_value, jax.Array)
    np.testing.assert_allclose(jax_value, numpy_value, rtol=1e-15, atol=1e-18)


def test_constant_is_one_even_where_a_value_is_missing() -> None:
    ones = regressors.evaluate(regressors.parse("1"), {"alpha": np.array([np.nan, 0.1])})
    np.testing.assert_array_equal(ones, [1.0, 1.0])


def test_hinge_gradient_is_one_side_of_the_knot() -> None:
    regressor = regressors.parse("max(0, alpha - 0.12)")
    slope = jax.grad(lambda a: regressors.evaluate(regressor, {"alpha": a}))
    assert slope(0.2) == 1.0
    assert slope(0.1) == 0.0


@pytest.mark.parametrize(
    ("text", "found", "fix"),
    [
        ("alpha*elevatr", "`elevatr` at character 7", "did you mean `elevator`?"),
        ("alpah", "`alpah` at character 1", "did you mean `alpha`?"),
        ("alpha**2", "nothing at character 7", "`alpha^2`"),
        ("", "nothing at character 1", "`alpha^2`"),
        ("alpha + beta", "`alpha + beta` at character 1", "two terms"),
        ("beta* sin(alpha)", "`sin(alpha)` at character 7", "max(0, alpha - 0.12)"),
        ("alpha^-1", "`alpha^-1`", "two terms"),
        ("alpha^0", "exponent 0", "leave the factor out"),
        ("alpha^5*alpha^5", "exponent 10", "lower"),
        ("max(0, gamma - 0.1)", "`gamma` at character 8", "control"),
    ],
)
def test_mistakes_say_where_and_what_to_write(text: str, found: str, fix: str) -> None:
    with pytest.raises(RegressorError) as caught:
        regressors.parse(text, controls=CONTROLS)
    assert found in caught.value.found
    assert fix in caught.value.fix
    assert caught.value.allowed


def test_missing_value_is_named() -> None:
    regressor = regressors.parse("alpha*elevator", controls=CONTROLS)
    with pytest.raises(UsageError, match="needs elevator, given: alpha"):
        regressors.evaluate(regressor, {"alpha": np.zeros(2)})
    with pytest.raises(UsageError, match="at least one array"):
        regressors.evaluate(regressors.parse("1"), {})


def test_variables_are_listed_once() -> None:
    regressor = regressors.parse("alpha*max(0, alpha - 0.1)*Tc", controls=CONTROLS)
    assert regressor.variables == ("alpha", "Tc")
    assert all(v.unit and v.meaning for v in regressors.VARIABLES.values())


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("elevator", "longitudinal"),
        ("flaps", "longitudinal"),
        ("flap_inboard", "longitudinal"),
        ("elevon_symmetric", "longitudinal"),
        ("elevon_differential", "lateral"),
        ("flap_differential", "lateral"),
        ("Aileron", "lateral"),
        ("rudder", "lateral"),
        ("elevon", "unknown"),
        ("elevator_left", "unknown"),
        ("thrust_vane", "unknown"),
    ],
)
def test_control_kind(name: str, kind: str) -> None:
    assert regressors.control_kind(name) == kind


def aircraft(*controls: str, **aerodynamics: CoefficientModel) -> Aircraft:
    return Aircraft(
        name="test",
        mass=Mass(1.0, 1.0, 1.0, 1.0),
        geometry=Geometry(1.0, 1.0, 1.0),
        controls=tuple(Control(name, {name: 1.0}) for name in controls),
        aerodynamics=aerodynamics,
    )


def test_default_structure_without_aerodynamics() -> None:
    assert regressors.default_structure(aircraft("elevator", "aileron", "rudder", "vane")) == {
        "CX": ("1", "alpha", "alpha^2", "elevator", "vane"),
        "CY": ("1", "beta", "phat", "rhat", "aileron", "rudder", "vane"),
        "CZ": ("1", "alpha", "qhat", "elevator", "vane"),
        "Cl": ("1", "beta", "phat", "rhat", "aileron", "rudder", "vane"),
        "Cm": ("1", "alpha", "qhat", "elevator", "vane"),
        "Cn": ("1", "beta", "phat", "rhat", "aileron", "rudder", "vane"),
    }


def test_structure_follows_the_file_and_adds_the_constant() -> None:
    terms = {"elevator*alpha": Value(1.0, 0.1), "alpha": Value(1.0, 0.1)}
    table = TableTerm(
        name="wash",
        regressors=("Tc", "alpha"),
        breakpoints=((0.0, 1.0), (0.0, 1.0)),
        values=((0.0, 0.0), (0.0, 1.0)),
        sigma=0.1,
    )
    structure = regressors.default_structure(
        aircraft("elevator", Cm=CoefficientModel(terms, (table,)))
    )
    assert structure["Cm"] == ("1", "alpha*elevator", "alpha", "Tc")
    assert structure["CZ"] == ("1", "alpha", "qhat", "elevator")
