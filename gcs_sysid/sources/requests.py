"""Asks a vehicle for the streams that it sends too slowly, one at a time, and minds its answers.

Nothing is asked for that comes fast enough already, and no rate is ever lowered. An answer to
SET_MESSAGE_INTERVAL does not say which message it is about, so one request waits for its answer
before the next is sent. A vehicle that does not know the command, or never answers it, is asked
once with REQUEST_DATA_STREAM, group by group; a stream that it refuses is left as it is, and told.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from pymavlink.dialects.v20 import all as dialect

from gcs_sysid.recording import Vehicle
from gcs_sysid.sources.layouts import sizes
from gcs_sysid.sources.rates import Rates
from gcs_sysid.sources.sender import COMPONENT, SYSTEM, Sender
from gcs_sysid.sources.tables import MessageTable, TableKey

ANSWER_S = 1.0
"""An answer takes less than this, or is lost."""
TRIES = 3
LOOK_S = 8.0
"""So long after a request was granted the rate must have come up."""
ROUNDS = 3
"""A vehicle that grants a request and does not follow it is asked so many times."""
LATER_S = 5.0
"""A vehicle that is busy (temporarily rejected) is asked again after this."""
ENOUGH = 0.8
"""Share of the wanted rate with which a stream is left alone."""
SILENT_S = 5.0
"""After so long a silence the vehicle may have restarted: its answers count no longer."""
HEARTBEAT_S = 1.0
_FRAME = 12
"""Bytes of a frame around its payload."""
_RADIO_SHARE = 0.7
"""Share of a serial line that telemetry may fill; the rest is for others and for bursts."""

_IMU: Mapping[str, str] = {"MAV_AUTOPILOT_PX4": "HIGHRES_IMU"}
_GROUPS: Mapping[str, int] = {
    "RAW_IMU": dialect.MAV_DATA_STREAM_RAW_SENSORS,
    "HIGHRES_IMU": dialect.MAV_DATA_STREAM_RAW_SENSORS,
    "SCALED_PRESSURE": dialect.MAV_DATA_STREAM_RAW_SENSORS,
    "SERVO_OUTPUT_RAW": dialect.MAV_DATA_STREAM_RC_CHANNELS,
    "GLOBAL_POSITION_INT": dialect.MAV_DATA_STREAM_POSITION,
    "ATTITUDE": dialect.MAV_DATA_STREAM_EXTRA1,
    "AOA_SSA": dialect.MAV_DATA_STREAM_EXTRA1,
    "VFR_HUD": dialect.MAV_DATA_STREAM_EXTRA2,
    "SYSTEM_TIME": dialect.MAV_DATA_STREAM_EXTRA3,
    "RPM": dialect.MAV_DATA_STREAM_EXTRA3,
    "ESC_TELEMETRY_1_TO_4": dialect.MAV_DATA_STREAM_EXTRA3,
}
_NUMBERS: Mapping[str, int] = {
    kind.msgname: number for number, kind in dialect.mavlink_map.items() if kind.msgname in _GROUPS
}

Answer = Literal["enough", "asked", "granted", "refused", "unanswered", "too slow"]


@dataclass(frozen=True)
class Needs:
    """Which streams a flight is reconstructed from.

    Attributes:
        vanes: whether the aircraft has some.
        motor_speeds: whether thrust is known by rotation speed.
        bytes_per_second: what the link carries; None where that is not known.
    """

    vanes: bool = False
    motor_speeds: bool = False
    bytes_per_second: float | None = None

    def rates(self, autopilot: str) -> dict[str, float]:
        """Rates [Hz] to ask for by message type, lower where the link is narrow."""
        wanted = {
            "SYSTEM_TIME": 1.0,
            _IMU.get(autopilot, "RAW_IMU"): 50.0,
            "SERVO_OUTPUT_RAW": 50.0,
            "ATTITUDE": 25.0,
            "VFR_HUD": 25.0,
            "GLOBAL_POSITION_INT": 10.0,
            "SCALED_PRESSURE": 10.0,
        }
        if self.vanes:
            wanted["AOA_SSA"] = 25.0
        if self.motor_speeds:
            wanted |= {"RPM": 10.0, "ESC_TELEMETRY_1_TO_4": 10.0}
        if self.bytes_per_second is None:
            return wanted
        needed = sum((_FRAME + sizes()[_NUMBERS[name]]) * hz for name, hz in wanted.items())
        share = min(_RADIO_SHARE * self.bytes_per_second / needed, 1.0)
        return {name: max(hz * share, 1.0) for name, hz in wanted.items()}


@dataclass
class _Stream:
    wanted: float
    answer: Answer | None = None
    rounds: int = 0
    look_at: float = 0.0


class Requests:
    """What to send to one vehicle, and when.

    Args:
        sender: makes the frames.
        needs: streams to ask for.
    """

    def __init__(self, sender: Sender, needs: Needs) -> None:
        self._sender = sender
        self._needs = needs
        self._rates = Rates()
        self._beat: float | None = None
        self._vehicle: Vehicle | None = None
        self._heard = 0.0
        self._streams: dict[str, _Stream] = {}
        self._pending: tuple[str, float, int] | None = None
        self._by_group = False
        self._answers = 0

    def heard(
        self,
        vehicle: Vehicle | None,
        tables: Mapping[TableKey, MessageTable],
        now: float,
    ) -> None:
        """Takes note of what arrived at a time [s]."""
        if vehicle is None:
            return
        if self._vehicle is None:
            self._vehicle = vehicle
            rates = self._needs.rates(vehicle.autopilot)
            self._streams = {name: _Stream(hz) for name, hz in rates.items()}
        own = {
            key.name: table
            for key, table in tables.items()
            if key[:2] == (vehicle.system, vehicle.component)
        }
        self._rates.add({name: table.count for name, table in own.items()}, now)
        if own:
            self._heard = now
        if "COMMAND_ACK" in own:
            self._answered(own["COMMAND_ACK"], now)

    def due(self, now: float) -> list[bytes]:
        """Frames to send at a time [s], which does not fall."""
        frames = []
        if self._beat is None or now - self._beat >= HEARTBEAT_S:
            self._beat = now
            frames.append(self._sender.heartbeat())
        if self._vehicle is not None and now - self._heard > SILENT_S:
            self._begin_again()
        if self._vehicle is None or not self._rates.settled(now):
            return frames
        if self._pending is not None:
            return frames + self._again(now)
        for name, stream in self._streams.items():
            enough = self._rates.rate(name, now) >= ENOUGH * stream.wanted
            if enough:
                stream.answer = "enough"
            elif self._to_ask(stream, now):
                return [*frames, self._ask(name, now)]
        return frames

    def told(self, now: float) -> dict[str, dict[str, object]]:
        """By stream: wanted and measured rate [Hz], and what the vehicle answered."""
        return {
            name: {
                "wanted_hz": round(stream.wanted, 1),
                "rate_hz": round(self._rates.rate(name, now), 1),
                "answer": stream.answer,
            }
            for name, stream in self._streams.items()
        }

    def _begin_again(self) -> None:
        self._rates.clear()
        self._pending, self._by_group = None, False
        for name, stream in self._streams.items():
            self._streams[name] = _Stream(stream.wanted)

    def _to_ask(self, stream: _Stream, now: float) -> bool:
        if stream.answer in ("refused", "too slow") or now < stream.look_at:
            return False
        if stream.answer == "enough":
            # It came fast enough once and does not any more: somebody changed it, or the vehicle
            # restarted.
            stream.rounds = 0
        if stream.rounds >= ROUNDS:
            if stream.answer != "unanswered":
                stream.answer = "too slow"
            return False
        return True

    def _ask(self, name: str, now: float) -> bytes:
        stream = self._streams[name]
        stream.answer = "asked"
        stream.rounds += 1
        if self._by_group:
            return self._ask_group(name, now)
        self._pending = (name, now, 1)
        return self._request(name, 0)

    def _request(self, name: str, again: int) -> bytes:
        return self._sender.interval(
            self._address(), _NUMBERS[name], self._streams[name].wanted, again
        )

    def _ask_group(self, name: str, now: float) -> bytes:
        """Asks for the whole group of a stream, as fast as the fastest that is wanted of it."""
        group = _GROUPS[name]
        mine = [s for other, s in self._streams.items() if _GROUPS[other] == group]
        for stream in mine:
            stream.answer, stream.look_at = "asked", now + LOOK_S
            stream.rounds = ROUNDS
        return self._sender.group(self._address(), group, max(s.wanted for s in mine))

    def _again(self, now: float) -> list[bytes]:
        """Repeats a request whose answer is overdue; after the last try goes over to groups."""
        if self._pending is None:
            return []
        name, asked, tries = self._pending
        if now - asked < ANSWER_S:
            return []
        if tries < TRIES:
            self._pending = (name, now, tries + 1)
            return [self._request(name, tries)]
        self._pending = None
        if self._answers:
            stream = self._streams[name]
            stream.answer, stream.look_at = "unanswered", now + LATER_S
            return []
        self._by_group = True
        return [self._ask_group(name, now)]

    def _answered(self, table: MessageTable, now: float) -> None:
        fields = table.fields
        for row in range(table.count):
            target = int(fields["target_system"][row]), int(fields["target_component"][row])
            ours = target[0] in (0, SYSTEM) and target[1] in (0, COMPONENT)
            mine = int(fields["command"][row]) == dialect.MAV_CMD_SET_MESSAGE_INTERVAL
            if ours and mine and self._pending is not None:
                self._judge(int(fields["result"][row]), now)

    def _judge(self, result: int, now: float) -> None:
        if self._pending is None:
            return
        name, _, _ = self._pending
        self._answers += 1
        stream = self._streams[name]
        self._pending = None
        if result in (dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_IN_PROGRESS):
            stream.answer, stream.look_at = "granted", now + LOOK_S
        elif result == dialect.MAV_RESULT_TEMPORARILY_REJECTED:
            stream.look_at = now + LATER_S
        elif result == dialect.MAV_RESULT_UNSUPPORTED:
            # The command itself is not known: autopilots of before 2018.
            self._by_group = True
            stream.rounds, stream.answer = 0, None
        else:
            stream.answer = "refused"

    def _address(self) -> tuple[int, int]:
        if self._vehicle is None:
            raise ValueError("nobody is there to ask; call `heard` first")
        return self._vehicle.system, self._vehicle.component
