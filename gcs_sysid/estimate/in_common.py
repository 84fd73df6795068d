"""What all flights of an aircraft have in common: derivatives, and its body where that is sought.

In the flat vector of `Means` derivatives come first; mass, inertia and thrust lie behind the
sensors, which are each flight's own.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

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


class Said(NamedTuple):
    """What flights say of what they have in common, whatever was believed before; it adds up.

    Attributes:
        information: Λ, were the lag of the moments what it seems to be.
        told: Λ times the values that the flights say.
        late: Λ times what these go by where the lag is off by as much as is allowed for. Of all
            flights by the same lag, so that more of them do not take it away.
    """

    information: Float[np.ndarray, "key key"]
    told: Float[np.ndarray, " key"]
    late: Float[np.ndarray, " key"]

    def plus(self, other: Said) -> Said:
        """What these flights and others say."""
        return Said(*(one + more for one, more in zip(self, other, strict=True)))

    @staticmethod
    def nothing(count: int) -> Said:
        """What no flight says of so many keys."""
        return Said(np.zeros((count, count)), np.zeros(count), np.zeros(count))


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
