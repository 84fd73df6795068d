"""Aerodynamic coefficients in body axes from their terms and tables, differentiable."""

from __future__ import annotations

from collections.abc import Mapping

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from gcs_sysid import regressors
from gcs_sysid.aircraft import COEFFICIENTS, Aircraft, CoefficientModel, TableTerm
from gcs_sysid.model import tables

Values = Mapping[str, Mapping[str, Float[ArrayLike, ""]]]
"""Numbers by coefficient, and by regressor key or name of a table."""


def coefficients(
    models: Mapping[str, CoefficientModel],
    terms: Values,
    flow: Mapping[str, Float[ArrayLike, "*sample"]],
    *,
    shares: Values | None = None,
) -> Float[Array, "*sample six"]:
    """CX…Cn in the order of `COEFFICIENTS`; 0 for those that there is no model of.

    Args:
        models: regressors and tables.
        terms: value of every term.
        flow: arrays of one shape, at least one, by name: the variables of
            `regressors.VARIABLES` that the models use, in their units, and the controls [rad].
        shares: factor of every table; without them the tables count as they are.

    Raises:
        UsageError: a variable or control that the models use is not in `flow`.
    """
    rows = []
    for name in COEFFICIENTS:
        total = jnp.zeros_like(next(iter(flow.values())))
        model = models.get(name, CoefficientModel())
        for key in model.terms:
            total = total + terms[name][key] * _regressor(key, flow)
        for item in model.tables:
            share = 1.0 if shares is None else shares[name][item.name]
            total = total + share * table(item, flow)
        rows.append(total)
    return jnp.stack(rows, axis=-1)


def of_aircraft(
    aircraft: Aircraft,
    flow: Mapping[str, Float[ArrayLike, "*sample"]],
    *,
    terms: Values | None = None,
    shares: Values | None = None,
) -> Float[Array, "*sample six"]:
    """The same of an aircraft, with what was learned beyond its terms and tables.

    Args:
        aircraft: regressors, tables, and what was learned.
        flow: likewise.
        terms: value of every term; None as the aircraft has them.
        shares: likewise.
    """
    models = aircraft.aerodynamics
    if terms is None:
        terms = {
            name: {key: item.value for key, item in model.terms.items()}
            for name, model in models.items()
        }
    found = coefficients(models, terms, flow, shares=shares)
    return found if aircraft.beyond is None else found + aircraft.beyond(flow)


def table(
    item: TableTerm, values: Mapping[str, Float[ArrayLike, "*sample"]]
) -> Float[Array, "*sample"]:
    """What one table adds; `values` as `flow` of `coefficients`."""
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
