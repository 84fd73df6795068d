"""The Ultra Stick 25e's published linear model, and aircraft asked for theirs."""

from __future__ import annotations

import json
import math

import numpy as np
from scipy.optimize import fsolve

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.sitl import jsbsim_xml, units
from gcs_sysid.sitl.jsbsim_aircraft import JsbsimAircraft, Start
from tests.sitl import examples

PUBLISHED = json.loads(
    (examples.ROOT / "tests" / "reference" / "ultra_stick_17mps.json").read_text(encoding="utf-8")
)
STATES, CONTROLS = PUBLISHED["states"], PUBLISHED["controls"]
AIRSPEED = 17.0


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
