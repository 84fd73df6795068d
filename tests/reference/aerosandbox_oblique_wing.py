"""Made aerosandbox_oblique_wing.json with aerosandbox 4.2.10, in an environment of its own.

A flat wing of aspect ratio 8 and constant chord, yawed 30° (right half forward), chords along x.
Body axes about the middle of its quarter-chord line, unit density, speed, and chord.
"""

import json
from pathlib import Path

import aerosandbox as asb
import numpy as np

SPAN, SWEEP, ALPHA, STEP = 8.0, np.radians(30.0), np.radians(4.0), 1e-3


def coefficients(alpha=ALPHA, beta=0.0, p=0.0, q=0.0, r=0.0):
    half = 0.5 * SPAN * np.tan(SWEEP)
    sections = [
        asb.WingXSec(xyz_le=[x - 0.25, y, 0.0], chord=1.0, airfoil=asb.Airfoil("naca0010"))
        for x, y in ((half, -0.5 * SPAN), (-half, 0.5 * SPAN))
    ]
    found = asb.VortexLatticeMethod(
        asb.Airplane(wings=[asb.Wing(xsecs=sections, symmetric=False)]),
        asb.OperatingPoint(
            velocity=1.0, alpha=np.degrees(alpha), beta=np.degrees(beta), p=p, q=q, r=r
        ),
        xyz_ref=[0.0, 0.0, 0.0],
        spanwise_resolution=40,
        chordwise_resolution=8,
    ).run()
    scale = 2.0 / (1.225 * SPAN)
    force, moment = np.array(found["F_b"]), np.array(found["M_b"])
    return np.concatenate([force, moment / [SPAN, 1.0, SPAN]]) * scale


def main():
    found = {"1": coefficients()}
    for key, name, length in (
        ("alpha", "alpha", 0.0),
        ("beta", "beta", 0.0),
        ("phat", "p", SPAN),
        ("qhat", "q", 1.0),
        ("rhat", "r", SPAN),
    ):
        step = STEP * (2.0 / length if length else 1.0)
        base = ALPHA if name == "alpha" else 0.0
        above, below = (coefficients(**{name: base + sign * step}) for sign in (1.0, -1.0))
        found[key] = (above - below) / (2.0 * STEP)
    rows = {key: [float(f"{x:.5g}") for x in np.ravel(row)] for key, row in found.items()}
    text = json.dumps({"made_with": f"AeroSandbox {asb.__version__}", "rows": rows}, indent=1)
    Path(__file__).with_suffix(".json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
