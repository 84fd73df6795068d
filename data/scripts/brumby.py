"""Brumby MkIII, the 45 kg delta-wing aircraft of Hemakumara's thesis, as an aircraft file.

    .venv/bin/python -m data.scripts.brumby

writes data/aircraft/brumby_mk3.toml. Mass, span, engine power and speeds are published; all else is
estimated here, number by number in data/MANIFEST.md. Coordinates are body axes from the apex of the
wing [m], and from the centre of gravity in the file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from data.scripts import derivatives, files, planform
from data.scripts.vortex_lattice import Flap, Lattice, Surface
from gcs_sysid.aircraft import (
    Aircraft,
    Control,
    Envelope,
    Geometry,
    Imu,
    Mass,
    Pitot,
    Propulsion,
    Servo,
)

SPAN, ROOT_CHORD, TIP_CHORD = 2.9, 1.10, 0.30
SWEEP = math.radians(35.0)
"""Of the leading edge."""
MASS = 45.0
STATIC_MARGIN = 0.10
"""Of the mean chord; chosen, and the payload put where it gives that."""
ALPHA = math.radians(4.0)
CONTROLS = ("elevator", "aileron", "rudder")
STALL = 0.262
"""Angle of attack beyond which lift is lost [rad], 15°."""

_TAPER = TIP_CHORD / ROOT_CHORD
GEOMETRY = Geometry(
    wing_area=files.rounded(0.5 * SPAN * (ROOT_CHORD + TIP_CHORD)),
    wing_span=SPAN,
    mean_chord=files.rounded(2.0 / 3.0 * ROOT_CHORD * (1.0 + _TAPER + _TAPER**2) / (1.0 + _TAPER)),
)

_PROPELLER = 0.60
_PROPELLER_PLACE = (-1.30, 0.0, -0.08)
_FIN_Y, _FIN_HEIGHT, _FIN_CHORDS = 0.75, 0.45, (0.25, 0.45)


@dataclass(frozen=True)
class Part:
    """A box of uniform density: mass [kg], middle and edges [m]."""

    mass: float
    middle: tuple[float, float, float]
    edges: tuple[float, float, float] = (0.0, 0.0, 0.0)


FIXED = (
    Part(7.0, (-0.10, 0.0, 0.02), (2.1, 0.25, 0.28)),  # fuselage
    Part(5.5, (-1.15, 0.0, -0.06), (0.3, 0.3, 0.25)),  # engine, propeller, mount
    Part(5.0, (-0.55, 0.0, 0.0), (0.3, 0.3, 0.2)),  # fuel
    Part(4.0, (0.15, 0.0, 0.0), (0.5, 0.2, 0.2)),  # computers, sensors, batteries
    Part(0.8, (0.55, 0.0, 0.30)),  # nose wheel
    Part(0.9, (-0.75, -0.45, 0.30)),  # main wheels
    Part(0.9, (-0.75, 0.45, 0.30)),
    Part(0.7, (-1.40, -_FIN_Y, -0.22), (0.35, 0.0, _FIN_HEIGHT)),  # fins
    Part(0.7, (-1.40, _FIN_Y, -0.22), (0.35, 0.0, _FIN_HEIGHT)),
)
PAYLOAD = Part(8.0, (0.0, 0.0, 0.04), (0.5, 0.22, 0.22))
"""Its middle along x is solved for."""
_WING_MASS = 11.5


def leading_edge(y: float) -> float:
    """Where the wing's leading edge is [m]."""
    return -abs(y) * math.tan(SWEEP)


def wing() -> Surface:
    """A cropped delta set at 2°, with 2.5° of washout; most of its trailing edge are elevons."""
    half = 0.5 * SPAN
    leading = np.array([[leading_edge(y), y, 0.0] for y in (-half, 0.0, half)])
    both = (("left", (0.03, 0.40)), ("right", (0.60, 0.97)))
    return planform.straight(
        leading,
        np.array([TIP_CHORD, ROOT_CHORD, TIP_CHORD]),
        panels=(8, 20),
        twist=lambda share: np.radians(2.0 - 2.5 * np.abs(2.0 * share - 1.0)),
        flaps=tuple(
            Flap(control, along, 0.20, sign)
            for side, along in both
            for control, sign in (("elevator", 1.0), ("aileron", 1.0 if side == "left" else -1.0))
        ),
    )


def fin(side: float) -> Surface:
    """One of two fins on the trailing edge, the rear 30 % rudder."""
    tip, root = _FIN_CHORDS
    y = side * _FIN_Y
    behind = leading_edge(y) - ROOT_CHORD + (ROOT_CHORD - TIP_CHORD) * 2.0 * _FIN_Y / SPAN - 0.15
    leading = np.array([[behind + tip, y, -0.02 - _FIN_HEIGHT], [behind + root, y, -0.02]])
    return planform.straight(
        leading,
        np.array([tip, root]),
        panels=(6, 8),
        flaps=(Flap("rudder", (0.0, 1.0), 0.3),),
    )


def lattice(reference: Float[np.ndarray, " xyz"]) -> Lattice:
    """All surfaces about a point, measured from the apex [m]."""
    return Lattice([wing(), fin(-1.0), fin(1.0)], reference)


def wing_parts() -> tuple[Part, ...]:
    """The wing as strips along the flow, their mass in proportion to their chord."""
    edges = np.linspace(-0.5 * SPAN, 0.5 * SPAN, 41)
    middles = 0.5 * (edges[:-1] + edges[1:])
    chords = ROOT_CHORD - (ROOT_CHORD - TIP_CHORD) * np.abs(middles) / (0.5 * SPAN)
    masses = _WING_MASS * chords / chords.sum()
    return tuple(
        Part(m, (leading_edge(y) - 0.5 * c, y, 0.0), (c, SPAN / 40, 0.0))
        for m, y, c in zip(masses.tolist(), middles.tolist(), chords.tolist(), strict=True)
    )


def centre(parts: tuple[Part, ...]) -> Float[np.ndarray, " xyz"]:
    """Centre of gravity [m]."""
    masses = np.array([part.mass for part in parts])
    return masses @ np.array([part.middle for part in parts]) / masses.sum()


def inertia(parts: tuple[Part, ...]) -> Float[np.ndarray, "axis axis"]:
    """Inertia tensor about the centre of gravity [kg·m²]."""
    about = centre(parts)
    total = np.zeros((3, 3))
    for part in parts:
        arm = np.array(part.middle) - about
        spread = np.diag(np.array(part.edges) ** 2) / 12.0 + np.outer(arm, arm)
        total += part.mass * (np.trace(spread) * np.eye(3) - spread)
    return total


def neutral_point() -> float:
    """Where lift by angle of attack acts [m], negative behind the apex."""
    slope = derivatives.slopes(lattice(np.zeros(3)), GEOMETRY, ALPHA, ())["alpha"]
    return float(slope[4] / -slope[2]) * GEOMETRY.mean_chord


def parts() -> tuple[Part, ...]:
    """Everything, the payload where it gives the static margin."""
    others = (*FIXED, *wing_parts())
    target = neutral_point() + STATIC_MARGIN * GEOMETRY.mean_chord
    moment = MASS * target - sum(part.mass * part.middle[0] for part in others)
    _, y, z = PAYLOAD.middle
    return (*others, Part(PAYLOAD.mass, (moment / PAYLOAD.mass, y, z), PAYLOAD.edges))


def aircraft() -> Aircraft:
    """The aircraft."""
    everything = parts()
    about = centre(everything)
    surfaces = lattice(about)
    lift = -float(derivatives.slopes(surfaces, GEOMETRY, ALPHA, ())["alpha"][2])
    beyond = f"max(0, alpha - {STALL})"
    return Aircraft(
        name="Brumby MkIII",
        mass=_mass(everything),
        geometry=GEOMETRY,
        imu=Imu(position=(0.25, 0.0, 0.05)),
        pitot=Pitot(position=(1.9, 0.0, 0.0)),
        servos=tuple(_servos()),
        controls=(
            Control("elevator", {"elevon_left": 0.5, "elevon_right": 0.5}),
            Control("aileron", {"elevon_left": 0.5, "elevon_right": -0.5}),
            Control("rudder", {"rudder_left": 0.5, "rudder_right": 0.5}),
        ),
        propulsion=(_engine(np.array(_PROPELLER_PLACE) - about),),
        envelope=Envelope(
            airspeed=(25.7, 48.0),
            alpha=(math.radians(-8.0), math.radians(13.0)),
            beta=(math.radians(-15.0), math.radians(15.0)),
            load_factor=(-1.5, 3.5),
            bank=math.radians(60.0),
            height_min=60.0,
        ),
        aerodynamics=derivatives.aerodynamics(
            surfaces,
            GEOMETRY,
            alpha=ALPHA,
            controls=CONTROLS,
            friction=0.020,
            added={"CZ": {beyond: 0.7 * lift}, "CX": {beyond: -1.0}},
            sigma=0.2,
        ),
    )


def _mass(everything: tuple[Part, ...]) -> Mass:
    tensor = inertia(everything)
    return Mass(
        mass=MASS,
        Ixx=files.rounded(tensor[0, 0]),
        Iyy=files.rounded(tensor[1, 1]),
        Izz=files.rounded(tensor[2, 2]),
        Ixz=files.rounded(-tensor[0, 2]),
        mass_sigma=0.02,
        inertia_sigma=0.2,
    )


def _servos() -> list[Servo]:
    surfaces = ("elevon_left", "elevon_right", "rudder_left", "rudder_right")
    end = math.radians(25.0)
    return [
        Servo(
            channel,
            surface,
            (1000.0, 1500.0, 2000.0),
            (-end, 0.0, end),
            time_constant=0.05,
            delay=0.03,
        )
        for channel, surface in zip((1, 2, 4, 5), surfaces, strict=True)
    ]


def _engine(position: Float[np.ndarray, " xyz"]) -> Propulsion:
    """A pusher at 30 to 120 1/s: CT = 0.10·(1 - J/0.98), CP = 0.045·(1 - (J/1.15)²)."""
    throttles = (0.0, 0.25, 0.5, 0.75, 1.0)
    speeds = (20.0, 26.0, 32.0, 38.0, 44.0, 50.0)
    thrust, torque = [], []
    for throttle in throttles:
        turns = 30.0 + 90.0 * throttle
        dynamic = 1.225 * turns**2 * _PROPELLER**4
        advance = [speed / (turns * _PROPELLER) for speed in speeds]
        thrust.append(tuple(files.rounded(0.10 * (1.0 - j / 0.98) * dynamic) for j in advance))
        work = [0.045 * (1.0 - (j / 1.15) ** 2) * dynamic * _PROPELLER for j in advance]
        torque.append(tuple(files.rounded(w / (2.0 * math.pi)) for w in work))
    x, y, z = np.round(position, 3).tolist()
    return Propulsion(
        throttle_channel=3,
        pwm=(1000.0, 2000.0),
        throttle=throttles,
        airspeed=speeds,
        thrust=tuple(thrust),
        torque=tuple(torque),
        position=(x, y, z),
        time_constant=0.25,
        thrust_sigma=0.15,
    )


def main() -> None:
    """Write the file."""
    path = Path(__file__).parents[1] / "aircraft" / "brumby_mk3.toml"
    files.write(aircraft(), path, made_by="data.scripts.brumby")


if __name__ == "__main__":
    main()
