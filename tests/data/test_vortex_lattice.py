"""The vortex lattice against closed forms and against AeroSandbox's."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from data.scripts import derivatives, planform
from data.scripts.vortex_lattice import Flap, Lattice, Surface
from gcs_sysid.aircraft import Geometry

REFERENCE = Path(__file__).parents[1] / "reference" / "aerosandbox_oblique_wing.json"
ORIGIN = np.zeros(3)


def elliptic(aspect_ratio: float) -> tuple[Surface, Geometry]:
    """A flat elliptic wing of span 1, its tips cut off where they are 3 % of the root."""
    root = 4.0 / (math.pi * aspect_ratio)
    y = planform.shares(60) - 0.5
    chord = root * np.maximum(np.sqrt(np.maximum(1.0 - 4.0 * y**2, 0.0)), 0.03)
    leading = np.stack([0.25 * chord, y, 0.0 * y], axis=-1)
    back = np.linspace(0.0, 1.0, 7)[:, None, None]
    surface = Surface(leading - back * chord[:, None] * np.array([1.0, 0.0, 0.0]))
    return surface, Geometry(1.0 / aspect_ratio, 1.0, 1.0 / aspect_ratio)


def test_an_elliptic_wing_is_prandtls():
    """CLα = 2π/(1 + 2/A), CDi = CL²/(πA); lifting line theory errs by about 1/A² of them."""
    wing, geometry = elliptic(20.0)
    alpha = 0.05
    CX, _, CZ, *_ = derivatives.coefficients(Lattice([wing], ORIGIN), geometry, alpha)
    lift = CX * math.sin(alpha) - CZ * math.cos(alpha)
    drag = -CX * math.cos(alpha) - CZ * math.sin(alpha)
    assert lift / alpha == pytest.approx(2.0 * math.pi / (1.0 + 0.1), rel=0.01)
    assert drag == pytest.approx(lift**2 / (math.pi * 20.0), rel=0.05)


def test_lift_of_a_slender_delta_is_joness():
    """CLα = πA/2 in the limit of small aspect ratios (Jones 1946); 0.1 is 2 % off it."""
    leading = np.array([[-20.0, -0.5, 0.0], [0.0, 0.0, 0.0], [-20.0, 0.5, 0.0]])
    wing = planform.straight(leading, np.array([1e-3, 20.0, 1e-3]), panels=(16, 16))
    slope = derivatives.slopes(Lattice([wing], ORIGIN), Geometry(10.0, 1.0, 10.0), 0.0, ())
    assert -slope["alpha"][2] == pytest.approx(0.5 * math.pi * 0.1, rel=0.03)


def test_camber_lifts_as_thin_airfoil_theory_says():
    """Zero-lift angle of a 2 % parabolic arc: -2·0.02 rad in two dimensions."""
    chord = np.array([0.01, 0.01])
    leading = np.array([[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]])

    def arc(share):
        return -4.0 * 0.02 * (1.0 - 2.0 * share)

    wing = planform.straight(leading, chord, panels=(20, 20), incidence=arc)
    found = derivatives.slopes(Lattice([wing], ORIGIN), Geometry(0.01, 1.0, 0.01), 0.0, ())
    assert -found["1"][2] / found["alpha"][2] == pytest.approx(-2.0 * 0.02, rel=0.02)


def test_an_oblique_wing_is_aerosandboxs():
    """AeroSandbox takes no force on chordwise vortices: of a flow with sideslip or rates that
    leaves lift and what follows from it alone."""
    rows = json.loads(REFERENCE.read_text(encoding="utf-8"))["rows"]
    half = 4.0 * math.tan(math.radians(30.0))
    leading = np.array([[0.25 - half, -4.0, 0.0], [0.25 + half, 4.0, 0.0]])
    wing = planform.straight(leading, np.ones(2), panels=(8, 40))
    geometry = Geometry(8.0, 8.0, 1.0)
    found = derivatives.slopes(Lattice([wing], ORIGIN), geometry, math.radians(4.0), ())
    for key, names in {
        "1": ("CX", "CZ", "Cl", "Cm"),
        "alpha": ("CX", "CZ", "Cl", "Cm"),
        "beta": ("CZ",),
        "phat": ("CZ", "Cl", "Cm"),
        "qhat": ("CX", "CZ", "Cl", "Cm"),
    }.items():
        for name in names:
            i = ("CX", "CY", "CZ", "Cl", "Cm", "Cn").index(name)
            # Chordwise panels of equal length here, cosine there.
            assert found[key][i] == pytest.approx(rows[key][i], rel=0.01, abs=2e-4), (name, key)


def test_the_mirrored_wing_answers_in_the_mirror():
    leading = np.array([[-0.4, -2.0, 0.1], [0.3, 1.5, 0.0]])
    wing = planform.straight(leading, np.array([0.6, 1.0]), panels=(3, 8))
    mirrored = planform.straight(
        (leading * [1.0, -1.0, 1.0])[::-1], np.array([1.0, 0.6]), panels=(3, 8)
    )
    geometry = Geometry(3.0, 4.0, 0.8)
    args = {"beta": 0.1, "phat": 0.05, "qhat": 0.01, "rhat": -0.02}
    signs = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    other = {key: -value if key != "qhat" else value for key, value in args.items()}
    here = derivatives.coefficients(Lattice([wing], ORIGIN), geometry, 0.08, **args)
    there = derivatives.coefficients(Lattice([mirrored], ORIGIN), geometry, 0.08, **other)
    assert here == pytest.approx(signs * there, rel=1e-9, abs=1e-12)


def test_moments_move_with_their_point():
    leading = np.array([[0.0, -2.0, 0.0], [0.3, 2.0, -0.2]])
    wing = planform.straight(leading, np.ones(2), panels=(4, 8))
    geometry = Geometry(4.0, 4.0, 1.0)
    at = np.array([0.3, 0.2, -0.1])
    here = derivatives.coefficients(Lattice([wing], ORIGIN), geometry, 0.08, beta=0.05)
    there = derivatives.coefficients(Lattice([wing], at), geometry, 0.08, beta=0.05)
    lengths = np.array([4.0, 1.0, 4.0])
    moved = here[3:] * lengths - np.cross(at, here[:3])
    assert there[:3] == pytest.approx(here[:3], rel=1e-12)
    assert there[3:] * lengths == pytest.approx(moved, rel=1e-9)


def test_flaps_move_the_way_their_signs_say():
    """A trailing edge down lifts; a rudder's to the left pushes the tail to the right."""
    wing = planform.straight(
        np.array([[0.0, -2.0, 0.0], [0.0, 2.0, 0.0]]),
        np.ones(2),
        panels=(4, 16),
        flaps=(Flap("right", (0.6, 0.9), 0.25), Flap("left", (0.1, 0.4), 0.25)),
    )
    fin = planform.straight(
        np.array([[-4.0, 0.0, -1.0], [-4.0, 0.0, 0.0]]),
        np.ones(2),
        panels=(4, 8),
        flaps=(Flap("rudder", (0.0, 1.0), 0.4),),
    )
    lattice = Lattice([wing, fin], ORIGIN)
    found = derivatives.slopes(lattice, Geometry(4.0, 4.0, 1.0), 0.0, ("left", "right", "rudder"))
    assert found["left"][2] < -0.1
    assert found["left"][3] == pytest.approx(-found["right"][3], rel=1e-9)
    assert found["left"][3] > 0.01
    assert found["rudder"][1] > 0.05
    assert found["rudder"][5] < -0.05
