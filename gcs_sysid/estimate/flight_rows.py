"""One flight as the aided filter reads it, what is unknown about it, and stretches of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid.model.aided import Means, Noise, Row, State
from gcs_sysid.reconstruct.aided_smoother import Beginning


class Unknowns(NamedTuple):
    """A value, or one standard deviation, of everything that can be estimated."""

    means: Means
    log_noise: Noise

    def same(self, other: Unknowns) -> bool:
        """Whether all values are those of another, but for rounding."""
        pairs = zip(jax.tree.leaves(self), jax.tree.leaves(other), strict=True)
        return all(np.allclose(one, its, rtol=1e-9, atol=1e-12) for one, its in pairs)


@dataclass(frozen=True)
class Flight:
    """One flight as the filter reads it.

    Attributes:
        rows: samples.
        nominal: first guess of the states, one a row.
        beginning: belief about the state before the first row.
    """

    rows: Row
    nominal: State
    beginning: Beginning

    @property
    def found(self) -> Bool[np.ndarray, " row"]:
        """At which rows the filter has found its states.

        Before, innovations are no small errors about what is expected: an angle of attack that is
        known to several degrees reaches a stall, or wherever else a line is none. So it is at the
        beginning, and where the filter flew blind, equations not believed and inertial unit silent,
        for longer than `LOST`; either takes `FINDING`.
        """
        end = np.cumsum(self.rows.step)
        blind = ~np.asarray(self.rows.modelled) & ~np.asarray(self.rows.inertial)
        seen = np.maximum.accumulate(np.where(blind, 0.0, end))
        lost = np.maximum.accumulate(np.where(end - seen > LOST, end, 0.0))
        return end >= lost + FINDING


FINDING = 2.0
"""Time in which a filter finds flow angles that were guessed [s]: some short periods."""
LOST = 1.0
"""Time for which it may fly blind [s]. After 1.9 s in a curve of ArduPlane's the likelihood of a
flight changed by 7 nats with the path about which the filter was linearised; after half a second it
does not."""
LONGEST = 12000
"""Rows of a flight that are fitted at most: four minutes at 50 Hz."""


Stretch = tuple[Flight, Bool[np.ndarray, " stretch"]]
"""A part of a flight, and which of its rows take part."""


def busiest(flight: Flight, counts: Bool[np.ndarray, " row"], longest: int = LONGEST) -> Stretch:
    """The stretch of a flight with the most control.

    Args:
        flight: itself the answer where it is no longer than that.
        counts: which rows take part.
        longest: rows of the stretch.
    """
    return next(busy(flight, counts, longest))


def busy(flight: Flight, counts: Bool[np.ndarray, " row"], longest: int) -> Iterator[Stretch]:
    """Stretches of a flight, no two with more than half in common; the most control comes first.

    Args:
        flight: itself the only one where it is no longer than that.
        counts: which rows take part.
        longest: rows of a stretch.
    """
    if flight.rows.step.shape[0] <= longest:
        yield flight, counts
        return
    worth = _liveliness(flight, longest)
    while np.isfinite(worth).any():
        start = int(np.argmax(worth))
        yield _cut(flight, slice(start, start + longest)), counts[start : start + longest]
        worth[max(start - longest // 2, 0) : start + longest // 2] = -np.inf


def _liveliness(flight: Flight, count: int) -> Float[np.ndarray, " start"]:
    """How much the controls of a flight move in `count` rows, fewer than it has, from each row on.

    The logarithm of the product of the controls' shares of movement, so that none is left out.
    """
    moved = np.diff(np.asarray(flight.rows.controls)[:, 0], axis=0, prepend=0.0) ** 2
    moved[0] = 0.0
    moved = np.where(np.asarray(flight.rows.modelled)[:, None], moved, 0.0)
    sums = np.cumsum(np.concatenate([np.zeros((1, moved.shape[1])), moved]), axis=0)
    share = (sums[count:] - sums[:-count]) / np.maximum(sums[-1], 1e-12)
    return np.sum(np.log(np.maximum(share, 1e-6)), axis=1)


def _cut(flight: Flight, rows: slice) -> Flight:
    """A stretch of a flight, before which no more is believed than before its first row."""
    taken, nominal = jax.tree.map(lambda part: part[rows], (flight.rows, flight.nominal))
    first = jax.tree.map(lambda part: part[0], nominal)
    step = np.array(taken.step)
    step[0] = 0.0
    beginning = Beginning(first, flight.beginning.covariance)
    return Flight(taken._replace(step=step), nominal, beginning)
