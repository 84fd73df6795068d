"""What a ground station may tell a live vehicle, and what it answers.

References:
    MAVLink command protocol, https://mavlink.io/en/services/command.html; which messages an
    ArduPlane handles: GCS_Mavlink.cpp and GCS_Common.cpp of ArduPilot 4.6.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_sysid.sitl import status, telemetry
from gcs_sysid.sitl.computer import ATTITUDE_TIMEOUT, AttitudeTarget, Computer
from gcs_sysid.sitl.link import COMPONENT, SYSTEM
from gcs_sysid.sitl.mission import Item
from gcs_sysid.sitl.modes import IGNORE, PITCH, POWER, ROLL, YAW, Mode, mode
from gcs_sysid.sitl.telemetry import Message, Received, Snapshot

FORCE = 21196.0
"""Second parameter of the command that arms and disarms whatever the checks say."""

_ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
_DENIED = mavlink.MAV_RESULT_DENIED
_UNSUPPORTED = mavlink.MAV_RESULT_UNSUPPORTED
_LATER = mavlink.MAV_RESULT_TEMPORARILY_REJECTED

_UNUSED = 32767
"""Value of an axis of MANUAL_CONTROL that says nothing."""

_MODES_BY_COMMAND = {
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: Mode.RTL,
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: Mode.LOITER,
    mavlink.MAV_CMD_MISSION_START: Mode.AUTO,
}


@dataclass(frozen=True)
class Command:
    """A COMMAND_LONG or COMMAND_INT: its number, parameters, and position [deg, deg, m]."""

    number: int
    parameters: tuple[float, float, float, float]
    latitude_deg: float
    longitude_deg: float
    height: float
    frame: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT


@dataclass(frozen=True)
class Now:
    """What the vehicle is at when a message comes in: its time [s], and its newest snapshot."""

    time: float
    snapshot: Snapshot


def receive(computer: Computer, message: Received, now: Now) -> Iterable[Message]:
    """Do what a message asks for, and answer it; nothing where it is for somebody else."""
    if getattr(message, "target_system", SYSTEM) not in (0, SYSTEM):
        return []
    if getattr(message, "target", SYSTEM) != SYSTEM:
        return []
    if getattr(message, "target_component", COMPONENT) not in (0, COMPONENT):
        return []
    sender = (message.get_srcSystem(), message.get_srcComponent())
    kind = message.get_type()
    if kind.startswith("MISSION_"):
        return computer.mission.receive(message, sender, now.time)
    if kind.startswith("PARAM_"):
        return computer.parameters.receive(message)
    match kind:
        case "COMMAND_LONG" | "COMMAND_INT":
            return _command(computer, _parsed(message), sender, now)
        case "SET_MODE":
            _set_mode(computer, message.custom_mode)
        case "REQUEST_DATA_STREAM":
            rate = message.req_message_rate if message.start_stop else 0
            computer.streams.set_group(message.req_stream_id, float(rate))
        case "RC_CHANNELS_OVERRIDE":
            pulses = {i: getattr(message, f"chan{i}_raw") for i in range(1, 9)}
            computer.sticks = computer.sticks.override(pulses, now.time)
        case "MANUAL_CONTROL":
            computer.sticks = computer.sticks.override(_stick_pulses(message), now.time)
        case "SET_ATTITUDE_TARGET":
            _attitude_target(computer, message, now.time)
        case "SET_POSITION_TARGET_GLOBAL_INT":
            _position_target(computer, message)
        case "TIMESYNC" if message.tc1 == 0:
            boot_ns = now.snapshot.boot_us * 1000
            return [mavlink.MAVLink_timesync_message(boot_ns, message.ts1)]
        case "PING" if message.target_system == 0:
            return [mavlink.MAVLink_ping_message(message.time_usec, message.seq, *sender)]
        case "AUTOPILOT_VERSION_REQUEST":
            return [status.BUILDERS["AUTOPILOT_VERSION"](now.snapshot)]
    return []


def _command(
    computer: Computer, command: Command, sender: tuple[int, int], now: Now
) -> Iterable[Message]:
    result, more = _obey(computer, command, now)
    return [mavlink.MAVLink_command_ack_message(command.number, result, 0, 0, *sender), *more]


def _obey(computer: Computer, command: Command, now: Now) -> tuple[int, list[Message]]:
    first, second = command.parameters[:2]
    match command.number:
        case mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            return _arm(computer, wanted=first == 1.0, force=second == FORCE)
        case mavlink.MAV_CMD_DO_SET_MODE:
            return (_ACCEPTED if _set_mode(computer, round(second)) else _UNSUPPORTED), []
        case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            known = computer.streams.set_interval(_name(first), second)
            return (_ACCEPTED if known else _DENIED), []
        case mavlink.MAV_CMD_GET_MESSAGE_INTERVAL:
            interval = computer.streams.interval(_name(first)) or -1
            return _ACCEPTED, [mavlink.MAVLink_message_interval_message(round(first), interval)]
        case mavlink.MAV_CMD_REQUEST_MESSAGE:
            return _tell(_name(first), now)
        case mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
            return _tell("AUTOPILOT_VERSION", now)
        case mavlink.MAV_CMD_DO_CHANGE_SPEED:
            return _change_speed(computer, second)
        case mavlink.MAV_CMD_DO_REPOSITION:
            return _reposition(computer, command)
        case mavlink.MAV_CMD_DO_SET_MISSION_CURRENT:
            return (_ACCEPTED if computer.mission.select(round(first)) else _DENIED), []
        case mavlink.MAV_CMD_NAV_TAKEOFF:
            return _LATER, [telemetry.text("Already flying")]
    if command.number in _MODES_BY_COMMAND:
        computer.change_mode(_MODES_BY_COMMAND[command.number])
        return _ACCEPTED, []
    return _UNSUPPORTED, []


def _arm(computer: Computer, *, wanted: bool, force: bool) -> tuple[int, list[Message]]:
    if wanted == computer.armed:
        return _ACCEPTED, []
    if not wanted and not force:
        # It is always in the air.
        return mavlink.MAV_RESULT_FAILED, [telemetry.text("Disarm: vehicle is flying")]
    computer.armed = wanted
    return _ACCEPTED, [telemetry.text("Throttle armed" if wanted else "Throttle disarmed")]


def _set_mode(computer: Computer, number: int) -> bool:
    wanted = mode(number)
    if wanted is None:
        return False
    computer.change_mode(wanted)
    return True


def _change_speed(computer: Computer, airspeed: float) -> tuple[int, list[Message]]:
    low, high = computer.parameters["AIRSPEED_MIN"], computer.parameters["AIRSPEED_MAX"]
    if not low <= airspeed <= high:
        return _DENIED, [telemetry.text(f"Airspeed: {low:.0f} to {high:.0f} m/s")]
    computer.airspeed = airspeed
    return _ACCEPTED, []


def _reposition(computer: Computer, command: Command) -> tuple[int, list[Message]]:
    if not all(map(math.isfinite, (command.latitude_deg, command.longitude_deg, command.height))):
        return _DENIED, []
    computer.change_mode(Mode.GUIDED)
    item = Item(
        command.number,
        command.parameters,
        command.latitude_deg,
        command.longitude_deg,
        command.height,
        command.frame,
    )
    computer.target = computer.place_of(item)
    return _ACCEPTED, []


def _tell(name: str, now: Now) -> tuple[int, list[Message]]:
    builder = status.BUILDERS.get(name)
    return (_ACCEPTED, [builder(now.snapshot)]) if builder else (_UNSUPPORTED, [])


def _attitude_target(computer: Computer, message: Received, time: float) -> None:
    if computer.mode != Mode.GUIDED or message.type_mask & 0b1000_0000:
        return
    w, x, y, z = message.q
    throttle = None if message.type_mask & 0b0100_0000 else min(max(message.thrust, 0.0), 1.0)
    computer.attitude = AttitudeTarget(
        theta=math.asin(min(max(2.0 * (w * y - x * z), -1.0), 1.0)),
        bank=math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        throttle=throttle,
        until=time + ATTITUDE_TIMEOUT,
    )


def _position_target(computer: Computer, message: Received) -> None:
    if computer.mode != Mode.GUIDED:
        return
    item = Item(
        0,
        (0.0, 0.0, 0.0, 0.0),
        message.lat_int * 1e-7,
        message.lon_int * 1e-7,
        message.alt,
        message.coordinate_frame,
    )
    wanted = computer.place_of(item)
    if message.type_mask & 0b011:
        wanted = replace(computer.target, height=wanted.height)
    if message.type_mask & 0b100:
        wanted = replace(wanted, height=computer.target.height)
    computer.target, computer.attitude = wanted, None


def _stick_pulses(message: Received) -> dict[int, int]:
    """Forward is nose down, and the throttle runs from 0 to 1000."""
    axes = {
        ROLL: (message.y, 1500.0, 0.5),
        PITCH: (message.x, 1500.0, -0.5),
        POWER: (message.z, 1000.0, 1.0),
        YAW: (message.r, 1500.0, 0.5),
    }
    return {
        channel: IGNORE if value == _UNUSED else round(middle + gain * value)
        for channel, (value, middle, gain) in axes.items()
    }


def _parsed(message: Received) -> Command:
    parameters = (message.param1, message.param2, message.param3, message.param4)
    if message.get_type() == "COMMAND_INT":
        place = (message.x * 1e-7, message.y * 1e-7, message.z)
        return Command(message.command, parameters, *place, frame=message.frame)
    return Command(message.command, parameters, message.param5, message.param6, message.param7)


def _name(number: float) -> str:
    known = mavlink.mavlink_map.get(round(number))
    return known.msgname if known else ""
