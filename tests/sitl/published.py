"""The Ultra Stick 25e's published linear model, and aircraft asked for theirs."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
from scipy.optimize import fsolve

from gcs_sysid.aircraft import Aircraft, Value
from gcs_sysid.sitl import jsbsim_xml, units
from gcs_sysid.sitl.jsbsim_aircraft import JsbsimAircraft, Start
from tests.sitl import examples

PUBLISHED = json.loads(
    (examples.ROOT / "tests" / "reference" / "ultra_stick_17mps.json").read_text(encoding="utf-8")
)
STATES, CONTROLS = PUBLISHED["states"], PUBLISHED["controls"]
AIRSPEED = 17.0


# Entries that are not compared: what the file has no words for, or other numbers in.
LEFT_OUT = {
    ("u", "u"): "thrust falls faster with speed than by the thrust table, which was chosen",
    ("q", "u"): "and pitches: that propeller sits 46 mm off the centre of gravity, tilted by 3°",
    ("p", "u"): "its torque changes with speed",
    ("p", "q"): "its gyroscopic moment, of 1.3e-4 kg·m² at 7900 rpm",
    ("q", "r"): "likewise",
    ("r", "q"): "likewise",
    ("u", "elevator"): "drag of a deflection, whichever way it goes",
    ("u", "rudder"): "likewise",
    ("u", "aileron"): "likewise",
}


def as_published() -> Aircraft:
    """The file with two things of the published model that it leaves out.

    The published forces act 4.5 mm behind the centre of gravity, which makes Cm_alpha -0.81 of
    -0.72; and CY is in wind axes there, so that drag adds to CY_beta.
    """
    aircraft = examples.ultra_stick()
    aerodynamics = dict(aircraft.aerodynamics)
    side = aerodynamics["CY"]
    terms = {**side.terms, "beta": Value(side.terms["beta"].value - 0.0455, 0.0)}
    aerodynamics["CY"] = dataclasses.replace(side, terms=terms)
    mass = dataclasses.replace(aircraft.mass, cg=(0.0045, 0.0, 0.0))
    return dataclasses.replace(aircraft, aerodynamics=aerodynamics, mass=mass)


def entries(A, B):
    """Entries that matter, by name: at least 3 % of their row's largest, given usual motions."""
    usual = {"phi": 0.3, "theta": 0.1, "p": 1.0, "q": 0.5, "r": 0.5, "u": 1.0, "v": 1.0, "w": 1.0}
    scale = [usual[name] for name in STATES] + [0.1] * len(CONTROLS)
    whole = np.hstack([A, B])
    found = {}
    for i, row in enumerate(STATES):
        if row in ("phi", "theta"):
            continue
        weights = np.abs(whole[i]) * scale
        for j, column in enumerate([*STATES, *CONTROLS]):
            if weights[j] > 0.03 * weights.max() and (row, column) not in LEFT_OUT:
                found[row, column] = whole[i, j]
    return found


class Placed:
    """An aircraft put into any state, to be asked how it goes on."""

    def __init__(self, aircraft: Aircraft) -> None:
        start = Start(airspeed=AIRSPEED, elevation=0.0, height=100.0)
        self._fdm = JsbsimAircraft(aircraft, start=start)._fdm
        self.alpha, self.elevator, self.throttle = fsolve(self._off_trim, [0.05, -0.07, 0.5])
        self.state = np.zeros(8)
        self.state[STATES.index("theta")] = self.alpha
        self.state[STATES.index("u")] = AIRSPEED * math.cos(self.alpha)
        self.state[STATES.index("w")] = AIRSPEED * math.sin(self.alpha)

    def rates(self, state, controls, throttle):
        """Time derivatives of the states, for controls in the order of `CONTROLS`."""
        fdm = self._fdm
        for name, value in zip(CONTROLS, controls, strict=True):
            fdm[jsbsim_xml.control_property(name)] = value
        fdm[jsbsim_xml.throttle_property(0)] = throttle
        phi, theta, p, q, r, u, v, w = state
        placed = {"phi-rad": phi, "theta-rad": theta, "psi-true-rad": 0.0}
        placed |= {f"{name}-rad_sec": value for name, value in zip("pqr", (p, q, r), strict=True)}
        placed |= {f"{name}-fps": x / units.FOOT for name, x in zip("uvw", (u, v, w), strict=True)}
        for name, value in placed.items():
            fdm[f"ic/{name}"] = value
        fdm.run_ic()
        turning = [fdm[f"accelerations/{name}dot-rad_sec2"] for name in "pqr"]
        moving = [fdm[f"accelerations/{name}dot-ft_sec2"] * units.FOOT for name in "uvw"]
        nose = math.tan(theta) * (q * math.sin(phi) + r * math.cos(phi))
        return np.array([p + nose, q * math.cos(phi) - r * math.sin(phi), *turning, *moving])

    def _off_trim(self, guess):
        alpha, elevator, throttle = guess
        state = [0.0, alpha, 0.0, 0.0, 0.0, 17.0 * math.cos(alpha), 0.0, 17.0 * math.sin(alpha)]
        rates = self.rates(state, (elevator, 0.0, 0.0), throttle)
        return rates[[STATES.index(name) for name in "uwq"]]

    def linear(self):
        """A and B about the trim, by central differences."""
        step, controls = 1e-4, np.array([self.elevator, 0.0, 0.0])

        def slope(dx, du):
            above = self.rates(self.state + dx, controls + du, self.throttle)
            below = self.rates(self.state - dx, controls - du, self.throttle)
            return (above - below) / (2.0 * step)

        A = np.array([slope(step * e, 0.0) for e in np.eye(8)]).T
        B = np.array([slope(0.0, step * e) for e in np.eye(3)]).T
        return A, B
