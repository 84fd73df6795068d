"""One effect under its other name.

An airspeed that lags and one that is late leave nearly the same trace at held gains. Where flights
settled with the one, linear evidence goes on preferring it, though with the other they may be
hundreds of nats more probable: which it is, is told by settling with either.

Nor is the one free while flights are settled with the other, not even by its ordinary error. A
search that shares the effect between them finds no way out: from a lag of 0.13 s and 0.07 s of
delay to the 0.23 s of lag that were there, the likelihood rises by 86 nats, but not at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.cause import Candidate


class Renamed(NamedTuple):
    """A set of causes of which one goes by its other name.

    Attributes:
        causes: with the other one in its place.
        other: that one.
        values: departures of all unknowns, what was the one's now the other's.
    """

    causes: tuple[Candidate, ...]
    other: Candidate
    values: Float[np.ndarray, " unknown"]


def renamed(
    causes: Sequence[Candidate],
    values: Float[np.ndarray, " unknown"],
    unknowns: Unknowns,
    every: Sequence[Candidate],
) -> Renamed | None:
    """The same causes with another name for one of them; None where each has one only.

    Args:
        causes: what is set free.
        values: departures of all unknowns.
        unknowns: in whose order, and which quantities are two names for one thing.
        every: all causes.
    """
    for one in causes:
        for pair in unknowns.either:
            mine = pair & set(one.frees)
            others = [each for each in every if mine and set(each.frees) == pair - mine]
            if others:
                swapped = tuple(others[0] if each is one else each for each in causes)
                moved = _handed_on(*mine, *others[0].frees, values, unknowns)
                return Renamed(swapped, others[0], moved)
    return None


def gathered(
    causes: Sequence[Candidate],
    moved: Float[np.ndarray, " parameter"],
    unknowns: Unknowns,
    number: int,
) -> Float[np.ndarray, " parameter"]:
    """Departures of a flight's parameters with all of an effect under the name that is free.

    So what is ordinarily off in the same way as a quantity: half of a delay that only a cause can
    explain had stayed with the delay that is ordinary.

    Args:
        causes: what is set free.
        moved: departures.
        unknowns: all, and which quantities are two names for one thing.
        number: of the flight.
    """
    own = unknowns.own[number]
    for here, there in _sides(causes, unknowns, number):
        share = float(there @ moved) / float(there @ there)
        moved = moved + share * (here - there)
    for name in (name for one in causes for name in one.frees if name in unknowns.beside):
        ordinary = int(np.flatnonzero(own == unknowns.names.index(unknowns.beside[name]))[0])
        here = unknowns.directions[own, unknowns.names.index(name) - unknowns.parameters]
        moved = moved + moved[ordinary] * here
        moved[ordinary] = 0.0
    return moved


def unnamed(
    causes: Sequence[Candidate], unknowns: Unknowns, number: int
) -> Bool[np.ndarray, " parameter"]:
    """Parameters of a flight that are an effect under the name that is not free."""
    found = np.zeros(unknowns.own[number].size, dtype=bool)
    for here, there in _sides(causes, unknowns, number):
        found |= (there != 0.0) & (here == 0.0)
    return found


def _sides(
    causes: Sequence[Candidate], unknowns: Unknowns, number: int
) -> Iterator[tuple[Float[np.ndarray, " parameter"], Float[np.ndarray, " parameter"]]]:
    """What one of each quantity of two names does in a flight: by the free name, by the other."""
    for one in causes:
        for pair in unknowns.either:
            mine = pair & set(one.frees)
            if mine:
                columns = [unknowns.names.index(name) for name in (*mine, *(pair - mine))]
                across = unknowns.directions[unknowns.own[number]]
                here, there = (across[:, column - unknowns.parameters] for column in columns)
                yield here, there


def _handed_on(
    name: str, other: str, values: Float[np.ndarray, " unknown"], unknowns: Unknowns
) -> Float[np.ndarray, " unknown"]:
    """Departures with one quantity's, the ordinary part of it too, in another's place."""
    here, there = (unknowns.names.index(each) for each in (name, other))
    along = unknowns.directions[:, here - unknowns.parameters]
    ordinary = np.flatnonzero(along)
    total = values[here] + float(np.mean(values[ordinary] / along[ordinary]))
    moved = values.copy()
    moved[ordinary], moved[here], moved[there] = 0.0, 0.0, total
    return moved
