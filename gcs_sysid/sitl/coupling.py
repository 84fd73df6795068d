"""What to do with all controls together where pitching does not stay apart from roll and yaw.

An oblique wing, or any aircraft without a plane of symmetry: its aileron pitches it, its elevator
rolls it, by the air and by its products of inertia. Demands on the angular acceleration are then
met by inverting both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import MOMENTS, Aircraft
from gcs_sysid.sitl.terms import slope

_PITCHING = ("1", "alpha", "qhat", "alphadot_hat")
_LATERAL = ("1", "beta", "phat", "rhat")

Rates = tuple[float, float, float]


@dataclass(frozen=True)
class Coupling:
    """Roll, pitch and yaw of one aircraft at one airspeed; build with `coupling`.

    Attributes:
        names: controls for roll, pitch and, where there is one, yaw.
        controls_per_acceleration: [rad per rad/s²], inertia and all controls inverted together.
        acceleration_per_rate: [1/s], what the rate of another axis does.
        acceleration_per_control: [1/s²].
        acceleration_at: by `"1"` [rad/s²] and `alpha` [1/s²].
    """

    names: tuple[str, ...]
    controls_per_acceleration: Float[np.ndarray, "control axis"]
    acceleration_per_rate: Float[np.ndarray, "axis axis"]
    acceleration_per_control: Float[np.ndarray, "axis control"]
    acceleration_at: Mapping[str, Float[np.ndarray, " axis"]]

    def controls(self, accelerations: Rates, rates: Rates) -> dict[str, float]:
        """Deflections [rad] that give angular accelerations [rad/s²] at rates [rad/s]."""
        wanted = np.array(accelerations) - self.acceleration_per_rate @ np.array(rates)
        found = self.controls_per_acceleration @ wanted
        return dict(zip(self.names, found.tolist(), strict=True))

    def balance(self, alpha: float) -> dict[str, float]:
        """Deflections [rad] without any moment at an angle of attack [rad]."""
        moment = self.acceleration_at["1"] + self.acceleration_at["alpha"] * alpha
        found = -self.controls_per_acceleration @ moment
        return dict(zip(self.names, found.tolist(), strict=True))

    def accelerations(self, controls: Mapping[str, float]) -> Float[np.ndarray, " axis"]:
        """Angular accelerations by deflections [rad]."""
        return self.acceleration_per_control @ [controls[name] for name in self.names]


def is_coupled(aircraft: Aircraft, names: Sequence[str]) -> bool:
    """Whether pitching meets roll and yaw in the inertia or in the moments' linear terms.

    Args:
        aircraft: its file.
        names: controls for roll, pitch and yaw.
    """
    if aircraft.mass.Ixy != 0.0 or aircraft.mass.Iyz != 0.0:
        return True
    pitch = {*_PITCHING, names[1]}
    lateral = {*_LATERAL, names[0], *names[2:]}
    return any(
        slope(aircraft, coefficient, key) != 0.0
        for coefficient in MOMENTS
        for key in ((lateral if coefficient == "Cm" else pitch) - {"1"})
    )


def coupling(aircraft: Aircraft, airspeed: float, names: Sequence[str], density: float) -> Coupling:
    """The coupling at an equivalent airspeed [m/s] and a density [kg/m³]."""
    geometry = aircraft.geometry
    span, chord = geometry.wing_span, geometry.mean_chord
    force = 0.5 * density * airspeed**2 * geometry.wing_area
    inverse = np.linalg.inv(aircraft.mass.inertia) * force * np.array([span, chord, span])

    def accelerations(key: str) -> Float[np.ndarray, " axis"]:
        return inverse @ [slope(aircraft, coefficient, key) for coefficient in MOMENTS]

    lengths = zip(("phat", "qhat", "rhat"), (span, chord, span), strict=True)
    by_rate = np.stack(
        [accelerations(key) * length / (2.0 * airspeed) for key, length in lengths], axis=1
    )
    by_control = np.stack([accelerations(name) for name in names], axis=1)
    # Damping in its own axis is the rate loops' business.
    np.fill_diagonal(by_rate, 0.0)
    # Without a control for yaw, yaw is left alone; the pseudo-inverse would compromise on it.
    axes = len(names)
    by_acceleration = np.zeros((axes, 3))
    by_acceleration[:, :axes] = np.linalg.pinv(by_control[:axes])
    return Coupling(
        tuple(names),
        by_acceleration,
        by_rate,
        by_control,
        {key: accelerations(key) for key in ("1", "alpha")},
    )
