from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from gcs_sysid.model import tables

ROWS = np.array([-0.2, 0.0, 0.5, 0.6])
COLUMNS = np.array([10.0, 20.0, 40.0])
VALUES = np.random.default_rng(1).normal(size=(4, 3))


@given(st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(0.0, 60.0)), min_size=8, max_size=8))
@settings(deadline=None, max_examples=30)
def test_bilinear_equals_scipy_inside_and_is_held_outside(points: list[tuple]) -> None:
    x, y = np.array(points).T
    clamped = np.stack(
        [np.clip(x, ROWS[0], ROWS[-1]), np.clip(y, COLUMNS[0], COLUMNS[-1])], axis=-1
    )
    expected = RegularGridInterpolator((ROWS, COLUMNS), VALUES)(clamped)
    found = jax.jit(tables.bilinear)(x, y, ROWS, COLUMNS, VALUES)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-13)


def test_linear_equals_numpy_on_any_shape() -> None:
    x = np.linspace(-0.5, 1.0, 60).reshape(3, 20)
    np.testing.assert_allclose(
        tables.linear(x, ROWS, VALUES[:, 0]), np.interp(x, ROWS, VALUES[:, 0]), atol=1e-15
    )


def test_breakpoints_give_the_table_itself() -> None:
    x, y = np.meshgrid(ROWS, COLUMNS, indexing="ij")
    np.testing.assert_allclose(tables.bilinear(x, y, ROWS, COLUMNS, VALUES), VALUES, atol=1e-15)


def test_slope_is_that_of_the_cell_and_zero_outside() -> None:
    slope = jax.grad(lambda x: tables.linear(x, jnp.asarray(ROWS), jnp.asarray(VALUES[:, 0])))
    inside = (VALUES[2, 0] - VALUES[1, 0]) / (ROWS[2] - ROWS[1])
    assert slope(0.2) == pytest.approx(inside, rel=1e-14)
    assert slope(-0.3) == 0.0
    assert slope(0.7) == 0.0
