"""Sweeps as parameters of ArduPlane's own system identification.

Only firmware built with it has these parameters ("system ID support" in the custom build server);
an RC switch with RCn_OPTION = 184 starts and stops the sweep. Released versions accept it in VTOL
modes only. Where it is there for the surfaces, its mixer axes add a sweep after the controller.

References:
    ArduPilot, `ArduPlane/systemid.cpp` (parameters and axes), ardupilot.org, "System
    Identification Feature".
"""

from __future__ import annotations

from collections.abc import Mapping

from gcs_sysid.maneuvers.recipes import SLOW, SWEEP
from gcs_sysid.maneuvers.signals.sweep import TAPER

MIXER = {"roll": 10, "pitch": 11, "yaw": 12}
"""Values of SID_AXIS that inject after the controller."""


def parameters(axis: str, *, amplitude: float, travel: float, last: float) -> Mapping[str, float]:
    """Parameters of a sweep.

    Args:
        axis: `roll`, `pitch` or `yaw`.
        amplitude: of the control [rad].
        travel: of the control [rad].
        last: frequency at the end [Hz].
    """
    return {
        "SID_AXIS": float(MIXER[axis]),
        "SID_MAGNITUDE": amplitude / travel,
        "SID_F_START_HZ": SLOW,
        "SID_F_STOP_HZ": last,
        "SID_T_FADE_IN": TAPER * SWEEP,
        "SID_T_REC": SWEEP,
        "SID_T_FADE_OUT": TAPER * SWEEP,
    }


def file(values: Mapping[str, float]) -> str:
    """A parameter file that ground stations load."""
    lines = ["# ArduPlane built with system ID only; start with RCn_OPTION = 184"]
    return "\n".join([*lines, *(f"{name},{value:.6g}" for name, value in values.items())]) + "\n"
