"""What each DataFlash message says about the flight, under the names that telemetry has.

Units are those of ArduPilot's LogStructure.h where the log itself does not state others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid.sources.dataflash.log import Messages
from gcs_sysid.sources.units import UNITS, Unit

_NUMBER = Unit("number", 1.0)
_LABELS: Mapping[str, str] = {
    "deg": "deg", "degheading": "deg", "deglatitude": "deg", "deglongitude": "deg",
    "rad": "rad", "deg/s": "deg/s", "rad/s": "rad/s", "m/s": "m/s", "m/s/s": "m/s^2", "m": "m",
    "s": "s", "Pa": "Pa", "degC": "C", "Gauss": "gauss", "rpm": "rpm", "v": "V", "A": "A",
}  # fmt: skip
"""What the UNIT messages of a log call the units of tables."""


@dataclass(frozen=True)
class Field:
    """How one field becomes one channel.

    Attributes:
        channel: name in `gcs_sysid.recording.CHANNELS`.
        field: field of the message.
        unit: unit of the field in logs that do not state it; empty for plain numbers and pulses.
        factor: SI value of one in that unit, beyond the unit's own.
        unknown: value that means "not measured".
    """

    channel: str
    field: str
    unit: str = ""
    factor: float = 1.0
    unknown: float | None = None

    def read(self, messages: Messages) -> Float[np.ndarray, " message"]:
        """Values in SI."""
        values = messages.value(self.field)
        if self.unknown is not None:
            values = np.where(values == self.unknown, np.nan, values)
        stated = _LABELS.get(messages.format.unit(self.field))
        unit = UNITS[stated or self.unit] if self.unit else _NUMBER
        values = self.factor * (unit.factor * values + unit.zero)
        return np.where(np.isfinite(values), values, np.nan)


@dataclass(frozen=True)
class Reading:
    """A message type and what it carries.

    Attributes:
        message: its name.
        streams: stream of each instance, the first first; more instances are not read.
        fields: its channels; those that a log's version of it lacks are left out.
        first: instance that messages without an instance field are about.
        healthy: field that is zero while the sensor is not to be believed.
    """

    message: str
    streams: tuple[str, ...]
    fields: tuple[Field, ...]
    first: int = 0
    healthy: str | None = None


def _each(names: str, fields: str, unit: str = "") -> tuple[Field, ...]:
    pairs = zip(names.split(), fields.split(), strict=True)
    return tuple(Field(name, field, unit) for name, field in pairs)


def _pulses(first: int, last: int) -> tuple[Field, ...]:
    # An output without a function is 0.
    return tuple(Field(f"pwm_{n}", f"C{n}", unknown=0.0) for n in range(first, last + 1))


_IMUS = ("RAW_IMU", "SCALED_IMU2", "SCALED_IMU3")
_PRESSURES = ("SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3")
_RECEIVERS = ("GPS_RAW_INT", "GPS2_RAW")
_IMU = (
    *_each("acc_x acc_y acc_z", "AccX AccY AccZ", "m/s^2"),
    *_each("p q r", "GyrX GyrY GyrZ", "rad/s"),
    Field("temperature", "T", "C", unknown=0.0),
)
_MAG = _each("mag_x mag_y mag_z", "MagX MagY MagZ", "mgauss")
_BARO = (Field("static_pressure", "Press", "Pa", unknown=0.0), Field("temperature", "Temp", "C"))
_ARSP = (Field("airspeed", "Airspeed", "m/s"), Field("temperature", "Temp", "C"))
_PLACE = (*_each("latitude longitude", "Lat Lng", "deg"), Field("altitude", "Alt", "m"))
_LOCAL = (
    *_each("north east", "PN PE", "m"),
    Field("height", "PD", "m", factor=-1.0),
)
_VELOCITY = _each("v_north v_east v_down", "VN VE VD", "m/s")
_WIND = _each("wind_north wind_east", "VWN VWE", "m/s")
_BATTERY = (Field("voltage", "Volt", "V"), Field("current", "Curr", "A"))
_BATTERIES = ("BATTERY_STATUS", "BATTERY_STATUS[1]", "BATTERY_STATUS[2]")
_EULER = _each("roll pitch yaw", "Roll Pitch Yaw", "deg")

READINGS: tuple[Reading, ...] = (
    *(Reading(f"IMU{n or ''}", _IMUS, _IMU, max(n - 1, 0)) for n in (0, 2, 3)),
    *(Reading(f"MAG{n or ''}", _IMUS, _MAG, max(n - 1, 0)) for n in (0, 2, 3)),
    Reading("ATT", ("ATTITUDE",), _EULER),
    *(Reading(f"BA{name}", _PRESSURES, _BARO, n) for n, name in enumerate(("RO", "R2", "R3"))),
    *(
        Reading(name, streams, fields, n, healthy)
        for streams, fields, healthy in (
            (("AIRSPEED", "AIRSPEED[1]"), _ARSP, "H"),
            (_PRESSURES, (Field("dynamic_pressure", "DiffPress", "Pa"),), None),
        )
        for n, name in enumerate(("ARSP", "ASP2"))
    ),
    Reading(
        "CTUN",
        ("VFR_HUD",),
        (
            *_each("airspeed airspeed", "As Aspd", "m/s"),
            *(Field("throttle", name, factor=1e-2) for name in ("ThO", "ThrOut")),
        ),
    ),
    Reading("POS", ("GLOBAL_POSITION_INT",), (*_PLACE, Field("height", "RelHomeAlt", "m"))),
    *(
        Reading(f"{ekf}KF1", (stream,), fields)
        for ekf in "XN"
        for stream, fields in (
            ("LOCAL_POSITION_NED", (*_LOCAL, *_VELOCITY)),
            ("GLOBAL_POSITION_INT", _VELOCITY),
        )
    ),
    *(Reading(f"{ekf}KF2", ("WIND",), _WIND) for ekf in "XN"),
    Reading("GPS", _RECEIVERS, (*_PLACE, Field("v_down", "VZ", "m/s"))),
    Reading("GPS2", _RECEIVERS, (*_PLACE, Field("v_down", "VZ", "m/s")), 1),
    Reading("AOA", ("AOA_SSA",), _each("alpha beta", "AOA SSA", "deg")),
    Reading("RCOU", ("SERVO_OUTPUT_RAW",), _pulses(1, 14)),
    Reading("RCO2", ("SERVO_OUTPUT_RAW",), _pulses(15, 18)),
    Reading("RCO3", ("SERVO_OUTPUT_RAW",), _pulses(19, 32)),
    Reading("RCIN", ("RC_CHANNELS",), _pulses(1, 14)),
    Reading("RCI2", ("RC_CHANNELS",), _pulses(15, 16)),
    Reading("RPM", ("RPM",), _each("rpm_1 rpm_2", "rpm1 rpm2")),
    Reading("BAT", _BATTERIES, _BATTERY),
    Reading("CURR", _BATTERIES, _BATTERY),
    Reading("MODE", ("HEARTBEAT",), (Field("mode", "ModeNum"),)),
    Reading("ARM", ("HEARTBEAT",), (Field("armed", "ArmState"),)),
    Reading("STAT", ("HEARTBEAT",), (Field("armed", "Armed"),)),
    Reading("SIM", ("SIMSTATE",), (*_EULER, *_each("latitude longitude", "Lat Lng", "deg"))),
    Reading(
        "AETR",
        ("AETR",),
        (
            *(
                Field(f"demand_{name}", field, factor=1.0 / 4500.0)
                for name, field in (("aileron", "Ail"), ("elevator", "Elev"), ("rudder", "Rudd"))
            ),
            Field("throttle", "Thr", factor=1e-2),
        ),
    ),
    Reading("PM", ("SYSTEM_TIME",), (Field("time_unix", "R", "us", unknown=0.0),)),
    Reading("MSG", ("STATUSTEXT",), ()),
    Reading("PARM", ("PARAM_VALUE",), ()),
)
"""What is read, the most important of each stream first: it sets the stream's times."""

MOTORS: Mapping[str, Callable[[int], str]] = {
    "ESC": lambda motor: f"ESC_TELEMETRY_{motor - motor % 4 + 1}_TO_{motor - motor % 4 + 4}",
    "RPM": lambda _motor: "RPM",
}
"""Types whose field `RPM` is about the motor of their instance, counted from 0 -> its stream."""

CORES = ("XKF1", "XKF2", "NKF1", "NKF2")
"""Types of which each core of the navigation filter writes its own; the primary one is read."""
PRIMARY: Mapping[str, str] = {"X": "XKF4", "N": "NKF4"}
"""Types whose field `PI` says which core that is, by the first letter of a filter's messages."""

DEFINITIONS = ("FMT", "FMTU", "UNIT", "MULT", "FILE")
"""Types that describe the log, not the flight."""

WANTED = frozenset({*(one.message for one in READINGS), *MOTORS, "GPA", *PRIMARY.values(), "DSF"})
"""Types whose fields are needed."""
