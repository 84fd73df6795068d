"""More messages of an ArduPlane than a recording keeps: what clients ask for on a live link."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_sysid.sitl import telemetry
from gcs_sysid.sitl.slopes import GRAVITY
from gcs_sysid.sitl.telemetry import Message, Received, Snapshot, int16

UNKNOWN_16 = 65535

_SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_GPS
    | mavlink.MAV_SYS_STATUS_AHRS
    | mavlink.MAV_SYS_STATUS_PREARM_CHECK
)

_ESTIMATES = (
    mavlink.EKF_ATTITUDE
    | mavlink.EKF_VELOCITY_HORIZ
    | mavlink.EKF_VELOCITY_VERT
    | mavlink.EKF_POS_HORIZ_REL
    | mavlink.EKF_POS_HORIZ_ABS
    | mavlink.EKF_POS_VERT_ABS
    | mavlink.EKF_PRED_POS_HORIZ_REL
    | mavlink.EKF_PRED_POS_HORIZ_ABS
)

RATES: Mapping[str, float] = {
    **{name: float(rate) for name, rate in telemetry.RATES.items()},
    "SCALED_IMU2": 25.0,
    "HIGHRES_IMU": 0.0,
    "AIRSPEED": 5.0,
    "GPS_RAW_INT": 5.0,
    "RC_CHANNELS": 5.0,
    "WIND": 2.0,
    "RPM": 5.0,
    "SYS_STATUS": 2.0,
    "LOCAL_POSITION_NED": 2.0,
    "NAV_CONTROLLER_OUTPUT": 2.0,
    "MISSION_CURRENT": 2.0,
    "EKF_STATUS_REPORT": 1.0,
    "EXTENDED_SYS_STATE": 1.0,
    "HOME_POSITION": 0.2,
    "ATTITUDE_QUATERNION": 0.0,
    "AUTOPILOT_VERSION": 0.0,
}
"""Rates of a live link [Hz] until a client asks for others; 0 is on request only."""


def _imu(snapshot: Snapshot) -> tuple[list[int], list[int]]:
    """Acceleration [mg] and rates [mrad/s]."""
    measurement = snapshot.measurement
    acceleration = [int16(f / GRAVITY * 1e3) for f in measurement.specific_force]
    return acceleration, [int16(rate * 1e3) for rate in measurement.rates]


def _scaled_imu2(snapshot: Snapshot) -> Message:
    acceleration, rates = _imu(snapshot)
    return mavlink.MAVLink_scaled_imu2_message(
        snapshot.boot_ms, *acceleration, *rates, 0, 0, 0, 4500
    )


def _highres_imu(snapshot: Snapshot) -> Message:
    measurement = snapshot.measurement
    # The magnetic field is not simulated: its bits are not set.
    return mavlink.MAVLink_highres_imu_message(
        snapshot.boot_us,
        *measurement.specific_force,
        *measurement.rates,
        *(0.0, 0.0, 0.0),
        measurement.static_pressure / 100.0,
        measurement.dynamic_pressure / 100.0,
        measurement.altitude,
        measurement.temperature - 273.15,
        0b1111000111111,
    )


def _airspeed(snapshot: Snapshot) -> Message:
    measurement = snapshot.measurement
    celsius = round((measurement.temperature - 273.15) * 100.0)
    return mavlink.MAVLink_airspeed_message(
        0, measurement.indicated_airspeed, celsius, measurement.dynamic_pressure / 100.0, 0
    )


def _gps_raw_int(snapshot: Snapshot) -> Message:
    measurement = snapshot.measurement
    north, east, _ = measurement.velocity
    course = math.degrees(math.atan2(east, north)) % 360.0
    return mavlink.MAVLink_gps_raw_int_message(
        snapshot.boot_us,
        mavlink.GPS_FIX_TYPE_3D_FIX,
        *_position(measurement.latitude, measurement.longitude, measurement.altitude),
        *(80, 120),
        min(round(100.0 * math.hypot(north, east)), UNKNOWN_16 - 1),
        round(100.0 * course) % 36000,
        14,
    )


def _rc_channels(snapshot: Snapshot) -> Message:
    channels = snapshot.status.channels
    pulses = [*channels, *[UNKNOWN_16] * (18 - len(channels))]
    return mavlink.MAVLink_rc_channels_message(snapshot.boot_ms, len(channels), *pulses, 255)


def _wind(snapshot: Snapshot) -> Message:
    north, east = snapshot.status.wind
    blows_from = math.degrees(math.atan2(-east, -north))
    return mavlink.MAVLink_wind_message(blows_from, math.hypot(north, east), 0.0)


def _rpm(snapshot: Snapshot) -> Message:
    speeds = snapshot.motors
    return mavlink.MAVLink_rpm_message(speeds.get(1, 0.0), speeds.get(2, 0.0))


def _sys_status(snapshot: Snapshot) -> Message:
    battery: Received = telemetry.BUILDERS["BATTERY_STATUS"](snapshot)
    cells = [cell for cell in battery.voltages if cell != UNKNOWN_16]
    return mavlink.MAVLink_sys_status_message(
        *(_SENSORS, _SENSORS, _SENSORS, 250),
        *(sum(cells), battery.current_battery, battery.battery_remaining),
        *(0, 0, 0, 0, 0, 0),
    )


def _local_position_ned(snapshot: Snapshot) -> Message:
    measurement = snapshot.measurement
    latitude, longitude, elevation = snapshot.status.home
    radius = 6371000.0
    return mavlink.MAVLink_local_position_ned_message(
        snapshot.boot_ms,
        radius * (measurement.latitude - latitude),
        radius * math.cos(latitude) * (measurement.longitude - longitude),
        elevation - measurement.altitude,
        *measurement.velocity,
    )


def _nav_controller_output(snapshot: Snapshot) -> Message:
    roll, pitch, _ = (math.degrees(angle) for angle in snapshot.measurement.attitude)
    wanted = math.remainder(math.degrees(snapshot.status.heading), 360.0)
    return mavlink.MAVLink_nav_controller_output_message(
        roll, pitch, round(wanted), round(wanted), 0, 0.0, 0.0, 0.0
    )


def _mission_current(snapshot: Snapshot) -> Message:
    status = snapshot.status
    return mavlink.MAVLink_mission_current_message(status.item, status.items - 1)


def _ekf_status_report(snapshot: Snapshot) -> Message:
    return mavlink.MAVLink_ekf_status_report_message(_ESTIMATES, 0.1, 0.1, 0.1, 0.1, 0.0)


def _extended_sys_state(snapshot: Snapshot) -> Message:
    return mavlink.MAVLink_extended_sys_state_message(
        mavlink.MAV_VTOL_STATE_UNDEFINED, mavlink.MAV_LANDED_STATE_IN_AIR
    )


def _home_position(snapshot: Snapshot) -> Message:
    return mavlink.MAVLink_home_position_message(
        *_position(*snapshot.status.home),
        *(0.0, 0.0, 0.0),
        [1.0, 0.0, 0.0, 0.0],
        *(0.0, 0.0, 0.0),
        snapshot.boot_us,
    )


def _attitude_quaternion(snapshot: Snapshot) -> Message:
    return mavlink.MAVLink_attitude_quaternion_message(
        snapshot.boot_ms, *_quaternion(*snapshot.measurement.attitude), *snapshot.measurement.rates
    )


def _autopilot_version(snapshot: Snapshot) -> Message:
    capabilities = (
        mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
        | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
        | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    )
    # The message set is that of ArduPlane 4.6.0; a development version, not the released one.
    version = (4 << 24) | (6 << 16) | mavlink.FIRMWARE_VERSION_TYPE_DEV
    return mavlink.MAVLink_autopilot_version_message(
        capabilities, version, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 1
    )


BUILDERS: Mapping[str, Callable[[Snapshot], Message]] = {
    **telemetry.BUILDERS,
    "SCALED_IMU2": _scaled_imu2,
    "HIGHRES_IMU": _highres_imu,
    "AIRSPEED": _airspeed,
    "GPS_RAW_INT": _gps_raw_int,
    "RC_CHANNELS": _rc_channels,
    "WIND": _wind,
    "RPM": _rpm,
    "SYS_STATUS": _sys_status,
    "LOCAL_POSITION_NED": _local_position_ned,
    "NAV_CONTROLLER_OUTPUT": _nav_controller_output,
    "MISSION_CURRENT": _mission_current,
    "EKF_STATUS_REPORT": _ekf_status_report,
    "EXTENDED_SYS_STATE": _extended_sys_state,
    "HOME_POSITION": _home_position,
    "ATTITUDE_QUATERNION": _attitude_quaternion,
    "AUTOPILOT_VERSION": _autopilot_version,
}
"""Every message that can be sent or asked for, by type."""


def _position(latitude: float, longitude: float, altitude: float) -> tuple[int, int, int]:
    return (
        round(math.degrees(latitude) * 1e7),
        round(math.degrees(longitude) * 1e7),
        round(altitude * 1e3),
    )


def _quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
