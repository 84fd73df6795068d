from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from gcs_sysid.aircraft import COEFFICIENTS, CoefficientModel, TableTerm, Value
from gcs_sysid.errors import RegressorError, UsageError
from gcs_sysid.model import aerodynamics

TABLE = TableTerm(
    name="wash",
    regressors=("alpha", "elevator*Tc"),
    breakpoints=((-0.1, 0.0, 0.2), (0.0, 0.1)),
    values=((0.0, 0.1), (0.0, 0.2), (0.0, 0.6)),
    sigma=0.1,
)
CURVE = TableTerm(
    name="stall",
    regressors=("alpha",),
    breakpoints=((0.0, 0.1, 0.2),),
    values=(0.0, 0.0, -0.3),
    sigma=0.1,
)
MODEL = CoefficientModel(
    terms={
        "1": Value(0.0135, 0.001),
        "alpha": Value(-2.74, 0.2),
        "qhat": Value(-38.21, 3.0),
        "elevator*Tc": Value(0.5, 0.1),
        "max(0, alpha - 0.12)^2": Value(-4.0, 1.0),
    },
    tables=(TABLE, CURVE),
)
VALUES = {
    "alpha": np.array([0.15, -0.05]),
    "qhat": np.array([0.001, -0.002]),
    "elevator": np.array([-0.1, 0.2]),
    "Tc": np.array([0.5, 0.25]),
}


def lift(values: Mapping[str, Any], model: CoefficientModel = MODEL) -> Float[Array, "*sample"]:
    """Of an aircraft that has a model of CZ only."""
    terms = {"CZ": {key: item.value for key, item in model.terms.items()}}
    return aerodynamics.coefficients({"CZ": model}, terms, values)[..., COEFFICIENTS.index("CZ")]


def test_terms_and_tables_add_up() -> None:
    """Second implementation: the sum written out, the tables read by hand."""
    a, q, e = VALUES["alpha"], VALUES["qhat"], VALUES["elevator"] * VALUES["Tc"]
    terms = 0.0135 - 2.74 * a - 38.21 * q + 0.5 * e - 4.0 * np.maximum(a - 0.12, 0.0) ** 2
    # elevator·Tc is -0.05, held at 0, and 0.05, half way; alpha -0.05 is half way from 0.1 to 0.2.
    wash = np.array([0.0, 0.5 * 0.15])
    stall = np.array([-0.15, 0.0])
    found = jax.jit(lift)(VALUES)
    np.testing.assert_allclose(found, terms + wash + stall, rtol=1e-13)


def test_no_model_is_no_force() -> None:
    np.testing.assert_array_equal(lift(VALUES, CoefficientModel()), [0.0, 0.0])


@pytest.mark.parametrize("name", list(VALUES))
def test_gradient_equals_finite_differences(name: str) -> None:
    point = {key: jnp.asarray(values[1] + 0.011) for key, values in VALUES.items()}

    def at(value: jax.Array) -> jax.Array:
        return lift(point | {name: value})

    step = 1e-6
    numeric = (at(point[name] + step) - at(point[name] - step)) / (2.0 * step)
    # Rounding of a coefficient of 0.3: 1e-16 / 1e-6.
    assert jax.grad(at)(point[name]) == pytest.approx(float(numeric), rel=1e-8, abs=1e-9)


def test_missing_values_are_named() -> None:
    with pytest.raises(UsageError, match="qhat"):
        lift({k: v for k, v in VALUES.items() if k != "qhat"})
    with pytest.raises(RegressorError, match="elevator"):
        lift({k: v for k, v in VALUES.items() if k != "elevator"})
