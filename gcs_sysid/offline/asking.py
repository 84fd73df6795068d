"""How to get what a flight lacked from the autopilot next time: message, rate, parameter."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gcs_sysid.recording import NO_AUTOPILOT, Recording

_GROUPS: Mapping[str, tuple[int, str]] = {
    "RAW_IMU": (27, "SR0_RAW_SENS"),
    "SCALED_PRESSURE": (29, "SR0_RAW_SENS"),
    "ATTITUDE": (30, "SR0_EXTRA1"),
    "GLOBAL_POSITION_INT": (33, "SR0_POSITION"),
    "SERVO_OUTPUT_RAW": (36, "SR0_RC_CHAN"),
    "VFR_HUD": (74, "SR0_EXTRA2"),
    "AOA_SSA": (11020, "SR0_EXTRA1"),
}
"""MAVLink message number, and the ArduPilot parameter that sets its rate on the first link
(ArduPlane 4.6, stream groups of GCS_Mavlink.cpp)."""
_CHANNELS: Mapping[str, str] = {
    "RAW_IMU": "acc_x to acc_z and p, q, r",
    "SCALED_PRESSURE": "static_pressure",
    "ATTITUDE": "roll, pitch, yaw",
    "GLOBAL_POSITION_INT": "v_north, v_east, v_down",
    "SERVO_OUTPUT_RAW": "each servo's pulse or surface's deflection",
    "VFR_HUD": "airspeed",
    "AOA_SSA": "alpha, beta",
}
"""What to log where a table or an onboard log takes the place of messages."""
_PX4_NAMES: Mapping[str, str] = {"RAW_IMU": "HIGHRES_IMU", "SERVO_OUTPUT_RAW": "SERVO_OUTPUT_RAW_0"}
_ONBOARD = (".bin", ".log", ".ulg")
"""Endings of the names of onboard logs, whose rates other parameters set."""
_LOGGED: Mapping[str, str] = {
    "ArduPilot": "LOG_BITMASK = 1114111: everything, attitude and inertial unit at the full rate",
    "PX4": "SDLOG_PROFILE = 17: the default topics and the high rate",
}
"""What to set for that (ArduPlane 4.6, bits 0 to 15 and 20; PX4 1.14, bits 0 and 4)."""


def ask(recording: Recording, message: str, rate: float) -> str:
    """How to get a message at a rate [Hz] from this vehicle's autopilot, in telemetry or its log.

    Servo outputs are asked for in telemetry: ArduPlane logs them at 25 Hz, whatever the rest.
    """
    number, group = _GROUPS[message]
    rate = max(1.0, float(np.ceil(rate)))
    if recording.vehicle.autopilot == NO_AUTOPILOT:
        return f"log {_CHANNELS[message]} at {rate:.0f} Hz and name the columns in the column map"
    onboard = Path(recording.source).suffix.lower() in _ONBOARD
    px4 = "PX4" in recording.vehicle.autopilot
    if onboard and (px4 or message != "SERVO_OUTPUT_RAW"):
        setting = _LOGGED["PX4" if px4 else "ArduPilot"]
        return f"log {_CHANNELS[message]} at {rate:.0f} Hz ({setting})"
    if px4:
        name = _PX4_NAMES.get(message, message)
        return (
            f"ask PX4 for {name} at {rate:.0f} Hz (mavlink stream -d DEVICE -s {name} "
            f"-r {rate:.0f}, and a MAV_0_RATE that carries it)"
        )
    beside = "record telemetry beside the onboard log: " if onboard else ""
    return beside + (
        f"ask for {message} at {rate:.0f} Hz (ArduPilot: {group} = {rate:.0f}; any: "
        f"SET_MESSAGE_INTERVAL for message {number}, {1e6 / rate:.0f} us)"
    )
