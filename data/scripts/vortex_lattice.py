"""Forces and moments on lifting surfaces by a lattice of vortex rings.

Potential flow without compressibility: no separation, no friction, no thickness, no body. Surfaces
are flat; camber and deflected flaps turn the normals only. Wakes leave straight aft. Axes are body
axes, x forward, y right, z down.

References:
    Katz and Plotkin, Low-Speed Aerodynamics (2001), sections 10.4.5 (vortex segment) and 12.3
    (vortex rings).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

Points = Float[np.ndarray, "*shape xyz"]

AFT = np.array([-1.0, 0.0, 0.0])


@dataclass(frozen=True)
class Flap:
    """A hinged part of a surface: turned about the local span by `sign` times a deflection.

    Attributes:
        control: what deflects it.
        along: first and last share of the surface's span, 0 to 1 from its first edge.
        chord: share of the chord behind the hinge.
        sign: of the deflection; +1 moves a wing's trailing edge down, a fin's to the left.
    """

    control: str
    along: tuple[float, float]
    chord: float
    sign: float = 1.0


@dataclass(frozen=True)
class Surface:
    """One lifting surface as a grid of corners, leading edge first.

    Attributes:
        corners: of its panels [m]; a wing's run from left to right, a fin's from top to bottom.
        incidence: of the camber line against the chord by share of the chord [1]: how far it falls
            on its way aft.
        twist: by share of the span [rad], leading edge up.
        flaps: hinged parts.
    """

    corners: Float[np.ndarray, "chordwise spanwise xyz"]
    incidence: Callable[[np.ndarray], np.ndarray] = np.zeros_like
    twist: Callable[[np.ndarray], np.ndarray] = np.zeros_like
    flaps: tuple[Flap, ...] = ()


@dataclass(frozen=True)
class Flow:
    """How the body moves through still air: [m/s] and [rad/s] about the reference point."""

    velocity: tuple[float, float, float]
    rates: tuple[float, float, float] = (0.0, 0.0, 0.0)
    deflections: Mapping[str, float] = field(default_factory=dict)


class Lattice:
    """Surfaces that act on one another.

    Args:
        surfaces: whose vortices are solved for together.
        reference: point about which rates and moments are taken [m].
    """

    def __init__(self, surfaces: Sequence[Surface], reference: Float[np.ndarray, " xyz"]) -> None:
        meshes = [_Mesh(surface) for surface in surfaces]
        self._meshes = meshes
        self._reference = reference
        self._points = np.concatenate([mesh.points for mesh in meshes])
        self._segments = _Segments.joined([mesh.segments for mesh in meshes])
        self._influence = self._velocity(self._points)
        self._at_segments = self._velocity(self._segments.middle)

    def _velocity(self, at: Points) -> Float[np.ndarray, "point ring xyz"]:
        """Velocity at points by each ring of unit circulation."""
        return np.concatenate([mesh.velocity(at) for mesh in self._meshes], axis=1)

    def loads(self, flow: Flow) -> tuple[Float[np.ndarray, " xyz"], Float[np.ndarray, " xyz"]]:
        """Force and moment about the reference point, for air of unit density."""
        normals = np.concatenate([mesh.normals(flow.deflections) for mesh in self._meshes])
        onset = np.einsum("ni,ni->n", self._onset(flow, self._points), normals)
        circulation = np.linalg.solve(np.einsum("nmi,ni->nm", self._influence, normals), -onset)
        segments = self._segments
        speed = self._onset(flow, segments.middle) + np.einsum(
            "nmi,m->ni", self._at_segments, circulation
        )
        strength = segments.share @ circulation
        force = strength[:, None] * np.cross(speed, segments.length)
        arm = segments.middle - self._reference
        return force.sum(axis=0), np.cross(arm, force).sum(axis=0)

    def _onset(self, flow: Flow, at: Points) -> Points:
        turning = np.cross(np.array(flow.rates), at - self._reference)
        return -(np.array(flow.velocity) + turning)


@dataclass(frozen=True)
class _Segments:
    """Bound vortex segments: where, along what, and which share of each ring flows there."""

    middle: Float[np.ndarray, "segment xyz"]
    length: Float[np.ndarray, "segment xyz"]
    share: Float[np.ndarray, "segment ring"]

    @staticmethod
    def joined(parts: Sequence[_Segments]) -> _Segments:
        rings = sum(part.share.shape[1] for part in parts)
        shares, first = [], 0
        for part in parts:
            share = np.zeros((len(part.middle), rings))
            share[:, first : first + part.share.shape[1]] = part.share
            shares.append(share)
            first += part.share.shape[1]
        return _Segments(
            np.concatenate([part.middle for part in parts]),
            np.concatenate([part.length for part in parts]),
            np.concatenate(shares),
        )


class _Mesh:
    """The rings of one surface: corners a quarter of a panel behind the panel's own."""

    def __init__(self, surface: Surface) -> None:
        corners = surface.corners
        step = np.diff(corners, axis=0)
        self._surface = surface
        self.rings = np.concatenate([corners[:-1] + 0.25 * step, corners[-1:] + 0.25 * step[-1:]])
        at = corners[:-1] + 0.75 * step
        self.points = (0.5 * (at[:, :-1] + at[:, 1:])).reshape(-1, 3)
        across = np.diff(at, axis=1)
        along = 0.5 * (step[:, :-1] + step[:, 1:])
        self._span = _unit(across).reshape(-1, 3)
        self._flat = _unit(np.cross(across, -along)).reshape(-1, 3)
        # Shares of chord and span of the points.
        leading, trailing = corners[0], corners[-1]
        front, back = (0.5 * (edge[:-1] + edge[1:]) for edge in (leading, trailing))
        behind = np.linalg.norm(self.points.reshape(across.shape) - front, axis=-1)
        self._chordwise = (behind / np.linalg.norm(back - front, axis=-1)).ravel()
        quarter = leading + 0.25 * (trailing - leading)
        stations = np.concatenate(
            [[0.0], np.cumsum(np.linalg.norm(np.diff(quarter, axis=0), axis=-1))]
        )
        middle = 0.5 * (stations[:-1] + stations[1:]) / stations[-1]
        self._spanwise = np.broadcast_to(middle, across.shape[:2]).ravel()
        self.segments = self._bound()

    def normals(self, deflections: Mapping[str, float]) -> Points:
        """Normals at the points, turned by twist, camber and flaps."""
        surface = self._surface
        angle = surface.twist(self._spanwise) + np.arctan(surface.incidence(self._chordwise))
        for flap in surface.flaps:
            first, last = flap.along
            inside = (self._spanwise > first) & (self._spanwise < last)
            hinged = inside & (self._chordwise > 1.0 - flap.chord)
            angle = angle + hinged * flap.sign * deflections.get(flap.control, 0.0)
        sine, cosine = np.sin(angle)[:, None], np.cos(angle)[:, None]
        return cosine * self._flat + sine * np.cross(self._span, self._flat)

    def velocity(self, at: Points) -> Float[np.ndarray, "point ring xyz"]:
        """Velocity at points by each ring of unit circulation, wakes with the last row."""
        rings = self.rings
        across = _segment(at, rings[:-1, :-1], rings[:-1, 1:])
        along = _segment(at, rings[:-1], rings[1:])
        wake = _to_infinity(at, rings[-1])
        total = across + along[:, :, 1:] - along[:, :, :-1]
        total[:, :-1] -= across[:, 1:]
        total[:, -1] += wake[:, 1:] - wake[:, :-1]
        return total.reshape(len(at), -1, 3)

    def _bound(self) -> _Segments:
        rings = self.rings
        rows, columns = rings.shape[0] - 1, rings.shape[1] - 1
        number = np.arange(rows * columns).reshape(rows, columns)
        middle, length, share = [], [], []

        def add(start: np.ndarray, end: np.ndarray, plus: int | None, minus: int | None) -> None:
            middle.append(0.5 * (start + end))
            length.append(end - start)
            row = np.zeros(rows * columns)
            for ring, sign in ((plus, 1.0), (minus, -1.0)):
                if ring is not None:
                    row[ring] = sign
            share.append(row)

        for i in range(rows):
            for j in range(columns):
                ahead = number[i - 1, j] if i else None
                add(rings[i, j], rings[i, j + 1], number[i, j], ahead)
        for i in range(rows):
            for j in range(columns + 1):
                left = number[i, j - 1] if j else None
                right = number[i, j] if j < columns else None
                add(rings[i, j], rings[i + 1, j], left, right)
        return _Segments(np.array(middle), np.array(length), np.array(share))


def _segment(at: Points, start: Points, end: Points) -> Float[np.ndarray, "point *ring xyz"]:
    """Velocity by straight vortices of unit strength; none on their own axis."""
    shape = (len(at), *(1,) * (start.ndim - 1), 3)
    from_start, from_end = at.reshape(shape) - start, at.reshape(shape) - end
    axis = _cross(from_start, from_end)
    square = _dot(axis, axis)
    near_start, near_end = np.sqrt(_dot(from_start, from_start)), np.sqrt(_dot(from_end, from_end))
    length = end - start
    # On the axis the field is singular; there, a vortex is asked about itself.
    near = square < 1e-16 * _dot(length, length) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        along = _dot(length, from_start) / near_start - _dot(length, from_end) / near_end
        strength = np.where(near, 0.0, along / square) / (4.0 * np.pi)
    return strength[..., None] * axis


def _to_infinity(at: Points, start: Points) -> Float[np.ndarray, "point *ring xyz"]:
    """Velocity by straight vortices of unit strength from `start` aft without end."""
    offset = at.reshape(len(at), *(1,) * (start.ndim - 1), 3) - start
    distance = np.sqrt(_dot(offset, offset))
    axis = _cross(AFT, offset)
    beside = distance * (distance - offset @ AFT)
    near = _dot(axis, axis) < 1e-16
    strength = np.where(near, 0.0, 1.0 / np.where(near, 1.0, beside)) / (4.0 * np.pi)
    return strength[..., None] * axis


def _dot(a: Points, b: Points) -> Float[np.ndarray, "*shape"]:
    return np.einsum("...i,...i->...", a, b)


# NumPy's own takes three times as long, and this is where the time goes.
def _cross(a: Points, b: Points) -> Points:
    x, y, z = (a[..., i] for i in range(3))
    u, v, w = (b[..., i] for i in range(3))
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def _unit(vector: Points) -> Points:
    size = np.linalg.norm(vector, axis=-1, keepdims=True)
    return vector / np.where(size == 0.0, 1.0, size)
