"""Aerodynamic coefficients in body axes from their terms and tables, differentiable."""

from __future__ import annotations

from collections.abc import Mapping

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from gcs_sysid import regressors
from gcs_sysid.aircraft import CoefficientModel, TableTerm
from gcs_sysid.model import tables


def coefficient(
    model: CoefficientModel, values: Mapping[str, Float[ArrayLike, "*sample"]]
) -> Float[Array, "*sample"]:
    """One coefficient: Σ value·regressor + Σ tables.

    Args:
        model: terms and tables as the aircraft file gives them; a model without any is 0.
        values: arrays of one shape, at least one, by name: the variables of
            `regressors.VARIABLES` that the model uses, in their units, and the controls [rad].

    Returns:
        The coefficient, dimensionless, at every sample.

    Raises:
        UsageError: a variable or control that the model uses is not in `values`.
    """
    total = jnp.zeros_like(next(iter(values.values())))
    for key, value in model.terms.items():
        total = total + value.value * _regressor(key, values)
    return total + tables_of(model, values)


def tables_of(
    model: CoefficientModel, values: Mapping[str, Float[ArrayLike, "*sample"]]
) -> Float[Array, "*sample"]:
    """What the tables of one coefficient add; arguments as for `coefficient`."""
    total = jnp.zeros_like(next(iter(values.values())))
    for item in model.tables:
        total = total + table(item, values)
    return total


def table(
    item: TableTerm, values: Mapping[str, Float[ArrayLike, "*sample"]]
) -> Float[Array, "*sample"]:
    """What one table adds; `values` as for `coefficient`."""
    where = [_regressor(key, values) for key in item.regressors]
    breakpoints = [jnp.asarray(points) for points in item.breakpoints]
    if len(where) == 1:
        return tables.linear(where[0], breakpoints[0], jnp.asarray(item.values))
    return tables.bilinear(*where, *breakpoints, jnp.asarray(item.values))


def _regressor(
    key: str, values: Mapping[str, Float[ArrayLike, "*sample"]]
) -> Float[Array, "*sample"]:
    controls = [name for name in values if name not in regressors.VARIABLES]
    return jnp.asarray(regressors.evaluate(regressors.parse(key, controls=controls), values))
