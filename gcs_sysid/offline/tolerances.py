"""How far a simulated motion may be from the measured one before it counts as another motion.

Those of 14 CFR part 60, appendix A, table A2A, for the short period and roll response of full
flight simulators (about 11 m span); rates grow with √(11 m/b) for smaller aircraft, which move
faster by that factor (Froude scaling). Theil's inequality coefficient of 0.25 to 0.3 is the usual
limit of a good match (Jategaonkar, *Flight Vehicle System Identification*, 2nd ed. 2015, ch. 11).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from gcs_sysid.aircraft import Aircraft

THEIL = 0.3
SPAN = 11.0
"""Span [m] of the aircraft that the tolerances were written for."""


def tolerances(aircraft: Aircraft) -> Mapping[str, float]:
    """Tolerance of every simulated channel [m/s, rad, rad/s]."""
    angle = math.radians(1.5)
    rate = math.radians(2.0) * max(1.0, math.sqrt(SPAN / aircraft.geometry.wing_span))
    return {
        "V": 1.54,  # 3 kt
        "alpha": angle,
        "beta": angle,
        "p": rate,
        "q": rate,
        "r": rate,
        "phi": angle,
        "theta": angle,
        "psi": angle,
    }
