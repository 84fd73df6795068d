"""AD-1, the NASA oblique-wing aircraft, at five sweep angles, as aircraft files.

    .venv/bin/python -m data.scripts.ad1

writes data/aircraft/ad1_00.toml to ad1_60.toml. What is published and what is estimated is told in
data/MANIFEST.md. Body axes from the centre of gravity [m]; the right wing sweeps forward.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

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
    Vanes,
)

SWEEPS_DEG = (0, 15, 30, 45, 60)
GEOMETRY = Geometry(wing_area=8.60, wing_span=9.85, mean_chord=0.944)
"""Unswept, at all sweep angles."""
ALPHA = math.radians(4.0)
CONTROLS = ("elevator", "aileron", "rudder")
STALL = 0.2269
"""Angle of attack beyond which lift is lost [rad], 13°."""

PIVOT_AHEAD = 0.22
"""Of the centre of gravity [m]. Chosen: it gives Cm_alpha between -1.2 and -1.8 at every sweep."""

_ROOT_CHORD = 1.112
_TIP_CHORD = 0.32 * _ROOT_CHORD
_PIVOT = 0.40


def wing(sweep: float) -> Surface:
    """The wing with its pivot at the origin, turned by `sweep` [rad].

    An ellipse about a straight quarter-chord line, its tips cut off at a third of the root chord:
    further out, the wake of the advanced wing's trailing edge would run over the wing.
    """
    y = GEOMETRY.wing_span * (planform.shares(40) - 0.5)
    ellipse = np.sqrt(np.maximum(1.0 - (2.0 * y / GEOMETRY.wing_span) ** 2, 0.0))
    chord = np.maximum(_ROOT_CHORD * ellipse, _TIP_CHORD)
    leading = np.stack([(_PIVOT - 0.25) * _ROOT_CHORD + 0.25 * chord, y, 0.0 * y], axis=-1)
    back = np.linspace(0.0, 1.0, 9)[:, None, None]
    flat = leading - back * chord[:, None] * np.array([1.0, 0.0, 0.0])
    sine, cosine = math.sin(sweep), math.cos(sweep)
    turned = flat @ np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]]).T
    return Surface(
        turned,
        incidence=planform.camber(0.03, 0.6),
        flaps=(
            Flap("aileron", (0.06, 0.22), 0.15),
            Flap("aileron", (0.78, 0.94), 0.15, -1.0),
        ),
    )


def tailplane() -> Surface:
    """2.4 m² at 5.5 m behind the pivot, half of it elevator."""
    span, chord = math.sqrt(2.4 * 3.0), math.sqrt(2.4 / 3.0)
    edge = -5.5 + 0.25 * chord
    leading = np.array([[edge, -0.5 * span, 0.4], [edge, 0.5 * span, 0.4]])
    return planform.straight(
        leading,
        np.array([chord, chord]),
        panels=(6, 16),
        flaps=(Flap("elevator", (0.0, 1.0), 0.5),),
    )


def fin() -> Surface:
    """1.3 m², half of it rudder."""
    height, mean = math.sqrt(1.3 * 1.3), math.sqrt(1.3 / 1.3)
    root = 2.0 * mean / 1.6
    tip = 0.6 * root
    top = -5.3 + 0.25 * mean
    leading = np.array([[top, 0.0, -0.1 - height], [top + 0.25 * (root - tip), 0.0, -0.1]])
    return planform.straight(
        leading, np.array([tip, root]), panels=(6, 12), flaps=(Flap("rudder", (0.0, 1.0), 0.55),)
    )


def lattice(sweep: float, *, reference: np.ndarray) -> Lattice:
    """All surfaces at a sweep angle [rad]; `reference` is measured from the pivot [m]."""
    return Lattice([wing(sweep), tailplane(), fin()], reference)


def mass(sweep: float) -> Mass:
    """850 kg; inertia of a wing of 728 kg·m² about its pivot, turned, on the rest's."""
    blade, sine, cosine = 728.0, math.sin(sweep), math.cos(sweep)
    return Mass(
        mass=850.0,
        Ixx=files.rounded(75.0 + blade * cosine**2),
        Iyy=files.rounded(3300.0 + blade * sine**2),
        Izz=4078.0,
        Ixy=files.rounded(blade * sine * cosine),
        mass_sigma=0.05,
        inertia_sigma=0.15,
    )


def aircraft(sweep_deg: int) -> Aircraft:
    """The aircraft at a sweep angle."""
    sweep = math.radians(sweep_deg)
    surfaces = lattice(sweep, reference=np.array([-PIVOT_AHEAD, 0.0, 0.0]))
    body = mass(sweep)
    force = derivatives.slopes(surfaces, GEOMETRY, ALPHA, ())
    lift, lift_slope = -float(force["1"][2]), -float(force["alpha"][2])
    most_lift = lift + lift_slope * (STALL - ALPHA)
    return Aircraft(
        name=f"AD-1, wing swept {sweep_deg} deg",
        mass=body,
        geometry=GEOMETRY,
        imu=Imu(position=(0.3, 0.0, 0.1)),
        pitot=Pitot(position=(4.8, 0.0, 0.0)),
        vanes=Vanes(position=(4.8, 0.0, 0.0)),
        servos=tuple(_servos()),
        controls=(
            Control("elevator", {"elevator": 1.0}),
            Control("aileron", {"aileron_left": 0.5, "aileron_right": -0.5}),
            Control("rudder", {"rudder": 1.0}),
        ),
        propulsion=(_engine(3, -0.55), _engine(6, 0.55)),
        envelope=_envelope(body.mass, most_lift),
        aerodynamics=derivatives.aerodynamics(
            surfaces,
            GEOMETRY,
            alpha=ALPHA,
            controls=CONTROLS,
            friction=0.022 * (1.0 + 0.1 * math.sin(sweep) ** 2),
            added=_beyond_stall(lift_slope),
            sigma=0.2,
        ),
    )


def _beyond_stall(lift_slope: float) -> dict[str, dict[str, float]]:
    """Eight tenths of the lift slope lost beyond the stall, the nose down, more drag."""
    beyond = f"max(0, alpha - {STALL})"
    return {"CZ": {beyond: 0.8 * lift_slope}, "CX": {beyond: -1.5}, "Cm": {beyond: -0.6}}


def _servos() -> list[Servo]:
    pwm = (1000.0, 1500.0, 2000.0)
    ends = {"aileron_right": 25.0, "elevator": 20.0, "rudder": 25.0, "aileron_left": 25.0}
    return [
        Servo(
            channel,
            surface,
            pwm,
            (-math.radians(end), 0.0, math.radians(end)),
            time_constant=0.05,
            delay=0.02,
        )
        for channel, (surface, end) in zip((1, 2, 4, 5), ends.items(), strict=True)
    ]


def _engine(channel: int, y: float) -> Propulsion:
    speeds = (0.0, 30.0, 60.0, 90.0)
    full = [979.0 * (1.0 - speed / 450.0) for speed in speeds]
    shares = ((0.0, 0.05), (0.5, 0.45), (1.0, 1.0))
    return Propulsion(
        throttle_channel=channel,
        pwm=(1000.0, 2000.0),
        throttle=tuple(throttle for throttle, _ in shares),
        airspeed=speeds,
        thrust=tuple(tuple(files.rounded(share * t) for t in full) for _, share in shares),
        position=(0.3, y, 0.25),
        time_constant=0.8,
        thrust_sigma=0.05,
    )


def _envelope(mass_kg: float, most_lift: float) -> Envelope:
    stall_speed = math.sqrt(2.0 * mass_kg * 9.81 / (1.225 * GEOMETRY.wing_area * most_lift))
    return Envelope(
        airspeed=(float(round(1.25 * stall_speed)), 85.0),
        alpha=(math.radians(-6.0), math.radians(12.0)),
        beta=(math.radians(-10.0), math.radians(10.0)),
        load_factor=(-0.5, 3.0),
        bank=math.radians(50.0),
        height_min=60.0,
    )


def main() -> None:
    """Write the files."""
    for sweep_deg in SWEEPS_DEG:
        path = Path(__file__).parents[1] / "aircraft" / f"ad1_{sweep_deg:02d}.toml"
        files.write(aircraft(sweep_deg), path, made_by="data.scripts.ad1")


if __name__ == "__main__":
    main()
