"""What all flights of an aircraft have in common: derivatives, and its body where that is sought.

In the flat vector of `Means` derivatives come first; mass, inertia and thrust lie behind the
sensors, which are each flight's own.
"""

from __future__ import annotations

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Float, Int

from gcs_sysid.frames import Array
from gcs_sysid.model.aided import Means

BODY = "body"
"""Stands for the coefficient in the keys of mass, inertia and thrust."""
PARTS = ("mass", "Ixx", "Iyy", "Izz", "thrust")
Key = tuple[str, str]


def derivative_keys(aerodynamics: Mapping[str, Mapping[str, Array]]) -> tuple[Key, ...]:
    """Coefficient and regressor of every derivative in the order of the flat vector.

    They come first in it: `Means.aerodynamics` is the first field, and dictionaries are flattened
    in the order of their sorted keys.
    """
    return tuple((name, key) for name in sorted(aerodynamics) for key in sorted(aerodynamics[name]))


def keys(means: Means) -> tuple[Key, ...]:
    """Of all that flights have in common, derivatives first."""
    found = derivative_keys(means.aerodynamics)
    if means.departures is None:
        return found
    return (*found, *((BODY, part) for part in PARTS))


def places(means: Means) -> Int[np.ndarray, " key"]:
    """Where they are in the flat vector."""
    flat, unravel = ravel_pytree(means)
    number = unravel(jnp.arange(flat.size, dtype=flat.dtype))
    first = np.arange(len(derivative_keys(means.aerodynamics)))
    by = number.departures
    if by is None:
        return first
    body = [by.mass[None], by.inertia, by.thrust[None]]
    return np.concatenate([first, np.concatenate(body).astype(int)])


def values(means: Means) -> Float[np.ndarray, " key"]:
    """What they are."""
    return np.asarray(ravel_pytree(means)[0])[places(means)]


def with_values(means: Means, found: Float[np.ndarray, " key"]) -> Means:
    """The same means with other values of them."""
    flat, unravel = ravel_pytree(means)
    return unravel(flat.at[places(means)].set(jnp.asarray(found)))
