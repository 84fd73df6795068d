"""What each MAVLink message says about the flight, as channels in SI units.

One table serves logs and live links alike. Units and `unknown` values are those of the MAVLink
message definitions (mavlink.io, `common.xml`, `ardupilotmega.xml`); where an autopilot is known to
send something else, the entry says so. Message types that are not listed carry no channels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce

import numpy as np
from jaxtyping import Bool, Float, Shaped

Fields = Mapping[str, np.ndarray]
Channels = dict[str, Float[np.ndarray, " sample"]]

STANDARD_GRAVITY = 9.80665
"""Acceleration of the unit `g` [m/s²] (BIPM 1901)."""

INT16_MAX = 32767
UINT16_MAX = 65535
DEGREE = np.pi / 180.0
ZERO_CELSIUS = 273.15


@dataclass(frozen=True)
class Quantity:
    """How one field becomes one channel: channel = scale · field + offset.

    Attributes:
        channel: name in `gcs_sysid.recording.CHANNELS`.
        field: field of the message definition.
        scale: SI units per unit of the field.
        offset: SI value of a field of zero.
        unknown: field values that mean "not measured".
    """

    channel: str
    field: str
    scale: float = 1.0
    offset: float = 0.0
    unknown: tuple[int, ...] = ()

    def read(self, fields: Fields) -> Float[np.ndarray, " sample"]:
        """The channel's values [SI], NaN where the field says "not measured"."""
        raw = fields[self.field]
        if raw.shape == (1,):
            # A message alone, as from a link: setting up arrays would cost ten times as much.
            one = raw.item()
            value = math.nan if one in self.unknown else self.scale * float(one) + self.offset
            return np.array([value if math.isfinite(value) else math.nan])
        values = self.scale * raw.astype(np.float64) + self.offset
        for unknown in self.unknown:
            values[raw == unknown] = np.nan
        values[~np.isfinite(values)] = np.nan
        return values


def channels(name: str, fields: Fields) -> Channels:
    """Channels of messages of one type.

    Args:
        name: message type.
        fields: raw values by field name, shape (sample,) or (sample, element).

    Returns:
        Values in SI units and radians by channel name, NaN where not measured; empty for a message
        type without channels.
    """
    result = {quantity.channel: quantity.read(fields) for quantity in QUANTITIES.get(name, ())}
    special = SPECIAL.get(name)
    if special is not None:
        special(fields, result)
    return result


def has_channels(name: str) -> bool:
    """Whether messages of this type carry channels."""
    return name in QUANTITIES or name in SPECIAL


def _hide(result: Channels, where: Bool[np.ndarray, " sample"], *names: str) -> None:
    for name in names:
        result[name][where] = np.nan


def _all_zero(result: Channels, *names: str) -> Bool[np.ndarray, " sample"]:
    return reduce(np.logical_and, (result[name] == 0.0 for name in names))


def _wrapped(angle: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " sample"]:
    """Angle within [-π, π) [rad]."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def _imu(fields: Fields, result: Channels) -> None:
    # A working accelerometer reads gravity: three exact zeros mean that the sensor is absent or has
    # not started, and then zero rates beside them mean nothing either.
    dead = _all_zero(result, "acc_x", "acc_y", "acc_z")
    _hide(result, dead & _all_zero(result, "p", "q", "r"), "p", "q", "r")
    _hide(result, dead, "acc_x", "acc_y", "acc_z")
    _hide(result, _all_zero(result, "mag_x", "mag_y", "mag_z"), "mag_x", "mag_y", "mag_z")


HIGHRES_BITS = (
    "acc_x acc_y acc_z p q r mag_x mag_y mag_z static_pressure dynamic_pressure "
    "pressure_altitude temperature"
).split()


def _highres_imu(fields: Fields, result: Channels) -> None:
    # HIGHRES_IMU_UPDATED_FLAGS: a field whose bit is not set repeats an old value. Senders that do
    # not keep the bitmap leave it zero.
    updated = fields["fields_updated"].astype(np.int64)
    for bit, name in enumerate(HIGHRES_BITS):
        _hide(result, (updated != 0) & (updated & (1 << bit) == 0), name)
    _imu(fields, result)


def _attitude(fields: Fields, result: Channels) -> None:
    # Three exact zeros as floating-point numbers: the estimator has not started.
    _hide(result, _all_zero(result, "roll", "pitch", "yaw"), "roll", "pitch", "yaw")


def _attitude_quaternion(fields: Fields, result: Channels) -> None:
    w, x, y, z = (fields[f"q{i}"].astype(np.float64) for i in (1, 2, 3, 4))
    norm = np.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = (np.where((norm > 0.5) & (norm < 2.0), each, np.nan) for each in (w, x, y, z))
    result["roll"] = np.arctan2(2.0 * (w * x + y * z), w * w - x * x - y * y + z * z)
    result["pitch"] = np.arcsin(np.clip(2.0 * (w * y - z * x) / (norm * norm + 1e-300), -1.0, 1.0))
    result["yaw"] = np.arctan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


def _no_position(fields: Fields) -> Bool[np.ndarray, " sample"]:
    # Autopilots without a position yet report the origin, or their estimator's first steps from it:
    # 1e-4 degrees are 11 m.
    return (np.abs(fields["lat"]) < 1000) & (np.abs(fields["lon"]) < 1000)


def _global_position(fields: Fields, result: Channels) -> None:
    _hide(result, _no_position(fields), "latitude", "longitude")
    result["yaw"] = _wrapped(result["yaw"])


def _gps(fields: Fields, result: Channels) -> None:
    # GPS_FIX_TYPE: 3 is the first with a three-dimensional position.
    speed = Quantity("speed", "vel", 1e-2, unknown=(UINT16_MAX,)).read(fields)
    course = Quantity("course", "cog", 1e-2 * DEGREE, unknown=(UINT16_MAX,)).read(fields)
    result["v_north"] = speed * np.cos(course)
    result["v_east"] = speed * np.sin(course)
    lost = (fields["fix_type"] < 3) | _no_position(fields)
    _hide(result, lost, *result)


def _heading(fields: Fields, result: Channels) -> None:
    result["yaw"] = _wrapped(result["yaw"])


def _height(fields: Fields, result: Channels) -> None:
    result["height"] = -result.pop("down")


def _airspeed(fields: Fields, result: Channels) -> None:
    # AIRSPEED_SENSOR_UNHEALTHY = 1.
    _hide(result, (fields["flags"].astype(np.int64) & 1) != 0, "airspeed")


def _wind(fields: Fields, result: Channels) -> None:
    # `direction` is where the wind comes from; channels are where it blows to.
    speed = fields["speed"].astype(np.float64)
    origin = fields["direction"].astype(np.float64) * DEGREE
    result["wind_north"] = -speed * np.cos(origin)
    result["wind_east"] = -speed * np.sin(origin)


def _servo_output(fields: Fields, result: Channels) -> None:
    # Port 1 carries the sixteen outputs after those of port 0.
    port = int(fields["port"][0]) if fields["port"].size else 0
    if port:
        renamed = {f"pwm_{n + 16 * port}": result.pop(f"pwm_{n}") for n in range(1, 17)}
        result.update(renamed)


def _battery(fields: Fields, result: Channels) -> None:
    # Cells that do not exist are UINT16_MAX (1 to 10) and 0 (11 to 14).
    first = fields["voltages"].astype(np.float64)
    first[(first == UINT16_MAX) | (first == 0.0)] = np.nan
    total = np.nansum(first, axis=1) + np.sum(fields["voltages_ext"], axis=1, dtype=np.float64)
    result["voltage"] = np.where(total > 0.0, 1e-3 * total, np.nan)


def _esc(first: int) -> Callable[[Fields, Channels], None]:
    def read(fields: Fields, result: Channels) -> None:
        # No telemetry packet was ever received from an ESC whose counter is zero.
        for element in range(4):
            rpm = fields["rpm"][:, element].astype(np.float64)
            silent = (fields["count"][:, element] == 0) & (rpm == 0.0)
            result[f"rpm_{first + element}"] = np.where(silent, np.nan, rpm)

    return read


def _heartbeat(fields: Fields, result: Channels) -> None:
    # MAV_MODE_FLAG_SAFETY_ARMED = 128.
    armed = (fields["base_mode"].astype(np.int64) & 128) != 0
    result["armed"] = armed.astype(np.float64)


def _xyz(names: tuple[str, str, str], fields: tuple[str, str, str], scale: float = 1.0) -> tuple:
    return tuple(Quantity(n, f, scale) for n, f in zip(names, fields, strict=True))


_ACC = ("acc_x", "acc_y", "acc_z")
_RATE = ("p", "q", "r")
_MAG = ("mag_x", "mag_y", "mag_z")
_EULER = ("roll", "pitch", "yaw")
_RAW_ACC = ("xacc", "yacc", "zacc")
_RAW_GYRO = ("xgyro", "ygyro", "zgyro")
_RAW_MAG = ("xmag", "ymag", "zmag")
_VELOCITY = ("v_north", "v_east", "v_down")
_LATITUDE = Quantity("latitude", "lat", 1e-7 * DEGREE)
_LONGITUDE = Quantity("longitude", "lon", 1e-7 * DEGREE)

_SCALED_IMU = (
    *_xyz(_ACC, _RAW_ACC, 1e-3 * STANDARD_GRAVITY),
    *_xyz(_RATE, _RAW_GYRO, 1e-3),
    *_xyz(_MAG, _RAW_MAG, 1e-7),
    Quantity("temperature", "temperature", 1e-2, ZERO_CELSIUS, unknown=(0,)),
)
_RATES = _xyz(_RATE, ("rollspeed", "pitchspeed", "yawspeed"))
_SCALED_PRESSURE = (
    Quantity("static_pressure", "press_abs", 100.0, unknown=(0,)),
    Quantity("dynamic_pressure", "press_diff", 100.0),
    Quantity("temperature", "temperature", 1e-2, ZERO_CELSIUS),
)
_GPS = (
    _LATITUDE,
    _LONGITUDE,
    Quantity("altitude", "alt", 1e-3),
)


def _pulses(pattern: str, count: int) -> tuple[Quantity, ...]:
    # Autopilots fill channels that they do not have with 0 as well as with UINT16_MAX.
    return tuple(
        Quantity(f"pwm_{n}", pattern.format(n), unknown=(0, UINT16_MAX))
        for n in range(1, count + 1)
    )


QUANTITIES: Mapping[str, tuple[Quantity, ...]] = {
    "AIRSPEED": (
        # raw_press is left out: ArduPilot 4.6 sends pascals where the definition says hectopascals.
        Quantity("airspeed", "airspeed"),
        Quantity("temperature", "temperature", 1e-2, ZERO_CELSIUS, unknown=(INT16_MAX,)),
    ),
    "ALTITUDE": (
        Quantity("altitude", "altitude_amsl"),
        Quantity("height", "altitude_relative"),
    ),
    "AOA_SSA": (Quantity("alpha", "AOA", DEGREE), Quantity("beta", "SSA", DEGREE)),
    "ATTITUDE": (*_xyz(_EULER, ("roll", "pitch", "yaw")), *_RATES),
    "ATTITUDE_QUATERNION": _RATES,
    "BATTERY_STATUS": (Quantity("current", "current_battery", 1e-2, unknown=(-1,)),),
    "EFI_STATUS": (Quantity("rpm_1", "rpm"),),
    "GLOBAL_POSITION_INT": (
        _LATITUDE,
        _LONGITUDE,
        Quantity("altitude", "alt", 1e-3),
        Quantity("height", "relative_alt", 1e-3),
        *_xyz(_VELOCITY, ("vx", "vy", "vz"), 1e-2),
        Quantity("yaw", "hdg", 1e-2 * DEGREE, unknown=(UINT16_MAX,)),
    ),
    "GPS2_RAW": _GPS,
    "GPS_RAW_INT": _GPS,
    "HEARTBEAT": (Quantity("mode", "custom_mode"),),
    "HIGHRES_IMU": (
        *_xyz(_ACC, _RAW_ACC),
        *_xyz(_RATE, _RAW_GYRO),
        *_xyz(_MAG, _RAW_MAG, 1e-4),
        Quantity("static_pressure", "abs_pressure", 100.0),
        Quantity("dynamic_pressure", "diff_pressure", 100.0),
        Quantity("pressure_altitude", "pressure_alt"),
        Quantity("temperature", "temperature", 1.0, ZERO_CELSIUS),
    ),
    "LOCAL_POSITION_NED": (
        Quantity("north", "x"),
        Quantity("east", "y"),
        Quantity("down", "z"),
        *_xyz(_VELOCITY, ("vx", "vy", "vz")),
    ),
    "RAW_IMU": _SCALED_IMU,
    "RC_CHANNELS": _pulses("chan{}_raw", 18),
    "RC_CHANNELS_RAW": _pulses("chan{}_raw", 8),
    "RPM": (Quantity("rpm_1", "rpm1"), Quantity("rpm_2", "rpm2")),
    "SCALED_IMU": _SCALED_IMU,
    "SCALED_IMU2": _SCALED_IMU,
    "SCALED_IMU3": _SCALED_IMU,
    "SCALED_PRESSURE": _SCALED_PRESSURE,
    "SCALED_PRESSURE2": _SCALED_PRESSURE,
    "SCALED_PRESSURE3": _SCALED_PRESSURE,
    "SERVO_OUTPUT_RAW": _pulses("servo{}_raw", 16),
    "SIMSTATE": (
        *_xyz(_EULER, ("roll", "pitch", "yaw")),
        *_xyz(_ACC, _RAW_ACC),
        *_xyz(_RATE, _RAW_GYRO),
        _LATITUDE,
        Quantity("longitude", "lng", 1e-7 * DEGREE),
    ),
    "SYSTEM_TIME": (Quantity("time_unix", "time_unix_usec", 1e-6, unknown=(0,)),),
    "SYS_STATUS": (
        Quantity("voltage", "voltage_battery", 1e-3, unknown=(UINT16_MAX,)),
        Quantity("current", "current_battery", 1e-2, unknown=(-1,)),
    ),
    "VFR_HUD": (
        Quantity("airspeed", "airspeed"),
        Quantity("groundspeed", "groundspeed"),
        Quantity("yaw", "heading", DEGREE),
        Quantity("throttle", "throttle", 1e-2),
        Quantity("altitude", "alt"),
        Quantity("climb", "climb"),
    ),
    "WIND": (Quantity("wind_down", "speed_z"),),
    "WIND_COV": _xyz(("wind_north", "wind_east", "wind_down"), ("wind_x", "wind_y", "wind_z")),
}
"""Message type -> how its fields become channels."""

SPECIAL: Mapping[str, Callable[[Fields, Channels], None]] = {
    "AIRSPEED": _airspeed,
    "ATTITUDE": _attitude,
    "ATTITUDE_QUATERNION": _attitude_quaternion,
    "BATTERY_STATUS": _battery,
    "ESC_TELEMETRY_1_TO_4": _esc(1),
    "ESC_TELEMETRY_5_TO_8": _esc(5),
    "ESC_TELEMETRY_9_TO_12": _esc(9),
    "ESC_TELEMETRY_13_TO_16": _esc(13),
    "GLOBAL_POSITION_INT": _global_position,
    "GPS2_RAW": _gps,
    "GPS_RAW_INT": _gps,
    "HEARTBEAT": _heartbeat,
    "HIGHRES_IMU": _highres_imu,
    "LOCAL_POSITION_NED": _height,
    "RAW_IMU": _imu,
    "SCALED_IMU": _imu,
    "SCALED_IMU2": _imu,
    "SCALED_IMU3": _imu,
    "SERVO_OUTPUT_RAW": _servo_output,
    "VFR_HUD": _heading,
    "WIND": _wind,
}
"""Message type -> what a plain scale and offset cannot say; works on the channels in place."""

INSTANCE_FIELD: Mapping[str, str] = {
    "AIRSPEED": "id",
    "BATTERY_STATUS": "id",
    "HIGHRES_IMU": "id",
    "RAW_IMU": "id",
    "SERVO_OUTPUT_RAW": "port",
}
"""Message types sent for several sensors, and the field that tells them apart."""


def instance(name: str, fields: Fields, row: int) -> int:
    """Which sensor, battery or output port a message is about; 0 for types that have one only."""
    field = INSTANCE_FIELD.get(name)
    return 0 if field is None else int(fields[field][row])


def stream_name(name: str, number: int) -> str:
    """Name of the stream of one instance: the type's for the first, `TYPE[1]` for the second."""
    return name if number == 0 else f"{name}[{number}]"


ABSENT_IF_ALWAYS_ZERO = (
    ("p", "q", "r"),
    ("airspeed",),
    ("dynamic_pressure",),
    ("voltage",),
    ("rpm_1",),
    ("rpm_2",),
)
"""Channels that, zero from the first to the last sample of a log, belong to no sensor."""


def text(values: Shaped[np.ndarray, " sample"]) -> list[str]:
    """Text fields as strings, up to their terminating zero."""
    return [bytes(value).split(b"\0")[0].decode("utf-8", "replace") for value in values]
