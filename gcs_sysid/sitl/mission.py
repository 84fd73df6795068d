"""The mission on board: how it is loaded and read over MAVLink, and which item is flown.

References:
    MAVLink mission protocol, https://mavlink.io/en/services/mission.html.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_sysid.sitl.telemetry import Message, Received

REPEAT_AFTER = 0.7
"""How long to wait for an item before it is asked for again [s]."""

PATIENCE = 8.0
"""How long to wait for an item before an upload is given up [s]."""


@dataclass(frozen=True)
class Item:
    """One mission item: command, its four parameters, and a position [deg, deg, m]."""

    command: int
    parameters: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    latitude_deg: float = 0.0
    longitude_deg: float = 0.0
    height: float = 0.0
    frame: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT


@dataclass
class _Upload:
    count: int
    sender: tuple[int, int]
    items: list[Item]
    asked: float
    begun: float


class Mission:
    """The stored mission and what is being loaded; the first item is home, as ArduPilot has it."""

    def __init__(self, home: Item) -> None:
        self.items: tuple[Item, ...] = (home,)
        self.current = 0
        self.version = 0
        """Counts uploads."""
        self._upload: _Upload | None = None

    def select(self, number: int) -> bool:
        """Fly an item next; False if there is none of that number."""
        known = 0 <= number < len(self.items)
        self.current = number if known else self.current
        return known

    def receive(self, message: Received, sender: tuple[int, int], time: float) -> Iterable[Message]:
        """Answer a message of the mission protocol, received at `time` [s]."""
        kind = message.get_type()
        other = getattr(message, "mission_type", mavlink.MAV_MISSION_TYPE_MISSION)
        if other != mavlink.MAV_MISSION_TYPE_MISSION:
            return _nothing_of(kind, sender, other)
        match kind:
            case "MISSION_REQUEST_LIST":
                return [mavlink.MAVLink_mission_count_message(*sender, len(self.items))]
            case "MISSION_REQUEST_INT" | "MISSION_REQUEST":
                return self._item(kind, sender, message.seq)
            case "MISSION_COUNT":
                return self._begin(message.count, sender, time)
            case "MISSION_ITEM_INT" | "MISSION_ITEM":
                return self._take(message, sender, time)
            case "MISSION_CLEAR_ALL":
                self._replace(self.items[:1])
                return [_ack(sender, mavlink.MAV_MISSION_ACCEPTED)]
            case "MISSION_SET_CURRENT":
                self.select(message.seq)
                return [mavlink.MAVLink_mission_current_message(self.current)]
        return []

    def remind(self, time: float) -> Iterable[Message]:
        """Ask again for an item that did not come; call now and then."""
        upload = self._upload
        if upload is None or time - upload.asked < REPEAT_AFTER:
            return []
        if time - upload.begun > PATIENCE:
            self._upload = None
            return [_ack(upload.sender, mavlink.MAV_MISSION_OPERATION_CANCELLED)]
        upload.asked = time
        return [_ask(upload)]

    def _item(self, kind: str, sender: tuple[int, int], number: int) -> Sequence[Message]:
        if not 0 <= number < len(self.items):
            return [_ack(sender, mavlink.MAV_MISSION_INVALID_SEQUENCE)]
        item = self.items[number]
        head = (*sender, number, item.frame, item.command, int(number == self.current), 1)
        if kind == "MISSION_REQUEST":
            place = (item.latitude_deg, item.longitude_deg, item.height)
            return [mavlink.MAVLink_mission_item_message(*head, *item.parameters, *place)]
        fine = (round(item.latitude_deg * 1e7), round(item.longitude_deg * 1e7), item.height)
        return [mavlink.MAVLink_mission_item_int_message(*head, *item.parameters, *fine)]

    def _begin(self, count: int, sender: tuple[int, int], time: float) -> Sequence[Message]:
        if count == 0:
            self._replace(self.items[:1])
            return [_ack(sender, mavlink.MAV_MISSION_ACCEPTED)]
        self._upload = _Upload(count, sender, [], asked=time, begun=time)
        return [_ask(self._upload)]

    def _take(self, message: Received, sender: tuple[int, int], time: float) -> Sequence[Message]:
        upload = self._upload
        if upload is None or message.seq != len(upload.items):
            return []
        upload.items.append(item_of(message))
        upload.asked = upload.begun = time
        if len(upload.items) < upload.count:
            return [_ask(upload)]
        # The first item is home, and home is where the vehicle says it is.
        self._replace((self.items[0], *upload.items[1:]))
        self._upload = None
        return [_ack(sender, mavlink.MAV_MISSION_ACCEPTED)]

    def _replace(self, items: tuple[Item, ...]) -> None:
        self.items = items
        self.current = min(self.current, len(items) - 1)
        self.version += 1


def item_of(message: Received) -> Item:
    """The item that a MISSION_ITEM or MISSION_ITEM_INT holds."""
    scale = 1e-7 if message.get_type() == "MISSION_ITEM_INT" else 1.0
    return Item(
        message.command,
        (message.param1, message.param2, message.param3, message.param4),
        message.x * scale,
        message.y * scale,
        message.z,
        message.frame,
    )


def _ask(upload: _Upload) -> Message:
    return mavlink.MAVLink_mission_request_int_message(*upload.sender, len(upload.items))


def _ack(sender: tuple[int, int], result: int) -> Message:
    return mavlink.MAVLink_mission_ack_message(*sender, result)


def _nothing_of(kind: str, sender: tuple[int, int], mission_type: int) -> Sequence[Message]:
    """There is no fence and there are no rally points, and none can be loaded."""
    match kind:
        case "MISSION_REQUEST_LIST":
            return [mavlink.MAVLink_mission_count_message(*sender, 0, mission_type)]
        case "MISSION_COUNT" | "MISSION_CLEAR_ALL":
            empty = kind == "MISSION_CLEAR_ALL"
            result = mavlink.MAV_MISSION_ACCEPTED if empty else mavlink.MAV_MISSION_UNSUPPORTED
            return [mavlink.MAVLink_mission_ack_message(*sender, result, mission_type)]
    return []
