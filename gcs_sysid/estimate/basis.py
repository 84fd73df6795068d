"""Regressor columns and their exact derivatives, for fitting and for prediction alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid import regressors

Values = Mapping[str, Float[np.ndarray, " sample"]]


def columns(
    keys: Sequence[str], controls: Sequence[str], values: Values
) -> Float[np.ndarray, "sample term"]:
    """One column a regressor."""
    parsed = [regressors.parse(key, controls=controls) for key in keys]
    return np.stack([regressors.evaluate(item, values) for item in parsed], axis=1)


def slopes(
    keys: Sequence[str], controls: Sequence[str], values: Values, variable: str
) -> Float[np.ndarray, "sample term"]:
    """Derivative of every column with respect to one variable."""
    parsed = [regressors.parse(key, controls=controls) for key in keys]
    arrays = {name: jnp.asarray(value) for name, value in values.items()}

    def moved(changed: jax.Array) -> jax.Array:
        replaced = {**arrays, variable: changed}
        return jnp.stack([regressors.evaluate(item, replaced) for item in parsed], axis=1)

    point = arrays[variable]
    return np.asarray(jax.jvp(moved, (point,), (jnp.ones_like(point),))[1])


def correlation(columns: Float[np.ndarray, "sample term"]) -> Float[np.ndarray, "term term"]:
    """Of regressors; zero with a constant one."""
    centred = columns - columns.mean(axis=0)
    size = np.sqrt(np.sum(centred**2, axis=0))
    safe = np.where(size > 1e-12 * np.sqrt(columns.shape[0]), size, np.inf)
    return (centred / safe).T @ (centred / safe)
