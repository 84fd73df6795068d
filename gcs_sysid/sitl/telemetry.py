"""What the vehicle sends: MAVLink 2 messages at their own rates, in the fields' own resolution."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.sitl.autopilot import neutral
from gcs_sysid.sitl.sensors import Measurement
from gcs_sysid.sitl.slopes import GRAVITY

Message = mavlink.MAVLink_message

Received = Any
"""A message that was received: type checkers know no fields of a `Message`."""

TICK_RATE = 50
"""Rate of the vehicle's main loop [Hz]; stream rates divide it."""

TICK_US = 1_000_000 // TICK_RATE
"""Time between two ticks [µs]."""

RATES: Mapping[str, int] = {
    "SYSTEM_TIME": 1,
    "HEARTBEAT": 1,
    "BATTERY_STATUS": 1,
    "ATTITUDE": 50,
    "RAW_IMU": 50,
    "SERVO_OUTPUT_RAW": 50,
    "VFR_HUD": 25,
    "SCALED_PRESSURE": 25,
    "AOA_SSA": 25,
    "GLOBAL_POSITION_INT": 10,
    "ESC_TELEMETRY_1_TO_4": 10,
}
"""Message rates [Hz] that a ground station asks for on a good link; each divides the tick rate."""

BOOT_BEFORE_RECORDING = 93.0
"""How long the vehicle has been switched on when the recording begins [s]."""

AUTO_MODE = 10
"""Custom mode of an ArduPlane that flies its plan (AUTO)."""

MANUAL_MODE = 0
"""Custom mode of an ArduPlane that obeys the sticks (MANUAL)."""

_SERVO_FUNCTIONS = {"aileron": 4, "elevator": 19, "rudder": 21, "flap": 2}
"""ArduPlane's SERVOn_FUNCTION by the first word of a surface's name."""
_THROTTLE_FUNCTION = 70

_CELLS = 3
_FULL_CELL, _EMPTY_CELL, _CAPACITY_AH, _FULL_CURRENT = 4.15, 3.4, 3.2, 32.0
"""A small lithium battery [V, V, A·h, A at full throttle]: plausible numbers, no model."""


@dataclass(frozen=True)
class Status:
    """What the flight computer is about.

    Attributes:
        mode: custom mode of an ArduPlane.
        armed: whether the motor may turn.
        channels: pulses of the remote control from channel 1 [µs].
        home: latitude, longitude [rad], height above sea level [m].
        item: of the mission, flown now.
        items: of the mission, home included.
        heading: wanted [rad].
        wind: estimate of the moving air, north and east [m/s].
    """

    mode: int = AUTO_MODE
    armed: bool = True
    channels: tuple[int, ...] = ()
    home: tuple[float, float, float] = (0.0, 0.0, 0.0)
    item: int = 0
    items: int = 1
    heading: float = 0.0
    wind: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Snapshot:
    """One tick of the vehicle: what was measured and what was commanded.

    Attributes:
        tick: since the recording began.
        epoch_us: wall time of tick 0 [µs since 1970].
        measurement: of this tick.
        pulses: [µs] by output channel.
        throttle: commanded, 0 to 1.
        used: charge taken from the battery [A·h].
        motors: rotation speeds [rpm] by motor number.
        late: by how much its time stamps are too late [s].
        booted: when the flight computer was switched on [s after the recording began].
        status: of the flight computer.
    """

    tick: int
    epoch_us: int
    measurement: Measurement
    pulses: Mapping[int, int] = field(default_factory=dict)
    throttle: float = 0.0
    used: float = 0.0
    motors: Mapping[int, float] = field(default_factory=dict)
    late: float = 0.0
    booted: float = -BOOT_BEFORE_RECORDING
    status: Status = field(default_factory=Status)

    @property
    def boot_us(self) -> int:
        """Time since boot [µs], as stamped."""
        return round((self.late - self.booted) * 1e6) + self.tick * TICK_US

    @property
    def boot_ms(self) -> int:
        """Time since boot [ms]."""
        return self.boot_us // 1000

    @property
    def unix_us(self) -> int:
        """Wall time [µs since 1970], as stamped."""
        return self.epoch_us + round(self.late * 1e6) + self.tick * TICK_US

    def told_late(self, late: float) -> Snapshot:
        """The same, told and stamped this much too late [s]."""
        return replace(self, late=late) if late else self


def untold(aircraft: Aircraft) -> frozenset[str]:
    """Messages that an aircraft without vanes, or without motors that tell their speed, lacks."""
    vanes = () if aircraft.vanes is not None else ("AOA_SSA",)
    speeds = any(thruster.rpm_channel is not None for thruster in aircraft.propulsion)
    return frozenset(vanes if speeds else (*vanes, "RPM", "ESC_TELEMETRY_1_TO_4"))


def current(throttle: float) -> float:
    """Battery current at a throttle setting [A]."""
    return 0.6 + _FULL_CURRENT * throttle**2


def parameters(aircraft: Aircraft) -> list[Message]:
    """What a ground station downloads on connection: the parameters that describe the outputs."""
    values = output_parameters(aircraft)
    return [
        mavlink.MAVLink_param_value_message(
            name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32, len(values), index
        )
        for index, (name, value) in enumerate(values.items())
    ]


def output_parameters(aircraft: Aircraft) -> dict[str, float]:
    """Parameters that describe the outputs, by ArduPlane's names."""
    values: dict[str, float] = {"SYSID_THISMAV": 1.0, "ARSPD_USE": 1.0}
    for servo in aircraft.servos:
        word = servo.surface.split("_", maxsplit=1)[0]
        values |= _output_parameters(
            servo.channel, servo.pwm, _SERVO_FUNCTIONS.get(word, 0), float(neutral(servo))
        )
    for thruster in aircraft.propulsion:
        channel, pwm = thruster.throttle_channel, thruster.pwm
        values |= _output_parameters(channel, pwm, _THROTTLE_FUNCTION, pwm[0])
    return values


def text(content: str) -> Message:
    """A status text; what does not fit into one message is cut."""
    return mavlink.MAVLink_statustext_message(
        mavlink.MAV_SEVERITY_INFO, content.encode("ascii", "replace")[:50]
    )


def _output_parameters(
    channel: int, pwm: tuple[float, ...], function: int, trim: float
) -> dict[str, float]:
    return {
        f"SERVO{channel}_FUNCTION": float(function),
        f"SERVO{channel}_MIN": float(min(pwm)),
        f"SERVO{channel}_MAX": float(max(pwm)),
        f"SERVO{channel}_TRIM": float(round(trim)),
        f"SERVO{channel}_REVERSED": 0.0,
    }


def _heartbeat(snapshot: Snapshot) -> Message:
    mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    if snapshot.status.armed:
        mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    if snapshot.status.mode >= AUTO_MODE:
        mode |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
    if snapshot.status.mode == MANUAL_MODE:
        mode ^= mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_FIXED_WING,
        mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
        mode,
        snapshot.status.mode,
        mavlink.MAV_STATE_ACTIVE,
        3,
    )


def _system_time(snapshot: Snapshot) -> Message:
    return mavlink.MAVLink_system_time_message(snapshot.unix_us, snapshot.boot_ms)


def _attitude(snapshot: Snapshot) -> Message:
    roll, pitch, yaw = snapshot.measurement.attitude
    return mavlink.MAVLink_attitude_message(
        snapshot.boot_ms,
        roll,
        pitch,
        math.remainder(yaw, 2.0 * math.pi),
        *snapshot.measurement.rates,
    )


def _raw_imu(snapshot: Snapshot) -> Message:
    measurement = snapshot.measurement
    acceleration = [int16(f / GRAVITY * 1e3) for f in measurement.specific_force]
    rates = [int16(rate * 1e3) for rate in measurement.rates]
    return mavlink.MAVLink_raw_imu_message(
        snapshot.boot_us, *acceleration, *rates, 0, 0, 0, 0, 4500
    )


def _servo_output_raw(snapshot: Snapshot) -> Message:
    pulses = [snapshot.pulses.get(channel, 0) for channel in range(1, 17)]
    # Its time is 32 bit and wraps after 71 minutes.
    return mavlink.MAVLink_servo_output_raw_message(snapshot.boot_us % 2**32, 0, *pulses)


def _vfr_hud(snapshot: Snapshot) -> Message:
    measurement = snapshot.measurement
    north, east, down = measurement.velocity
    return mavlink.MAVLink_vfr_hud_message(
        measurement.indicated_airspeed,
        math.hypot(north, east),
        int(math.degrees(measurement.attitude[2])) % 360,
        round(100.0 * snapshot.throttle),
        measurement.altitude,
        -down,
    )


def _scaled_pressure(snapshot: Snapshot) -> Message:
    measurement = snapshot.measurement
    celsius = round((measurement.temperature - 273.15) * 100.0)
    return mavlink.MAVLink_scaled_pressure_message(
        snapshot.boot_ms,
        measurement.static_pressure / 100.0,
        measurement.dynamic_pressure / 100.0,
        celsius,
        celsius,
    )


def _aoa_ssa(snapshot: Snapshot) -> Message:
    measurement = snapshot.measurement
    return mavlink.MAVLink_aoa_ssa_message(
        snapshot.boot_us, math.degrees(measurement.alpha), math.degrees(measurement.beta)
    )


def _global_position_int(snapshot: Snapshot) -> Message:
    measurement = snapshot.measurement
    return mavlink.MAVLink_global_position_int_message(
        snapshot.boot_ms,
        round(math.degrees(measurement.latitude) * 1e7),
        round(math.degrees(measurement.longitude) * 1e7),
        round(measurement.altitude * 1e3),
        round(measurement.height * 1e3),
        *(int16(v * 1e2) for v in measurement.velocity),
        round(math.degrees(measurement.attitude[2]) * 1e2) % 36000,
    )


def _battery_status(snapshot: Snapshot) -> Message:
    left = 1.0 - snapshot.used / _CAPACITY_AH
    cell = _EMPTY_CELL + (_FULL_CELL - _EMPTY_CELL) * left - 0.008 * current(snapshot.throttle)
    voltages = [round(cell * 1e3)] * _CELLS + [65535] * (10 - _CELLS)
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        2800,
        voltages,
        round(current(snapshot.throttle) * 1e2),
        round(snapshot.used * 1e3),
        -1,
        max(0, round(100.0 * left)),
    )


def _esc_telemetry_1_to_4(snapshot: Snapshot) -> Message:
    battery: Received = _battery_status(snapshot)
    running = [number in snapshot.motors for number in range(1, 5)]
    volts = sum(battery.voltages[:_CELLS]) // 10
    return mavlink.MAVLink_esc_telemetry_1_to_4_message(
        [40 * told for told in running],
        [volts * told for told in running],
        [battery.current_battery * told for told in running],
        [battery.current_consumed * told for told in running],
        [round(snapshot.motors.get(number, 0.0)) for number in range(1, 5)],
        # A count of nought says that nothing was ever heard of a motor.
        [(1 + snapshot.tick) % 65536 * told for told in running],
    )


BUILDERS: Mapping[str, Callable[[Snapshot], Message]] = {
    "SYSTEM_TIME": _system_time,
    "HEARTBEAT": _heartbeat,
    "BATTERY_STATUS": _battery_status,
    "ATTITUDE": _attitude,
    "RAW_IMU": _raw_imu,
    "SERVO_OUTPUT_RAW": _servo_output_raw,
    "VFR_HUD": _vfr_hud,
    "SCALED_PRESSURE": _scaled_pressure,
    "AOA_SSA": _aoa_ssa,
    "GLOBAL_POSITION_INT": _global_position_int,
    "ESC_TELEMETRY_1_TO_4": _esc_telemetry_1_to_4,
}


def int16(value: float) -> int:
    """Rounded, and kept in the range of a 16 bit field."""
    return min(max(round(value), -32768), 32767)
