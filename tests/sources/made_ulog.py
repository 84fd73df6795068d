"""Writes ULog files after PX4's published format (docs.px4.io, "ULog File Format")."""

from __future__ import annotations

import math
import struct

MAGIC = b"ULog\x01\x12\x35"
CODES = {
    "uint64_t": "Q", "int64_t": "q", "uint32_t": "I", "int32_t": "i", "uint16_t": "H",
    "uint8_t": "B", "bool": "?", "float": "f", "double": "d",
}  # fmt: skip
FORMATS = {
    "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2",
    "vehicle_attitude": "uint64_t timestamp;uint64_t timestamp_sample;float[4] q",
    "vehicle_angular_velocity": "uint64_t timestamp;float[3] xyz",
    "vehicle_local_position": (
        "uint64_t timestamp;float x;float y;float z;float vx;float vy;float vz;"
        "bool xy_valid;bool z_valid;bool v_xy_valid;bool v_z_valid"
    ),
    "vehicle_global_position": "uint64_t timestamp;double lat;double lon;float alt",
    "sensor_gps": (
        "uint64_t timestamp;uint64_t time_utc_usec;double latitude_deg;double longitude_deg;"
        "double altitude_msl_m;float vel_n_m_s;float vel_e_m_s;float vel_d_m_s;uint8_t fix_type"
    ),
    "airspeed": "uint64_t timestamp;float indicated_airspeed_m_s;float air_temperature_celsius",
    "vehicle_air_data": "uint64_t timestamp;float baro_pressure_pa;float ambient_temperature",
    "actuator_outputs": "uint64_t timestamp;uint32_t noutputs;float[16] output",
    "actuator_servos": "uint64_t timestamp;float[8] control",
    "airflow_aoa": "uint64_t timestamp;float aoa_rad;bool valid",
    "airflow_slip": "uint64_t timestamp;float slip_rad;bool valid",
    "esc_report": "int32_t esc_rpm;float esc_voltage",
    "esc_status": "uint64_t timestamp;uint8_t esc_count;esc_report[2] esc",
    "vehicle_status": "uint64_t timestamp;uint8_t arming_state;uint8_t nav_state",
    "cpuload": "uint64_t timestamp;float load",
}


def _code(topic: str) -> str:
    code = ""
    for field in FORMATS[topic].split(";"):
        kind, _, count = field.split()[0].partition("[")
        one = CODES[kind] if kind in CODES else _code(kind)
        code += one * int(count.rstrip("]") or 1)
    return code


def _message(kind: str, content: bytes) -> bytes:
    return struct.pack("<HB", len(content), ord(kind)) + content


class Ulog:
    """A log in memory; definitions and subscriptions are written when first needed."""

    def __init__(self, *, start_us: int = 1_000_000) -> None:
        self.head = MAGIC + bytes([1]) + struct.pack("<Q", start_us)
        self.head += _message("B", bytes(40))
        self.messages: list[bytes] = []
        self._ids: dict[tuple[str, int], int] = {}
        for name, fields in FORMATS.items():
            self.head += _message("F", f"{name}:{fields};".encode())

    def parameter(self, name: str, value: float) -> Ulog:
        kind, code = ("int32_t", "i") if isinstance(value, int) else ("float", "f")
        key = f"{kind} {name}".encode()
        self.head += _message("P", bytes([len(key)]) + key + struct.pack(f"<{code}", value))
        return self

    def add(self, topic: str, *values: float, instance: int = 0) -> Ulog:
        """Adds a sample: time [µs], then the fields one by one."""
        if (topic, instance) not in self._ids:
            number = self._ids[topic, instance] = len(self._ids)
            content = struct.pack("<BH", instance, number) + topic.encode()
            self.messages.append(_message("A", content))
        content = struct.pack(f"<H{_code(topic)}", self._ids[topic, instance], *values)
        self.messages.append(_message("D", content))
        return self

    def text(self, time_us: int, line: str) -> Ulog:
        self.messages.append(_message("L", struct.pack("<BQ", ord("6"), time_us) + line.encode()))
        return self

    def dropout(self, milliseconds: int) -> Ulog:
        self.messages.append(_message("O", struct.pack("<H", milliseconds)))
        return self

    @property
    def data(self) -> bytes:
        return self.head + b"".join(self.messages)


def flight(seconds: float = 2.0, *, outputs: bool = True) -> Ulog:
    """A short flight: 200 Hz inertial data, the rest slower."""
    log = Ulog().parameter("MAV_SYS_ID", 3).parameter("MAV_TYPE", 1)
    log.parameter("PWM_MAIN_FUNC2", 201).parameter("PWM_MAIN_MIN2", 1100.0)
    log.parameter("PWM_MAIN_MAX2", 1900.0).parameter("FW_AIRSPD_TRIM", 15.5)
    log.text(1_000_000, "[commander] Takeoff detected")
    half = math.radians(30.0) / 2.0
    for i in range(int(200 * seconds)):
        t = 1_000_000 + 5000 * i
        log.add("sensor_combined", t, 0.01 * i, 0.5, -0.25, 0.5, 0.25, -9.75)
        if i % 2 == 0:
            log.add("vehicle_attitude", t + 300, t, math.cos(half), math.sin(half), 0.0, 0.0)
            log.add("vehicle_angular_velocity", t + 200, 0.125, 0.25, 0.5)
        if i % 4 == 0:
            demand = -0.5 + 0.01 * (i % 100)
            if outputs:
                log.add("actuator_outputs", t, 4, 1500.0 + i, 1200.0, 0.0, 900.0, *[0.0] * 12)
                log.add("actuator_outputs", t + 60, 2, 1750.0, *[0.0] * 15, instance=1)
            log.add("actuator_servos", t, demand, *[math.nan] * 7)
        if i % 20 == 0:
            log.add("vehicle_global_position", t, 47.5, 8.5, 600.0)
            log.add(
                "vehicle_local_position", t, 1.0, 2.0, -50.0, 15.0, 1.0, -0.5,
                True, True, True, True,
            )  # fmt: skip
            log.add("airspeed", t, 15.25, 21.0)
            log.add("vehicle_air_data", t, 95_000.0, 15.0)
            log.add("airflow_aoa", t, 0.0625, i >= 40)
            log.add("esc_status", t, 2, 7000, 16.0, -6500, 16.0)
            log.add("vehicle_status", t, 2, 3)
            log.add("cpuload", t, 0.5)
        if i % 40 == 0:
            log.add(
                "sensor_gps", t, 1_790_000_000_000_000 + t, 47.5, 8.5, 600.0, 15.0, 1.0, -0.5,
                3 if i else 0,
            )  # fmt: skip
    return log
