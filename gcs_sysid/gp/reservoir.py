"""A bounded store of samples, the same whatever order they came in.

Every sample draws a number from its own content; those with the largest numbers stay. That is a
uniform draw from all samples ever seen, and two machines that saw the same flights hold the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from gcs_sysid.gp.samples import Rows

_MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)
"""Of Fibonacci hashing: 2⁶⁴ over the golden ratio."""


class Kept(NamedTuple):
    """Samples with the flight each belongs to and the number it drew."""

    inputs: Float[np.ndarray, "kept input"]
    values: Float[np.ndarray, "kept output"]
    precision: Float[np.ndarray, "kept output"]
    flight: Int[np.ndarray, " kept"]
    drawn: Float[np.ndarray, " kept"]


@dataclass(frozen=True)
class Reservoir:
    """At most `capacity` samples.

    Attributes:
        capacity: most that are kept.
        kept: those that are.
    """

    capacity: int
    kept: Kept

    def rows(self, which: Bool[np.ndarray, " kept"] | None = None) -> Rows:
        """The kept samples, or some of them."""
        parts = (self.kept.inputs, self.kept.values, self.kept.precision)
        chosen = parts if which is None else tuple(part[which] for part in parts)
        return Rows(*chosen)


def empty(capacity: int, *, inputs: int, outputs: int) -> Reservoir:
    """Nothing yet."""
    return Reservoir(
        capacity,
        Kept(
            np.zeros((0, inputs)),
            np.zeros((0, outputs)),
            np.zeros((0, outputs)),
            np.zeros(0, dtype=int),
            np.zeros(0),
        ),
    )


def with_rows(store: Reservoir, some: Rows, flight: int) -> Reservoir:
    """The store after more samples of one flight."""
    inputs, values, precision = (np.asarray(part) for part in some)
    drawn = _draw(np.concatenate([inputs, values], axis=1))
    if store.kept.drawn.size == store.capacity:
        # Most samples of a long flight end here: nothing is copied for them.
        worth = drawn > store.kept.drawn.min()
        if not worth.any():
            return store
        inputs, values, precision, drawn = (
            part[worth] for part in (inputs, values, precision, drawn)
        )
    new = Kept(inputs, values, precision, np.full(drawn.size, flight), drawn)
    both = Kept(*(np.concatenate(pair) for pair in zip(store.kept, new, strict=True)))
    best = np.sort(np.argsort(-both.drawn, kind="stable")[: store.capacity])
    return Reservoir(store.capacity, Kept(*(part[best] for part in both)))


def without_flight(store: Reservoir, flight: int) -> Reservoir:
    """The store less one flight's samples."""
    stays = store.kept.flight != flight
    return Reservoir(store.capacity, Kept(*(part[stays] for part in store.kept)))


def _draw(content: Float[np.ndarray, "sample number"]) -> Float[np.ndarray, " sample"]:
    """A number in [0, 1) a sample, from the bits of its numbers."""
    bits = np.ascontiguousarray(content).view(np.uint64)
    mixed = np.zeros(content.shape[0], dtype=np.uint64)
    for column in bits.T:
        mixed = (mixed ^ column) * _MULTIPLIER
        mixed ^= mixed >> np.uint64(29)
    return (mixed >> np.uint64(11)).astype(np.float64) / 2.0**53
