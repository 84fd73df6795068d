"""What each topic of a PX4 log says about the flight, under the names that telemetry has.

Topics and fields are those of PX4's `msg/*.msg`, version 1.8 to 1.16; names that changed are listed
side by side, and those that a log lacks are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid.sources.messages import DEGREE, ZERO_CELSIUS

Column = Float[np.ndarray, " sample"]
Topic = Mapping[str, np.ndarray]
Channels = dict[str, Column]

OUTPUTS = 16
"""Outputs of one driver instance: those of the second follow those of the first."""
ARMED = 2
"""`arming_state` of vehicle_status while armed."""
FIX = 3
"""`fix_type` from which on there is a position in three dimensions."""


@dataclass(frozen=True)
class Field:
    """channel = scale · field + offset, NaN where the field named `valid` is zero."""

    channel: str
    field: str
    scale: float = 1.0
    offset: float = 0.0
    valid: str | None = None


@dataclass(frozen=True)
class Reading:
    """A topic and what it carries.

    Attributes:
        topic: its name.
        stream: the stream that it becomes.
        fields: its channels.
        special: adds what a scale and an offset cannot say: (topic, instance) -> channels.
        each: whether every instance has a stream of its own; otherwise only the first is read,
            unless `special` tells them apart.
    """

    topic: str
    stream: str
    fields: tuple[Field, ...] = ()
    special: Callable[[Topic, int], Channels] | None = None
    each: bool = False

    def read(self, topic: Topic, instance: int) -> Channels:
        """Values in SI; of fields that exist under two names the first counts."""
        result: Channels = {}
        for field in self.fields:
            if field.field not in topic or field.channel in result:
                continue
            values = field.scale * topic[field.field].astype(np.float64) + field.offset
            if field.valid is not None and field.valid in topic:
                values = np.where(topic[field.valid] == 0, np.nan, values)
            result[field.channel] = np.where(np.isfinite(values), values, np.nan)
        if self.special is not None:
            result.update(self.special(topic, instance))
        return result


def _array(channels: str, field: str, scale: float = 1.0) -> tuple[Field, ...]:
    return tuple(Field(name, f"{field}[{i}]", scale) for i, name in enumerate(channels.split()))


def _attitude(topic: Topic, _instance: int) -> Channels:
    if "q[3]" not in topic:
        return {}
    w, x, y, z = (topic[f"q[{i}]"].astype(np.float64) for i in range(4))
    known = np.abs(w * w + x * x + y * y + z * z - 1.0) < 0.1
    angles = {
        "roll": np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        "pitch": np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
        "yaw": np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    }
    return {name: np.where(known, angle, np.nan) for name, angle in angles.items()}


def _fixes(topic: Topic, _instance: int) -> Channels:
    """Position and velocity; what is no fix is NaN."""
    result: Channels = {}
    for channel, degrees, whole in (
        ("latitude", "latitude_deg", "lat"),
        ("longitude", "longitude_deg", "lon"),
    ):
        if degrees in topic:
            result[channel] = DEGREE * topic[degrees].astype(np.float64)
        elif whole in topic:
            result[channel] = 1e-7 * DEGREE * topic[whole].astype(np.float64)
    if "altitude_msl_m" in topic:
        result["altitude"] = topic["altitude_msl_m"].astype(np.float64)
    elif "alt" in topic:
        result["altitude"] = 1e-3 * topic["alt"].astype(np.float64)
    for channel, field in (
        ("v_north", "vel_n_m_s"),
        ("v_east", "vel_e_m_s"),
        ("v_down", "vel_d_m_s"),
    ):
        if field in topic:
            result[channel] = topic[field].astype(np.float64)
    if "fix_type" in topic:
        lost = topic["fix_type"] < FIX
        result = {name: np.where(lost, np.nan, values) for name, values in result.items()}
    return result


def _outputs(topic: Topic, instance: int) -> Channels:
    """Pulses; outputs that a driver does not have are 0 or not a number."""
    result: Channels = {}
    for n in range(OUTPUTS):
        if f"output[{n}]" in topic:
            pulse = topic[f"output[{n}]"].astype(np.float64)
            # Outputs that are no pulses (a CAN motor's 0 to 8191, a simulation's -1 to 1) stay out.
            pulse = np.where((pulse >= 700.0) & (pulse <= 2300.0), pulse, np.nan)
            result[f"pwm_{OUTPUTS * instance + n + 1}"] = pulse
    return result


def _channels(topic: Topic, _instance: int) -> Channels:
    found = {f"pwm_{n + 1}": topic.get(f"values[{n}]") for n in range(18)}
    return {
        name: np.where(values == 0, np.nan, values.astype(np.float64))
        for name, values in found.items()
        if values is not None
    }


def _motors(topic: Topic, _instance: int) -> Channels:
    found = {f"rpm_{n + 1}": topic.get(f"esc[{n}].esc_rpm") for n in range(8)}
    return {
        name: np.abs(values.astype(np.float64))
        for name, values in found.items()
        if values is not None
    }


def _rpm(topic: Topic, instance: int) -> Channels:
    for name in ("rpm_estimate", "indicated_frequency_rpm"):
        if name in topic:
            return {f"rpm_{instance + 1}": topic[name].astype(np.float64)}
    return {}


def _armed(topic: Topic, _instance: int) -> Channels:
    if "arming_state" not in topic:
        return {}
    return {"armed": (topic["arming_state"] == ARMED).astype(np.float64)}


_VELOCITY = (
    Field("v_north", "vx", valid="v_xy_valid"),
    Field("v_east", "vy", valid="v_xy_valid"),
    Field("v_down", "vz", valid="v_z_valid"),
)
_HEIGHT = Field("height", "z", -1.0, valid="z_valid")
_WIND = (Field("wind_north", "windspeed_north"), Field("wind_east", "windspeed_east"))

READINGS: tuple[Reading, ...] = (
    Reading(
        "sensor_combined",
        "HIGHRES_IMU",
        (
            *_array("acc_x acc_y acc_z", "accelerometer_m_s2"),
            *_array("p q r", "gyro_rad"),
            *_array("mag_x mag_y mag_z", "magnetometer_ga", 1e-4),
        ),
    ),
    Reading(
        "vehicle_magnetometer", "HIGHRES_IMU", _array("mag_x mag_y mag_z", "magnetometer_ga", 1e-4)
    ),
    Reading(
        "vehicle_attitude",
        "ATTITUDE",
        (Field("p", "rollspeed"), Field("q", "pitchspeed"), Field("r", "yawspeed")),
        _attitude,
    ),
    Reading("vehicle_angular_velocity", "ATTITUDE", _array("p q r", "xyz")),
    Reading(
        "vehicle_local_position",
        "LOCAL_POSITION_NED",
        (
            Field("north", "x", valid="xy_valid"),
            Field("east", "y", valid="xy_valid"),
            _HEIGHT,
            *_VELOCITY,
        ),
    ),
    Reading(
        "vehicle_global_position",
        "GLOBAL_POSITION_INT",
        (
            Field("latitude", "lat", DEGREE),
            Field("longitude", "lon", DEGREE),
            Field("altitude", "alt"),
        ),
    ),
    Reading("vehicle_local_position", "GLOBAL_POSITION_INT", (_HEIGHT, *_VELOCITY)),
    Reading("vehicle_gps_position", "GPS_RAW_INT", special=_fixes),
    Reading("sensor_gps", "GPS_RAW_INT", special=_fixes),
    Reading(
        "airspeed",
        "AIRSPEED",
        (
            Field("airspeed", "indicated_airspeed_m_s"),
            Field("temperature", "air_temperature_celsius", 1.0, ZERO_CELSIUS),
        ),
        each=True,
    ),
    Reading(
        "airspeed_validated",
        "VFR_HUD",
        tuple(
            Field("airspeed", name, valid="airspeed_sensor_measurement_valid")
            for name in ("calibrated_airspeed_m_s", "equivalent_airspeed_m_s")
        ),
    ),
    Reading(
        "vehicle_air_data",
        "SCALED_PRESSURE",
        (
            Field("static_pressure", "baro_pressure_pa"),
            Field("temperature", "ambient_temperature", 1.0, ZERO_CELSIUS),
            Field("temperature", "baro_temp_celcius", 1.0, ZERO_CELSIUS),
        ),
    ),
    Reading(
        "differential_pressure",
        "SCALED_PRESSURE",
        tuple(
            Field("dynamic_pressure", f"differential_pressure_{name}pa")
            for name in ("", "filtered_", "raw_")
        ),
    ),
    Reading("airflow_aoa", "AOA_SSA", (Field("alpha", "aoa_rad", valid="valid"),)),
    Reading("airflow_slip", "AOA_SSA", (Field("beta", "slip_rad", valid="valid"),)),
    Reading("actuator_outputs", "SERVO_OUTPUT_RAW", special=_outputs),
    Reading("input_rc", "RC_CHANNELS", special=_channels),
    Reading("esc_status", "ESC_STATUS", special=_motors),
    Reading("rpm", "RPM", special=_rpm),
    Reading(
        "battery_status",
        "BATTERY_STATUS",
        (Field("voltage", "voltage_v"), Field("current", "current_a")),
        each=True,
    ),
    Reading("wind", "WIND_COV", _WIND),
    Reading("wind_estimate", "WIND_COV", _WIND),
    Reading("vehicle_status", "HEARTBEAT", (Field("mode", "nav_state"),), _armed),
)
"""What is read, the most important topic of each stream first: it sets the stream's times."""

BY_INSTANCE = ("actuator_outputs", "rpm")
"""Topics whose instances are parts of one stream."""
DEMANDS = {"actuator_motors": 101, "actuator_servos": 201}
"""Topics of demands, -1 to 1, and the output function of the first (PX4, `PWM_MAIN_FUNCn`)."""
WANTED = frozenset({*(one.topic for one in READINGS), *DEMANDS})
"""Topics that are read; others are left in the file."""
