"""Shapes of lifting surfaces for the vortex lattice. Body axes [m]."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from data.scripts.vortex_lattice import Flap, Surface


def shares(panels: int) -> Float[np.ndarray, " edge"]:
    """Panel edges from 0 to 1, closer together at both ends."""
    return 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, panels + 1))


def straight(
    leading: Float[np.ndarray, "station xyz"],
    chord: Float[np.ndarray, " station"],
    *,
    panels: tuple[int, int],
    incidence: Callable[[np.ndarray], np.ndarray] = np.zeros_like,
    twist: Callable[[np.ndarray], np.ndarray] = np.zeros_like,
    flaps: tuple[Flap, ...] = (),
) -> Surface:
    """A surface between stations joined by straight edges, its chords along x.

    Args:
        leading: leading edge at each station, a wing's from left to right, a fin's from the top.
        chord: at each station.
        panels: along the chord, and along the span of each part between two stations.
        incidence: of the camber line; see `Surface`.
        twist: see `Surface`.
        flaps: hinged parts.
    """
    chordwise, spanwise = panels
    along = shares(spanwise)
    at = np.concatenate([i + along[(i > 0) :] for i in range(len(chord) - 1)])
    edge = np.stack([np.interp(at, range(len(chord)), leading[:, i]) for i in range(3)], axis=-1)
    chords = np.interp(at, range(len(chord)), chord)
    back = np.linspace(0.0, 1.0, chordwise + 1)[:, None, None]
    corners = edge - back * chords[:, None] * np.array([1.0, 0.0, 0.0])
    return Surface(corners, incidence, twist, flaps)


def camber(height: float, place: float) -> Callable[[np.ndarray], np.ndarray]:
    """Incidence of a NACA four-digit camber line: its height and place in shares of the chord."""

    def incidence(share: np.ndarray) -> np.ndarray:
        length = np.where(share < place, place, 1.0 - place)
        return -2.0 * height / length**2 * (place - share)

    return incidence
