"""The parameters on board, as ArduPlane names them, and how they are read and set.

References:
    MAVLink parameter protocol, https://mavlink.io/en/services/parameter.html; names and defaults
    of the ArduPlane 4.6 parameter list.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.sitl import telemetry
from gcs_sysid.sitl.telemetry import Message, Received


class Parameters:
    """Names and values; `airspeed` [m/s] is the one to cruise at unless told otherwise."""

    def __init__(self, aircraft: Aircraft, *, airspeed: float) -> None:
        envelope = aircraft.envelope
        low, high = envelope.airspeed if envelope else (0.7 * airspeed, 1.4 * airspeed)
        bank = envelope.bank if envelope else math.radians(45.0)
        values = telemetry.output_parameters(aircraft) | {
            "SYSID_MYGCS": 255.0,
            "AIRSPEED_CRUISE": airspeed,
            "AIRSPEED_MIN": low,
            "AIRSPEED_MAX": high,
            "ROLL_LIMIT_DEG": round(math.degrees(min(bank, math.radians(45.0)))),
            "PTCH_LIM_MAX_DEG": 20.0,
            "PTCH_LIM_MIN_DEG": -25.0,
            "WP_RADIUS": max(20.0, round(2.0 * airspeed)),
            "WP_LOITER_RAD": max(60.0, round(airspeed**2 / 5.0)),
            "RTL_ALTITUDE": 100.0,
            "RC_OVERRIDE_TIME": 3.0,
        }
        self._values = {name: float(value) for name, value in values.items()}
        self._names = list(self._values)

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def receive(self, message: Received) -> Iterable[Message]:
        """Answer a message of the parameter protocol."""
        match message.get_type():
            case "PARAM_REQUEST_LIST":
                return [self._message(name) for name in self._names]
            case "PARAM_REQUEST_READ":
                return self._read(message.param_index, message.param_id)
            case "PARAM_SET":
                return self._set(message.param_id, message.param_value)
        return []

    def _read(self, index: int, name: str) -> Iterable[Message]:
        if 0 <= index < len(self._names):
            return [self._message(self._names[index])]
        return [self._message(name)] if name in self._values else []

    def _set(self, name: str, value: float) -> Iterable[Message]:
        if name not in self._values:
            return []
        if math.isfinite(value):
            self._values[name] = value
        return [self._message(name)]

    def _message(self, name: str) -> Message:
        return mavlink.MAVLink_param_value_message(
            name.encode(),
            self._values[name],
            mavlink.MAV_PARAM_TYPE_REAL32,
            len(self._names),
            self._names.index(name),
        )
